//! The suite of HORUS (STM32F429): the profile's code, the filling of a cycle's objects, and their cycles.
#![no_std]
#![no_main]

#[path = "horus/gnss.rs"]
mod gnss;
#[path = "horus/transmitter.rs"]
mod transmitter;

use defmt_rtt as _;
use panic_probe as _;
use stm32f4xx_hal as _; // this crate brings the interrupt vectors

#[defmt_test::tests]
mod tests {
    use super::{gnss, transmitter};
    use horus_tx_fw::timing;
    use on_target_tests::{
        cycles::{bounds, Cycles},
        profile_suite as profile,
    };
    use stm32f4xx_hal::{pac, prelude::*, rcc::Config};

    #[init]
    fn init() -> Cycles {
        let core = defmt::unwrap!(cortex_m::Peripherals::take());
        let device = defmt::unwrap!(pac::Peripherals::take());
        // The suite runs on the firmware's clocks, since a board's wait states of the flash depend on the clock.
        let config = Config::hse(8.MHz())
            .bypass_hse_oscillator()
            .sysclk(timing::CORE_HZ.Hz())
            .hclk(timing::CORE_HZ.Hz())
            .pclk1(timing::APB1_HZ.Hz())
            .pclk2(timing::APB2_HZ.Hz());
        let rcc = device.RCC.freeze(config);
        defmt::assert_eq!(rcc.clocks.hclk().raw(), timing::CORE_HZ);
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
        // After each of four objects is checked, the code jumps to an address that it reads from flash. With four wait
        // states the time of each jump may differ by up to 8 cycles, so the time of verifying may vary by 32 cycles.
        profile::bounds(cycles, bounds(3_500, 2_700, 7_600, 0), bounds(2_900, 1_600, 6_200, 4 * 8));
    }

    #[test]
    fn a_cycle_is_filled_and_sealed_in_bounded_and_constant_cycles(cycles: &mut Cycles) {
        gnss::fill(cycles);
    }

    #[test]
    fn what_a_receiver_says_is_parsed_in_bounded_cycles(cycles: &mut Cycles) {
        gnss::receive(cycles);
    }

    #[test]
    fn a_profile_is_offered_and_fired_in_bounded_and_constant_cycles(cycles: &mut Cycles) {
        transmitter::cycle(cycles);
    }

    #[test]
    fn a_function_whose_work_depends_on_the_data_is_found_out(cycles: &mut Cycles) {
        on_target_tests::cycles::a_dependence_is_seen(cycles);
    }
}
