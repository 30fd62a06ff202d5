//! Tests how a receiver's bytes become its solution.

use crate::ubx;

use std::{fs, path::Path};

use horus_tx_fw::receiver::{Position, Receiver, BUFFER, BYTES_PER_CALL, GAP_MS, HEARD_MS};
use profile::FixType;
use proptest::prelude::*;
use ubx::{esf_ins, message, nav_att, NavPvt, NMEA};

fn feed(receiver: &mut Receiver, mut bytes: &[u8], now: u32) {
    while !bytes.is_empty() {
        let taken = receiver.receive(bytes, now);
        assert!(taken > 0 && taken <= BYTES_PER_CALL);
        bytes = &bytes[taken..];
    }
}

fn fed(bytes: &[u8]) -> Receiver {
    let mut receiver = Receiver::new();
    feed(&mut receiver, bytes, 0);
    receiver
}

/// Returns the float64 nearest to `raw` / 10^`decimals`. The standard library's parser of decimal digits rounds
/// correctly, and has no code in common with a division.
fn decimal(raw: i32, decimals: usize) -> f64 {
    let digits = format!("{:0width$}", raw.unsigned_abs(), width = decimals + 1);
    let (whole, part) = digits.split_at(digits.len() - decimals);
    let sign = if raw < 0 { "-" } else { "" };
    format!("{sign}{whole}.{part}").parse().expect("digits")
}

proptest! {
    #[test]
    fn a_position_is_the_nearest_float64_to_what_the_receiver_said(
        latitude in -900_000_000i32..=900_000_000,
        longitude in -1_800_000_000i32..=1_800_000_000,
        height in any::<i32>(),
    ) {
        let receiver = fed(&NavPvt { latitude, longitude, height, ..NavPvt::GOOD }.bytes());
        let position = &receiver.solution().position;
        prop_assert_eq!(position.valid, (-1_000_000..=20_000_000).contains(&height));
        prop_assert_eq!(position.latitude.to_bits(), (decimal(latitude, 7) + 0.0).to_bits());
        prop_assert_eq!(position.longitude.to_bits(), (decimal(longitude, 7) + 0.0).to_bits());
        prop_assert_eq!(position.altitude.to_bits(), (decimal(height, 3) + 0.0).to_bits());
    }

    #[test]
    fn velocity_and_accuracies_are_the_nearest_float64_to_what_the_receiver_said(
        velocity in any::<[i32; 3]>(),
        accuracies in [0..=i32::MAX as u32, 0..=i32::MAX as u32],
    ) {
        let receiver = fed(&NavPvt { velocity, accuracies, ..NavPvt::GOOD }.bytes());
        let position = &receiver.solution().position;
        for (given, said) in position.velocity.into_iter().zip(velocity) {
            prop_assert_eq!(given.to_bits(), (decimal(said, 3) + 0.0).to_bits());
        }
        let given = [position.horizontal_accuracy, position.vertical_accuracy];
        prop_assert_eq!(given, accuracies.map(|said| decimal(said as i32, 3)));
    }

    /// Among any four messages in a row there is at least one before which no message was lost.
    #[test]
    fn messages_that_are_lost_now_and_then_do_not_lengthen_the_period(
        period in prop::sample::select(vec![25u32, 40, 100, 200, 250, 500, 1_000]),
        lost in proptest::collection::vec((0u32..20, 0u32..20, 0u32..20), 1..40),
    ) {
        let mut receiver = Receiver::new();
        let mut itow = 1_000;
        let mut send = |steps: u32| {
            itow += steps * period;
            feed(&mut receiver, &NavPvt::at(itow).bytes(), itow);
            receiver.solution().position.pace.period_ms()
        };
        send(1);
        prop_assert_eq!(send(1), period);
        for (first, second, third) in lost {
            for lost in [first, second, third, 0] {
                prop_assert_eq!(send(1 + lost), period);
            }
        }
    }

    // Shows REC-12.
    #[test]
    fn no_position_is_valid_longer_than_1150_ms_after_its_arrival(
        messages in proptest::collection::vec((any::<u32>(), 0u32..3_000), 1..60),
    ) {
        let mut receiver = Receiver::new();
        let mut now = 0;
        for (itow, later) in messages {
            now += later;
            feed(&mut receiver, &NavPvt::at(itow).bytes(), now);
            let pace = receiver.solution().position.pace;
            prop_assert!((20..=1_000).contains(&pace.period_ms()));
            prop_assert!(!pace.is_current(now + 1_151) && !pace.is_fresh(now + 1_050));
        }
    }

    #[test]
    fn how_the_bytes_are_cut_does_not_matter(cuts in proptest::collection::vec(1usize..90, 1..60)) {
        let mut stream = Vec::new();
        for epoch in 0..4 {
            stream.extend(NMEA);
            stream.extend(NavPvt { latitude: 470_000_000 + epoch, ..NavPvt::at(1_000 + 100 * epoch as u32) }.bytes());
            stream.extend([0xB5, 0xB5, 0x62, 0x01]);
            stream.extend(nav_att(1_000, [1, 2, 3], [1, 1, 1]));
            stream.extend(esf_ins(1_000, [true; 3], [10, 20, 30]));
        }
        stream.extend([0; BUFFER]);
        let whole = fed(&stream);
        let mut receiver = Receiver::new();
        let mut rest = stream.as_slice();
        let mut cuts = cuts.into_iter().cycle();
        while !rest.is_empty() {
            let (piece, after) = rest.split_at(cuts.next().unwrap_or(1).min(rest.len()));
            feed(&mut receiver, piece, 0);
            rest = after;
        }
        prop_assert_eq!(receiver.solution(), whole.solution());
        prop_assert_eq!(receiver.counts().messages, whole.counts().messages);
        prop_assert_eq!(whole.counts().messages, 12);
    }

    #[test]
    fn a_message_is_found_after_any_noise(noise in proptest::collection::vec(any::<u8>(), 0..600)) {
        // Noise may look like the beginning of a long message. Zeros that fill the parser's buffer end that message.
        let mut receiver = Receiver::new();
        feed(&mut receiver, &noise, 0);
        feed(&mut receiver, &[0; BUFFER + BYTES_PER_CALL], 0);
        let before = receiver.counts().messages;
        feed(&mut receiver, &NavPvt::GOOD.bytes(), 0);
        prop_assert_eq!(receiver.counts().messages, before + 1);
        prop_assert!(receiver.solution().position.valid);
    }

    #[test]
    fn one_flipped_bit_is_never_taken_for_a_position(bit in 0usize..800) {
        let mut bytes = NavPvt::GOOD.bytes();
        prop_assume!(bit < bytes.len() * 8);
        bytes[bit / 8] ^= 1 << (bit % 8);
        let receiver = fed(&[bytes, vec![0; BUFFER + BYTES_PER_CALL]].concat());
        prop_assert!(!receiver.solution().position.valid);
        prop_assert!(!receiver.solution().last_heard.within(0, u32::MAX / 2));
    }
}

