# SPDX-License-Identifier: MIT OR Apache-2.0
"""What a reader knows of the hold, and a writer's commands to it; the recorded transactions play both as well."""

import struct
import unittest

from horus_profile import FRAME, MAPS_WITH_HOLD, HoldStatus, Identifier
from horus_profile.client import AGE_UNKNOWN, Client, Config
from horus_profile.hold import HoldTrack, Sender, Sent, acknowledged
from horus_profile.objects import HoldShown, HoldWord, Outcome


def status(timestamp, base=(0, 0), own=(0, 0)):
    data = struct.pack("<IHH36x4H8x", timestamp, Identifier.HOLD_STATUS, 0, *base, *own)
    return HoldStatus.verify(data + FRAME(data).to_bytes(4, "big"))


class Track(unittest.TestCase):
    def setUp(self):
        self.track = HoldTrack()
        self.client = Client(Config(3, MAPS_WITH_HOLD[3].map_bytes, hold=True))

    def read(self, place, began_us):
        self.client.begin()
        self.client.end(bytes(MAPS_WITH_HOLD[3].map_bytes - 64) + place, began_us)
        said = self.track.read(self.client, began_us)
        return said.shown, said.values and said.values.timestamp, said.age_us

    def test_there_is_none_before_the_first_and_in_a_vacant_place(self):
        self.assertEqual(self.read(bytes(64), 0), (HoldShown.ABSENT, None, AGE_UNKNOWN))
        self.assertEqual(self.read(status(0).raw, 40_000), (HoldShown.VALID, 0, 41_416))
        self.assertEqual(self.read(bytes(64), 80_000), (HoldShown.ABSENT, None, AGE_UNKNOWN))
        self.assertEqual(self.read(status(0).raw, 90_000), (HoldShown.VALID, 0, 11_416))

    def test_one_that_stays_the_same_for_more_than_300_ms_is_old(self):
        same = status(100).raw
        self.assertEqual(self.read(same, 1_000_000), (HoldShown.VALID, 100, 301_416))
        self.assertEqual(self.read(same, 1_300_000), (HoldShown.VALID, 100, 601_416))
        self.assertEqual(self.read(same, 1_300_001), (HoldShown.OLD, None, 601_417))
        self.assertEqual(self.read(status(200).raw, 1_310_001), (HoldShown.VALID, 200, 11_416))

    def test_damaged_bytes_and_a_busy_dpr_let_it_age(self):
        self.read(bytes(64), 0)
        self.read(status(100).raw, 10_000)
        self.assertEqual(self.read(status(200).raw[::-1], 50_000), (HoldShown.VALID, 100, 51_416))
        self.assertEqual(self.read(b"", 60_000), (HoldShown.VALID, 100, 61_416))
        self.client.end(b"\xff" * MAPS_WITH_HOLD[3].map_bytes, 100_000)
        self.assertEqual(self.track.read(self.client, 100_000).age_us, 101_416)
        self.assertEqual(self.read(status(200).raw, 110_000), (HoldShown.VALID, 200, 101_416))

    def test_a_clock_that_is_set_back_makes_the_age_unknown(self):
        self.read(status(100).raw, 500_000)
        self.assertEqual(self.read(status(100).raw, 499_999), (HoldShown.OLD, None, AGE_UNKNOWN))
        self.assertEqual(self.read(status(200).raw, 400_000), (HoldShown.VALID, 200, 301_416))


class Commands(unittest.TestCase):
    def test_a_command_is_sent_until_it_is_acknowledged(self):
        sender = Sender()
        self.assertIsNone(sender.send(HoldWord.LOCK))
        sender.observe(status(0, own=(0xFFFF, 1)))
        self.assertEqual(sender.send(HoldWord.SET_POINT, 5.0), 0)
        self.assertIsNone(sender.send(HoldWord.LOCK))
        self.assertEqual(sender.fill(b"\x3c" * 52), struct.pack("<HHfI", 0, 1, 5.0, 0) + b"\x3c" * 40)
        sender.observe(status(100, own=(0, 2)))
        self.assertEqual((sender.sent, sender.outcome), (Sent.ANSWERED, Outcome.REFUSED))
        self.assertEqual(sender.fill(b"\x3c" * 52), bytes(12) + b"\x3c" * 40)

    def test_a_reserved_outcome_acknowledges_nothing(self):
        sender = Sender()
        sender.observe(status(0))
        sender.send(HoldWord.LOCK)
        for code in (0, 5):
            sender.observe(status(100, own=(1, code)))
            self.assertIs(sender.sent, Sent.WAITING)

    def test_a_command_is_lost_if_the_hold_restarts_or_the_writer_gives_up(self):
        sender = Sender()
        sender.observe(status(500, own=(7, 1)))
        sender.send(HoldWord.LOCK)
        sender.observe(status(0))
        self.assertIs(sender.sent, Sent.LOST)
        self.assertEqual(sender.send(HoldWord.LOCK), 9)
        sender.give_up()
        self.assertIs(sender.sent, Sent.LOST)
        sender.observe(status(100, own=(9, 1)))
        self.assertEqual((sender.sent, sender.outcome), (Sent.ANSWERED, Outcome.DONE))

    def test_a_later_acknowledgement_makes_it_lost(self):
        sender = Sender()
        sender.observe(status(0))
        sender.send(HoldWord.LOCK)
        sender.observe(status(100, own=(2, 1)))
        self.assertIs(sender.sent, Sent.LOST)

    def test_each_writer_has_its_own_acknowledgement(self):
        both = status(0, base=(3, 4), own=(8, 9))
        self.assertEqual(acknowledged(both), (8, None))
        self.assertEqual(acknowledged(both, Identifier.UPLINK_BASE_STATION), (3, Outcome.TOO_OLD))
        base = Sender(Identifier.UPLINK_BASE_STATION)
        base.observe(both)
        self.assertEqual(base.send(HoldWord.UNLOCK), 4)
        with self.assertRaises(ValueError):
            Sender(Identifier.COMMAND)


if __name__ == "__main__":
    unittest.main()
