//! The suite of the active hold (nRF52840): what its firmware does in each cycle, and the cycles that it takes.
#![no_std]
#![no_main]

#[path = "hold/link.rs"]
mod link;
#[path = "hold/patrol.rs"]
mod patrol;
#[path = "hold/state.rs"]
mod state;

use defmt_rtt as _;
use nrf52840_hal::pac; // this crate also brings the interrupt vectors
use panic_probe as _;

// The suite starts no watchdog, because it would not feed one.
firmware_common::install_start!([]);

#[defmt_test::tests]
mod tests {
    use super::{link, pac, patrol, state};
    use on_target_tests::{cycles::Cycles, profile_suite as profile};

    #[init]
    fn init() -> Cycles {
        let core = defmt::unwrap!(cortex_m::Peripherals::take());
        let device = defmt::unwrap!(pac::Peripherals::take());
        firmware_common::nrf52840::open_debug_port(&device.FICR, &device.UICR);
        // The suite enables the flash cache like the firmware. Without it each access to flash has its wait states.
        device.NVMC.icachecnf.write(|w| w.cacheen().enabled());
        Cycles::start(core.DCB, core.DWT)
    }

    #[test]
    fn both_crcs_give_their_check_values() {
        profile::check_values();
    }

    #[test]
    fn the_control_and_hold_status_take_bounded_and_constant_cycles(cycles: &mut Cycles) {
        state::control(cycles);
        state::cycle(cycles);
    }

    #[test]
    fn commands_are_executed_and_kept_in_bounded_cycles(cycles: &mut Cycles) {
        state::keep(cycles);
        state::command(cycles);
    }

    #[test]
    fn a_frame_is_offered_sent_and_answered_in_bounded_cycles(cycles: &mut Cycles) {
        link::exchange(cycles);
    }

    #[test]
    fn a_slice_of_the_patrol_takes_bounded_and_constant_cycles(cycles: &mut Cycles) {
        patrol::slices(cycles);
    }

    #[test]
    fn a_function_whose_work_depends_on_the_data_is_found_out(cycles: &mut Cycles) {
        on_target_tests::cycles::a_dependence_is_seen(cycles);
    }
}