#[test]
fn nmea_and_damage_are_passed_over_and_counted() {
    let good = NavPvt::GOOD.bytes();
    let mut damaged = good.clone();
    damaged[30] ^= 0x10;
    let stream = [NMEA, &damaged, NMEA, &good].concat();
    let receiver = fed(&stream);
    assert!(receiver.solution().position.valid);
    let counts = receiver.counts();
    assert_eq!((counts.messages, counts.damaged, counts.unusable), (1, 1, 0));
    assert_eq!(counts.bytes as usize, stream.len());
    assert_eq!(counts.skipped() as usize, stream.len() - good.len());
}

// Shows REC-11.
#[test]
fn zeros_behind_a_sync_do_not_tell_that_a_receiver_is_heard() {
    let receiver = fed(&[0xB5, 0x62, 0, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!((receiver.counts().messages, receiver.counts().damaged), (0, 1));
    assert!(!receiver.solution().last_heard.within(0, HEARD_MS));
    // A message of a kind that HORUS does not use makes the receiver count as heard.
    assert!(fed(&message(1, 0x35, &[0; 8])).solution().last_heard.within(0, HEARD_MS));
}

#[test]
fn a_message_longer_than_the_buffer_costs_only_itself() {
    let long = message(0x01, 0x35, &vec![0x55; 2 * BUFFER]);
    let receiver = fed(&[long, NavPvt::GOOD.bytes()].concat());
    assert_eq!(receiver.counts().unusable, 1);
    assert!(receiver.solution().position.valid);
}

#[test]
fn a_message_of_another_length_than_its_kind_has_is_not_used() {
    // In protocol 14, a NAV-PVT message had a payload of 84 bytes.
    let old = message(0x01, 0x07, &[0xFF; 84]);
    let receiver = fed(&old);
    assert_eq!(receiver.counts().messages, 1);
    assert_eq!(receiver.counts().skipped() as usize, old.len());
    assert_eq!(receiver.solution().position, Position::default());
}

#[test]
fn what_was_cut_off_is_no_message_once_the_line_is_silent() {
    let beginnings = [0xB5, 0x62, 0x01, 0x07, 0xFF, 0xFF].repeat(20);
    for whole in [NavPvt::at(1_000).bytes(), message(0x01, 0x03, &[]), beginnings] {
        for cut in 1..whole.len() {
            let mut receiver = Receiver::new();
            feed(&mut receiver, &whole[..cut], 1_000);
            for now in (1_010..1_000 + GAP_MS + 100).step_by(10) {
                receiver.receive(&[], now);
            }
            let (messages, heard) = (receiver.counts().messages, receiver.solution().last_heard);
            assert_eq!((messages, heard), (0, Receiver::new().solution().last_heard), "{cut} of {whole:02x?}");
        }
    }
}

#[test]
fn a_receiver_that_is_not_due_may_be_left_alone_without_bytes() {
    let whole = NavPvt::GOOD.bytes();
    for cut in [1, 7, 50, whole.len() - 1, whole.len()] {
        let (mut called, mut spared, mut calls) = (Receiver::new(), Receiver::new(), 0);
        for receiver in [&mut called, &mut spared] {
            feed(receiver, &nav_att(1_000, [1, 2, 3], [1, 1, 1]), 1_000);
            feed(receiver, &whole[..cut], 1_000);
        }
        for now in (1_010..70_000).step_by(10) {
            called.receive(&[], now);
            if spared.is_due(now) {
                spared.receive(&[], now);
                calls += 1;
            }
            assert_eq!((called.solution(), called.counts()), (spared.solution(), spared.counts()), "{cut}, at {now}");
        }
        assert!((1..20).contains(&calls), "{cut}: {calls} calls");
    }
}

#[test]
fn a_false_start_hides_a_message_only_until_the_line_is_silent() {
    // The header of a message of 200 bytes comes without its payload, and a whole message follows at once.
    let mut receiver = Receiver::new();
    feed(&mut receiver, &[&[0xB5, 0x62, 0x01, 0x07, 200, 0], NavPvt::GOOD.bytes().as_slice()].concat(), 1_000);
    assert!(!receiver.solution().position.valid);
    for now in (1_010..1_100).step_by(10) {
        receiver.receive(&[], now);
        assert_eq!(receiver.solution().position.valid, now >= 1_000 + GAP_MS + 20, "at {now}");
    }
    assert!(receiver.solution().last_heard.within(1_250, 250) && !receiver.solution().last_heard.within(1_251, 250));
    assert_eq!(receiver.counts().skipped(), 6, "what is filled in is nobody's bytes");
}

// Shows REC-10.
#[test]
fn only_a_fix_that_the_receiver_vouches_for_is_a_position() {
    let with = |fix, flags, flags3| {
        let receiver = fed(&NavPvt { fix, flags, flags3, ..NavPvt::GOOD }.bytes());
        receiver.solution().position.valid
    };
    let valid: Vec<u8> = (0..=255).filter(|fix| with(*fix, 1, 0)).collect();
    assert_eq!(valid, [2, 3, 4], "2D, 3D, GNSS with dead reckoning");
    assert!(!with(3, 0, 0), "without gnssFixOK");
    assert!(!with(3, 1, 1), "with invalidLlh");
    let off_the_earth = NavPvt { latitude: 900_000_001, ..NavPvt::GOOD };
    assert!(!fed(&off_the_earth.bytes()).solution().position.valid);
    let off_the_earth = NavPvt { longitude: -1_800_000_001, ..NavPvt::GOOD };
    assert!(!fed(&off_the_earth.bytes()).solution().position.valid);
    let date_line_at_the_pole = NavPvt { longitude: 1_800_000_000, latitude: -900_000_000, ..NavPvt::GOOD };
    assert!(fed(&date_line_at_the_pole.bytes()).solution().position.valid);
    let reserved = NavPvt { fix: 9, ..NavPvt::GOOD };
    assert_eq!(fed(&reserved.bytes()).solution().position.fix, None);
    assert_eq!(fed(&NavPvt::GOOD.bytes()).solution().position.fix, Some(FixType::Fix3D));
}

// Shows REC-6.
#[test]
fn only_a_plausible_position_is_valid_to_the_last_unit() {
    let valid = |message: NavPvt| fed(&message.bytes()).solution().position.valid;
    let accuracies = |horizontal, vertical| valid(NavPvt { accuracies: [horizontal, vertical], ..NavPvt::GOOD });
    assert!(accuracies(1, 1) && accuracies(30_000, 50_000));
    assert!(!accuracies(0, 1) && !accuracies(1, 0) && !accuracies(30_001, 1) && !accuracies(1, 50_001));
    assert!(!accuracies(u32::MAX, u32::MAX));
    let flat = |vertical| valid(NavPvt { fix: 2, accuracies: [30_000, vertical], ..NavPvt::GOOD });
    assert!(flat(0) && flat(u32::MAX), "the altitude of a 2D fix is not measured");
    let at = |height| valid(NavPvt { height, ..NavPvt::GOOD });
    assert!(at(-1_000_000) && at(20_000_000) && !at(-1_000_001) && !at(20_000_001));
    assert!(valid(NavPvt { fix: 2, height: i32::MAX, ..NavPvt::GOOD }));
    let moving = |velocity| valid(NavPvt { velocity, ..NavPvt::GOOD });
    assert!(moving([0, 0, -200_000]) && moving([-120_000, 160_000, 0]));
    assert!(!moving([0, 0, -200_001]) && !moving([-120_000, 160_000, 1_000]) && !moving([i32::MIN; 3]));
}

#[test]
fn attitude_is_in_radians_and_an_angle_without_accuracy_is_not_given() {
    let receiver = fed(&nav_att(0, [-1_000_000, 500_000, 27_000_000], [1, 1, 1]));
    let attitude = &receiver.solution().attitude;
    assert!(attitude.valid);
    assert_eq!(attitude.roll, (-10f64).to_radians() as f32);
    assert_eq!(attitude.pitch, 5f64.to_radians() as f32);
    assert_eq!(attitude.yaw, 270f64.to_radians() as f32);

    let receiver = fed(&nav_att(0, [1, 2, 3], [1, 1, 0]));
    let attitude = &receiver.solution().attitude;
    assert!(!attitude.valid && attitude.yaw.is_nan());
    assert!(!attitude.roll.is_nan() && !attitude.pitch.is_nan());
}

fn combinations() -> impl Iterator<Item = [bool; 3]> {
    (0..8).map(|bits| [0, 1, 2].map(|bit| bits >> bit & 1 == 1))
}

#[test]
fn attitude_is_valid_only_with_all_three_angles_whichever_are_missing() {
    for given in combinations() {
        let receiver = fed(&nav_att(0, [1, 2, 3], given.map(u32::from)));
        let attitude = &receiver.solution().attitude;
        assert_eq!([attitude.roll, attitude.pitch, attitude.yaw].map(|angle| !angle.is_nan()), given);
        assert_eq!(attitude.valid, given == [true; 3], "{given:?}");
    }
}

#[test]
fn acceleration_is_valid_only_with_all_three_axes_whichever_are_missing() {
    for given in combinations() {
        let receiver = fed(&esf_ins(0, given, [1, 2, 3]));
        let acceleration = &receiver.solution().acceleration;
        assert_eq!(acceleration.axes.map(|axis| !axis.is_nan()), given);
        assert_eq!(acceleration.valid, given == [true; 3], "{given:?}");
    }
}

#[test]
fn no_byte_of_the_messages_that_are_used_counts_as_skipped() {
    let messages = [NavPvt::GOOD.bytes(), nav_att(1_000, [1, 2, 3], [1; 3]), esf_ins(1_000, [true; 3], [1, 2, 3])];
    let mut receiver = Receiver::new();
    for message in messages {
        feed(&mut receiver, &message, 0);
        assert_eq!(receiver.counts().skipped(), 0);
    }
    assert_eq!(receiver.counts().messages, 3);
}

#[test]
fn each_axis_of_the_acceleration_has_its_own_validity() {
    let receiver = fed(&esf_ins(0, [true; 3], [123, -456, 7]));
    let acceleration = &receiver.solution().acceleration;
    assert!(acceleration.valid);
    assert_eq!(acceleration.axes, [1.23, -4.56, 0.07]);

    let receiver = fed(&esf_ins(0, [true, false, true], [123, -456, 7]));
    let acceleration = &receiver.solution().acceleration;
    assert!(!acceleration.valid && acceleration.axes[1].is_nan());
    assert_eq!((acceleration.axes[0], acceleration.axes[2]), (1.23, 0.07));
}

#[test]
fn a_solution_ages_by_the_receivers_own_period() {
    let mut receiver = Receiver::new();
    for epoch in 0..5 {
        feed(&mut receiver, &NavPvt::at(200 * epoch).bytes(), 200 * epoch);
    }
    let pace = receiver.solution().position.pace;
    assert_eq!(pace.period_ms(), 200);
    assert!(pace.is_fresh(800 + 249) && !pace.is_fresh(800 + 250), "stale from one period and 50 ms on");
    assert!(pace.is_current(800 + 350) && !pace.is_current(800 + 351), "valid up to one period and 150 ms");
}

#[test]
fn a_receiver_slower_than_one_hertz_counts_as_one_of_one_hertz() {
    let mut receiver = Receiver::new();
    for epoch in 0..6 {
        feed(&mut receiver, &NavPvt::at(5_000 * epoch).bytes(), 5_000 * epoch);
    }
    let pace = receiver.solution().position.pace;
    assert_eq!(pace.period_ms(), 1_000);
    assert!(pace.is_current(25_000 + 1_150) && !pace.is_current(25_000 + 1_151));
}

#[test]
fn a_longer_period_is_adopted_only_at_the_fourth_step() {
    let mut receiver = Receiver::new();
    let mut period_after = |itow| {
        feed(&mut receiver, &NavPvt::at(itow).bytes(), itow);
        receiver.solution().position.pace.period_ms()
    };
    assert_eq!([0, 100, 200, 400, 500].map(&mut period_after), [1_000, 100, 100, 100, 100], "one is lost");
    assert_eq!([1_500, 2_500, 3_500].map(&mut period_after), [100; 3]);
    assert_eq!(period_after(4_400), 900, "the shortest of the four");
    assert_eq!(period_after(4_500), 100);
}

#[test]
fn a_first_fix_between_two_epochs_shortens_the_period_for_four_messages() {
    let mut receiver = Receiver::new();
    let periods = [456, 1_000, 2_000, 3_000, 4_000, 5_000].map(|itow| {
        feed(&mut receiver, &NavPvt::at(itow).bytes(), itow);
        receiver.solution().position.pace.period_ms()
    });
    assert_eq!(periods, [1_000, 544, 544, 544, 544, 1_000]);
}

#[test]
fn a_receiver_that_restarts_at_an_earlier_time_is_accepted_at_once() {
    let mut receiver = Receiver::new();
    for itow in [100_000, 100_100, 100_200] {
        feed(&mut receiver, &NavPvt::at(itow).bytes(), itow);
    }
    feed(&mut receiver, &NavPvt::at(5_000).bytes(), 110_000);
    let pace = receiver.solution().position.pace;
    assert_eq!(pace.period_ms(), 100);
    assert!(pace.is_current(110_000));
    // A single step back of the time of week does not count among the four longer steps that make the period longer.
    let periods = [6_000, 7_000, 8_000, 9_000].map(|itow| {
        feed(&mut receiver, &NavPvt::at(itow).bytes(), 105_000 + itow);
        receiver.solution().position.pace.period_ms()
    });
    assert_eq!(periods, [100, 100, 100, 1_000]);
}

#[test]
fn the_period_survives_the_end_of_the_week() {
    let week = 604_800_000;
    let mut receiver = Receiver::new();
    for (now, itow) in [(0, week - 200), (100, week - 100), (200, 0), (300, 100)] {
        feed(&mut receiver, &NavPvt::at(itow).bytes(), now);
    }
    let pace = receiver.solution().position.pace;
    assert_eq!(pace.period_ms(), 100);
    assert!(pace.is_fresh(300));
}

#[test]
fn the_lag_is_the_arrival_less_the_time_of_week() {
    let week = 604_800_000;
    let mut receiver = Receiver::new();
    for (now, itow, lag) in [
        (0, week - 200, 200),
        (160, week - 100, 260),
        (300, 0, 300),
        (900, 0, 300),
        (week + 1_050, 1_000, 50),
        // These times of week lie beyond the end of the week. No receiver sends them.
        (week + 2_000, 2 * week + 300, 1_700),
        (u32::MAX, 0, u32::MAX % week),
    ] {
        feed(&mut receiver, &NavPvt::at(itow).bytes(), now);
        assert_eq!(receiver.solution().position.pace.lag_ms(), lag, "at {now} ms, {itow}");
    }
}

#[test]
fn a_step_over_the_weeks_end_gives_the_period_as_any_other() {
    let mut receiver = Receiver::new();
    for (now, itow) in [(0, 604_800_000 - 60), (100, 40)] {
        feed(&mut receiver, &NavPvt::at(itow).bytes(), now);
    }
    assert_eq!(receiver.solution().position.pace.period_ms(), 100);
}

#[test]
fn a_receiver_that_repeats_itself_ages_like_a_silent_one() {
    let mut receiver = Receiver::new();
    feed(&mut receiver, &NavPvt::at(0).bytes(), 0);
    for now in (100..5_000).step_by(100) {
        feed(&mut receiver, &NavPvt::at(100).bytes(), now);
    }
    let solution = receiver.solution();
    assert!(solution.last_heard.within(5_000, 250), "it is heard");
    assert!(!solution.position.pace.is_current(5_000), "but says nothing new");
}

#[test]
fn a_silent_receiver_still_counts_as_silent_when_the_clock_wraps() {
    let mut receiver = Receiver::new();
    feed(&mut receiver, &NavPvt::GOOD.bytes(), 100);
    for minute in 1..80_000u32 {
        receiver.receive(&[], minute.wrapping_mul(60_000));
        let now = minute.wrapping_mul(60_000).wrapping_add(50);
        assert!(!receiver.solution().last_heard.within(now, 250));
        assert!(!receiver.solution().position.pace.is_current(now));
    }
}

/// In recordings of real receivers, the parser must find exactly the NAV-PVT messages that a plain search finds. The
/// search looks for sync bytes and computes checksums by itself. Without recordings the test is skipped.
#[test]
fn recordings_of_real_receivers_are_read_in_full() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/ubx");
    let Ok(entries) = fs::read_dir(&folder) else {
        println!("skipped: no recordings beside the workspace");
        return;
    };
    let mut positions = 0;
    for entry in entries {
        let bytes = fs::read(entry.expect("a readable folder").path()).expect("a readable file");
        let expected: Vec<(f64, f64)> = (0..bytes.len().saturating_sub(99))
            .map(|at| &bytes[at..at + 100])
            .filter(|m| m[..6] == [0xB5, 0x62, 0x01, 0x07, 92, 0] && **m == message(0x01, 0x07, &m[6..98])[..])
            .map(|m| {
                let field = |at: usize| i32::from_le_bytes([m[at], m[at + 1], m[at + 2], m[at + 3]]);
                (decimal(field(34), 7), decimal(field(30), 7))
            })
            .collect();
        let mut receiver = Receiver::new();
        let (mut seen, mut itow) = (Vec::new(), receiver.solution().position);
        for (now, byte) in bytes.iter().enumerate() {
            let before = receiver.counts().messages;
            receiver.receive(&[*byte], now as u32 / 46);
            if receiver.counts().messages != before && receiver.solution().position != itow {
                itow = receiver.solution().position;
                seen.push((itow.latitude, itow.longitude));
            }
        }
        assert_eq!(seen, expected);
        positions += seen.len();
    }
    assert!(positions > 0, "the recordings hold positions");
    println!("{positions} positions");
}

#[test]
fn an_answer_to_a_configuration_message_is_given_once() {
    use horus_tx_fw::configuration::Answer;
    let mut receiver = Receiver::new();
    for (kind, answered, answer) in [
        (0x01, [0x06, 0x8A], Some(Answer::Taken)),
        (0x00, [0x06, 0x8A], Some(Answer::Refused)),
        (0x01, [0x06, 0x01], None),
        (0x00, [0x0A, 0x04], None),
    ] {
        feed(&mut receiver, &message(0x05, kind, &answered), 0);
        assert_eq!(receiver.take_answer(), answer);
        assert_eq!(receiver.take_answer(), None);
    }
    assert_eq!((receiver.counts().messages, receiver.counts().skipped()), (4, 20), "only answers are of use");
}
