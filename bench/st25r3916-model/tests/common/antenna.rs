//! A poller without a chip, which emits given bytes at given instants, and a listener's antenna that records every
//! event.

use st25r3916_model::{Air, AirEvent, AirFaults, Chunk, FrameStart, Heard, Technology};

pub(crate) const US: u64 = 1_000;
pub(crate) const MS: u64 = 1_000_000;
/// The duration of one bit at 424 kbit/s, attoseconds.
pub(crate) const BIT_AS: u64 = 2_359_882_005_899;
/// The number of bits in the preamble and sync of a frame.
pub(crate) const HEADER: u64 = 64;

pub(crate) fn bits_ns(bits: u64) -> u64 {
    (bits * (BIT_AS / 1_000) + 500_000) / 1_000_000
}

/// Returns the bytes of a frame: LEN, a payload drawn from `seed`, and two bytes in place of the CRC-16.
pub(crate) fn frame(payload: usize, seed: u8) -> Vec<u8> {
    let mut bytes = vec![payload as u8 + 1];
    bytes.extend((0..payload + 2).map(|i| (i as u8).wrapping_mul(37).wrapping_add(seed)));
    bytes
}

pub(crate) fn start(technology: Technology, data: &[u8]) -> FrameStart {
    let (header_bits, byte_bits) = if technology == Technology::NfcF { (HEADER as u32, 8) } else { (1, 9) };
    let chunk = Chunk { data: data.to_vec(), parity_error: false };
    let (bits_per_second, load_modulation) = (424_000, false);
    FrameStart { technology, bits_per_second, bit_as: BIT_AS, header_bits, byte_bits, load_modulation, chunk }
}

pub(crate) struct Antenna {
    pub(crate) air: Air,
    pub(crate) told: Vec<(u64, AirEvent)>,
}

impl Antenna {
    pub(crate) fn new(seed: u64, faults: AirFaults) -> Self {
        let mut antenna = Self { air: Air::new(seed, faults), told: vec![] };
        antenna.poller(0, AirEvent::FieldOn);
        antenna
    }

    pub(crate) fn poller(&mut self, at: u64, event: AirEvent) {
        let told = &mut self.told;
        self.air.from_poller(at, event, &mut |at, event| told.push((at, event.clone())));
    }

    pub(crate) fn set(&mut self, at: u64, faults: AirFaults) {
        let told = &mut self.told;
        self.air.set_faults(at, faults, &mut |at, event| told.push((at, event.clone())));
    }

    pub(crate) fn run_to(&mut self, to: u64) {
        let told = &mut self.told;
        while let Some(at) = self.air.next_event().filter(|at| *at <= to) {
            self.air.advance(at, &mut |at, event| told.push((at, event.clone())));
            assert!(self.air.next_event().is_none_or(|next| next >= at), "an event in the past");
        }
        self.air.advance(to, &mut |at, event| told.push((at, event.clone())));
    }

    pub(crate) fn send(&mut self, at: u64, bytes: &[u8]) -> u64 {
        self.run_to(at);
        self.poller(at, AirEvent::FrameStart(start(Technology::NfcF, bytes)));
        let end = at + bits_ns(HEADER + 8 * bytes.len() as u64);
        self.run_to(end - 1);
        self.poller(end, AirEvent::FrameEnd { bits: 8 * bytes.len() as u32 });
        end
    }

    pub(crate) fn heard(&mut self) -> Vec<Heard> {
        self.air.take_heard()
    }

    pub(crate) fn injected(&mut self, kind: &str) -> Vec<u64> {
        let all = self.air.take_injected();
        assert!(all.is_sorted_by_key(|(at, _)| *at), "{all:?}");
        all.into_iter().filter(|(_, other)| *other == kind).map(|(at, _)| at).collect()
    }

    pub(crate) fn ended(&self) -> (u64, u64, u64) {
        let counters = self.air.counters();
        (counters.delivered, counters.damaged, counters.lost)
    }
}

/// Returns the positions of the bits, in NFC-F's order, in which two frames of the same length differ.
pub(crate) fn wrong_bits(a: &[u8], b: &[u8]) -> Vec<u64> {
    assert_eq!(a.len(), b.len());
    (0..8 * a.len() as u64)
        .filter(|bit| ((a[*bit as usize / 8] ^ b[*bit as usize / 8]) << (bit % 8)) & 0x80 != 0)
        .collect()
}
