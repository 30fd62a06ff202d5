# SPDX-License-Identifier: MIT OR Apache-2.0
"""The description in JSON: it follows its schema, and says the same as the module that is generated beside it."""

import json
import re
import unittest
from pathlib import Path

import horus_profile
from horus_profile import MAPS, MAPS_WITH_HOLD, Object, objects

FOLDER = Path(horus_profile.__file__).parent
LAYOUT = json.loads((FOLDER / "layout.json").read_text())
SCHEMA = json.loads((FOLDER / "layout.schema.json").read_text())
TYPES = {"object": dict, "array": list, "string": str, "boolean": bool, "integer": int, "number": (int, float)}
KNOWN = {
    "$defs", "$schema", "$ref", "additionalProperties", "description", "enum", "items", "minimum", "pattern",
    "properties", "required", "title", "type",
}


def errors(schema, value, path="layout"):
    """What of `value` does not follow `schema`, which uses only the keywords in `KNOWN`."""
    assert schema.keys() <= KNOWN, schema.keys() - KNOWN
    if "$ref" in schema:
        yield from errors(SCHEMA["$defs"][schema["$ref"].rsplit("/", 1)[1]], value, path)
    kind = schema.get("type")
    if kind and (not isinstance(value, TYPES[kind]) or isinstance(value, bool) != (kind == "boolean")):
        yield f"{path} is no {kind}"
        return
    if "enum" in schema and value not in schema["enum"]:
        yield f"{path} is none of {schema['enum']}"
    if "pattern" in schema and not re.search(schema["pattern"], value):
        yield f"{path} is {value!r}"
    if "minimum" in schema and value < schema["minimum"]:
        yield f"{path} is below {schema['minimum']}"
    if isinstance(value, list):
        for index, item in enumerate(value):
            yield from errors(schema.get("items", {}), item, f"{path}[{index}]")
    if isinstance(value, dict):
        for name in schema.get("required", ()):
            if name not in value:
                yield f"{path} has no {name}"
        for name, item in value.items():
            inner = schema.get("properties", {}).get(name, schema.get("additionalProperties", {}))
            if inner is False:
                yield f"{path} has {name}"
            else:
                yield from errors(inner, item, f"{path}.{name}")


class Description(unittest.TestCase):
    def test_it_follows_its_schema(self):
        self.assertEqual(list(errors(SCHEMA, LAYOUT)), [])

    def test_the_schema_refuses_what_is_missing_misspelt_or_malformed(self):
        for change in (
            lambda layout: layout.pop("crcs"),
            lambda layout: layout.update(wires=1),
            lambda layout: layout["objects"][0]["fields"][0].update(type="u8"),
            lambda layout: layout["maps"][0].update(receivers=4),
            lambda layout: layout["crcs"]["frame"].update(check="12D3A0B1"),
        ):
            layout = json.loads(json.dumps(LAYOUT))
            change(layout)
            self.assertEqual(len(list(errors(SCHEMA, layout))), 1)

    def test_fields_fill_each_object(self):
        for item in LAYOUT["objects"]:
            end = 0
            for field in item["fields"]:
                self.assertEqual(field["offset"], end, f"{item['name']}.{field['name']}")
                end += field["bytes"]
            self.assertEqual(end, item["bytes"])

    def test_it_describes_the_classes_of_the_module(self):
        kinds = {kind.IDENTIFIERS: kind for kind in Object.__subclasses__()}
        described = {tuple(item["identifiers"]): item for item in LAYOUT["objects"] if item["identifiers"]}
        self.assertEqual(kinds.keys(), described.keys())
        for identifiers, kind in kinds.items():
            item = described[identifiers]
            self.assertEqual(kind.SIZE, item["bytes"])
            names = [(field.name, field.unit) for field in kind.FIELDS]
            self.assertEqual(names, [(field["name"], field.get("unit", "")) for field in item["fields"]])
            covers = [(name, start, end) for name, _, start, end in kind.CRCS]
            self.assertEqual(covers, [(f["name"], *f["covers"]) for f in item["fields"] if "crc" in f])

    def test_it_describes_the_maps_of_the_module(self):
        for item in LAYOUT["maps"]:
            layout = (MAPS_WITH_HOLD if item["hold"] else MAPS)[item["receivers"]]
            self.assertEqual(layout.map_bytes, item["map_bytes"])
            places = [(place.identifier, place.offset, place.kind.SIZE) for place in layout.places]
            self.assertEqual(places, [(p["identifier"], p["offset"], p["bytes"]) for p in item["places"]])

    def test_every_bit_of_a_status_word_is_a_property(self):
        for word in LAYOUT["status_words"]:
            kind = getattr(objects, word["name"].title().replace("_", "") + "Bits")
            for bits in word["bits"]:
                name, mask = bits["name"], int(bits["mask"], 16)
                self.assertNotEqual(getattr(kind(mask), name), getattr(kind(0), name), f"{word['name']}.{name}")
                self.assertEqual(getattr(kind(0xFFFF & ~mask), name), getattr(kind(0), name))


if __name__ == "__main__":
    unittest.main()
