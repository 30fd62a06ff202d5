//! Rows: what the base station shows against what was forwarded.

use bench::faults::{AirFaults, BaseFault, Fault, Faults, WireFault};
use bench_judge::Violation;

use super::{MS, Row, breaks, table};

/// For 40 ms.
fn for_a_while(fault: Fault) -> Faults {
    Faults::none().with(breaks(), breaks() + 40 * MS, fault)
}

table! {
    a_radio_that_drops_profiles => Row::new(Violation::BaseMissed, || {
        for_a_while(Fault::Wire(WireFault::RadioDrop))
    });
    // For one profile: of many, some would be damaged in their framing and so be missed.
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
}
