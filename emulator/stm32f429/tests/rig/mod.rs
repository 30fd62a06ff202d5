//! A test bench for the whole part: register accesses without a core.
#![allow(missing_docs, unreachable_pub, reason = "it is a part of the tests")]

use cortex_m4::{Access, BusError, Purpose, Width};
use emulator_part::{Cycle, FindingKind, I2cAnswer, I2cEvent, Outside, Pad, Part, Pin, SpiFrame, UartFrame};
use stm32f429::{Oscillators, Stm32f429};

pub const RCC: u32 = 0x4002_3800;
pub const FLASH: u32 = 0x4002_3C00;
pub const PWR: u32 = 0x4000_7000;
pub const GPIOA: u32 = 0x4002_0000;
pub const GPIOD: u32 = 0x4002_0C00;
pub const SPI1: u32 = 0x4001_3000;
pub const USART2: u32 = 0x4000_4400;
pub const DMA1: u32 = 0x4002_6000;
pub const DMA2: u32 = 0x4002_6400;
pub const EXTI: u32 = 0x4001_3C00;
pub const SYSCFG: u32 = 0x4001_3800;
pub const IWDG: u32 = 0x4000_3000;
pub const WWDG: u32 = 0x4000_2C00;

/// Records what the part reports. On MISO it answers with the complement of MOSI.
#[derive(Default)]
pub struct Bench {
    pub pins: Vec<(Cycle, Pin, Pad)>,
    pub frames: Vec<SpiFrame>,
}

impl Outside for Bench {
    fn pin(&mut self, at: Cycle, pin: Pin, pad: Pad) {
        self.pins.push((at, pin, pad));
    }
    fn spi(&mut self, frame: &SpiFrame) -> Option<u32> {
        self.frames.push(*frame);
        Some(!frame.data & ((1 << frame.bits) - 1))
    }
    fn uart(&mut self, _: Cycle, _: Pin, _: &UartFrame) {}
    fn i2c(&mut self, _: Cycle, _: Pin, _: Pin, _: I2cEvent) -> I2cAnswer {
        I2cAnswer::NOBODY
    }
    fn microvolts(&self, _: Cycle, _: Pin) -> i32 {
        0
    }
}

pub struct Rig {
    pub part: Stm32f429,
    pub bench: Bench,
    pub now: Cycle,
}

impl Rig {
    pub fn new(oscillators: Oscillators) -> Self {
        Self { part: Stm32f429::new(oscillators), bench: Bench::default(), now: 0 }
    }

    pub fn board() -> Self {
        let mut rig = Self::new(Oscillators::default());
        rig.clock_up();
        rig
    }

    pub fn access(&self, address: u32, width: Width) -> Access {
        Access { address, width, purpose: Purpose::Data, privileged: true, cycle: self.now, pc: 0x2000_0100 }
    }

    pub fn step(&mut self, cycles: u64) {
        self.now += cycles;
        self.part.advance(self.now, &mut self.bench);
    }

    pub fn try_read(&mut self, address: u32, width: Width) -> Result<u32, BusError> {
        self.step(2);
        let access = self.access(address, width);
        self.part.read(&access, &mut self.bench)
    }

    pub fn try_write(&mut self, address: u32, width: Width, value: u32) -> Result<(), BusError> {
        self.step(2);
        let access = self.access(address, width);
        self.part.write(&access, value, &mut self.bench)
    }

    pub fn read(&mut self, address: u32) -> u32 {
        self.try_read(address, Width::Word).expect("an address that answers")
    }

    pub fn write(&mut self, address: u32, value: u32) {
        self.try_write(address, Width::Word, value).expect("an address that answers");
    }

    pub fn set(&mut self, address: u32, bits: u32) {
        let old = self.read(address);
        self.write(address, old | bits);
    }

    pub fn wait(&mut self, address: u32, bits: u32) {
        for _ in 0..1_000_000 {
            if self.read(address) & bits == bits {
                return;
            }
        }
        panic!("bits {bits:#x} at {address:#x} are never set");
    }

    pub fn ms(&self, ms: u64) -> u64 {
        self.part.clock().hz / 1000 * ms
    }

    /// Sets up 144 MHz from 8 MHz on OSC_IN, with APB1 at a quarter and APB2 at half of it.
    pub fn clock_up(&mut self) {
        self.write(RCC, 0x83 | 1 << 18);
        self.write(RCC, 0x83 | 1 << 18 | 1 << 16);
        self.wait(RCC, 1 << 17);
        self.set(RCC + 0x40, 1 << 28);
        self.set(PWR, 3 << 14);
        // The PLL has M 8, N 288, P 2 and Q 6, and is driven by HSE.
        self.write(RCC + 4, 8 | 288 << 6 | 1 << 22 | 6 << 24);
        self.set(RCC, 1 << 24);
        self.wait(RCC, 1 << 25);
        self.write(FLASH, 4 | 0x700);
        self.write(RCC + 8, 5 << 10 | 4 << 13 | 2);
        self.wait(RCC + 8, 2 << 2);
        // The writes switch on the clock security system, and the clocks of all ports, DMA1, DMA2, SPI1, SYSCFG,
        // USART6, USART2 and WWDG.
        self.set(RCC, 1 << 19);
        self.set(RCC + 0x30, 0x7FF | 3 << 21);
        self.set(RCC + 0x44, 1 << 12 | 1 << 14 | 1 << 5);
        self.set(RCC + 0x40, 1 << 17 | 1 << 11);
    }

    pub fn line(&mut self, line: usize) -> bool {
        self.part.signals().lines()[line / 64] >> (line % 64) & 1 != 0
    }

    /// Sets up SPI1 on PA5 to PA7 in mode 1 at APB2 / 8, with both DMA streams.
    pub fn spi_up(&mut self) {
        let afr = self.read(GPIOA + 0x20);
        self.write(GPIOA + 0x20, afr & 0x000F_FFFF | 0x5550_0000);
        let moder = self.read(GPIOA);
        self.write(GPIOA, moder & !0xFC00 | 0xA800);
        self.write(SPI1, 1 | 1 << 2 | 2 << 3 | 3 << 8 | 1 << 6);
    }

    pub fn found(&self, kind: FindingKind, words: &str) -> bool {
        self.part.findings().iter().any(|finding| finding.kind == kind && finding.text.contains(words))
    }
}
