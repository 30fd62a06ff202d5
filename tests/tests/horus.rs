//! On-target suite of the HORUS side (STM32F429): the profile's code, the filling of a cycle's objects, and their
//! cycles.
#![no_std]
#![no_main]

use defmt_rtt as _;
use panic_probe as _;
use stm32f4xx_hal as _; // the interrupt vectors

#[defmt_test::tests]
mod tests {
    use horus_tx_fw::{
        cycle::Cycle,
        receiver::{Attitude, Position, Solution},
        timing,
    };
    use on_target_tests::{cycles::Cycles, profile_suite as profile};
    use stm32f4xx_hal::{pac, prelude::*, rcc::Config};

    #[init]
    fn init() -> Cycles {
        let core = defmt::unwrap!(cortex_m::Peripherals::take());
        let device = defmt::unwrap!(pac::Peripherals::take());
        // The flight image's clocks: on a board, flash wait states and with them cycles depend on the clock.
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
        profile::bounds(cycles, 6_000, 5_000);
    }

    #[test]
    fn a_cycle_is_filled_and_sealed_in_bounded_and_constant_cycles(cycles: &mut Cycles) {
        let silent = [Solution::default(); profile::RECEIVERS];
        let mut heard = silent;
        for solution in &mut heard {
            solution.position =
                Position { valid: true, latitude: 47.4979, longitude: 8.7289, altitude: 470.0, ..Position::default() };
            solution.attitude = Attitude { valid: true, pitch: 0.1, roll: -0.2, yaw: 3.0, ..Attitude::default() };
        }
        let taken = cycles.over([(1, silent), (2, heard), (u32::MAX, heard), (0, silent)], |(tick, solutions)| {
            Cycle::new().fill(*tick, solutions)
        });
        // The tick-to-air slot leaves 43 200 cycles to fill, seal and load; loading takes 32 000 of them.
        taken.assert("fill and seal of a cycle", 8_000, 64);
    }
}
