use gnss_sim::ubx::{EsfIns, Frame, NavAtt, NavPvt};

use super::*;

const MS: u64 = 1_000_000;

fn burst(itow_ms: u32) -> Vec<u8> {
    let pvt = NavPvt {
        itow_ms,
        valid: 7,
        fix_type: 3,
        flags: NavPvt::FLAG_FIX_OK,
        satellites: 12,
        latitude_1e7: 475_000_000,
        ..NavPvt::default()
    };
    let att = NavAtt { itow_ms, roll_1e5: 77, ..NavAtt::default() };
    let ins = EsfIns { itow_ms, rates_1e3: [1, 2, 3], accelerations_1e2: [4, 5, 6] };
    [pvt.encode(), att.encode(), ins.encode()].concat()
}

fn with(fault: ReceiverFault) -> LineFaults {
    let mut faults = LineFaults::new(1);
    faults.begin(0, 400 * MS, 0, fault);
    faults
}

fn bytes(on_line: &[OnLine]) -> Vec<u8> {
    let [on_line] = on_line else { panic!("{} bursts", on_line.len()) };
    assert!(on_line.clean);
    on_line.bytes().map(|byte| byte.expect("a clean burst has ordinary frames")).collect()
}

fn payloads(bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut payloads = vec![];
    let mut rest = bytes;
    while !rest.is_empty() {
        let frame = Frame::at_start_of(rest).unwrap_or_else(|| panic!("no message in {rest:02x?}"));
        payloads.push(frame.payload.to_vec());
        rest = &rest[frame.wire_len()..];
    }
    payloads
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn itows(bytes: &[u8]) -> [u32; 3] {
    let payloads = payloads(bytes);
    [word(&payloads[0], 0), word(&payloads[1], 0), word(&payloads[2], 8)]
}

#[test]
fn without_a_fault_a_burst_is_on_the_line_as_it_is() {
    let mut faults = LineFaults::new(1);
    let on_line = faults.burst(5 * MS, 1, &burst(100));
    assert_eq!(bytes(&on_line), burst(100));
    assert_eq!((on_line[0].at_ns, on_line[0].receiver), (5 * MS, 1));
    assert_eq!(faults.next_at(), u64::MAX);
}

#[test]
fn a_fault_of_one_receiver_leaves_the_others_alone_and_ends() {
    let mut faults = with(ReceiverFault::Silent);
    assert!(faults.burst(MS, 0, &burst(100)).is_empty());
    assert_eq!(bytes(&faults.burst(MS, 1, &burst(100))), burst(100));
    faults.end(0, ReceiverFault::Silent);
    assert_eq!(bytes(&faults.burst(2 * MS, 0, &burst(200))), burst(200));
}

#[test]
fn of_two_faults_the_one_that_began_last_acts_until_it_ends() {
    let mut faults = with(ReceiverFault::NoFix);
    faults.begin(MS, 2 * MS, 0, ReceiverFault::Silent);
    assert!(faults.burst(MS, 0, &burst(100)).is_empty());
    faults.end(0, ReceiverFault::Silent);
    assert_ne!(bytes(&faults.burst(2 * MS, 0, &burst(200))), burst(200));
}

fn endless(fault: ReceiverFault) -> Vec<u8> {
    let mut faults = LineFaults::new(1);
    faults.begin(10 * MS, 30 * MS, 0, fault);
    let (mut all, mut free_at) = (vec![], 10 * MS);
    while faults.next_at() < 30 * MS {
        let now = faults.next_at();
        assert_eq!(now, free_at, "the line is idle");
        assert!(faults.burst(now, 0, &burst(100)).is_empty(), "the receiver gets a word in");
        let taken = faults.take(now);
        all.extend(bytes(&taken));
        assert_eq!(taken[0].at_ns, now);
        free_at = now + taken[0].frames.iter().map(UartFrame::ns).sum::<u64>();
    }
    faults.end(0, fault);
    assert_eq!(faults.next_at(), u64::MAX);
    assert!((921..=970).contains(&all.len()), "{}", all.len());
    all
}

#[test]
fn a_receiver_that_babbles_sends_random_bytes_without_a_pause() {
    let bytes = endless(ReceiverFault::Babbles);
    let values: std::collections::BTreeSet<u8> = bytes.iter().copied().collect();
    assert!(values.len() > 200, "{} values", values.len());
}

#[test]
fn a_receiver_that_sends_beginnings_never_ends_a_message() {
    let bytes = endless(ReceiverFault::Beginnings);
    assert!(bytes.chunks(6).all(|chunk| chunk == [0xB5, 0x62, 0x01, 0x07, 0xFF, 0xFF]));
}

#[test]
fn messages_that_nobody_asked_for_are_whole() {
    let bytes = endless(ReceiverFault::Unasked);
    assert!(payloads(&bytes).len() >= 19);
    assert_ne!(bytes[1], 0x01);
    assert_eq!(Frame::at_start_of(&bytes).map(|frame| frame.class), Some(0x0A));
}

#[test]
fn a_frozen_receiver_repeats_its_last_time_of_week() {
    let mut faults = LineFaults::new(1);
    faults.burst(0, 0, &burst(100));
    faults.begin(MS, 400 * MS, 0, ReceiverFault::Frozen);
    for itow in [200, 300] {
        let bytes = bytes(&faults.burst(u64::from(itow) * MS, 0, &burst(itow)));
        assert_eq!(itows(&bytes), [100; 3]);
        assert_eq!(word(&payloads(&bytes)[1], 8), 77);
    }
    faults.end(0, ReceiverFault::Frozen);
    assert_eq!(itows(&bytes(&faults.burst(401 * MS, 0, &burst(400)))), [400; 3]);
}

#[test]
fn a_receiver_that_freezes_before_its_first_message_repeats_that_one() {
    let mut faults = with(ReceiverFault::Frozen);
    assert_eq!(itows(&bytes(&faults.burst(MS, 0, &burst(100)))), [100; 3]);
    assert_eq!(itows(&bytes(&faults.burst(2 * MS, 0, &burst(200)))), [100; 3]);
}

#[test]
fn a_receiver_that_jumps_is_so_many_metres_too_far_north() {
    let mut faults = with(ReceiverFault::Jumps { metres: 1_000 });
    let moved = payloads(&bytes(&faults.burst(MS, 0, &burst(100))));
    let was = payloads(&burst(100));
    // A degree of latitude at 47.5 degrees is 111.2 km long.
    assert_eq!(word(&moved[0], 28) - word(&was[0], 28), 89_930);
    assert_eq!(moved[0][..28], was[0][..28]);
    assert_eq!(moved[1..], was[1..]);
}

#[test]
fn a_jump_past_the_pole_ends_at_the_pole() {
    let mut faults = with(ReceiverFault::Jumps { metres: u32::MAX });
    let moved = payloads(&bytes(&faults.burst(MS, 0, &burst(100))));
    assert_eq!(word(&moved[0], 28), 900_000_000);
}

fn differs(fault: ReceiverFault, at: u64, places: &[usize]) -> Vec<i32> {
    let mut faults = with(fault);
    let (changed, was) = (payloads(&bytes(&faults.burst(at, 0, &burst(100)))), payloads(&burst(100)));
    assert_eq!(changed[1..], was[1..], "{fault:?}");
    let mut restored = changed[0].clone();
    for place in places {
        restored[*place..place + 4].copy_from_slice(&was[0][*place..place + 4]);
    }
    assert_eq!(restored, was[0], "{fault:?}");
    places.iter().map(|place| word(&changed[0], *place).cast_signed()).collect()
}

fn changes(fault: ReceiverFault, number: usize) -> Vec<(usize, u8, u8)> {
    let (changed, was) = (payloads(&bytes(&with(fault).burst(MS, 0, &burst(100)))), payloads(&burst(100)));
    for other in (0..3).filter(|other| *other != number) {
        assert_eq!(changed[other], was[other], "{fault:?}");
    }
    let pairs = was[number].iter().zip(&changed[number]).enumerate();
    pairs.filter(|(_, (was, is))| was != is).map(|(at, (was, is))| (at, *was, *is)).collect()
}

#[test]
fn a_receiver_with_a_2d_fix_says_so_and_keeps_its_height() {
    assert_eq!(changes(ReceiverFault::Flat, 0), [(20, 3, 2)]);
}

#[test]
fn a_receiver_that_is_turned_has_another_heading_within_a_turn() {
    let heading =
        |degrees| word(&payloads(&bytes(&with(ReceiverFault::Turned { degrees }).burst(MS, 0, &burst(1))))[1], 16);
    assert_eq!([0, 90, 359, 360].map(heading), [0, 9_000_000, 35_900_000, 0]);
    assert!(changes(ReceiverFault::Turned { degrees: 90 }, 1).iter().all(|(at, ..)| (16..20).contains(at)));
}

#[test]
fn a_receiver_that_is_pushed_has_another_acceleration_to_the_front() {
    assert_eq!(changes(ReceiverFault::Pushed { cm_s2: 500 }, 2), [(24, 4, 0xF8), (25, 0, 0x01)]);
    assert_eq!(changes(ReceiverFault::Pushed { cm_s2: -4 }, 2), [(24, 4, 0)]);
}

#[test]
fn a_receiver_that_is_off_is_so_in_all_three_directions() {
    let off = |north, east, up| differs(ReceiverFault::Offset { north, east, up }, MS, &[28, 24, 32]);
    assert_eq!(off(40, -30, 0), [475_003_597, -3_993, 0]);
    assert_eq!(off(0, 0, 120), [475_000_000, 0, 120_000]);
    assert_eq!(off(0, 0, -120), [475_000_000, 0, -120_000]);
}

#[test]
fn a_receiver_that_drifts_is_farther_off_from_burst_to_burst() {
    let north = |at| differs(ReceiverFault::Drifts { mm_s: 20_000 }, at, &[28])[0] - 475_000_000;
    assert_eq!(north(0), 0);
    assert_eq!(north(100 * MS), 179);
    assert_eq!(north(1_000 * MS), 1_798);
    assert_eq!(north(3_000 * MS), 5_395);
}

#[test]
fn a_frozen_position_repeats_the_last_one_and_the_time_goes_on() {
    let mut faults = LineFaults::new(1);
    faults.burst(0, 0, &burst(100));
    faults.begin(MS, 900 * MS, 0, ReceiverFault::FrozenPosition);
    let moved = each_message(&burst(200), |class, id, payload| move_by(class, id, payload, [7_000, 8_000, 9_000]));
    let frozen = bytes(&faults.burst(2 * MS, 0, &moved));
    assert_eq!(frozen, burst(200));
    assert_eq!(itows(&frozen), [200; 3]);
    faults.end(0, ReceiverFault::FrozenPosition);
    assert_eq!(bytes(&faults.burst(3 * MS, 0, &moved)), moved);
}

#[test]
fn a_position_that_freezes_before_any_message_is_that_of_the_first() {
    let mut faults = with(ReceiverFault::FrozenPosition);
    let moved = each_message(&burst(200), |class, id, payload| move_by(class, id, payload, [7_000, 8_000, 9_000]));
    assert_eq!(bytes(&faults.burst(MS, 0, &burst(100))), burst(100));
    assert_eq!(bytes(&faults.burst(2 * MS, 0, &moved)), burst(200));
    let mut faults = with(ReceiverFault::FrozenPosition);
    assert_eq!(bytes(&faults.burst(MS, 0, b"$GPGGA")), b"$GPGGA");
}

#[test]
fn an_understated_accuracy_is_one_centimetre() {
    assert_eq!(differs(ReceiverFault::Understates, MS, &[40, 44]), [10, 10]);
}

#[test]
fn absurd_fields_have_values_that_they_cannot_have() {
    let absurd = |field, places: &[usize]| differs(ReceiverFault::Absurd(field), MS, places);
    assert_eq!(absurd(Absurd::Latitude, &[28]), [910_000_000]);
    assert_eq!(absurd(Absurd::Longitude, &[24]), [1_810_000_000]);
    assert_eq!(absurd(Absurd::Height, &[32]), [i32::MAX]);
    assert_eq!(absurd(Absurd::Speed, &[48]), [i32::MIN]);
    assert_eq!(absurd(Absurd::NoAccuracy, &[40, 44]), [0, 0]);
    assert_eq!(absurd(Absurd::HugeAccuracy, &[40, 44]), [-1, -1]);
}

#[test]
fn a_time_of_week_that_jumps_is_shifted_in_every_message() {
    let jumped = |ms| itows(&bytes(&with(ReceiverFault::TimeJumps(ms)).burst(MS, 0, &burst(100))));
    assert_eq!(jumped(5_000), [5_100; 3]);
    assert_eq!(jumped(-40), [60; 3]);
    assert_eq!(jumped(-5_000), [ubx::WEEK_MS - 4_900; 3], "the week before");
}

#[test]
fn messages_of_another_length_are_whole_and_longer_or_shorter() {
    let was: Vec<usize> = payloads(&burst(100)).iter().map(Vec::len).collect();
    for more in [4, -8] {
        let sent = payloads(&bytes(&with(ReceiverFault::OtherLength(more)).burst(MS, 0, &burst(100))));
        let lengths: Vec<isize> =
            sent.iter().zip(&was).map(|(sent, was)| sent.len() as isize - *was as isize).collect();
        assert_eq!(lengths, [isize::from(more); 3]);
    }
}

#[test]
fn without_a_fix_the_position_is_invalid_and_time_goes_on() {
    let mut faults = with(ReceiverFault::NoFix);
    let bytes = bytes(&faults.burst(MS, 0, &burst(100)));
    let pvt = &payloads(&bytes)[0];
    assert_eq!((pvt[11], pvt[20], pvt[21] & 1, pvt[23], pvt[78] & 1), (7, 0, 0, 0, 1));
    assert_eq!(itows(&bytes), [100; 3]);
}

#[test]
fn a_receiver_that_restarts_is_silent_and_then_searches_from_time_0() {
    let mut faults = LineFaults::new(1);
    faults.begin(1_000 * MS, 1_400 * MS, 0, ReceiverFault::Restarts);
    assert!(faults.burst(1_000 * MS, 0, &burst(100)).is_empty());
    assert!(faults.burst(1_199 * MS, 0, &burst(200)).is_empty());
    let bytes_at = |faults: &mut LineFaults, at| bytes(&faults.burst(at, 0, &burst(300)));
    let first = bytes_at(&mut faults, 1_205 * MS);
    assert_eq!(itows(&first), [5; 3]);
    let pvt = &payloads(&first)[0];
    assert_eq!((pvt[11], pvt[20], pvt[21] & 1), (0, 0, 0));
    assert_eq!(itows(&bytes_at(&mut faults, 1_305 * MS)), [105; 3]);
    faults.end(0, ReceiverFault::Restarts);
    assert_eq!(bytes_at(&mut faults, 1_405 * MS), burst(300));
}

#[test]
fn a_restart_without_an_end_has_a_bounded_silence() {
    let mut faults = LineFaults::new(1);
    faults.begin(0, u64::MAX, 0, ReceiverFault::Restarts);
    assert!(faults.burst(LONGEST_SILENCE - 1, 0, &burst(100)).is_empty());
    assert_eq!(faults.burst(LONGEST_SILENCE, 0, &burst(100)).len(), 1);
}

#[test]
fn wrong_checksums_are_all_that_is_wrong() {
    let mut faults = with(ReceiverFault::BadChecksums);
    let sent = bytes(&faults.burst(MS, 0, &burst(100)));
    let differ: Vec<usize> = (0..sent.len()).filter(|&at| sent[at] != burst(100)[at]).collect();
    let (pvt, att, ins) = (NavPvt::WIRE, NavAtt::WIRE, EsfIns::WIRE);
    assert_eq!(differ, [pvt - 1, pvt + att - 1, pvt + att + ins - 1]);
}

#[test]
fn a_late_burst_is_not_overtaken_by_those_after_it() {
    let fault = ReceiverFault::LateBursts(60 * MS);
    let mut faults = with(fault);
    assert!(faults.burst(10 * MS, 0, &burst(100)).is_empty());
    faults.end(0, fault);
    assert!(faults.burst(50 * MS, 0, &burst(200)).is_empty());
    assert_eq!(faults.next_at(), 70 * MS);
    assert!(faults.take(70 * MS - 1).is_empty());
    let taken = faults.take(70 * MS);
    assert_eq!(taken.iter().map(|on_line| on_line.at_ns).collect::<Vec<_>>(), [70 * MS; 2]);
    assert_eq!(bytes(&taken[..1]), burst(100));
    assert_eq!(bytes(&taken[1..]), burst(200));
    assert_eq!(bytes(&faults.burst(80 * MS, 0, &burst(300))), burst(300));
}

#[test]
fn another_bit_rate_makes_other_frames_of_the_same_bytes() {
    let mut faults = with(ReceiverFault::WrongBaud(38_400));
    let on_line = faults.burst(MS, 0, &burst(100));
    assert!(!on_line[0].clean);
    assert_eq!(on_line[0].frames, burst(100).iter().map(|&b| UartFrame::eight_n_one(b, 38_400)).collect::<Vec<_>>());
    assert!(on_line[0].bytes().all(|byte| byte.is_none()));
}

#[test]
fn noise_inverts_as_many_bits_as_it_says() {
    let mut faults = with(ReceiverFault::Noise);
    let (mut bits, mut inverted, mut stops, mut unclean) = (0, 0, 0, 0);
    for nth in 0..200 {
        let on_line = faults.burst(nth * 100 * MS, 0, &burst(100)).remove(0);
        assert_eq!(on_line.frames.len(), burst(100).len());
        for (frame, byte) in on_line.frames.iter().zip(burst(100)) {
            bits += 9;
            inverted += (frame.data as u8 ^ byte).count_ones() as usize;
            stops += usize::from(frame.bits == 9);
            assert!(frame.data < 256);
        }
        unclean += usize::from(!on_line.clean);
        assert_eq!(on_line.clean, on_line.frames.iter().all(|frame| frame.bits == 8));
    }
    let one_in = bits / (inverted + stops);
    assert!((450..550).contains(&one_in), "one in {one_in}");
    assert!((50..130).contains(&stops), "{stops}");
    assert!(unclean > 20);
}

#[test]
fn a_framing_error_holds_the_stop_bit_low() {
    let mut faults = with(ReceiverFault::FramingErrors);
    let on_line = faults.burst(MS, 0, &[0x5A; 10_000]).remove(0);
    let low: Vec<&UartFrame> = on_line.frames.iter().filter(|frame| frame.bits != 8).collect();
    assert!((550..700).contains(&low.len()), "{}", low.len());
    assert!(low.iter().all(|frame| frame.bits == 9 && frame.data == 0x5A && frame.stop_halves == 2));
    assert!(!on_line.clean);
    assert_eq!(on_line.bytes().filter(Option::is_none).count(), low.len());
}

#[test]
fn a_break_is_one_low_level_for_as_long_as_it_lasts() {
    let mut faults = LineFaults::new(1);
    faults.begin(7 * MS, 107 * MS, 0, ReceiverFault::Break);
    assert_eq!(faults.next_at(), 7 * MS);
    let taken = faults.take(7 * MS);
    let [OnLine { at_ns: 7_000_000, receiver: 0, frames, clean: false }] = &taken[..] else { panic!("{taken:?}") };
    let [frame] = frames[..] else { panic!("{frames:?}") };
    assert_eq!((frame.data, frame.bits), (0, 9));
    assert!(frame.ns().abs_diff(100 * MS) < 1_000, "{}", frame.ns());
    assert!(faults.burst(50 * MS, 0, &burst(100)).is_empty());
    faults.end(0, ReceiverFault::Break);
    assert_eq!(bytes(&faults.burst(108 * MS, 0, &burst(200))), burst(200));
}

#[test]
fn a_break_without_an_end_is_no_longer_than_can_be_told() {
    let mut faults = LineFaults::new(1);
    faults.begin(0, u64::MAX, 0, ReceiverFault::Break);
    assert!(faults.take(0)[0].frames[0].ns() <= LONGEST_BREAK);
}

#[test]
fn the_same_seed_does_the_same_and_another_seed_something_else() {
    let on_line = |seed| {
        let mut faults = LineFaults::new(seed);
        faults.begin(0, 400 * MS, 0, ReceiverFault::Noise);
        (0..20).map(|nth| faults.burst(nth * MS, 0, &burst(100))).collect::<Vec<_>>()
    };
    assert_eq!(on_line(1), on_line(1));
    assert_ne!(on_line(1), on_line(2));
}
