//! On-target suite of the DPR (nRF52840): the profile's code, buffer rotation and scrub, and their cycles.
#![no_std]
#![no_main]

use defmt_rtt as _;
use nrf52840_hal as _; // the interrupt vectors
use panic_probe as _;

#[defmt_test::tests]
mod tests {
    use dpr_fw::triple::{Rotated, Rotation, Scrubbed, Spent};
    use on_target_tests::{cycles::Cycles, profile_suite as profile};

    /// Words of a receive buffer of this suite: LEN, 254 bytes of payload and CRC-16, rounded up.
    const WORDS: usize = 65;

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
        profile::bounds(cycles, 6_000, 5_000);
    }

    #[test]
    fn the_three_roles_rotate_and_every_buffer_is_clean_when_written() {
        let (mut filling, mut rotation, found) = Rotation::<[u32; WORDS], u32>::new([[u32::MAX; WORDS]; 3]);
        defmt::assert_eq!(found.stuck_bits, 0);
        for frame in 1..=9 {
            defmt::assert!(filling.memory().iter().all(|word| *word == 0));
            filling.memory().fill(frame);
            let (next, rotated) = rotation.rotate(filling, frame);
            filling = next;
            defmt::assert!(rotated == Rotated::Handed);
            let read = defmt::unwrap!(rotation.read());
            defmt::assert_eq!(*read.about(), frame);
            defmt::assert!(read.memory().iter().all(|word| *word == frame));
            rotation.done(read);
            let (clean, found) = defmt::unwrap!(rotation.dirty()).scrub();
            defmt::assert_eq!(found.stuck_bits, 0);
            rotation.cleaned(clean);
        }
    }

    #[test]
    fn rotation_and_scrub_take_bounded_and_constant_cycles(cycles: &mut Cycles) {
        // Two fills and two readings of 65 words cannot take less than one cycle a word each: a scrub that the compiler
        // dropped would show.
        let taken = cycles.over([[0; WORDS], [u32::MAX; WORDS], [0xA5A5_5A5A; WORDS]], |words| {
            let (_, found) = Spent::new(*words).scrub();
            defmt::assert!(found == Scrubbed { stuck_bits: 0 });
        });
        defmt::assert!(taken.min >= 4 * WORDS as u32);
        taken.assert("scrub of a receive buffer", 6_000, 32);

        let (filling, mut rotation, _) = Rotation::<[u32; WORDS], u32>::new([[0; WORDS]; 3]);
        let mut filling = Some(filling);
        let taken = cycles.over([1, 2, 3, 4], |frame| {
            let (next, _) = rotation.rotate(defmt::unwrap!(filling.take()), *frame);
            filling = Some(next);
            let read = defmt::unwrap!(rotation.read());
            rotation.done(read);
            let (clean, _) = defmt::unwrap!(rotation.dirty()).scrub();
            rotation.cleaned(clean);
        });
        taken.assert("rotation through all three roles", 9_000, 64);
    }
}
