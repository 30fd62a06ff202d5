# SPDX-License-Identifier: MIT OR Apache-2.0
"""The dissector for Wireshark, in the real tshark: each object of the recorded transactions, in captures written here."""

import json
import math
import os
import random
import shutil
import struct
import subprocess
import tempfile
import unittest
from pathlib import Path

from horus_profile import Gps, HoldStatus, LinkStatus, PortStatus, Rejection, ReportedPosition, Uplink, read
from horus_profile.objects import Violation
from horus_profile.recording import Recording, _Rest
from horus_profile.tunnel import PLACES
from tests import missing
from tests.test_objects import GPS1, LINK, REPORTED
from tests.test_recording import FLIGHT
from tests.test_tapes import answers, objects
from tests.test_tunnel import frame

DISSECTOR = Path(__file__).parents[2] / "wireshark/horus.lua"
TSHARK = os.environ.get("TSHARK") or shutil.which("tshark")
NAMES = {
    LinkStatus: "link_status", ReportedPosition: "reported", Gps: "gps", PortStatus: "port_status", Uplink: "uplink",
    HoldStatus: "hold_status",
}
IMAGE = LINK + REPORTED + GPS1


def capture(datagrams):
    """A pcap file of UDP over IPv4; the datagrams have ports and bytes."""
    yield struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 101)
    for number, (port, data) in enumerate(datagrams):
        udp = struct.pack(">HHHH", 40_000, port, 8 + len(data), 0) + data
        addresses = bytes([10, 0, 0, 1, 10, 0, 0, 2])
        packet = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), number, 0, 64, 17, 0) + addresses + udp
        yield struct.pack("<IIII", number, 0, len(packet), len(packet)) + packet


def leaves(tree):
    """Each field below `tree` with its value."""
    for name, value in tree:
        if isinstance(value, list) and value and isinstance(value[0], tuple):
            yield from leaves(value)
        else:
            yield name, value


def expected(item):
    """What is to be shown of an object, by name."""
    values = {f"{name}.status": 1 for name, *_ in item.CRCS}
    for field in item.FIELDS:
        value = getattr(item, field.name)
        if field.name == "violations":
            values.update({f"violations.{kind.name.lower()}": value[kind] for kind in Violation})
        elif field.name == "acknowledged":
            names = [f"{who}.{what}" for who in ("base_station", "flight_controller") for what in ("number", "outcome")]
            values.update({f"acknowledged.{name}": part for name, part in zip(names, value)})
        elif isinstance(value, tuple):
            values.update({f"{field.name}.{axis}": part for axis, part in zip("xyz", value)})
        else:
            values[field.name] = value
    if item.BITS is not None:
        # `decode` drops bits without a meaning.
        values["status"] = int.from_bytes(item.raw[6:8], "little")
    for name, bits in vars(item.BITS or object).items():
        if isinstance(bits, property):
            mask = getattr(item.BITS, name.upper())
            values[f"status.{name}"] = (item.status & mask) // (mask & -mask)
    return values


def message_of(number):
    """A MAVLink message that is no TUNNEL."""
    return frame(0, bytes(9), message_id=number, extra=50)


