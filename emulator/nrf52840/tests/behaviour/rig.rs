//! A test bench in which the test acts as the core: it accesses registers as firmware would, and lets time pass. Time
//! is in cycles, 64 to a microsecond.
use cortex_m4::{Access, Purpose, Width};
use emulator_part::{
    Cycle, Finding, FindingKind, I2cAnswer, I2cEvent, Outside, Pad, Part, Pin, Reset, SpiFrame, SpiMode, UartFrame,
};
use nrf52840::{Nrf52840, Settings, SpisWires};
use std::collections::BTreeMap;

pub(crate) const POWER: u32 = 0x4000_0000;
pub(crate) const UARTE0: u32 = 0x4000_2000;
pub(crate) const SPIM0: u32 = 0x4000_3000;
pub(crate) const SPIS1: u32 = 0x4000_4000;
pub(crate) const GPIOTE: u32 = 0x4000_6000;
pub(crate) const SAADC: u32 = 0x4000_7000;
pub(crate) const TIMER0: u32 = 0x4000_8000;
pub(crate) const TIMER1: u32 = 0x4000_9000;
pub(crate) const RTC0: u32 = 0x4000_B000;
pub(crate) const RNG: u32 = 0x4000_D000;
pub(crate) const ECB: u32 = 0x4000_E000;
pub(crate) const WDT: u32 = 0x4001_0000;
pub(crate) const QDEC: u32 = 0x4001_2000;
pub(crate) const COMP: u32 = 0x4001_3000;
pub(crate) const EGU0: u32 = 0x4001_4000;
pub(crate) const TIMER3: u32 = 0x4001_A000;
pub(crate) const PWM0: u32 = 0x4001_C000;
pub(crate) const NVMC: u32 = 0x4001_E000;
pub(crate) const PPI: u32 = 0x4001_F000;
pub(crate) const SPIM3: u32 = 0x4002_F000;
pub(crate) const P0: u32 = 0x5000_0000;
pub(crate) const P1: u32 = 0x5000_0300;
pub(crate) const RAM: u32 = 0x2000_0000;
/// The buffers from which EasyDMA sends and into which it receives.
pub(crate) const TX: u32 = RAM + 0x100;
pub(crate) const RX: u32 = RAM + 0x200;

pub(crate) const US: Cycle = 64;
pub(crate) const MS: Cycle = 64_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Seen {
    Select(Cycle),
    Byte(Cycle, u8),
    Deselect(Cycle),
}

/// The outside: it records the part's effects, and a chip on SCK, MOSI, MISO and CS answers each byte with the
/// complement of the previous byte (0xA5 first).
#[derive(Clone, Debug, Default)]
pub(crate) struct World {
    pub(crate) chip: Option<SpiMode>,
    selected: bool,
    last: u8,
    pub(crate) seen: Vec<Seen>,
    pub(crate) pins: Vec<(Cycle, Pin, Pad)>,
    pub(crate) frames: Vec<SpiFrame>,
    pub(crate) sent: Vec<(Cycle, Pin, UartFrame)>,
    pub(crate) bus: Vec<(Cycle, I2cEvent)>,
    pub(crate) address: Option<u8>,
    pub(crate) microvolts: BTreeMap<Pin, i32>,
}

impl Outside for World {
    fn pin(&mut self, at: Cycle, pin: Pin, pad: Pad) {
        self.pins.push((at, pin, pad));
        if pin == CS && self.chip.is_some() {
            let selected = pad == Pad::Driven(false);
            if selected != self.selected {
                self.selected = selected;
                self.last = !0xA5;
                self.seen.push(if selected { Seen::Select(at) } else { Seen::Deselect(at) });
            }
        }
    }

    fn spi(&mut self, frame: &SpiFrame) -> Option<u32> {
        self.frames.push(*frame);
        if !self.selected || frame.sck[0] != Some(SCK) {
            return None;
        }
        let heard = if frame.mosi[0] == Some(MOSI) { frame.data as u8 } else { 0 };
        let answer = !std::mem::replace(&mut self.last, heard);
        self.seen.push(Seen::Byte(frame.ends, heard));
        (frame.miso == Some(MISO)).then_some(u32::from(answer))
    }

    fn uart(&mut self, at: Cycle, pin: Pin, frame: &UartFrame) {
        self.sent.push((at, pin, *frame));
    }

    fn i2c(&mut self, at: Cycle, _: Pin, _: Pin, event: I2cEvent) -> I2cAnswer {
        self.bus.push((at, event));
        match event {
            I2cEvent::Start(address) if Some(address >> 1) != self.address => I2cAnswer::NOBODY,
            I2cEvent::Read(_) => I2cAnswer { acknowledged: true, data: self.bus.len() as u8, stretched_ns: 0 },
            _ => I2cAnswer { acknowledged: true, data: 0, stretched_ns: 0 },
        }
    }

    fn microvolts(&self, _: Cycle, pin: Pin) -> i32 {
        self.microvolts.get(&pin).copied().unwrap_or(0)
    }
}

#[derive(Clone)]
pub(crate) struct Rig {
    pub(crate) part: Nrf52840,
    pub(crate) world: World,
    pub(crate) now: Cycle,
    restarts: u32,
}

impl Rig {
    pub(crate) fn new() -> Self {
        Self::with(Settings { hfint_ppb: 0, ..Settings::default() })
    }

    pub(crate) fn with(settings: Settings) -> Self {
        let mut part = Nrf52840::new(settings);
        part.wire_spis(WIRES);
        Self { part, world: World::default(), now: 0, restarts: 0 }
    }

