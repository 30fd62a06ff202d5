# SPDX-License-Identifier: MIT OR Apache-2.0
"""Objects whose bytes are written by hand in `golden.rs` and `hold.rs` of `profile/tests`, damaged ones, and places."""

import math
import unittest

from horus_profile import (
    FRAME, MAPS, MAPS_WITH_HOLD, POSITION, CommandWord, Gps, HoldStatus, Identifier, LinkStatus, PortStatus, Rejected,
    Rejection, ReportedPosition, Uplink, checked, read, seal_command, seal_request, seal_uplink, verify_written,
)
from horus_profile.objects import Fix, Reset, State

GPS1 = bytes.fromhex(
    "CE040000014893080000000000C047400000000000802140"
    "0000000000D47E40" "0000003F" "0000C03F" "000080BE" "0000803F" "0000C07F" "000000C0" "DC40C5A8"
)
REPORTED = bytes.fromhex(
    "D804000000480B410000000000C047C00000000000802140" "3F14F65D" "0000000000D47E40"
    "0000003F" "0000C03F" "000080BE" "0000803F" "0000C07F" "000000C0" "4E8EA967"
)
HOLD = bytes.fromhex(
    "10270000" "0041" "8300" "00009040" "00002A42" "0000A040" "0000803E" "0000003F" "0000C07F" "00001A42" "00004241"
    "000040BF" "34120100" "78560400" "0A000000" "00000000"
)
HOLD += FRAME(HOLD).to_bytes(4, "big")
LINK = bytes.fromhex("88130000" "00440300" "A00F000001000000E80300000200000035000700" "54E44152")


class Golden(unittest.TestCase):
    def test_both_crcs_have_their_check_values(self):
        self.assertEqual((FRAME(b"123456789"), POSITION(b"123456789")), (0x12D3A0B1, 0xEA8707AB))
        self.assertEqual((FRAME.check, POSITION.check), (0x12D3A0B1, 0xEA8707AB))

    def test_a_receiver_has_these_values(self):
        gps = Gps.verify(GPS1, Identifier.GPS1)
        self.assertEqual((gps.timestamp, gps.identifier, gps.crc), (1230, 0x4801, 0xDC40C5A8))
        self.assertEqual((gps.latitude, gps.longitude, gps.altitude), (47.5, 8.75, 493.25))
        self.assertEqual((gps.pitch, gps.yaw, gps.roll), (0.5, 1.5, -0.25))
        self.assertEqual((gps.acceleration[0], gps.acceleration[2]), (1.0, -2.0))
        self.assertTrue(math.isnan(gps.acceleration[1]))
        self.assertEqual((gps.status.fix, gps.status.age), (Fix.FIX_3D, 50))
        self.assertTrue(gps.status.position_valid and gps.status.heard and not gps.status.stale)

    def test_reported_position_has_these_values(self):
        reported = ReportedPosition.verify(REPORTED)
        self.assertEqual((reported.timestamp, reported.position_crc), (1240, 0x3F14F65D))
        self.assertEqual((reported.latitude, reported.longitude), (-47.5, 8.75))
        status = reported.status
        self.assertEqual((status.agreeing, status.state, status.reset), (3, State.MONITORING, Reset.WATCHDOG))
        self.assertEqual(reported.raw, REPORTED)

    def test_link_status_has_these_values(self):
        link = LinkStatus.verify(LINK)
        self.assertTrue(link.status.up and link.status.all_accepted)
        counts = (link.objects_accepted, link.objects_rejected, link.frames_received, link.frames_missed)
        self.assertEqual((counts, link.age_100us, link.access_violations), ((4000, 1, 1000, 2), 53, 7))

    def test_hold_status_has_these_values(self):
        hold = HoldStatus.verify(HOLD, Identifier.HOLD_STATUS)
        self.assertEqual((hold.timestamp, hold.seconds, hold.acknowledged), (10_000, 10, (0x1234, 1, 0x5678, 4)))
        self.assertEqual((hold.temperature, hold.humidity, hold.set_point), (4.5, 42.5, 5.0))
        self.assertEqual((hold.greatest_shock, hold.supply, hold.output), (38.5, 12.125, -0.75))
        self.assertEqual(hold.vibration[:2], (0.25, 0.5))
        self.assertTrue(math.isnan(hold.vibration[2]))
        status = hold.status
        self.assertTrue(status.values_valid and status.within_limits and not status.locked)
        self.assertEqual((status.reset, status.USED), (Reset.WATCHDOG, 0x01FF))

    def test_port_status_counts_what_came_from_the_hold(self):
        status = PortStatus.BITS(0x0100 | 11 << 9 | 5 << 13)
        self.assertEqual((status.hold_accepted_count, status.hold_rejected_count), (11, 5))
        self.assertTrue(status.hold_accepted and not status.hold_heard)

    def test_bits_without_a_meaning_are_dropped(self):
        link = LinkStatus.decode(LINK[:6] + b"\xff\xff" + LINK[8:])
        self.assertEqual((link.status, link.status.USED), (0xF7FF, 0xF7FF))

    def test_a_request_is_these_bytes(self):
        self.assertEqual(seal_request(32, 64), bytes.fromhex("200040006E68695A"))


