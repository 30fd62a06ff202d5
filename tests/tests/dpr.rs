//! The suite of the DPR (nRF52840): the profile's code, the rotation and the scrub of buffers, and their cycles.
#![no_std]
#![no_main]

#[path = "dpr/commit.rs"]
mod commit;
#[path = "dpr/frames.rs"]
mod frames;
#[path = "dpr/listener.rs"]
mod listener;
#[path = "dpr/ssi.rs"]
mod ssi;

use defmt_rtt as _;
use dpr_fw::triple::Memory;
use nrf52840_hal::pac; // this crate also brings the interrupt vectors
use panic_probe as _;

/// The address at which code in RAM is fetched, and the number of its bytes for which the suite has room (build.rs).
const HOT: usize = 0x0080_0000;
const HOT_SIZE: usize = 128 * 1024;

/// The number of words in a receive buffer of this suite: LEN, 254 bytes of payload and CRC-16, rounded up.
const WORDS: usize = 65;

/// Fills a buffer with a pattern and reads it back, as a scrub does with each of its two patterns. Sound memory has no
/// bit that differs.
///
/// The function is inlined as it is in a scrub, so that the compiler generates the same code for both places.
#[inline(always)]
fn pass(memory: &mut [u32; WORDS], pattern: u32) {
    memory.fill(pattern);
    defmt::assert!(memory.differing_bits(pattern) == 0);
}

// The suite starts no watchdog, because it would have to feed it.
firmware_common::install_start!([]);

#[defmt_test::tests]
mod tests {
    use super::{commit, listener, pac, pass, ssi, HOT, HOT_SIZE, WORDS};
    use ::profile::crc::frame as frame_crc;
    use dpr_fw::triple::{Dirty, Rotated, Rotation, Scrubbable};
    use on_target_tests::{
        cycles::{bounds, Cycles},
        profile_suite as profile,
    };

    #[init]
    fn init() -> Cycles {
        let core = defmt::unwrap!(cortex_m::Peripherals::take());
        let device = defmt::unwrap!(pac::Peripherals::take());
        firmware_common::nrf52840::open_debug_port(&device.FICR, &device.UICR);
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
        profile::bounds(cycles, bounds(3_500, 2_700, 3_700, 0), bounds(2_900, 1_600, 2_300, 16));
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
            let outcome = defmt::unwrap!(rotation.take_dirty()).scrub();
            defmt::assert_eq!(rotation.scrubbed(outcome).stuck_bits, 0);
        }
    }

    #[test]
    fn a_scrub_takes_both_of_its_passes(cycles: &mut Cycles) {
        let mut memory = [0xA5A5_5A5A; WORDS];
        let ones = cycles.over([()], |()| pass(&mut memory, u32::MAX));
        let zeros = cycles.over([()], |()| pass(&mut memory, 0));
        // The buffer is used through a reference, as in the firmware. So no copy of it is timed.
        let scrub = cycles.over([()], |()| {
            defmt::assert!(Dirty::new(&mut memory).scrub().is_ok());
        });
        // Reading a word back and counting its bits takes more than two instructions, so a scrub that leaves this out
        // is too fast.
        ones.assert_at_least("fill and read-back of ones", 2 * WORDS as u32);
        zeros.assert_at_least("fill and read-back of zeros", 2 * WORDS as u32);
        // A scrub must take at least 15/16 of the time of both passes timed alone. The rest allows for reading the
        // cycle counter and, on a board, for where the code lies in the flash. A scrub that does not read back is still
        // found, because reading back takes nine tenths of a pass.
        let both = ones.min + zeros.min;
        scrub.assert_at_least("both passes of a scrub", both - both / 16);
    }

    #[test]
    fn rotation_and_scrub_take_bounded_and_constant_cycles(cycles: &mut Cycles) {
        let taken = cycles.over([[0; WORDS], [u32::MAX; WORDS], [0xA5A5_5A5A; WORDS]], |words| {
            defmt::assert!(Dirty::new(*words).scrub().is_ok());
        });
        taken.assert("Dirty::scrub", bounds(4_000, 2_700, 3_200, 0));

        let mut buffers = [[0; WORDS]; 3];
        let (filling, mut rotation, _) = Rotation::<&mut [u32; WORDS], u32>::new(buffers.each_mut());
        let mut filling = Some(filling);
        let taken = cycles.over([1, 2, 3, 4], |frame| {
            let (next, _) = rotation.rotate(defmt::unwrap!(filling.take()), *frame);
            filling = Some(next);
            let read = defmt::unwrap!(rotation.read());
            rotation.done(read);
            let outcome = defmt::unwrap!(rotation.take_dirty()).scrub();
            rotation.scrubbed(outcome);
        });
        taken.assert("rotation through all three roles", bounds(1_500, 1_400, 1_900, 0));
    }

    #[test]
    fn what_arrives_is_verified_in_bounded_and_constant_cycles(cycles: &mut Cycles) {
        commit::follow(cycles);
        commit::judge(cycles);
    }

    #[test]
    fn a_frame_becomes_an_image_in_bounded_and_constant_cycles(cycles: &mut Cycles) {
        commit::frame(cycles);
    }

    #[test]
    fn a_deadline_and_link_status_take_bounded_and_constant_cycles(cycles: &mut Cycles) {
        commit::deadline(cycles);
        commit::seal(cycles);
    }

    #[test]
    fn a_frame_is_read_in_steps_of_bounded_and_constant_cycles(cycles: &mut Cycles) {
        listener::steps(cycles);
    }

    #[test]
    fn buffers_are_handed_over_in_bounded_and_constant_cycles(cycles: &mut Cycles) {
        ssi::rotation(cycles);
        ssi::exchange(cycles);
    }

    #[test]
    fn a_transaction_is_answered_in_bounded_and_constant_cycles(cycles: &mut Cycles) {
        ssi::windows(cycles);
        ssi::serve(cycles);
    }

    #[test]
    fn what_the_flight_controller_wrote_is_judged_in_bounded_cycles(cycles: &mut Cycles) {
        ssi::port(cycles);
    }

    #[test]
    fn the_code_under_test_runs_from_ram_as_in_the_image() {
        let addresses = [
            dpr_fw::accept::Early::follow::<{ dpr_fw::RECEIVERS }> as fn(&mut dpr_fw::accept::Early, &[u8]) as usize,
            frame_crc as fn(&[u8]) -> u32 as usize,
        ];
        for address in addresses {
            defmt::assert!((HOT..HOT + HOT_SIZE).contains(&address), "{=usize:#x}", address);
        }
    }

    #[test]
    fn a_function_whose_work_depends_on_the_data_is_found_out(cycles: &mut Cycles) {
        on_target_tests::cycles::a_dependence_is_seen(cycles);
    }
}
