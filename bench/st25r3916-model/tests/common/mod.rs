//! A simple controller for tests: transfers at 8 MHz, and the start sequences of the data sheet for poller and
//! listener.

pub(crate) mod antenna;
pub(crate) mod two_way;

use st25r3916_model::{Air, AirEvent, AirFaults, Chip, Chunk, Config, FrameStart, Technology, Variant};

/// The duration of one SPI byte at 8 MHz, ns.
pub(crate) const BYTE_NS: u64 = 1_000;

pub(crate) struct Pair {
    pub(crate) poller: Chip,
    pub(crate) listener: Chip,
    pub(crate) air: Air,
    pub(crate) now: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    Poller,
    Listener,
}

impl Pair {
    pub(crate) fn new(poller: Config, listener: Config, air: Air) -> Self {
        Self { poller: Chip::new(poller), listener: Chip::new(listener), air, now: 0 }
    }

    pub(crate) fn chip(&mut self, side: Side) -> &mut Chip {
        match side {
            Side::Poller => &mut self.poller,
            Side::Listener => &mut self.listener,
        }
    }

    pub(crate) fn next_event(&self) -> Option<u64> {
        [self.poller.next_event(), self.listener.next_event(), self.air.next_event()].into_iter().flatten().min()
    }

    pub(crate) fn run_to(&mut self, to: u64) {
        self.air.carry(&mut self.poller, &mut self.listener);
        loop {
            let t = self.next_event().filter(|t| *t <= to).unwrap_or(to);
            assert!(t >= self.now, "an event in the past");
            self.now = t;
            self.poller.advance(t);
            self.listener.advance(t);
            self.air.carry(&mut self.poller, &mut self.listener);
            if t == to && self.next_event().is_none_or(|n| n > to) {
                return;
            }
        }
    }

    pub(crate) fn run_for(&mut self, ns: u64) {
        self.run_to(self.now + ns);
    }

    pub(crate) fn spi(&mut self, side: Side, mosi: &[u8]) -> Vec<u8> {
        let now = self.now;
        self.chip(side).select(now);
        let mut miso = Vec::with_capacity(mosi.len());
        for &b in mosi {
            let now = self.now + BYTE_NS;
            self.run_to(now);
            miso.push(self.chip(side).transfer(now, b));
            self.air.carry(&mut self.poller, &mut self.listener);
        }
        let now = self.now;
        self.chip(side).deselect(now);
        miso
    }

    pub(crate) fn wait_irq(&mut self, side: Side, ns: u64) -> bool {
        let end = self.now + ns;
        while !self.chip(side).irq() {
            match self.next_event().filter(|t| *t <= end) {
                Some(t) => self.run_to(t),
                None => {
                    self.run_to(end);
                    return self.chip(side).irq();
                }
            }
        }
        true
    }

    /// Reads the four interrupt registers of this side's chip, which clears them.
    pub(crate) fn irqs(&mut self, side: Side) -> [u8; 4] {
        let r = self.spi(side, &[0x5A, 0, 0, 0, 0]);
        [r[1], r[2], r[3], r[4]]
    }

    pub(crate) fn start(&mut self, side: Side) {
        self.spi(side, &[0xC1]);
        // The registers are set for a board with a 5 V supply and an antenna that needs tuning.
        self.spi(side, &[0x00, 0x07, 0x3C]);
        self.spi(side, &[0x02, 0x80]);
        assert!(self.wait_irq(side, 10_000_000), "oscillator");
        assert_eq!(self.irqs(side), [0x80, 0, 0, 0]);
        if self.chip(side).config().variant == Variant::St25r3916b {
            self.spi(side, &[0xEA]);
            assert!(self.wait_irq(side, 10_000_000), "RC calibration");
            assert_eq!(self.irqs(side), [0, 0x80, 0, 0]);
        }
        self.spi(side, &[0xD6]);
        assert!(self.wait_irq(side, 5_000_000), "regulators");
        assert_eq!(self.irqs(side), [0, 0x80, 0, 0]);
    }

    pub(crate) fn start_poller(&mut self) {
        self.start(Side::Poller);
        self.spi(Side::Poller, &[0x03, 0x1C, 0x22]);
        self.spi(Side::Poller, &[0x07, 0x00]);
        self.modulate_nfc_f();
        self.spi(Side::Poller, &[0x16, 0x77]);
        self.spi(Side::Poller, &[0x02, 0x88]);
    }

    /// Sets the poller to amplitude modulation of 12 % depth, by active wave shaping if the chip has it, and tunes its
    /// antenna.
    pub(crate) fn modulate_nfc_f(&mut self) {
        let [a, b] = self.poller.config().tuning[0];
        self.spi(Side::Poller, &[0x26, a, b]);
        if self.poller.config().variant == Variant::St25r3916b {
            self.spi(Side::Poller, &[0x28, 0x40]);
            self.spi(Side::Poller, &[0xFB, 0x28, 0x84]);
            self.spi(Side::Poller, &[0xFB, 0x2E, 0x09, 0x28]);
        } else {
            self.spi(Side::Poller, &[0x28, 0x70]);
            self.spi(Side::Poller, &[0xFB, 0x28, 0x00]);
        }
    }

