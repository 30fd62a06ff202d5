//! Measures the time of a cycle's control step and Hold-Status, and of commands, which are executed and kept.

use core::{hint::black_box, sync::atomic::AtomicU32};

use hold_fw::{
    climate::Climate,
    kept::{Keeper, Kept, Memory, WORDS},
    sensors::Readings,
    state::Hold,
    telemetry::Telemetry,
};
use on_target_tests::cycles::{bounds, Cycles, Taken};
use profile::{
    criticality::{BaseStation, FlightController, Writer, WritesUplink},
    hold::{Acknowledged, Answer, Outcome, Sender},
    HoldCommand, ResetReason, Uplink, UplinkValues,
};

/// The records of this suite, which each hold takes over from the one before.
static MEMORY: Memory = [const { [const { AtomicU32::new(0) }; WORDS] }; 2];

pub(crate) fn hold() -> Hold {
    Hold::new(ResetReason::PowerOn, Keeper::take(&MEMORY))
}

/// Readings that are absent, at rest, beyond every limit, and as extreme as an f32 can be.
pub(crate) const READINGS: [(Readings, Option<f32>); 6] = {
    const fn readings(climate: Option<[f32; 2]>, vibration: Option<[f32; 3]>, shock: Option<f32>) -> Readings {
        Readings { climate, vibration, shock, fault: climate.is_none() }
    }
    [
        (readings(None, None, None), None),
        (readings(Some([20.0, 40.0]), Some([1.0, 2.0, 3.0]), Some(9.0)), Some(3.0)),
        (readings(Some([-40.0, 100.0]), Some([78.0; 3]), Some(156.0)), Some(3.6)),
        (readings(Some([125.0, 0.0]), Some([0.0; 3]), None), Some(0.0)),
        (readings(Some([f32::MAX, f32::MIN_POSITIVE]), None, Some(f32::MAX)), None),
        (readings(None, Some([f32::MIN_POSITIVE / 2.0; 3]), Some(0.0)), Some(2.9)),
    ]
};

/// Times a step of the control with a temperature, from rest and from each limit of its output, and without one.
pub(crate) fn control(cycles: &Cycles) {
    let valid = [-40.0, 0.0, 19.95, 20.0, 45.0, f32::MIN_POSITIVE / 2.0, f32::MAX].map(Some);
    let [mut with, mut without] = [Taken::NONE; 2];
    for before in [20.0, -40.0, 125.0] {
        let prepare = |_: &&Option<f32>| {
            let mut climate = Climate::new(20.0);
            for _ in 0..30 {
                climate.step(Some(before), true);
            }
            climate
        };
        // One place in the code makes all steps, so that each runs the same copy of it.
        for (inputs, taken) in [(&valid[..], &mut with), (&[None, Some(f32::NAN)], &mut without)] {
            let here = cycles.over_prepared(inputs, prepare, |celsius, climate| climate.step(**celsius, true));
            taken.note(here.min);
            taken.note(here.max);
        }
    }
    with.assert("Climate::step", bounds(400, 230, 900, 64));
    without.assert("Climate::step, no temperature", bounds(110, 80, 250, 16));
}

/// Times the task `cycle` without its registers: the control step, and Hold-Status filled and sealed.
pub(crate) fn cycle(cycles: &Cycles) {
    let [mut with, mut without] = [Taken::NONE; 2];
    for (readings, supply) in READINGS {
        let taken = cycles.over_prepared(
            [()],
            |()| (hold(), readings),
            |(), (hold, readings)| {
                let (status, _) = hold.cycle(black_box(7), readings, black_box(supply));
                status
            },
        );
        if readings.climate.is_some() { &mut with } else { &mut without }.note(taken.max);
    }
    with.assert("Hold::cycle", bounds(1_200, 850, 3_100, 128));
    without.assert("Hold::cycle, no temperature", bounds(900, 700, 2_400, 192));
}

/// Times the write of a record, and the reading of both at a start.
pub(crate) fn keep(cycles: &Cycles) {
    let kept = [0, 1, u16::MAX].map(|number| Kept {
        locked: number == 0,
        set_point: f32::from(number),
        acknowledged: [Acknowledged::new(number, Outcome::TooOld), Acknowledged::new(!number, Outcome::Done)],
    });
    let taken = cycles.over_prepared(kept, |_| Keeper::take(&MEMORY).0, |kept, keeper| keeper.keep(kept));
    taken.assert("Keeper::keep", bounds(230, 190, 650, 16));
    let taken = cycles.over(kept, |kept| {
        let (_, newest) = Keeper::take(&MEMORY);
        defmt::assert!(newest.is_some());
        kept.locked
    });
    taken.assert("Keeper::take", bounds(480, 380, 1_350, 8));
}

fn fill<W: WritesUplink>(answer: &mut Answer, sender: &Sender<W>, writer: Writer<W>, tick: u32) {
    let mut values = UplinkValues { timestamp: 80 * tick, ..UplinkValues::default() };
    sender.fill(&mut values.payload);
    answer.set_uplink(writer, Uplink::seal(writer, &values));
}

/// Returns a hold in cycle 4 that has heard both writers, and an answer in which each of them sends `command`.
pub(crate) fn commanded(command: HoldCommand, telemetry: &Telemetry) -> (Hold, Answer) {
    let (mut hold, mut answer) = (hold(), Answer::EMPTY);
    let mut base_station = Sender::<BaseStation>::new();
    let mut flight_controller = Sender::<FlightController>::new();
    for tick in 1..=4 {
        let (mut readings, supply) = READINGS[1];
        let (status, _) = hold.cycle(tick, &mut readings, supply);
        base_station.observe(status.as_object());
        flight_controller.observe(status.as_object());
        if tick == 4 {
            defmt::assert!(base_station.send(&command).is_some() && flight_controller.send(&command).is_some());
        }
        fill(&mut answer, &base_station, Writer::claim(), tick);
        fill(&mut answer, &flight_controller, Writer::claim(), tick);
        if tick < 4 {
            hold.command(&answer, tick, telemetry);
        }
    }
    (hold, answer)
}

/// Times the task `answer` without its registers: commands of both writers, damaged ones, and an answer without any.
pub(crate) fn command(cycles: &Cycles) {
    let telemetry = Telemetry::new();
    let commands =
        [HoldCommand::SetPoint(25.0), HoldCommand::SetPoint(f32::NAN), HoldCommand::Lock, HoldCommand::ClearShock];
    let taken = cycles.over_prepared(
        commands,
        |command| commanded(*command, &telemetry),
        |_, (hold, answer)| hold.command(answer, 4, &telemetry),
    );
    defmt::assert_eq!((telemetry.commands_done.get(), telemetry.commands_refused.get()), (12, 4));
    taken.assert("Hold::command, one of each writer", bounds(1_600, 1_200, 4_600, u32::MAX));
    let taken = cycles.over_prepared(
        [None, Some(40), Some(100)],
        |damaged| {
            let (hold, answer) = commanded(HoldCommand::Lock, &telemetry);
            let mut bytes = *answer.as_bytes();
            match damaged {
                Some(at) => bytes[*at] ^= 1,
                None => bytes.fill(0),
            }
            (hold, *defmt::unwrap!(Answer::read(&bytes).ok()))
        },
        |_, (hold, answer)| hold.command(answer, 4, &telemetry),
    );
    taken.assert("Hold::command, damaged or none", bounds(1_450, 1_100, 4_200, u32::MAX));
}
