//! Tests that the `ublox` crate reads the values that this crate encodes.

use gnss_sim::ubx::{self, EsfIns, Frame, NavAtt, NavPvt};
use ublox::{
    ParserBuilder, UbxPacket,
    proto27::{PacketRef, Proto27},
};

fn only(bytes: &[u8], check: impl FnOnce(&PacketRef<'_>)) {
    let mut parser = ParserBuilder::new().with_protocol::<Proto27>().with_vec_buffer();
    let mut found = parser.consume_ubx(bytes);
    let Some(Ok(UbxPacket::Proto27(packet))) = found.next() else {
        panic!("no message in {bytes:02x?}");
    };
    check(&packet);
    assert!(found.next().is_none());
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() <= b.abs() * 1e-12
}

#[test]
fn nav_pvt_reads_back_field_by_field() {
    let sent = NavPvt {
        itow_ms: 294_123_875,
        year: 2025,
        month: 6,
        day: 25,
        hour: 9,
        minute: 59,
        second: 42,
        valid: 0b0111,
        time_accuracy_ns: 25,
        nano: -123_456,
        fix_type: 4,
        flags: NavPvt::FLAG_FIX_OK | NavPvt::FLAG_HEADING_OF_VEHICLE,
        flags2: 0b1110_0000,
        satellites: 17,
        longitude_1e7: 87_289_001,
        latitude_1e7: -474_979_003,
        height_mm: 470_123,
        height_msl_mm: 422_623,
        horizontal_accuracy_mm: 1_414,
        vertical_accuracy_mm: 2_002,
        velocity_mm_s: [-1_001, 2_002, -3_003],
        ground_speed_mm_s: 2_238,
        heading_of_motion_1e5: 11_658_333,
        speed_accuracy_mm_s: 71,
        heading_accuracy_1e5: 61_234,
        pdop_1e2: 131,
        flags3: 0,
        heading_of_vehicle_1e5: 11_700_007,
    };
    let bytes = sent.encode();
    assert_eq!(bytes.len(), 100);
    only(&bytes, |packet| {
        let PacketRef::NavPvt(pvt) = packet else {
            panic!("{packet:?}");
        };
        assert_eq!(pvt.itow(), sent.itow_ms);
        assert_eq!((pvt.year(), pvt.month(), pvt.day()), (2025, 6, 25));
        assert_eq!((pvt.hour(), pvt.min(), pvt.sec()), (9, 59, 42));
        assert_eq!(pvt.valid_raw(), sent.valid);
        assert_eq!(pvt.time_accuracy(), 25);
        assert_eq!(pvt.nanosec(), -123_456);
        assert_eq!(pvt.fix_type_raw(), 4);
        assert_eq!(pvt.flags_raw(), sent.flags);
        assert_eq!(pvt.flags2_raw(), sent.flags2);
        assert_eq!(pvt.num_satellites(), 17);
        assert_eq!(pvt.longitude_raw(), sent.longitude_1e7);
        assert_eq!(pvt.latitude_raw(), sent.latitude_1e7);
        assert!(near(pvt.height_above_ellipsoid(), 470.123));
        assert!(near(pvt.height_msl(), 422.623));
        assert!(near(pvt.horizontal_accuracy(), 1.414));
        assert!(near(pvt.vertical_accuracy(), 2.002));
        assert!(near(pvt.vel_north(), -1.001) && near(pvt.vel_east(), 2.002) && near(pvt.vel_down(), -3.003));
        assert!(near(pvt.ground_speed_2d(), 2.238));
        assert!(near(pvt.heading_motion(), 116.583_33));
        assert!(near(pvt.speed_accuracy(), 0.071));
        assert!(near(pvt.heading_accuracy(), 0.612_34));
        assert!(near(pvt.pdop(), 1.31));
        assert!(!pvt.flags3().invalid_llh());
        assert!(near(pvt.heading_vehicle(), 117.000_07));
        assert_eq!(pvt.magnetic_declination(), 0.0);
    });
}

#[test]
fn nav_att_reads_back_field_by_field() {
    let sent = NavAtt {
        itow_ms: 294_123_900,
        roll_1e5: -1_234_567,
        pitch_1e5: 765_432,
        heading_1e5: 35_999_999,
        accuracy_1e5: [40_001, 40_002, 60_003],
    };
    let bytes = sent.encode();
    assert_eq!(bytes.len(), NavAtt::WIRE);
    only(&bytes, |packet| {
        let PacketRef::NavAtt(att) = packet else {
            panic!("{packet:?}");
        };
        assert_eq!((att.itow(), att.version()), (sent.itow_ms, 0));
        assert!(near(att.vehicle_roll(), -12.345_67));
        assert!(near(att.vehicle_pitch(), 7.654_32));
        assert!(near(att.vehicle_heading(), 359.999_99));
        assert!(near(att.vehicle_roll_accuracy(), 0.400_01));
        assert!(near(att.vehicle_pitch_accuracy(), 0.400_02));
        assert!(near(att.vehicle_heading_accuracy(), 0.600_03));
    });
}

#[test]
fn esf_ins_reads_back_field_by_field() {
    let sent = EsfIns { itow_ms: 294_124_000, rates_1e3: [-12_345, 678, 90_001], accelerations_1e2: [351, -42, -981] };
    let bytes = sent.encode();
    assert_eq!(bytes.len(), EsfIns::WIRE);
    only(&bytes, |packet| {
        let PacketRef::EsfIns(ins) = packet else {
            panic!("{packet:?}");
        };
        assert_eq!(ins.itow(), sent.itow_ms);
        assert_eq!(ins.bitfield_raw(), 0x3f01);
        assert!(near(ins.x_angular_rate(), -12.345));
        assert!(near(ins.y_angular_rate(), 0.678));
        assert!(near(ins.z_angular_rate(), 90.001));
        assert!(near(ins.x_acceleration(), 3.51));
        assert!(near(ins.y_acceleration(), -0.42));
        assert!(near(ins.z_acceleration(), -9.81));
    });
}

#[test]
fn framing_is_that_of_a_poll_request_of_the_specification() {
    // A poll of NAV-PVT, which has no payload. The checksum by hand: 01+07+00+00 = 08 and 01+08+08+08 = 19
    // (hexadecimal).
    assert_eq!(ubx::frame(0x01, 0x07, &[]), [0xb5, 0x62, 0x01, 0x07, 0x00, 0x00, 0x08, 0x19]);
}

#[test]
fn a_frame_is_found_only_whole_and_undamaged() {
    let bytes = NavAtt { itow_ms: 1_000, ..NavAtt::default() }.encode();
    let mut stream = bytes.clone();
    stream.extend(b"$GN");
    let found = Frame::at_start_of(&stream).expect("a whole frame");
    assert_eq!((found.class, found.id, found.payload.len()), (0x01, 0x05, 32));
    assert_eq!((found.wire_len(), found.itow_ms()), (bytes.len(), Some(1_000)));
    for cut in 0..bytes.len() {
        assert_eq!(Frame::at_start_of(&bytes[..cut]), None);
    }
    for bit in 0..bytes.len() * 8 {
        let mut damaged = bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(Frame::at_start_of(&damaged), None, "bit {bit}");
    }
}

#[test]
fn time_of_week_is_read_where_each_message_has_it() {
    let itow = |class: u8, id: u8, payload: &[u8]| Frame { class, id, payload }.itow_ms();
    let mut payload = [0; 40];
    payload[..4].copy_from_slice(&1_000_u32.to_le_bytes());
    payload[4..8].copy_from_slice(&2_000_u32.to_le_bytes());
    assert_eq!(itow(0x01, 0x07, &payload), Some(1_000));
    assert_eq!(itow(0x01, 0x14, &payload), Some(2_000), "NAV-HPPOSLLH starts with a version");
    assert_eq!(itow(0x01, 0x10, &[]), None, "NAV-RESETODO has none");
    assert_eq!(itow(0x10, 0x15, &payload), None, "ESF messages come between epochs");
    assert_eq!(itow(0x01, 0x07, &payload[..3]), None);
    assert_eq!(itow(0x01, 0x07, &[0xff; 92]), None, "no such time in a week");
}