class Damage(unittest.TestCase):
    def test_every_flipped_bit_is_found(self):
        for kind, good in ((Gps, GPS1), (ReportedPosition, REPORTED), (LinkStatus, LINK), (HoldStatus, HOLD)):
            for bit in range(8 * len(good)):
                bad = bytearray(good)
                bad[bit // 8] ^= 0x80 >> bit % 8
                self.assertIs(kind.judge(bad), Rejection.CRC, f"{kind.__name__}, bit {bit}")

    def test_a_wrong_position_crc_under_a_right_frame_crc_is_found(self):
        bad = bytearray(REPORTED)
        bad[10] ^= 1
        bad[60:] = FRAME(bytes(bad[:60])).to_bytes(4, "big")
        self.assertIs(ReportedPosition.judge(bad), Rejection.POSITION_CRC)

    def test_another_object_in_its_place_is_refused(self):
        self.assertIs(Gps.judge(GPS1, Identifier.GPS2), Rejection.IDENTIFIER)
        self.assertIs(Uplink.judge(REPORTED), Rejection.IDENTIFIER)
        self.assertIs(Gps.judge(GPS1[1:]), Rejection.LENGTH)

    def test_the_object_of_another_makers_hold_is_refused(self):
        other = HOLD[:4] + b"\x01\x41" + HOLD[6:60]
        self.assertIs(HoldStatus.judge(other + FRAME(other).to_bytes(4, "big")), Rejection.IDENTIFIER)

    def test_zeros_and_ones_are_a_vacant_place(self):
        for kind in (Gps, ReportedPosition, LinkStatus, Uplink, HoldStatus):
            for byte in (b"\x00", b"\xff"):
                self.assertIs(kind.judge(byte * kind.SIZE), Rejection.VACANT)


class Images(unittest.TestCase):
    def test_the_length_tells_profile_image_and_map(self):
        for receivers, layout in MAPS.items():
            for length in (layout.profile_bytes, layout.image_bytes, layout.map_bytes):
                reading = read(bytes(length))
                self.assertEqual(reading.gps, (Rejection.VACANT,) * receivers)
                self.assertEqual(reading.link is None, length == layout.profile_bytes)
                self.assertEqual(reading.port is None, length != layout.map_bytes)
        with self.assertRaises(Rejected):
            read(bytes(155))

    def test_a_map_with_a_hold_ends_with_its_object(self):
        for receivers, layout in MAPS_WITH_HOLD.items():
            before = MAPS[receivers].map_bytes
            self.assertEqual(layout.places[-1], (HoldStatus, Identifier.HOLD_STATUS, before))
            self.assertEqual(layout.places[:-1], MAPS[receivers].places)
            reading = read(bytes(before) + HOLD)
            self.assertEqual((reading.hold.raw, len(reading.gps)), (HOLD, receivers))
            self.assertIsNone(read(bytes(before)).hold)

    def test_each_object_of_an_image_is_judged_separately(self):
        damaged = bytearray(LINK + REPORTED + GPS1)
        damaged[40] ^= 1
        reading = read(damaged)
        self.assertEqual((reading.link, reading.reported), (LinkStatus.verify(LINK), Rejection.CRC))
        self.assertEqual(reading.gps[0].raw, GPS1)

    def test_what_is_not_valid_is_not_shown(self):
        gps = checked(Gps.verify(GPS1))
        self.assertEqual(gps.latitude, 47.5)
        self.assertTrue(all(map(math.isnan, (gps.pitch, gps.yaw, gps.roll, *gps.acceleration))))
        impossible = bytearray(GPS1)
        impossible[8:16] = bytes.fromhex("0000000000805740")  # 94 degrees
        gps = checked(Gps.decode(impossible))
        self.assertTrue(all(map(math.isnan, (gps.latitude, gps.longitude, gps.altitude))))
        self.assertFalse(gps.status.position_valid)


class Written(unittest.TestCase):
    def test_what_is_sealed_verifies(self):
        uplink = verify_written(seal_uplink(Identifier.UPLINK_BASE_STATION, 2**32 + 7, b"abc", 5))
        self.assertEqual((uplink.timestamp, uplink.status, uplink.payload), (7, 5, b"abc" + bytes(49)))
        command = verify_written(seal_command(1, CommandWord.SELF_TEST))
        self.assertEqual(command.raw[8:12], b"TEST")

    def test_what_the_dpr_would_refuse_is_refused(self):
        unknown = bytearray(seal_command(1, CommandWord.SELF_TEST))
        unknown[20] = 1
        unknown[60:] = FRAME(bytes(unknown[:60])).to_bytes(4, "big")
        for data, why in ((unknown, Rejection.COMMAND), (REPORTED, Rejection.IDENTIFIER), (b"", Rejection.LENGTH)):
            with self.assertRaises(Rejected) as caught:
                verify_written(bytes(data))
            self.assertIs(caught.exception.why, why)
        with self.assertRaises(ValueError):
            seal_uplink(Identifier.COMMAND, 1, b"")
        with self.assertRaises(ValueError):
            seal_uplink(Identifier.UPLINK_BASE_STATION, 1, bytes(53))
