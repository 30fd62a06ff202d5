//! Rows of the table of violations about the active hold.

use bench::faults::hold::Break;
use bench::faults::{Fault, Faults, HoldFault, WireFault};
use bench::sim::Setup;
use bench_judge::Violation;

use super::{MS, Row, breaks, table};
use crate::boards;

/// Adds a hold to the setup.
fn with_hold(setup: &mut Setup) {
    let image = |name| boards::image(setup.gps, name).expect("the images were built");
    (setup.images.dpr, setup.hold) = (image("dpr-fw-hold.elf"), Some(boards::hold_image().expect("it was built")));
    setup.writes = true;
}

/// Returns a row with a hold beside the link and a run of 4 s.
const fn row(violation: Violation, faults: fn() -> Faults) -> Row {
    Row { duration: || 4_000 * MS, setup: with_hold, ..Row::new(violation, faults) }
}

fn constant(of: u32, value: u32) -> Faults {
    Faults::none().with(0, u64::MAX, Fault::Hold(HoldFault::Constant { of, value }))
}

/// A hold whose box is cold.
fn cold(setup: &mut Setup) {
    setup.seed = 2;
    with_hold(setup);
}

fn broken(what: Break) -> Faults {
    Faults::none().with(2_000 * MS, 4_000 * MS, Fault::Hold(HoldFault::Broken(what)))
}

table! {
    a_hold_that_sends_nothing => row(Violation::HoldSilent, || broken(Break::Mute));
    // The firmware checks the length of its cycle by a second timer, so the length expected there is changed as well.
    a_hold_with_a_cycle_of_96_ms => row(Violation::HoldEarly, || {
        let expected = Fault::Hold(HoldFault::Constant { of: 24_500, value: 23_500 });
        constant(25_000, 24_000).with(0, u64::MAX, expected)
    });
    a_hold_that_heats_with_its_whole_power => Row {
        setup: cold,
        ..row(Violation::HoldHeats, || constant(0.8_f32.to_bits(), 1.0_f32.to_bits()))
    };
    a_map_with_another_temperature => row(Violation::HoldShown, || {
        let forged = WireFault::MisoForgedPort { object: 3, byte: 9, bits: 1 };
        Faults::none().with(breaks(), breaks() + 500 * MS, Fault::Wire(forged))
    });
    a_second_front_end_that_hears_nothing => row(Violation::HoldHidden, || broken(Break::PortDeaf));
    uplinks_in_an_answer_that_nobody_wrote => row(Violation::HoldAnswer, || broken(Break::Uplinks));
    a_second_front_end_that_does_not_answer => row(Violation::HoldUnanswered, || broken(Break::PortMute));
    a_hold_with_another_set_point => row(Violation::HoldCommand, || broken(Break::SetPoint));
    a_hold_that_hears_no_answer => row(Violation::HoldIgnores, || broken(Break::Deaf));
    a_lock_that_is_open => row(Violation::HoldOutput, || broken(Break::Lock));
    a_sensor_that_is_misused => row(Violation::HoldComplains, || broken(Break::Misuse));
}
