//! Rows of the table of violations: how the flight controller and the base station use the objects that were read.

use bench::faults::{AirFaults, BaseFault, Fault, Faults, WireFault};
use bench_judge::Violation;

use super::{MS, Row, breaks, table};

fn for_a_while(fault: Fault) -> Faults {
    Faults::none().with(breaks(), breaks() + 40 * MS, fault)
}

table! {
    a_radio_that_drops_profiles => Row::new(Violation::BaseMissed, || {
        for_a_while(Fault::Wire(WireFault::RadioDrop))
    });
    // A single profile is disturbed. Several disturbed profiles would also disturb the radio's framing.
    a_radio_that_inverts_a_bit => Row::new(Violation::BaseChanged, || {
        Faults::none().with(breaks(), breaks() + 8 * MS, Fault::Wire(WireFault::RadioBit))
    });
    a_radio_that_mixes_profiles => Row::new(Violation::BaseMixed, || {
        for_a_while(Fault::Wire(WireFault::RadioMix))
    });
    a_base_station_that_does_not_check_what_it_shows => Row::new(Violation::BaseInvalid, || {
        for_a_while(Fault::Base(BaseFault::ShowsAll))
            .with(breaks(), breaks() + 40 * MS, Fault::Air(AirFaults { bit_error: 5e-4, ..AirFaults::default() }))
    });
    a_base_station_that_hides_a_valid_object => Row::new(Violation::BaseHidden, || {
        for_a_while(Fault::Base(BaseFault::Hides(2)))
    });
    a_flight_controller_that_keeps_an_old_position => Row::new(Violation::ClientWrong, || {
        Faults::none().with(breaks(), breaks() + 250 * MS, Fault::Wire(WireFault::ClientKeeps))
    });
    a_flight_controller_that_takes_all_for_new => Row::new(Violation::ClientAge, || {
        for_a_while(Fault::Wire(WireFault::ClientYoung))
    });
    a_flight_controller_that_is_given_no_position => Row::new(Violation::ClientHides, || {
        for_a_while(Fault::Wire(WireFault::ClientBlind))
    });
    a_flight_controller_that_forwards_nothing => Row::new(Violation::NotForwarded, || {
        for_a_while(Fault::Wire(WireFault::ClientMute))
    });
    // No further profile arrives, so the displayed age is wrong.
    a_base_station_that_takes_all_for_new => Row {
        duration: || 1_200 * MS,
        ..Row::new(Violation::StationAge, || {
            let lost = AirFaults { lost: 1.0, ..AirFaults::default() };
            let until = breaks() + 250 * MS;
            Faults::none().with(breaks(), until, Fault::Base(BaseFault::Young)).with(breaks(), until, Fault::Air(lost))
        })
    };
    // There is no position before the receivers' first solutions, so an alarm is required.
    a_base_station_that_alarms_nobody => Row::new(Violation::StationAlarm, || {
        Faults::none().with(0, u64::MAX, Fault::Base(BaseFault::Calm))
    });
}
