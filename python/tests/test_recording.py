# SPDX-License-Identifier: MIT OR Apache-2.0
"""A recording that `horus-base record` made, whole and damaged, and recordings written here.

In `recorded/flight.mcap` two drones, one in datagrams and one over MAVLink, send the same 30 images of one receiver,
10 ms apart; the altitude begins at 470 m and rises by 0.25 m each time, and GPS1 of image 20 is damaged.
"""

import struct
import tempfile
import unittest
import zlib
from collections import Counter
from pathlib import Path

from horus_profile import Identifier, Rejection, ReportedPosition
from horus_profile.recording import Recording, _unstuffed
from tests import optional
from tests.test_hold import status
from tests.test_objects import GPS1, HOLD, LINK, REPORTED
from tests.test_tunnel import frame

FLIGHT = Path(__file__).parent / "recorded/flight.mcap"
IMAGE = LINK + REPORTED + GPS1
MAVLINK_STREAM, DATAGRAMS, STREAM, PUBLISHED = 2, 3, 4, 5


def record(opcode, body):
    return struct.pack("<BQ", opcode, len(body)) + body


def array(data):
    return struct.pack("<I", len(data)) + data


def carried(kind, data, places, verdict=b"new"):
    """A message of one channel, as the recorder writes it."""
    strings = lambda text: struct.pack("<I", len(places)) + array(text) * len(places)
    body = struct.pack("<QBH", 5, kind, 0) + array(b"") + array(data) + strings(b"7") + array(bytes(places))
    return record(0x05, struct.pack("<HIQQ", 1, 0, 0, 0) + body + strings(verdict))


def recording(*messages, damaged=False):
    """The bytes of a recording with these messages in one chunk."""
    records = record(0x04, struct.pack("<HH", 1, 0) + array(b"/carried")) + b"".join(messages)
    crc = zlib.crc32(records) ^ damaged
    chunk = struct.pack("<QQQIIQ", 0, 0, len(records), crc, 0, len(records)) + records
    return b"\x89MCAP0\r\n" + record(0x06, chunk) + record(0x02, bytes(20))


def stuffed(data):
    """A frame of fewer than 254 bytes between zeros."""
    return b"".join(bytes([len(run) + 1]) + run for run in data.split(b"\0")) + b"\0"


