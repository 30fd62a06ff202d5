# SPDX-License-Identifier: MIT OR Apache-2.0
"""MAVLink's TUNNEL: bytes written by hand, and pymavlink where it is installed."""

import random
import unittest
from types import SimpleNamespace

from horus_profile import HoldStatus, Identifier, Rejection, ReportedPosition
from horus_profile.tunnel import Frames, checksum, split, split_message, split_payload
from tests import optional
from tests.test_objects import GPS1, LINK, REPORTED

PAYLOAD = REPORTED + GPS1


def frame(payload_type, payload, *, signed=False, message_id=385, extra=147, sequence=0):
    """A message of system 7."""
    body = payload_type.to_bytes(2, "little") + bytes([0, 0, len(payload)]) + payload.ljust(128, b"\0")
    body = body.rstrip(b"\0")
    head = bytes([len(body), int(signed), 0, sequence, 7, 1]) + message_id.to_bytes(3, "little")
    crc = checksum(head + body + bytes([extra])).to_bytes(2, "little")
    return b"\xfd" + head + body + crc + b"\xfd" * (13 if signed else 0)


class Payloads(unittest.TestCase):
    def test_the_payload_type_tells_the_first_object(self):
        parts = split_payload(0xC800, PAYLOAD)
        self.assertEqual([data for _, _, data in parts], [REPORTED, GPS1])
        self.assertEqual([kind.verify(data, identifier).identifier for kind, identifier, data in parts],
                         [Identifier.REPORTED_POSITION, Identifier.GPS1])

    def test_another_type_or_length_carries_no_objects(self):
        for payload_type, payload in ((0x4800, PAYLOAD), (0xC301, PAYLOAD), (0xC800, PAYLOAD[1:]), (0xC800, b"")):
            self.assertIsNone(split_payload(payload_type, payload))
        self.assertIsNone(split(8, bytes(128)), "the hold's object is alone")
        self.assertIsNone(split(9, bytes(128)), "there is nothing behind the hold")

    def test_the_hold_is_alone_in_a_message(self):
        ((kind, identifier, _),) = split_payload(0xC100, bytes(64))
        self.assertEqual((kind, identifier), (HoldStatus, Identifier.HOLD_STATUS))
        self.assertEqual(len(split_payload(0xC401, bytes(128))), 2)

    def test_a_damaged_identifier_makes_only_its_own_object_unreadable(self):
        damaged = bytearray(PAYLOAD)
        damaged[4] ^= 1
        (_, _, first), (kind, identifier, second) = split_payload(0xC800, bytes(damaged))
        self.assertIs(ReportedPosition.judge(first), Rejection.CRC)
        self.assertEqual(kind.verify(second, identifier).raw, GPS1)

    def test_a_message_of_pymavlink_is_split(self):
        message = SimpleNamespace(
            get_type=lambda: "TUNNEL", payload_type=0xC400, payload_length=32, payload=list(LINK.ljust(128, b"\0"))
        )
        self.assertEqual([data for _, _, data in split_message(message)], [LINK])
        self.assertIsNone(split_message(SimpleNamespace(get_type=lambda: "HEARTBEAT")))


class Streams(unittest.TestCase):
    def test_the_checksum_has_its_check_value(self):
        self.assertEqual(checksum(b"123456789"), 0x6F91)

    def test_a_stream_in_pieces_gives_every_message_between_others(self):
        good = frame(0xC800, PAYLOAD), frame(0xC400, LINK, signed=True), frame(0xC801, GPS1)
        other = frame(0xFDFD, b"\xfd" * 50, message_id=30, extra=39)
        damaged, longer = bytearray(good[0]), bytearray(good[2])
        damaged[20] ^= 1
        # The next message begins within the length that this one claims.
        longer[1] += 20
        line = b"\x00\xfe" + good[0] + other + good[1] + bytes(damaged) + good[2] + bytes(longer) + good[2]
        expected = [(7, 0xC800, PAYLOAD), (7, 0xC400, LINK), (7, 0xC801, GPS1), (7, 0xC801, GPS1)]
        drawn = random.Random(1)
        for _ in range(200):
            frames, found, rest = Frames(), [], line
            while rest:
                piece = drawn.randint(1, 60)
                found += frames.feed(rest[:piece])
                rest = rest[piece:]
            self.assertEqual(found, expected)

    def test_pymavlink_writes_what_is_read(self):
        optional(self, "pymavlink")
        from pymavlink.dialects.v20 import common

        link = common.MAVLink(None, srcSystem=7, srcComponent=1)
        written = [(0xC800, PAYLOAD), (0xC400, LINK), (0xC800, bytes(124))]
        line = b""
        for payload_type, payload in written:
            padded = list(payload.ljust(128, b"\0"))
            line += bytes(common.MAVLink_tunnel_message(0, 0, payload_type, len(payload), padded).pack(link))
        self.assertEqual(list(Frames().feed(line)), [(7, *message) for message in written])
        received = link.parse_buffer(line)
        self.assertEqual([split_message(message) for message in received], [split_payload(*m) for m in written])


if __name__ == "__main__":
    unittest.main()
