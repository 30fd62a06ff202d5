//! A minimal Thumb assembler for test firmware. Each method appends one or a few instructions.
#![allow(dead_code, reason = "every test binary uses its own part of it")]

use emulator_node::Firmware;

/// The address of the vector table of test firmware, and its initial stack pointer, on an STM32F4.
pub(crate) const FLASH: u32 = 0x0800_0000;
pub(crate) const STACK: u32 = 0x2000_4000;

#[derive(Clone, Copy)]
pub(crate) enum If {
    Equal = 0,
    NotEqual = 1,
    CarrySet = 2,
    CarryClear = 3,
}

pub(crate) struct Thumb {
    base: u32,
    code: Vec<u16>,
}

impl Thumb {
    pub(crate) fn at(base: u32) -> Self {
        Self { base, code: Vec::new() }
    }

    pub(crate) fn here(&self) -> u32 {
        self.base + 2 * u32::try_from(self.code.len()).unwrap()
    }

    pub(crate) fn raw(&mut self, halves: &[u16]) -> &mut Self {
        self.code.extend_from_slice(halves);
        self
    }

    pub(crate) fn mov(&mut self, rd: u16, value: u32) -> &mut Self {
        for (opcode, half) in [(0xF240_u16, value as u16), (0xF2C0, (value >> 16) as u16)] {
            let (imm4, i, imm3, imm8) = (half >> 12, half >> 11 & 1, half >> 8 & 7, half & 0xFF);
            self.raw(&[opcode | i << 10 | imm4, imm3 << 12 | rd << 8 | imm8]);
        }
        self
    }

    /// Sets the word at `address` to `value`. It uses r0 and r1.
    pub(crate) fn store(&mut self, address: u32, value: u32) -> &mut Self {
        self.mov(0, address).mov(1, value).str(1, 0, 0)
    }

    pub(crate) fn str(&mut self, rt: u16, rn: u16, offset: u16) -> &mut Self {
        self.raw(&[0x6000 | (offset / 4) << 6 | rn << 3 | rt])
    }

    pub(crate) fn ldr(&mut self, rt: u16, rn: u16, offset: u16) -> &mut Self {
        self.raw(&[0x6800 | (offset / 4) << 6 | rn << 3 | rt])
    }

    /// Adds 1 to the word at `address`. It uses r0 and r1.
    pub(crate) fn count(&mut self, address: u32) -> &mut Self {
        self.mov(0, address).ldr(1, 0, 0).raw(&[0x3101]).str(1, 0, 0)
    }

    /// Copies bit `bit` (from 0) of `rn` into the carry flag, and destroys `rn`.
    pub(crate) fn test(&mut self, rn: u16, bit: u16) -> &mut Self {
        self.raw(&[0x0800 | (bit + 1) << 6 | rn << 3 | rn])
    }

    pub(crate) fn branch(&mut self, to: u32) -> &mut Self {
        let offset = to.wrapping_sub(self.here() + 4) as i32 >> 1;
        self.raw(&[0xE000 | offset as u16 & 0x7FF])
    }

    pub(crate) fn branch_if(&mut self, condition: If, to: u32) -> &mut Self {
        let offset = to.wrapping_sub(self.here() + 4) as i32 >> 1;
        self.raw(&[0xD000 | (condition as u16) << 8 | offset as u16 & 0xFF])
    }

    /// Loops until bit `bit` of the word at `address` is set. It uses r0 and r1.
    pub(crate) fn wait_for(&mut self, address: u32, bit: u16) -> &mut Self {
        self.mov(0, address);
        let again = self.here();
        self.ldr(1, 0, 0).test(1, bit).branch_if(If::CarryClear, again)
    }

    pub(crate) fn wfi(&mut self) -> &mut Self {
        self.raw(&[0xBF30])
    }

    /// Sleeps in an endless loop; only interrupts run.
    pub(crate) fn idle(&mut self) -> &mut Self {
        let again = self.here();
        self.wfi().branch(again)
    }

    /// Returns from a function or an interrupt, once all stores have reached their peripherals.
    pub(crate) fn ret(&mut self) -> &mut Self {
        self.raw(&[0xF3BF, 0x8F4F, 0x4770])
    }

    pub(crate) fn semihost(&mut self, operation: u32, parameter: u32) -> &mut Self {
        self.mov(0, operation).mov(1, parameter).raw(&[0xBEAB])
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.code.iter().flat_map(|half| half.to_le_bytes()).collect()
    }
}

/// Makes an image with `main` at reset, `handlers` at their interrupts, and its vector table at `base`.
pub(crate) fn firmware_at(base: u32, name: &str, main: &Thumb, handlers: &[(u32, &Thumb)]) -> Firmware {
    let mut table = vec![0_u32; 16 + 96];
    table[0] = STACK;
    table[1] = main.base | 1;
    for (interrupt, handler) in handlers {
        table[16 + usize::try_from(*interrupt).unwrap()] = handler.base | 1;
    }
    let table = table.iter().flat_map(|word| word.to_le_bytes()).collect();
    let mut segments = vec![(u64::from(base), table), (u64::from(main.base), main.bytes())];
    segments.extend(handlers.iter().map(|(_, handler)| (u64::from(handler.base), handler.bytes())));
    Firmware::raw(name, segments)
}

pub(crate) fn firmware(name: &str, main: &Thumb, handlers: &[(u32, &Thumb)]) -> Firmware {
    firmware_at(FLASH, name, main, handlers)
}

pub(crate) const MAIN: u32 = FLASH + 0x400;
pub(crate) const HANDLER: u32 = FLASH + 0x800;
pub(crate) const COUNTER: u32 = 0x2000_0000;

pub(crate) const RCC: u32 = 0x4002_3800;
pub(crate) const TIM2: u32 = 0x4000_0000;
pub(crate) const GPIOA: u32 = 0x4002_0000;
pub(crate) const GPIOD: u32 = 0x4002_0C00;
pub(crate) const SYSCFG: u32 = 0x4001_3800;
pub(crate) const EXTI: u32 = 0x4001_3C00;
const NVIC_ISER: u32 = 0xE000_E100;

impl Thumb {
    pub(crate) fn enable(&mut self, interrupt: u32) -> &mut Self {
        self.store(NVIC_ISER + 4 * (interrupt / 32), 1 << (interrupt % 32))
    }

    /// Sets up TIM2's update interrupt, every `ticks` cycles of its clock.
    pub(crate) fn tim2_every(&mut self, ticks: u32) -> &mut Self {
        self.store(RCC + 0x40, 1).store(TIM2 + 0x2C, ticks - 1).store(TIM2 + 0x0C, 1).enable(28).store(TIM2, 1)
    }

    /// Sets up EXTI3 on a rising edge of PA3.
    pub(crate) fn exti3_on_pa3(&mut self) -> &mut Self {
        self.store(RCC + 0x30, 1 | 1 << 3) // GPIOA, GPIOD
            .store(RCC + 0x44, 1 << 14) // SYSCFG
            .store(SYSCFG + 0x08, 0)
            .store(EXTI + 0x08, 1 << 3)
            .store(EXTI, 1 << 3)
            .enable(9)
    }
}