    pub(crate) fn start_listener(&mut self) {
        self.start(Side::Listener);
        self.spi(Side::Listener, &[0x08, 0x5D]);
        self.spi(Side::Listener, &[0x29, 0xFF]);
        self.spi(Side::Listener, &[0xFB, 0x28, 0x00]);
        self.spi(Side::Listener, &[0x0F, 0x02]);
        self.spi(Side::Listener, &[0x16, 0xCF, 0xE7, 0x0F, 0xFF]);
        self.receive_nfc_f(Side::Listener);
        self.spi(Side::Listener, &[0x03, 0xA0, 0x22]);
        self.spi(Side::Listener, &[0x02, 0xC3]);
        self.arm();
    }

    /// Gives this side's receive chain the values of public drivers for NFC-F.
    pub(crate) fn receive_nfc_f(&mut self, side: Side) {
        self.spi(side, &[0x0B, 0x13, 0x2D, 0x00, 0x00]);
        self.spi(side, &[0xFB, 0x0C, 0x54, 0x00]);
    }

    /// Gives this side's receive chain the values of public drivers for NFC-A.
    pub(crate) fn receive_nfc_a(&mut self, side: Side) {
        self.spi(side, &[0x0B, 0x08, 0x2D, 0x00, 0x00]);
        self.spi(side, &[0xFB, 0x0C, 0x51, 0x00]);
    }

    pub(crate) fn arm(&mut self) {
        self.spi(Side::Listener, &[0xDB]);
        self.spi(Side::Listener, &[0xD1]);
    }

    /// Returns two started chips. The listener has detected the poller's field.
    pub(crate) fn started(poller: Config, listener: Config, air: Air) -> Self {
        let mut pair = Self::new(poller, listener, air);
        pair.start_listener();
        pair.start_poller();
        assert!(pair.wait_irq(Side::Listener, 1_000_000), "external field");
        assert_eq!(pair.irqs(Side::Listener), [0, 0x10, 0, 0]);
        pair
    }

    /// Clears the poller's FIFO (DB), sets the frame's length, and loads the payload. The caller gives the transmit
    /// command.
    pub(crate) fn load(&mut self, payload: &[u8]) {
        self.spi(Side::Poller, &[0xDB]);
        let bits = (payload.len() as u16) << 3;
        let [high, low] = bits.to_be_bytes();
        self.spi(Side::Poller, &[0x22, high, low]);
        let mut load = vec![0x80];
        load.extend_from_slice(payload);
        self.spi(Side::Poller, &load);
    }

    pub(crate) fn fire(&mut self) {
        self.spi(Side::Poller, &[0xC4]);
    }

    pub(crate) fn fifo(&mut self, side: Side) -> (usize, u8) {
        let r = self.spi(side, &[0x5E, 0, 0]);
        (usize::from(r[1]) | usize::from(r[2] >> 6) << 8, r[2] & 0x3F)
    }

    pub(crate) fn read_fifo(&mut self, side: Side, n: usize) -> Vec<u8> {
        let mut mosi = vec![0u8; n + 1];
        mosi[0] = 0x9F;
        self.spi(side, &mosi)[1..].to_vec()
    }
}

pub(crate) fn bits_ns_424(bits: u64) -> u64 {
    antenna::bits_ns(bits)
}

pub(crate) fn exact() -> Config {
    Config { transmit_scatter_ns: 0, ..Config::default() }
}

pub(crate) fn payload(n: usize, seed: u64) -> Vec<u8> {
    let mut x = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    (0..n)
        .map(|_| {
            x ^= x << 13;
            x ^= x >> 7;
            x ^= x << 17;
            (x >> 32) as u8
        })
        .collect()
}

/// The duration of one bit at 106 kbit/s, attoseconds.
pub(crate) const BIT_106_AS: u64 = 9_439_528_023_598;

/// Returns a poller for NFC-A with field and receiver on, and a listener that has not been started.
pub(crate) fn nfc_a_poller(config: Config) -> Pair {
    let mut pair = Pair::new(config, Config::default(), Air::new(0, AirFaults::default()));
    pair.start(Side::Poller);
    pair.receive_nfc_a(Side::Poller);
    pair.spi(Side::Poller, &[0x03, 0x08, 0x00]);
    // The bit no_crc_rx switches the CRC check off, because these answers have no CRC.
    pair.spi(Side::Poller, &[0x0A, 0x80]);
    pair.spi(Side::Poller, &[0x02, 0xC8]);
    pair
}

pub(crate) fn nfc_a_answer_begins(pair: &mut Pair, data: &[u8]) {
    let now = pair.now;
    pair.poller.hear(
        now,
        &AirEvent::FrameStart(FrameStart {
            technology: Technology::NfcA,
            bits_per_second: 106_000,
            bit_as: BIT_106_AS,
            header_bits: 1,
            byte_bits: 9,
            load_modulation: true,
            chunk: Chunk { data: data.to_vec(), parity_error: false },
        }),
    );
    let bits = 1 + 9 * data.len() as u64;
    let end = now + bits * BIT_106_AS / 1_000_000_000;
    pair.poller.hear(end, &AirEvent::FrameEnd { bits: 8 * data.len() as u32 });
}

pub(crate) fn nfc_a_answer(pair: &mut Pair, data: &[u8]) {
    nfc_a_answer_begins(pair, data);
    pair.run_for(200_000 + 90_000 * data.len() as u64);
}