class Dissected(unittest.TestCase):
    def setUp(self):
        if TSHARK is None:
            missing(self, "no tshark (apt-get install tshark)")

    def dissect(self, *datagrams, arguments=()):
        """The fields of each datagram, in order; None for one that is not of HORUS."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "written.pcap"
            path.write_bytes(b"".join(capture(datagrams)))
            # The preferences and plugins of whoever runs this are left aside.
            command = [TSHARK, "-X", f"lua_script:{DISSECTOR}", *arguments, "-n", "-r", str(path), "-T", "json", "-J", "horus"]
            run = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "HOME": folder})
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertNotIn("Lua", run.stderr)
        self.assertFalse("Lua Error" in run.stdout or "_ws.lua.error" in run.stdout, "an error of the dissector")
        packets = json.loads(run.stdout, object_pairs_hook=lambda pairs: pairs)
        layers = [dict(dict(packet)["_source"])["layers"] for packet in packets]
        return [list(leaves(dict(found)["horus"])) if "horus" in dict(found) else None for found in layers]

    def compare(self, shown, item):
        """Holds what is shown of an object against its values."""
        prefix = f"horus.{NAMES[type(item)]}."
        found = {name[len(prefix):]: value for name, value in shown if name.startswith(prefix)}
        values = expected(item)
        self.assertEqual(found.keys(), values.keys())
        for name, value in values.items():
            if isinstance(value, bytes):
                self.assertEqual(bytes.fromhex(found[name].replace(":", "")), value, name)
            elif isinstance(value, float):
                # tshark prints the digits of which it is sure: 6 of a single.
                close = math.isclose(float(found[name]), value, rel_tol=1e-5)
                self.assertTrue(close or math.isnan(value) and found[name] == "nan", (name, found[name], value))
            else:
                self.assertEqual(int(found[name], 0), value, name)

    def test_each_object_of_the_tapes_is_shown_field_by_field(self):
        known = {identifier for _, identifier in PLACES}
        found = [item for item in objects() if item.identifier in known]
        self.assertEqual({type(item) for item in found}, NAMES.keys())
        shown = self.dissect(*((14550, frame(0x8000 | item.identifier, item.raw)) for item in found))
        for fields, item in zip(shown, found):
            self.compare(fields, item)
            self.assertEqual(dict(fields)["horus.mavlink.checksum.status"], "1")
            self.assertNotIn("horus.crc_wrong", dict(fields))

    def test_each_image_of_the_tapes_is_shown_with_its_objects(self):
        images = {data[: layout.image_bytes] for layout, offset, data in answers()
                  if offset == 0 and len(data) >= layout.image_bytes}
        readings = [(data, read(data)) for data in sorted(images)]
        readings = [(data, reading) for data, reading in readings if isinstance(reading.link, LinkStatus)]
        self.assertGreater(len(readings), 10)
        for fields, (_, reading) in zip(self.dissect(*((14561, data) for data, _ in readings)), readings):
            self.compare(fields, reading.link)
            if isinstance(reading.reported, ReportedPosition):
                self.compare(fields, reading.reported)
            crcs = [value for name, value in fields if name == "horus.gps.crc.status"]
            vacant = reading.gps.count(Rejection.VACANT)
            self.assertEqual(crcs.count("1"), len(reading.gps) - vacant - reading.gps.count(Rejection.CRC))

    def test_a_recorded_flight_is_shown_as_it_was_recorded(self):
        recording = Recording(FLIGHT)
        with open(FLIGHT, "rb") as file:
            rests = [_Rest(message) for message in recording._messages(file, "flight")]
        carried = [(rest.numbers("<QBH"), rest.array(), rest.array())[2] for rest in rests]
        shown = self.dissect(*((14550 if data[0] == 0xFD else 14561, data) for data in carried))
        fields = [field for packet in shown for field in packet]
        arrivals = list(Recording(FLIGHT))
        for kind in (LinkStatus, ReportedPosition, Gps):
            of_kind = [arrival for arrival in arrivals if arrival.identifier in kind.IDENTIFIERS]
            statuses = [value for name, value in fields if name == f"horus.{NAMES[kind]}.crc.status"]
            self.assertEqual(statuses, [str(int(arrival.verdict == "new")) for arrival in of_kind])
        altitudes = [float(value) for name, value in fields if name == "horus.reported.altitude"]
        self.assertEqual(altitudes, [arrival.found.altitude for arrival in arrivals
                                     if isinstance(arrival.found, ReportedPosition)])

    def test_every_crc_that_is_wrong_is_told(self):
        def changed(data, at):
            data = bytearray(data)
            data[at] ^= 1
            return bytes(data)

        message = frame(0xC800, REPORTED)
        # Latitude, altitude, the position CRC, the frame CRC, and the checksum of MAVLink.
        datagrams = [changed(message, 15 + at) for at in (8, 28, 24, 60)] + [changed(message, -1)]
        for fields, right in zip(self.dissect(*((14550, data) for data in datagrams)), ("000", "100", "000", "100", "110")):
            shown = dict(fields)
            names = ("reported.position_crc", "reported.crc", "mavlink.checksum")
            self.assertEqual("".join(shown[f"horus.{name}.status"] for name in names), right)
            self.assertEqual(sum(name == "horus.crc_wrong" for name, _ in fields), right.count("0"))

    def test_what_stands_in_a_place_without_its_object_is_told(self):
        other = frame(0x8000 | 42, REPORTED)
        shown = self.dissect(
            (14561, LINK + REPORTED + bytes(60)), (14561, LINK + REPORTED + b"\xff" * 60),
            (14550, frame(0xC801, GPS1[:4] + b"\2" + GPS1[5:])), (14550, frame(0xC800, REPORTED) + other),
            (14550, frame(0xC800, REPORTED) + message_of(30)), (14550, frame(0xC800, REPORTED) + other[:-1]),
            (14550, frame(0xC300, bytes(64))),
        )
        told = [[name[6:] for name, _ in fields if name.count(".") == 1] for fields in shown]
        self.assertEqual(told, [["vacant"], ["vacant"], ["crc_wrong", "other_object"], ["no_objects"], [], ["cut_off"],
                                ["no_objects"]])
        self.assertNotIn("horus.gps.crc", dict(shown[0]))

    def test_signed_and_shortened_messages_of_one_datagram_are_all_shown(self):
        data = frame(0xC801, GPS1, signed=True) + frame(0xC800, bytes(64)) + frame(0xC400, LINK, sequence=9)
        (fields,) = self.dissect((5000, data))
        self.assertEqual([value for name, value in fields if name == "horus.mavlink.signed"], ["1", "0", "0"])
        self.assertIn(("horus.mavlink.signature.link", str(0xFD)), fields)
        self.assertIn(("horus.vacant", ""), fields)
        self.assertEqual([value for name, value in fields if name == "horus.mavlink.sequence"], ["0", "0", "9"])

    def test_another_protocol_is_left_alone_unless_the_port_is_named(self):
        datagrams = [(14550, message_of(0)), (14561, IMAGE[1:]), (14561, b"\x55" * len(IMAGE))]
        self.assertEqual(self.dissect(*datagrams), [None] * 3)
        ports = ["-d", "udp.port==14550,horus", "-d", "udp.port==14561,horus"]
        heartbeat, shorter, damaged = self.dissect(*datagrams, arguments=ports)
        self.assertIn(("horus.mavlink.message", "0"), heartbeat)
        self.assertIsNone(shorter)
        self.assertEqual([value for name, value in damaged if name.endswith("crc.status")], ["0"] * 4)

    def test_no_datagram_makes_the_dissector_fail(self):
        drawn = random.Random(1)
        datagrams = []
        for _ in range(1_000):
            data = bytearray(drawn.choice([frame(0xC400, LINK + REPORTED), frame(0xC801, GPS1, signed=True), IMAGE]))
            for _ in range(drawn.randint(0, 3)):
                data[drawn.randrange(len(data))] = drawn.randrange(256)
            datagrams.append((14550, bytes(data[: drawn.choice([len(data), drawn.randint(1, len(data))])])))
        shown = self.dissect(*datagrams, arguments=["-d", "udp.port==14550,horus"])
        self.assertEqual(len(shown), 1_000)


if __name__ == "__main__":
    unittest.main()
