use super::*;
use proptest::prelude::*;

const DACCVIOL: u32 = 1 << 1;
const MSTKERR: u32 = 1 << 4;
const PRECISERR: u32 = 1 << 9;
const UNDEFINSTR: u32 = 1 << 16;

fn status(cfsr: u32) -> FaultStatus {
    FaultStatus { cfsr, mmfar: 0x0000_0004, bfar: 0x4001_0000 }
}

fn any_stop() -> impl Strategy<Value = Stop> {
    let cause = prop::sample::select(Cause::ALL.to_vec());
    let words = (any::<u32>(), any::<Option<u32>>(), any::<u32>(), any::<u32>());
    (cause, any::<u16>(), words, "[ -~]{0,40}").prop_map(|(cause, exception, (detail, address, pc, lr), path)| Stop {
        cause,
        exception,
        detail,
        address,
        pc,
        lr,
        place: Place::of(&path),
    })
}

proptest! {
    // Shows SAFE-14.
    #[test]
    fn what_was_recorded_is_what_is_read(stop in any_stop()) {
        prop_assert_eq!(Stop::from_words(&stop.to_words()), Some(stop));
    }

    // Shows SAFE-14.
    #[test]
    fn a_record_with_a_wrong_bit_is_none(stop in any_stop(), word in 0..WORDS, bit in 0_u32..32) {
        let mut words = stop.to_words();
        words[word] ^= 1 << bit;
        prop_assert_eq!(Stop::from_words(&words), None);
    }

    #[test]
    fn what_ram_holds_after_power_on_is_no_record(words in any::<[u32; WORDS]>()) {
        prop_assert_eq!(Stop::from_words(&words), None);
    }
}

#[test]
fn memory_without_a_stop_is_no_record_whether_zero_or_ones() {
    for word in [0, u32::MAX] {
        assert_eq!(Stop::from_words(&[word; WORDS]), None);
    }
    // A record with a right CRC and an unknown cause is no stop.
    let mut words = [0; WORDS];
    words[WORDS - 1] = check_word(&words);
    assert_eq!(Stop::from_words(&words), None);
}

#[test]
fn the_code_of_a_stop_has_its_cause_exception_and_detail() {
    let code = |cfsr, exception| Stop::of_fault(status(cfsr), None, exception).code();
    assert_eq!(code(DACCVIOL | 1 << 7, 20), 0x0114_0002);
    assert_eq!(code(PRECISERR | 1 << 15, 0), 0x0200_0002);
    assert_eq!(code(UNDEFINSTR | 1 << 25, 16), 0x0310_0201);
    assert_eq!(code(0, 255), 0x04FF_0000);
    assert_eq!(Stop::of_panic("src/main.rs", 70_000, 300).code(), 0x05FF_0000 | 70_000 & 0xFFFF);
    assert_eq!(Stop::new(Cause::GuardWord, 0, 3).code(), 0x0900_0003);
    for cause in Cause::ALL {
        assert_ne!(Stop::new(cause, 0, 0).code(), 0, "{cause:?}");
    }
}

#[test]
fn a_fault_with_several_causes_is_reported_as_memory_protection_first() {
    let of = |cfsr| Stop::of_fault(status(cfsr), Some((1, 2)), 0);
    assert_eq!(of(DACCVIOL).cause, Cause::MemoryProtection);
    assert_eq!(of(MSTKERR | PRECISERR | UNDEFINSTR).cause, Cause::MemoryProtection);
    assert_eq!(of(PRECISERR | UNDEFINSTR).cause, Cause::BusFault);
    assert_eq!(of(UNDEFINSTR).cause, Cause::UsageFault);
    assert_eq!(of(0).cause, Cause::HardFault);
    // The CFSR's bits that mark an address as valid are no cause by themselves.
    assert_eq!(of(1 << 7 | 1 << 15).cause, Cause::HardFault);
    assert_eq!((of(0).lr, of(0).pc), (1, 2));
}

#[test]
fn the_address_is_the_one_that_is_valid() {
    let of = |cfsr| Stop::of_fault(status(cfsr), None, 0).address;
    assert_eq!(of(DACCVIOL | 1 << 7), Some(4));
    assert_eq!(of(PRECISERR | 1 << 15), Some(0x4001_0000));
    assert_eq!(of(DACCVIOL), None);
    assert_eq!(of(PRECISERR), None);
}

#[test]
fn a_frame_that_could_not_be_stacked_is_not_believed() {
    assert!(status(DACCVIOL).has_frame() && status(UNDEFINSTR).has_frame());
    assert!(!status(MSTKERR).has_frame() && !status(1 << 12).has_frame());
}

#[test]
fn a_stop_is_told_in_words() {
    let fault = Stop::of_fault(status(DACCVIOL | 1 << 7), Some((0x801, 0x0800_1234)), 16);
    assert_eq!(fault.to_string(), "memory protection, data access at 0x00000004, pc 0x08001234");
    let stack = Stop::of_fault(status(MSTKERR), None, 16);
    assert_eq!(stack.to_string(), "memory protection, exception entry");
    assert_eq!(Stop::of_fault(status(UNDEFINSTR), None, 0).to_string(), "usage fault, undefined instruction");
    let bus = Stop::of_fault(status(PRECISERR | 1 << 15), None, 0);
    assert_eq!(bus.to_string(), "bus fault, data access at 0x40010000");
    assert_eq!(Stop::of_fault(status(0), None, 0).to_string(), "hard fault, no more is known");
    assert_eq!(Stop::of_panic("dpr-fw/src/main.rs", 12, 0).to_string(), "panic at dpr-fw/src/main.rs:12");
    assert_eq!(Stop::new(Cause::Flash, 0, 0xAB).to_string(), "flash changed (0xab)");
}

#[test]
fn of_a_long_path_the_end_is_kept() {
    let path = "/a/rather/long/path/to/a/file/of/rust.rs";
    assert_eq!(Place::of(path).text(), &path[path.len() - Place::LEN..]);
    assert_eq!(Place::of("").text(), "");
    assert_eq!(Place::of("x").text(), "x");
}

/// A single test covers the whole record, since all tests of a process share the statics.
#[test]
fn only_the_first_stop_since_the_start_is_kept_and_taken_once() {
    assert_eq!((take(), code()), (None, 0));
    let first = Stop::new(Cause::GuardWord, 0, 1);
    note(&first);
    note(&Stop::new(Cause::Panic, 0, 2));
    assert_eq!(take(), Some(first));
    assert_eq!(code(), first.code());
    assert_eq!(take(), None);
    assert_eq!(code(), 0);
}
