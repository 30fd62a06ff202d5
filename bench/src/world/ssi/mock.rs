//! The pins of a DPR for unit tests. They record every action of the flight controller, and send the test's bytes on
//! MISO.

use emulator_part::SpiMode;

use super::{Order, Progress, SsiMaster, SsiPort, Start, Transaction};

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Done {
    Select(u64),
    /// The clocked bytes: the instants (ns) of the last clock edges of the first and of the last byte, the bytes on
    /// MOSI, and the SPI mode.
    Bytes(u64, u64, Vec<u8>, SpiMode),
    Deselect(u64),
}

#[derive(Clone, Debug)]
pub(crate) struct Pins {
    pub(crate) now: u64,
    pub(crate) done: Vec<Done>,
    /// The bytes that each transaction reads on MISO. Zeros follow these bytes.
    pub(crate) shown: Vec<u8>,
    pub(crate) quiet: usize,
    index: usize,
}

impl Pins {
    pub(crate) fn showing(shown: &[u8]) -> Self {
        Self { now: 0, done: vec![], shown: shown.to_vec(), quiet: usize::MAX, index: 0 }
    }

    pub(crate) fn carry(&mut self, master: &mut SsiMaster, start: Start, order: Order) -> Transaction {
        master.begin(start, order);
        loop {
            self.now = master.next_at();
            if let Some(Progress::Over(transaction)) = master.act(self) {
                return transaction;
            }
        }
    }

    pub(crate) fn take_mosi(&mut self) -> Vec<u8> {
        let done = std::mem::take(&mut self.done).into_iter();
        done.flat_map(|done| if let Done::Bytes(_, _, mosi, _) = done { mosi } else { vec![] }).collect()
    }
}

impl SsiPort for Pins {
    fn now(&self) -> u64 {
        self.now
    }

    fn select(&mut self) {
        self.index = 0;
        self.done.push(Done::Select(self.now));
    }

    fn exchange(&mut self, first: u64, last: u64, mosi: &[u8], mode: SpiMode) -> Vec<u8> {
        self.done.push(Done::Bytes(first, last, mosi.to_vec(), mode));
        let miso = self.shown.iter().copied().chain(std::iter::repeat(0)).skip(self.index).take(mosi.len());
        self.index += mosi.len();
        miso.collect()
    }

    fn deselect(&mut self) {
        self.done.push(Done::Deselect(self.now));
    }

    fn quiet(&self) -> usize {
        self.quiet
    }
}
