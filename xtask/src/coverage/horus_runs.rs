//! The runs for HORUS alone, each a visit of one failure after the other.
//!
//! | run | what fails |
//! |---|---|
//! | horus: buses | the receiver on I2C holds a line in each part of its transactions; the DMA streams stop |
//! | horus: late tasks | each task is late by more than two cycles, while a receiver talks without a pause |
//! | horus: kept state | a bit of the state of the cycle, of a solution, of a receiver, and of the count of ticks |
//!
//! The judge's verdict is not asked for, since HORUS stops in many of them.

use bench::faults::receivers::{BusFault, ReceiverFault};
use bench::faults::{Board, Fault, Faults, InputFault, Upset, interrupt_of, tasks_of};

const MS: u64 = 1_000_000;

/// The instant of the first fault, ns: HORUS has started, and configures its receivers.
const FIRST: u64 = 150 * MS;

/// The time in which HORUS resets after a stop, and starts, ns.
const RESTART: u64 = 500 * MS;

/// The receiver on I2C.
const ON_I2C: usize = 1;

/// The receiver on SPI.
const ON_SPI: usize = 2;

/// The control registers of the DMA streams that serve receivers (RM0090, "DMA register map"): UART in, I2C in, SPI in
/// and SPI out. Bit 0 is EN.
const STREAMS: [u32; 4] = [0x4002_6088, 0x4002_6040, 0x4002_6488, 0x4002_64A0];

/// The register that enables the first 32 interrupts (ARMv7-M ARM B3.4.4). Others follow.
const ISER: u32 = 0xE000_E100;

/// Returns the names of the runs, their faults and their ends, ns. `kept` has the addresses of state that HORUS keeps.
pub(super) fn horus_runs(kept: &[u32]) -> Vec<(&'static str, Faults, u64)> {
    let (buses, late, state) = (buses(), late_tasks(), kept_state(kept));
    vec![("buses", buses.0, buses.1), ("late tasks", late.0, late.1), ("kept state", state.0, state.1)]
}

fn buses() -> (Faults, u64) {
    const TIMES: u64 = 45;
    // The receiver on I2C has a solution each 125 ms, so each fault comes 3 ms later behind a solution.
    const APART: u64 = 128 * MS;
    let (mut faults, mut at) = (Faults::none(), FIRST);
    for nth in 0..TIMES {
        faults = faults.with(at, at + 12 * MS, Fault::Receiver(ON_I2C, ReceiverFault::Bus(BusFault::SclStuck)));
        let stopped = at + APART / 2;
        for address in STREAMS {
            let upset = Fault::Upset(Board::Horus, Upset::Peripheral { address, bit: 0 });
            faults = faults.with(stopped, stopped, upset);
        }
        if nth % 15 == 14 {
            let loses = |receiver| Fault::Receiver(receiver, ReceiverFault::LosesSettings);
            faults = (0..3).fold(faults, |faults, receiver| faults.with(at, at + APART, loses(receiver)));
        }
        at += APART;
    }
    // SDA is low for most of a byte, each time a bit later in a cycle of 10 ms: arbitration is lost.
    let low = Fault::Receiver(ON_I2C, ReceiverFault::Bus(BusFault::SdaStuck));
    for _ in 0..260 {
        faults = faults.with(at, at + 15_000, low.clone());
        at += 10 * MS + 40_000;
    }
    // Pulses on SDA while the receiver has more bytes than can be read: many bus errors in a cycle.
    faults = faults.with(at, at + 200 * MS, Fault::Receiver(ON_I2C, ReceiverFault::Babbles));
    at += 100 * MS;
    faults = faults.with(at, at + 50 * MS, Fault::Receiver(ON_I2C, ReceiverFault::Bus(BusFault::Pulses)));
    // The receiver on SPI is configured while its transfers stop in different parts of them.
    at += 100 * MS;
    faults = faults.with(at, at + 10 * MS, Fault::Receiver(ON_SPI, ReceiverFault::LosesSettings));
    for _ in 0..150 {
        let upset = Fault::Upset(Board::Horus, Upset::Peripheral { address: STREAMS[2], bit: 0 });
        faults = faults.with(at, at, upset);
        at += 10_370_000;
    }
    (faults, at)
}

fn late_tasks() -> (Faults, u64) {
    const LATE: u64 = 25 * MS;
    const PART: u64 = 5 * MS;
    let (mut faults, mut at) = (Faults::none(), 1_000 * MS);
    // The first task serves slots and ticks. It is also late by less than a cycle, in four parts of it, so that only a
    // tick is late.
    let all = (0..tasks_of(Board::Horus).len() as u8).map(|task| (task, LATE));
    for (task, late) in [(0, PART); 4].into_iter().chain(all) {
        let Some(interrupt) = interrupt_of(Board::Horus, task) else { continue };
        let (address, bit) = (ISER + 4 * u32::from(interrupt / 32), (interrupt % 32) as u8);
        let again = Fault::Upset(Board::Horus, Upset::Peripheral { address, bit });
        faults = faults.with(at, at, Fault::DeadTask(Board::Horus, task));
        faults = faults.with(at, at + late, Fault::Receiver(0, ReceiverFault::Babbles));
        faults = faults.with(at + late, at + late, again);
        at += LATE + RESTART / 2 + 7_500_000;
    }
    // Meanwhile two state inputs at a time are active or contradict themselves.
    let mut begins = FIRST;
    for (one, other) in [(0, 1), (0, 2), (1, 2)] {
        for pair in [0, 1, 2, 3].map(|nth| [InputFault::ALL[nth / 2], InputFault::ALL[nth % 2]]) {
            for (input, fault) in [one, other].into_iter().zip(pair) {
                faults = faults.with(begins, begins + 100 * MS, Fault::Input(input, fault));
            }
            begins += RESTART;
        }
    }
    (faults, at)
}

fn kept_state(kept: &[u32]) -> (Faults, u64) {
    let (mut faults, mut at) = (Faults::none(), 1_000 * MS);
    for &address in kept {
        faults = faults.with(at, at, Fault::Upset(Board::Horus, Upset::Ram { address, bit: 2 }));
        at += RESTART;
    }
    (faults, at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_run_of_horus_has_faults_that_end_before_it() {
        for (name, faults, end) in horus_runs(&[0x2000_0000]) {
            let last = faults.episodes().iter().map(|episode| episode.until).max();
            assert!(last.is_some_and(|last| last <= end), "{name}");
        }
    }
}
