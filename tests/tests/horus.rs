//! On-target suite of the HORUS side (STM32F429): the profile's code and its cycles.
#![no_std]
#![no_main]

use defmt_rtt as _;
use panic_probe as _;
use stm32f4xx_hal as _; // the interrupt vectors

#[defmt_test::tests]
mod tests {
    use on_target_tests::{cycles::Cycles, profile_suite as profile};

    #[init]
    fn init() -> Cycles {
        let core = defmt::unwrap!(cortex_m::Peripherals::take());
        Cycles::start(core.DCB, core.DWT)
    }

    #[test]
    fn both_crcs_give_their_check_values() {
        profile::check_values();
    }

    #[test]
    fn a_sealed_profile_verifies_and_gives_its_values_back() {
        profile::seal_and_verify();
    }

    #[test]
    fn every_single_wrong_bit_is_found() {
        profile::every_wrong_bit_is_found();
    }

    #[test]
    fn scrubbed_and_misplaced_objects_are_rejected() {
        profile::nothing_but_the_object_in_its_place();
    }

    #[test]
    fn sealing_and_verifying_take_bounded_and_constant_cycles(cycles: &mut Cycles) {
        profile::bounds(cycles, 16_000, 16_000);
    }
}