class Flight(unittest.TestCase):
    def test_every_object_of_the_flight_is_read_with_its_verdict(self):
        whole = Recording(FLIGHT)
        arrivals = list(whole)
        self.assertEqual((whole.torn, whole.unmatched), ([], 0))
        drones = {arrival.drone for arrival in arrivals}
        self.assertEqual(len(drones), 2)
        for drone in drones:
            of_drone = [arrival for arrival in arrivals if arrival.drone == drone]
            count = Counter((arrival.identifier.name, arrival.verdict) for arrival in of_drone)
            gps = {("GPS1", "new"): 29, ("GPS1", "crc"): 1}
            self.assertEqual(count, {("LINK_STATUS", "new"): 30, ("REPORTED_POSITION", "new"): 30, **gps})
            damaged = [arrival for arrival in of_drone if arrival.verdict == "crc"]
            self.assertEqual([arrival.found for arrival in damaged], [Rejection.CRC])
            reported = [a.found for a in of_drone if isinstance(a.found, ReportedPosition)]
            self.assertEqual([values.altitude for values in reported], [470 + n / 4 for n in range(30)])

    def test_a_recording_that_was_cut_off_is_read_up_to_there(self):
        whole = FLIGHT.read_bytes()
        count = len(list(Recording(FLIGHT)))
        with tempfile.TemporaryDirectory() as folder:
            cut = Path(folder) / "cut.mcap"
            before = 0
            for end in range(0, len(whole), 4_999):
                cut.write_bytes(whole[:end])
                reader = Recording(cut)
                found = len(list(reader))
                self.assertEqual(len(reader.torn), 1)
                self.assertTrue(before <= found <= count)
                before = found
            self.assertGreater(before, 0)

    def test_arrays_have_the_new_objects_to_the_last_bit(self):
        optional(self, "numpy")
        recording = Recording(FLIGHT)
        arrays = recording.arrays()
        self.assertEqual(len(arrays), 2)
        objects = [a.found for a in recording if a.drone == "7" and isinstance(a.found, ReportedPosition)]
        array = arrays["7"][Identifier.REPORTED_POSITION]
        self.assertEqual(array["altitude"].tolist(), [470 + n / 4 for n in range(30)])
        for name in ("timestamp", "status", "position_crc", "crc"):
            self.assertEqual(array[name].tolist(), [getattr(values, name) for values in objects])
        self.assertTrue((array["at_us"][1:] > array["at_us"][:-1]).all())
        self.assertEqual(len(arrays["7"][Identifier.GPS1]), 29)

    def test_the_example_of_the_readme_plots_both_altitudes(self):
        optional(self, "numpy")
        optional(self, "matplotlib")
        readme = (Path(__file__).parents[1] / "README.md").read_text()
        example = readme.split("```python\n")[1].split("```")[0].replace("flight.mcap", str(FLIGHT))
        self.assertLessEqual(len(example.splitlines()), 12)
        import matplotlib

        matplotlib.use("svg")
        with tempfile.TemporaryDirectory() as folder:
            picture = Path(folder) / "altitude.png"
            plotted = {}
            exec(example.replace("altitude.png", str(picture)), plotted)
            self.assertEqual(picture.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
        axes = plotted["plt"].gca()
        self.assertEqual({text.get_text() for text in axes.get_legend().get_texts()}, set(Recording(FLIGHT).arrays()))
        for line in axes.lines:
            self.assertEqual(line.get_ydata().tolist(), [470 + n / 4 for n in range(30)])
            self.assertTrue(0.25 < line.get_xdata()[-1] < 1)
        self.assertEqual(len(axes.lines), 2)
        plotted["plt"].close("all")


class Written(unittest.TestCase):
    def read(self, data):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "written.mcap"
            path.write_bytes(data)
            reader = Recording(path)
            return list(reader), reader

    def test_frames_of_a_stream_may_be_in_two_messages(self):
        line = stuffed(IMAGE)
        messages = carried(STREAM, line[:50], []), carried(STREAM, line[50:], [0, 1, 2])
        arrivals, reader = self.read(recording(*messages))
        self.assertEqual([arrival.found.raw for arrival in arrivals], [LINK, REPORTED, GPS1])
        self.assertEqual(reader.unmatched, 0)

    def test_frames_are_the_examples_of_the_published_encoding(self):
        run = bytes(range(1, 256))
        examples = (
            (b"\0", b"\1\1"),
            (b"\x11\x22\0\x33", b"\3\x11\x22\2\x33"),
            (b"\x11\0\0\0", b"\2\x11\1\1\1"),
            (run[:254], b"\xff" + run[:254]),
            (run, b"\xff" + run[:254] + b"\2\xff"),
        )
        for payload, stuffing in examples:
            self.assertEqual(_unstuffed(stuffing), payload)
        self.assertEqual(_unstuffed(b"\3\x11"), b"", "it ends within a run")

    def test_a_length_that_cannot_be_is_the_end(self):
        arrivals, reader = self.read(b"\x89MCAP0\r\n\x06" + b"\xff" * 8 + bytes(100))
        self.assertEqual((arrivals, len(reader.torn)), ([], 1))

    def test_an_object_that_the_station_did_not_take_for_new_is_in_no_array(self):
        optional(self, "numpy")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "twice.mcap"
            again = carried(DATAGRAMS, IMAGE, [0, 1, 2], b"duplicate")
            path.write_bytes(recording(carried(DATAGRAMS, IMAGE, [0, 1, 2]), again))
            self.assertEqual([len(array) for array in Recording(path).arrays()["7"].values()], [1, 1, 1])

    def test_the_object_of_the_hold_is_read_into_an_array(self):
        optional(self, "numpy")
        first, second = (status(timestamp, own=(7, 1)).raw for timestamp in (100, 200))
        message = frame(0xC401, bytes(128)) + frame(0xC100, first)
        data = recording(carried(MAVLINK_STREAM, message, [7, 8, 9]), carried(MAVLINK_STREAM, frame(0xC100, second), [9]))
        arrivals, reader = self.read(data)
        self.assertEqual(reader.unmatched, 0)
        self.assertEqual([getattr(arrival.found, "timestamp", 0) for arrival in arrivals], [0, 0, 100, 200])
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "hold.mcap"
            path.write_bytes(data)
            array = Recording(path).arrays()["7"][Identifier.HOLD_STATUS]
        self.assertEqual(array["timestamp"].tolist(), [100, 200])
        self.assertEqual(array["acknowledged"].tolist(), [[0, 0, 7, 1]] * 2)

    def test_a_map_has_all_objects_but_the_flight_controllers_uplink(self):
        for end, places in ((bytes(192), [0, 1, 2, 7, 8]), (bytes(192) + HOLD, [0, 1, 2, 7, 8, 9])):
            arrivals, reader = self.read(recording(carried(DATAGRAMS, IMAGE + end, places)))
            self.assertEqual((len(arrivals), reader.unmatched), (len(places), 0))
        self.assertEqual((arrivals[-1].identifier, arrivals[-1].found.raw), (Identifier.HOLD_STATUS, HOLD))

    def test_what_another_station_published_is_read(self):
        message = bytes([1, 2]) + bytes(8) + bytes(2) + REPORTED + GPS1
        arrivals, _ = self.read(recording(carried(PUBLISHED, message, [1, 2])))
        self.assertEqual([arrival.found.raw for arrival in arrivals], [REPORTED, GPS1])

    def test_objects_without_a_verdict_are_left_out_and_counted(self):
        arrivals, reader = self.read(recording(carried(DATAGRAMS, IMAGE, []), carried(DATAGRAMS, IMAGE, [0, 1, 2])))
        self.assertEqual((len(arrivals), reader.unmatched), (3, 1))

    def test_a_damaged_chunk_is_told_and_nothing_of_it_is_used(self):
        arrivals, reader = self.read(recording(carried(DATAGRAMS, IMAGE, [0, 1, 2]), damaged=True))
        self.assertEqual((arrivals, len(reader.torn)), ([], 1))

    def test_a_malformed_message_is_left_out(self):
        message = carried(DATAGRAMS, IMAGE, [0, 1, 2])
        good = carried(DATAGRAMS, IMAGE, [0, 1, 2])
        for end in range(31, len(message)):
            short = record(0x05, message[9:end])
            arrivals, reader = self.read(recording(short, good))
            self.assertEqual((len(arrivals), reader.unmatched), (3, 1), end)

    def test_a_place_that_does_not_exist_is_malformed(self):
        arrivals, reader = self.read(recording(carried(DATAGRAMS, IMAGE, [0, 1, 10])))
        self.assertEqual((arrivals, reader.unmatched), ([], 1))


if __name__ == "__main__":
    unittest.main()