    fn access(&self, address: u32, width: Width) -> Access {
        Access { address, width, purpose: Purpose::Data, privileged: true, cycle: self.now, pc: 0x1000 }
    }

    fn after(&mut self) {
        if let Some(cause) = self.part.take_reset() {
            self.restarts += 1;
            self.part.reset(self.now, cause, &mut self.world);
        }
    }

    pub(crate) fn write(&mut self, address: u32, value: u32) {
        assert!(self.try_write(address, Width::Word, value), "{address:#x}");
    }

    /// Writes to `address`. Returns whether the bus carried the write out.
    pub(crate) fn try_write(&mut self, address: u32, width: Width, value: u32) -> bool {
        let done = self.part.write(&self.access(address, width), value, &mut self.world).is_ok();
        self.after();
        done
    }

    pub(crate) fn try_read(&mut self, address: u32, width: Width) -> Option<u32> {
        let read = self.part.read(&self.access(address, width), &mut self.world).ok();
        self.after();
        read
    }

    pub(crate) fn read(&mut self, address: u32) -> u32 {
        self.try_read(address, Width::Word).unwrap_or_else(|| panic!("{address:#x} does not answer"))
    }

    pub(crate) fn write_all(&mut self, writes: &[(u32, u32)]) {
        for &(address, value) in writes {
            self.write(address, value);
        }
    }

    pub(crate) fn deadline(&mut self) -> Cycle {
        self.part.due()
    }

    /// Lets time pass until `at`, and advances the models at each event.
    pub(crate) fn run_to(&mut self, at: Cycle) {
        assert!(at >= self.now, "time goes forward");
        loop {
            let deadline = self.deadline();
            if deadline > at {
                break;
            }
            self.now = self.now.max(deadline);
            self.part.advance(self.now, &mut self.world);
            assert!(self.part.due() > self.now, "what was due is done");
            self.after();
        }
        self.now = at;
    }

    pub(crate) fn run_for(&mut self, cycles: Cycle) {
        self.run_to(self.now + cycles);
    }

    /// Lets time pass until the register at `address` is not 0. Returns the cycle at which that is so.
    pub(crate) fn run_until_set(&mut self, address: u32, limit: Cycle) -> Cycle {
        while self.read(address) == 0 {
            let deadline = self.deadline();
            assert!(deadline <= limit, "{address:#x} is still 0 at {limit}");
            self.run_to(deadline);
        }
        self.now
    }

    pub(crate) fn drive(&mut self, pin: Pin, level: bool) {
        self.part.drive(self.now, pin, Some(level), &mut self.world);
        self.after();
    }

    pub(crate) fn release(&mut self, pin: Pin) {
        self.part.drive(self.now, pin, None, &mut self.world);
        self.after();
    }

    pub(crate) fn select(&mut self, csn: Pin) {
        self.part.spis_select(self.now, csn, &mut self.world);
    }

    pub(crate) fn deselect(&mut self, csn: Pin) {
        self.part.spis_deselect(self.now, csn, &mut self.world);
    }

    pub(crate) fn clock(&mut self, byte: u8) -> Option<u8> {
        self.part.spis_clock(self.now, byte, SpiMode::Mode0, &mut self.world)
    }

    pub(crate) fn reset(&mut self, cause: Reset) {
        self.part.reset(self.now, cause, &mut self.world);
    }

    pub(crate) fn restarts(&self) -> u32 {
        self.restarts
    }

    pub(crate) fn line(&mut self, number: u16) -> bool {
        self.part.signals().lines()[0] >> number & 1 != 0
    }

    pub(crate) fn lines(&mut self) -> u32 {
        self.part.signals().lines()[0].count_ones()
    }

    pub(crate) fn memory(&self, address: u32, len: usize) -> &[u8] {
        self.part.memory(address, len).expect("memory")
    }

    pub(crate) fn fill(&mut self, address: u32, bytes: &[u8]) {
        self.part.memory_mut(address, bytes.len()).expect("memory").copy_from_slice(bytes);
    }

    pub(crate) fn findings(&self, kind: FindingKind) -> Vec<Finding> {
        self.part.findings().iter().filter(|found| found.kind == kind).cloned().collect()
    }

    pub(crate) fn assert_clean(&self) {
        assert!(self.part.findings().is_empty(), "{:#?}", self.part.findings());
    }
}

pub(crate) fn psel(port: u32, n: u32) -> u32 {
    port << 5 | n
}

pub(crate) const SCK: Pin = Pin::new(1, 15);
pub(crate) const MOSI: Pin = Pin::new(1, 13);
pub(crate) const MISO: Pin = Pin::new(1, 14);
pub(crate) const CS: Pin = Pin::new(1, 12);
pub(crate) const CSN: Pin = Pin::new(1, 4);
pub(crate) const WIRES: SpisWires =
    SpisWires { sck: Pin::new(1, 1), mosi: Pin::new(1, 3), miso: Pin::new(1, 2), csn: CSN };

pub(crate) const OUTPUT: u32 = 1 | 1 << 1;
pub(crate) const INPUT: u32 = 0;
pub(crate) const PULLED_UP: u32 = 3 << 2;

pub(crate) const fn p1_cnf(n: u32) -> u32 {
    P1 + 0x700 + 4 * n
}

pub(crate) const fn p0_cnf(n: u32) -> u32 {
    P0 + 0x700 + 4 * n
}
