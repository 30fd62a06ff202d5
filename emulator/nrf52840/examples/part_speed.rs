//! Measures the host's time for frequent operations of firmware: register accesses, bytes of an SPIM, bytes of an SPIS.
use cortex_m4::{Access, Purpose, Width};
use emulator_part::{Cycle, I2cAnswer, I2cEvent, Outside, Pad, Part, Pin, SpiFrame, SpiMode, UartFrame};
use nrf52840::{Nrf52840, Settings, SpisWires};
use std::time::Instant;

const SPIM0: u32 = 0x4000_3000;
const SPIS1: u32 = 0x4000_4000;
const TIMER0: u32 = 0x4000_8000;
const P1: u32 = 0x5000_0300;
const RAM: u32 = 0x2000_0000;

struct Echo;

impl Outside for Echo {
    fn pin(&mut self, _: Cycle, _: Pin, _: Pad) {}
    fn spi(&mut self, frame: &SpiFrame) -> Option<u32> {
        Some(!frame.data & 0xFF)
    }
    fn uart(&mut self, _: Cycle, _: Pin, _: &UartFrame) {}
    fn i2c(&mut self, _: Cycle, _: Pin, _: Pin, _: I2cEvent) -> I2cAnswer {
        I2cAnswer::NOBODY
    }
    fn microvolts(&self, _: Cycle, _: Pin) -> i32 {
        0
    }
}

fn write(part: &mut Nrf52840, cycle: Cycle, address: u32, value: u32) {
    let access = Access { address, width: Width::Word, purpose: Purpose::Data, privileged: true, cycle, pc: 0 };
    part.write(&access, value, &mut Echo).expect("a register");
}

fn read(part: &mut Nrf52840, cycle: Cycle, address: u32) -> u32 {
    let access = Access { address, width: Width::Word, purpose: Purpose::Data, privileged: true, cycle, pc: 0 };
    part.read(&access, &mut Echo).expect("a register")
}

fn report(what: &str, n: u64, since: Instant) {
    println!("{what:32} {:6.1} ns", since.elapsed().as_nanos() as f64 / n as f64);
}

fn main() {
    let part = &mut Nrf52840::new(Settings::default());
    let mut cycle = 0;
    for n in 1..16 {
        write(part, 0, P1 + 0x700 + 4 * n, if n >= 12 && n != 14 { 3 } else { 0 });
    }
    const N: u64 = 2_000_000;

    let since = Instant::now();
    for _ in 0..N {
        cycle += 4;
        write(part, cycle, TIMER0 + 0x44, 1);
    }
    report("TIMER CAPTURE", N, since);

    let since = Instant::now();
    let mut sum = 0;
    for _ in 0..N {
        cycle += 4;
        sum += u64::from(read(part, cycle, TIMER0 + 0x544));
    }
    report("TIMER CC read", N, since);

    let since = Instant::now();
    for n in 0..N {
        cycle += 4;
        write(part, cycle, P1 + if n % 2 == 0 { 0x508 } else { 0x50C }, 1 << 12);
    }
    report("OUTSET, OUTCLR", N, since);

    let since = Instant::now();
    for n in 0..N as u32 {
        write(part, cycle, RAM + n % 1024 * 4, n);
        sum += u64::from(read(part, cycle, RAM + n % 512 * 4));
    }
    report("RAM write and read", N, since);

    for (offset, value) in [(0x508, 47), (0x50C, 45), (0x510, 46), (0x524, 0x8000_0000), (0x500, 7)] {
        write(part, cycle, SPIM0 + offset, value);
    }
    for (offset, value) in [(0x534, RAM), (0x538, 256), (0x544, RAM + 256), (0x548, 256)] {
        write(part, cycle, SPIM0 + offset, value);
    }
    let since = Instant::now();
    for _ in 0..N / 256 {
        write(part, cycle, SPIM0 + 0x118, 0);
        write(part, cycle, SPIM0 + 0x10, 1);
        while part.due() != u64::MAX {
            cycle = part.due();
            part.advance(cycle, &mut Echo);
        }
    }
    report("SPIM byte", N, since);

    let csn = Pin::new(1, 4);
    part.wire_spis(SpisWires { sck: Pin::new(1, 1), mosi: Pin::new(1, 2), miso: Pin::new(1, 3), csn });
    for (offset, value) in [(0x508, 33), (0x50C, 34), (0x510, 35), (0x514, 36), (0x500, 2)] {
        write(part, cycle, SPIS1 + offset, value);
    }
    for (offset, value) in [(0x534, RAM), (0x538, 256), (0x544, RAM + 256), (0x548, 256), (0x028, 1)] {
        write(part, cycle, SPIS1 + offset, value);
    }
    let (mosi, mut miso) = ([0x5A; 255], [0; 255]);
    let since = Instant::now();
    for _ in 0..N / 255 {
        cycle += 640;
        part.spis_select(cycle, csn, &mut Echo);
        cycle += 128;
        part.spis_exchange(cycle, 64 << 16, SpiMode::Mode0, &mosi, &mut miso, &mut Echo);
        cycle += 64 * 255;
        part.spis_deselect(cycle, csn, &mut Echo);
    }
    report("SPIS byte, together", N, since);
    assert!(part.findings().is_empty(), "{:?}", part.findings());
    println!("{sum}");
}
