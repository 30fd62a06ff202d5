//! A door bell: it rings while its button is pressed (low), says "ready" over its UART at the start, answers `?` with
//! the number of rings, and exits at `!`. Each ring is a line of the log.

#![no_std]
#![no_main]

use core::arch::asm;
use core::ptr::{read_volatile, write_volatile};
use core::sync::atomic::{AtomicU32, Ordering};

static TICKS: AtomicU32 = AtomicU32::new(0);

fn write(address: usize, value: u32) {
    unsafe { write_volatile(address as *mut u32, value) }
}

fn read(address: usize) -> u32 {
    unsafe { read_volatile(address as *const u32) }
}

#[cfg(feature = "nrf52840")]
mod part {
    use super::{read, write};

    const P0: usize = 0x5000_0000;
    const UART: usize = 0x4000_2000;
    pub const SYSTICK_RELOAD: u32 = 64_000 - 1;

    pub fn set_up() {
        write(P0 + 0x700 + 4 * 11, 3 << 2); // PIN_CNF[11]: input, connected, pull-up
        write(P0 + 0x518, 1 << 13 | 1 << 6); // DIRSET
        write(P0 + 0x508, 1 << 6); // the line is idle
        write(P0 + 0x700 + 4 * 8, 3 << 2);
        write(UART + 0x50C, 6); // PSELTXD
        write(UART + 0x514, 8); // PSELRXD
        write(UART + 0x524, 0x01D7_E000); // 115 200 baud
        write(UART + 0x500, 4); // the legacy UART
        write(UART, 1); // STARTRX
        write(UART + 0x008, 1); // STARTTX
    }

    pub fn pressed() -> bool {
        read(P0 + 0x510) >> 11 & 1 == 0
    }

    pub fn ring(on: bool) {
        write(P0 + if on { 0x508 } else { 0x50C }, 1 << 13);
    }

    pub fn send(byte: u8) {
        write(UART + 0x11C, 0);
        write(UART + 0x51C, byte.into());
        while read(UART + 0x11C) == 0 {}
    }

    pub fn heard() -> Option<u8> {
        (read(UART + 0x108) != 0).then(|| {
            write(UART + 0x108, 0);
            read(UART + 0x518) as u8
        })
    }
}

#[cfg(not(feature = "nrf52840"))]
mod part {
    use super::{read, write};

    const RCC: usize = 0x4002_3800;
    const GPIOA: usize = 0x4002_0000;
    const GPIOB: usize = 0x4002_0400;
    const GPIOD: usize = 0x4002_0C00;
    const USART2: usize = 0x4000_4400;
    pub const SYSTICK_RELOAD: u32 = 16_000 - 1;

    pub fn set_up() {
        write(RCC + 0x30, 1 | 1 << 1 | 1 << 3); // GPIOA, GPIOB, GPIOD
        write(RCC + 0x40, 1 << 17); // USART2
        read(RCC + 0x40);
        write(GPIOA + 0x0C, read(GPIOA + 0x0C) | 1); // PA0: pull-up
        write(GPIOB, read(GPIOB) | 1 << 14); // PB7: output
        write(GPIOD + 0x20, 7 << 20 | 7 << 24); // PD5, PD6: USART2
        write(GPIOD, 2 << 10 | 2 << 12);
        write(USART2 + 0x08, 139); // 115 200 baud of 16 MHz
        write(USART2 + 0x0C, 1 << 13 | 1 << 3 | 1 << 2);
    }

    pub fn pressed() -> bool {
        read(GPIOA + 0x10) & 1 == 0
    }

    pub fn ring(on: bool) {
        write(GPIOB + 0x18, if on { 1 << 7 } else { 1 << 23 });
    }

    pub fn send(byte: u8) {
        while read(USART2) & 1 << 7 == 0 {}
        write(USART2 + 0x04, byte.into());
    }

    pub fn heard() -> Option<u8> {
        (read(USART2) & 1 << 5 != 0).then(|| read(USART2 + 0x04) as u8)
    }
}

fn semihosting(operation: usize, argument: usize) {
    unsafe { asm!("bkpt 0xAB", inout("r0") operation => _, in("r1") argument) }
}

fn say(text: &[u8]) {
    text.iter().for_each(|byte| part::send(*byte));
}

#[cortex_m_rt::exception]
fn SysTick() {
    TICKS.fetch_add(1, Ordering::Relaxed);
}

#[cortex_m_rt::entry]
fn main() -> ! {
    part::set_up();
    write(0xE000_E014, part::SYSTICK_RELOAD);
    write(0xE000_E018, 0);
    write(0xE000_E010, 7);
    say(b"ready\r\n");
    let (mut rings, mut before) = (0, false);
    loop {
        let now = part::pressed();
        if now != before {
            part::ring(now);
            if now {
                rings += 1;
                semihosting(4, b"rang\n\0".as_ptr() as usize);
            }
            before = now;
        }
        match part::heard() {
            Some(b'?') => say(&[b'0' + rings, b'\r', b'\n']),
            // The exit reason is ADP_Stopped_ApplicationExit.
            Some(b'!') => semihosting(0x18, 0x2_0026),
            _ => {}
        }
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    cortex_m::asm::udf()
}
