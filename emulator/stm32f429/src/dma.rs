//! The DMA controllers, RM0090 chapter 10: registers and streams. Module `transfers` moves the data.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | Request mapping, tables 42 and 43 | A request reaches only the stream whose `CHSEL` selects it |
//! | `CR`, `NDTR`, `PAR`, `M0AR`, `M1AR`, `FCR` | The configuration cannot be changed while `EN` is set, 10.5.5 |
//! | Direct mode, FIFO mode, packing, 10.3.11, 10.3.12 | Modelled as far as software sees it |
//! | Circular and double-buffer mode, 10.3.8, 10.3.9 | Modelled as the manual describes it |
//! | Memory to memory, 10.3.6 | DMA2 only; all data moves when the stream is switched on |
//! | Flags | `TCIF`, `HTIF`, `TEIF`, `FEIF`; `TCIF` also when software switches a stream off, 10.3.14 |
//! | Priority | Software priority, then stream number; DMA1 before DMA2 if both have a request at one cycle |
//!
//! A transfer takes no time: data moves at the cycle of its request, and `EN` reads 0 right after it is cleared.
//!
//! **Left out.** `DMEIF` never comes, since a direct transfer never waits. `PFCTRL` (SDIO only) makes a finding and is
//! ignored. Bursts move like single transfers. A burst that crosses 1 KiB makes a finding. A burst that does not fit
//! the FIFO threshold makes a finding and a FIFO error (RM0090 10.3.12).

use cortex_m4::Width;
use emulator_part::FindingKind;

use crate::gpio::{lane, merge};
use crate::id;

pub(crate) const EN: u32 = 1 << 0;
const DMEIE: u32 = 1 << 1;
const TEIE: u32 = 1 << 2;
const HTIE: u32 = 1 << 3;
const TCIE: u32 = 1 << 4;
const PFCTRL: u32 = 1 << 5;
const CIRC: u32 = 1 << 8;
const PINC: u32 = 1 << 9;
const MINC: u32 = 1 << 10;
const PINCOS: u32 = 1 << 15;
const DBM: u32 = 1 << 18;
const CT: u32 = 1 << 19;

const FEIF: u8 = 1 << 0;
pub(crate) const TEIF: u8 = 1 << 3;
const HTIF: u8 = 1 << 4;
const TCIF: u8 = 1 << 5;

const DMDIS: u32 = 1 << 2;
const FEIE: u32 = 1 << 7;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Direction {
    FromPeripheral,
    ToPeripheral,
    MemoryToMemory,
}

type Source = (u8, u8);

const fn no() -> Source {
    (0, 0)
}
const RX: u8 = 1;
const TX: u8 = 2;
const UP: u8 = 1;
const CH1: u8 = 2;
const CH2: u8 = 4;
const CH3: u8 = 8;
const CH4: u8 = 16;
const TRIG: u8 = 32;
const COM: u8 = 64;

const fn spi(n: u8, what: u8) -> Source {
    (id::spi(n), what)
}
const fn uart(n: u8, what: u8) -> Source {
    (id::usart(n), what)
}
const fn i2c(n: u8, what: u8) -> Source {
    (id::i2c(n), what)
}
const fn tim(n: u8, what: u8) -> Source {
    (id::tim(n), what)
}
const fn adc(n: u8) -> Source {
    (id::ADC, 1 << (n - 1))
}

/// The request mapping of RM0090 tables 42 and 43, by controller, channel and stream. Peripherals without a model have
/// no requests.
#[rustfmt::skip]
static MAP: [[[Source; 8]; 8]; 2] = [
    [
        [spi(3, RX), no(), spi(3, RX), spi(2, RX), spi(2, TX), spi(3, TX), no(), spi(3, TX)],
        [i2c(1, RX), no(), tim(7, UP), no(), tim(7, UP), i2c(1, RX), i2c(1, TX), i2c(1, TX)],
        [tim(4, CH1), no(), no(), tim(4, CH2), no(), no(), tim(4, UP), tim(4, CH3)],
        [no(), tim(2, UP | CH3), i2c(3, RX), no(), i2c(3, TX), tim(2, CH1), tim(2, CH2 | CH4), tim(2, UP | CH4)],
        [uart(5, RX), uart(3, RX), uart(4, RX), uart(3, TX), uart(4, TX), uart(2, RX), uart(2, TX), uart(5, TX)],
        [uart(8, TX), uart(7, TX), tim(3, CH4 | UP), uart(7, RX), tim(3, CH1 | TRIG), tim(3, CH2), uart(8, RX),
         tim(3, CH3)],
        [tim(5, CH3 | UP), tim(5, CH4 | TRIG), tim(5, CH1), tim(5, CH4 | TRIG), tim(5, CH2), no(), tim(5, UP), no()],
        [no(), tim(6, UP), i2c(2, RX), i2c(2, RX), uart(3, TX), no(), no(), i2c(2, TX)],
    ],
    [
        [adc(1), no(), tim(8, CH1 | CH2 | CH3), no(), adc(1), no(), tim(1, CH1 | CH2 | CH3), no()],
        [no(), no(), adc(2), adc(2), no(), spi(6, TX), spi(6, RX), no()],
        [adc(3), adc(3), no(), spi(5, RX), spi(5, TX), no(), no(), no()],
        [spi(1, RX), no(), spi(1, RX), spi(1, TX), no(), spi(1, TX), no(), no()],
        [spi(4, RX), spi(4, TX), uart(1, RX), no(), no(), uart(1, RX), no(), uart(1, TX)],
        [no(), uart(6, RX), uart(6, RX), spi(4, RX), spi(4, TX), no(), uart(6, TX), uart(6, TX)],
        [tim(1, TRIG), tim(1, CH1), tim(1, CH2), tim(1, CH1), tim(1, CH4 | TRIG | COM), tim(1, UP), tim(1, CH3), no()],
        [no(), tim(8, UP), tim(8, CH1), tim(8, CH2), tim(8, CH3), spi(5, RX), spi(5, TX), tim(8, CH4 | TRIG | COM)],
    ],
];

#[derive(Clone, Debug)]
pub(crate) struct Stream {
    pub(crate) cr: u32,
    ndtr: u32,
    par: u32,
    m0ar: u32,
    m1ar: u32,
    fcr: u32,
    pub(crate) flags: u8,
    /// The number of items of a whole transfer. In circular mode NDTR is reloaded with this number.
    total: u32,
    pub(crate) left: u32,
    pub(crate) peripheral: u32,
    pub(crate) memory: u32,
    /// The 16 bytes of the FIFO, the oldest byte lowest.
    fifo: u128,
    pub(crate) filled: u8,
    /// The number of bytes of the present transfer that have yet to be read from memory.
    ahead: u32,
    /// The request that the stream serves. Its mask is 0 while the stream is off.
    pub(crate) source: Source,
}

/// A mask of the bits of `width`.
const fn ones(width: Width) -> u128 {
    (1 << (8 * width.bytes())) - 1
}

impl Stream {
    const OFF: Self = Self {
        cr: 0,
        ndtr: 0,
        par: 0,
        m0ar: 0,
        m1ar: 0,
        fcr: 0x21,
        flags: 0,
        total: 0,
        left: 0,
        peripheral: 0,
        memory: 0,
        fifo: 0,
        filled: 0,
        ahead: 0,
        source: (0, 0),
    };

    pub(crate) fn is_on(&self) -> bool {
        self.cr & EN != 0
    }

    pub(crate) fn direction(&self) -> Direction {
        match self.cr >> 6 & 3 {
            0 => Direction::FromPeripheral,
            1 => Direction::ToPeripheral,
            _ => Direction::MemoryToMemory,
        }
    }

    pub(crate) fn priority(&self) -> u32 {
        self.cr >> 16 & 3
    }

    fn is_direct(&self) -> bool {
        self.fcr & DMDIS == 0
    }

    pub(crate) fn peripheral_width(&self) -> Width {
        width(self.cr >> 11 & 3)
    }

    /// Returns the width on the memory side. In direct mode it is PSIZE, RM0090 10.3.11.
    pub(crate) fn memory_width(&self) -> Width {
        if self.is_direct() { self.peripheral_width() } else { width(self.cr >> 13 & 3) }
    }

    fn threshold(&self) -> u8 {
        4 * (1 + (self.fcr & 3) as u8)
    }

    pub(crate) fn irq(&self) -> bool {
        let flags = u32::from(self.flags);
        flags & u32::from(TCIF) != 0 && self.cr & TCIE != 0
            || flags & u32::from(HTIF) != 0 && self.cr & HTIE != 0
            || flags & u32::from(TEIF) != 0 && self.cr & TEIE != 0
            || flags & 4 != 0 && self.cr & DMEIE != 0
            || flags & u32::from(FEIF) != 0 && self.fcr & FEIE != 0
    }

    fn fifo_status(&self) -> u32 {
        match self.filled {
            0 => 4,
            16 => 5,
            bytes => u32::from(bytes / 4),
        }
    }

    pub(crate) fn push(&mut self, value: u32, width: Width) {
        let (at, count) = (self.filled, width.bytes() as u8);
        if at + count <= 16 {
            let mask = ones(width);
            self.fifo = self.fifo & !(mask << (8 * at)) | (u128::from(value) & mask) << (8 * at);
            self.filled += count;
        }
    }

    pub(crate) fn pop(&mut self, width: Width) -> u32 {
        let value = (self.fifo & ones(width)) as u32;
        self.fifo >>= 8 * width.bytes();
        self.filled = self.filled.saturating_sub(width.bytes() as u8);
        value
    }

    /// Whether the FIFO has data from the peripheral that must move to memory now.
    pub(crate) fn drains(&self) -> bool {
        u32::from(self.filled) >= self.memory_width().bytes()
            && (self.is_direct() || self.filled >= self.threshold() || self.left == 0)
    }

    /// Whether the present transfer needs an item from memory, and the FIFO has room for it.
    pub(crate) fn fills(&self) -> bool {
        let width = self.memory_width().bytes();
        let room = if self.is_direct() { width } else { 16 };
        self.ahead >= width && u32::from(self.filled) + width <= room
    }

    /// Returns the address of the peripheral register of the present transfer, as it was at the beginning.
    pub(crate) fn register(&self) -> u32 {
        self.par
    }

    /// Whether the stream is on and moves single bytes between memory and one register, in the direction that
    /// `to_memory` gives, without its FIFO.
    pub(crate) fn moves_bytes(&self, to_memory: bool) -> bool {
        let direction = if to_memory { Direction::FromPeripheral } else { Direction::ToPeripheral };
        self.is_on()
            && self.direction() == direction
            && self.is_direct()
            && self.peripheral_width() == Width::Byte
            && self.cr & PINC == 0
    }

    /// Whether the next item completes neither the transfer nor the first half of it. A stream of
    /// [`Stream::moves_bytes`] then holds no data if it receives, and one byte if it sends.
    #[inline]
    pub(crate) fn is_amid(&self) -> bool {
        self.left > 1
            && self.left - 1 != self.total / 2
            && u32::from(self.filled) == u32::from(self.direction() == Direction::ToPeripheral)
    }

    /// Counts a byte that goes from the peripheral straight to memory while [`Stream::is_amid`].
    #[inline]
    pub(crate) fn pass_byte(&mut self) {
        self.fifo >>= 8;
        self.left -= 1;
        self.step_memory();
    }

    /// Returns the byte that the stream holds while [`Stream::is_amid`]. Reads the next one from memory if the stream
    /// has one to send.
    #[inline(always)]
    pub(crate) fn next_byte(&mut self, read: impl FnOnce() -> u32) -> u32 {
        let value = self.fifo as u32 & 0xFF;
        self.fifo >>= 8;
        self.left -= 1;
        if self.ahead == 0 {
            self.filled = 0;
        } else {
            self.fifo = self.fifo & !0xFF | u128::from(read() & 0xFF);
            self.ahead -= 1;
            self.step_memory();
        }
        value
    }

    /// Counts an item that was read from memory into the FIFO.
    pub(crate) fn filled_from_memory(&mut self) {
        self.ahead -= self.memory_width().bytes();
    }

    #[inline]
    pub(crate) fn step_memory(&mut self) {
        if self.cr & MINC != 0 {
            self.memory = self.memory.wrapping_add(self.memory_width().bytes());
        }
    }

    pub(crate) fn step_peripheral(&mut self) {
        if self.cr & PINC != 0 {
            let step = if self.cr & PINCOS != 0 { 4 } else { self.peripheral_width().bytes() };
            self.peripheral = self.peripheral.wrapping_add(step);
        }
    }

    /// Counts an item on the peripheral's side. Returns whether the transfer is complete.
    pub(crate) fn count(&mut self) -> bool {
        self.left -= 1;
        if self.left == self.total / 2 {
            self.flags |= HTIF;
        }
        self.left == 0
    }

    pub(crate) const fn left(&self) -> u32 {
        self.left
    }

    /// Ends a transfer. In circular mode the next one begins.
    pub(crate) fn end_of_lap(&mut self) {
        self.flags |= TCIF;
        if self.cr & (CIRC | DBM) != 0 && self.direction() != Direction::MemoryToMemory {
            if self.cr & DBM != 0 {
                self.cr ^= CT;
            }
            self.begin_lap();
        } else {
            self.switch_off();
        }
    }

    fn begin_lap(&mut self) {
        self.left = self.total;
        self.ahead = self.total * self.peripheral_width().bytes();
        self.peripheral = self.par;
        self.memory = if self.cr & DBM != 0 && self.cr & CT != 0 { self.m1ar } else { self.m0ar };
    }

    pub(crate) fn switch_off(&mut self) {
        self.cr &= !EN;
        self.ndtr = self.left;
        self.source = (0, 0);
        self.filled = 0;
    }

    pub(crate) fn fail(&mut self) {
        self.flags |= TEIF;
        self.switch_off();
    }
}

fn width(code: u32) -> Width {
    match code {
        0 => Width::Byte,
        1 => Width::Half,
        _ => Width::Word,
    }
}

/// The effect that a write of a register has on a stream: start or stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    Nothing,
    On(usize),
    /// Software switched the stream off. The data in its FIFO must still go to memory.
    Off(usize),
}

#[derive(Clone, Debug)]
pub(crate) struct Dma {
    /// 0 for DMA1, 1 for DMA2.
    number: usize,
    pub(crate) streams: [Stream; 8],
}

/// The bit positions of the streams' flags in LISR and HISR.
const SHIFTS: [u32; 4] = [0, 6, 16, 22];

impl Dma {
    pub(crate) fn new(number: usize) -> Self {
        Self { number, streams: [Stream::OFF; 8] }
    }

    #[inline]
    pub(crate) fn is_active(&self) -> bool {
        self.streams.iter().any(Stream::is_on)
    }

    pub(crate) fn read(&self, offset: u32, width: Width) -> u32 {
        let register = match offset >> 2 {
            half @ (0 | 1) => {
                let mut flags = 0;
                for (nth, shift) in SHIFTS.into_iter().enumerate() {
                    flags |= u32::from(self.streams[4 * half as usize + nth].flags) << shift;
                }
                flags
            }
            number @ 4..=51 => {
                let stream = &self.streams[(number - 4) as usize / 6];
                match (number - 4) % 6 {
                    0 => stream.cr,
                    1 => {
                        if stream.is_on() {
                            stream.left
                        } else {
                            stream.ndtr
                        }
                    }
                    2 => stream.par,
                    3 => stream.m0ar,
                    4 => stream.m1ar,
                    _ => stream.fcr & 0x87 | stream.fifo_status() << 3,
                }
            }
            _ => 0,
        };
        lane(register, offset, width)
    }

    pub(crate) fn write(
        &mut self,
        offset: u32,
        width: Width,
        value: u32,
        find: &mut impl FnMut(FindingKind, &'static str),
    ) -> Turn {
        match offset >> 2 {
            half @ (2 | 3) => {
                let bits = merge(0, offset, width, value);
                for (nth, shift) in SHIFTS.into_iter().enumerate() {
                    self.streams[4 * (half as usize - 2) + nth].flags &= !((bits >> shift & 0x3D) as u8);
                }
                Turn::Nothing
            }
            number @ 4..=51 => {
                let nth = (number - 4) as usize / 6;
                let stream = &mut self.streams[nth];
                let on = stream.is_on();
                let mut protected = |register: &mut u32, mask: u32| {
                    let new = merge(*register, offset, width, value) & mask;
                    if !on {
                        *register = new;
                    } else if new != *register {
                        find(FindingKind::Misuse, "a stream's configuration is written while it is on: it stays");
                    }
                };
                match (number - 4) % 6 {
                    0 => return self.control(nth, merge(self.streams[nth].cr, offset, width, value), find),
                    1 => protected(&mut stream.ndtr, 0xFFFF),
                    2 => protected(&mut stream.par, u32::MAX),
                    // In double-buffer mode, software may change the address of the unused buffer (RM0090 10.3.9).
                    3 if on && stream.cr & (DBM | CT) == DBM | CT => stream.m0ar = value,
                    4 if on && stream.cr & (DBM | CT) == DBM => stream.m1ar = value,
                    3 => protected(&mut stream.m0ar, u32::MAX),
                    4 => protected(&mut stream.m1ar, u32::MAX),
                    _ => {
                        let new = merge(stream.fcr, offset, width, value) & 0x87;
                        stream.fcr = if on { stream.fcr & 7 | new & FEIE } else { new };
                    }
                }
                Turn::Nothing
            }
            _ => Turn::Nothing,
        }
    }

    fn control(&mut self, nth: usize, new: u32, find: &mut impl FnMut(FindingKind, &'static str)) -> Turn {
        const INTERRUPTS: u32 = DMEIE | TEIE | HTIE | TCIE;
        let stream = &mut self.streams[nth];
        let new = new & 0x0FEF_FFFF;
        if stream.is_on() {
            if (new ^ stream.cr) & !(EN | INTERRUPTS) != 0 {
                find(FindingKind::Misuse, "a stream's configuration is written while it is on: it stays");
            }
            stream.cr = stream.cr & !INTERRUPTS | new & INTERRUPTS;
            return if new & EN == 0 { Turn::Off(nth) } else { Turn::Nothing };
        }
        stream.cr = new & !EN;
        if new & EN == 0 {
            return Turn::Nothing;
        }
        // RM0090 10.3.17 requires all event flags to be clear "before the stream can be re-enabled". Common drivers
        // leave the half transfer and FIFO flags set, and their streams start. Any other flag keeps a stream from
        // starting.
        if stream.flags & !(HTIF | FEIF) != 0 {
            find(FindingKind::Misuse, "a stream is switched on with flags set: it stays off");
            return Turn::Nothing;
        }
        if stream.ndtr == 0 {
            find(FindingKind::Misuse, "a stream is switched on with NDTR 0: it stays off");
            return Turn::Nothing;
        }
        if stream.cr & PFCTRL != 0 {
            find(FindingKind::Unmodelled, "PFCTRL has no effect here: NDTR counts");
        }
        if stream.cr >> 11 & 3 == 3 || stream.cr >> 13 & 3 == 3 || stream.cr >> 6 & 3 == 3 {
            find(FindingKind::Misuse, "PSIZE, MSIZE or DIR has its reserved value");
        }
        if stream.direction() == Direction::MemoryToMemory {
            if self.number == 0 {
                find(FindingKind::Misuse, "DMA1 cannot move memory to memory: the stream fails");
                stream.flags |= TEIF;
                return Turn::Nothing;
            }
            if stream.cr & (CIRC | DBM) != 0 || stream.is_direct() {
                find(FindingKind::Misuse, "memory to memory in circular, double-buffer or direct mode is forbidden");
                stream.flags |= TEIF;
                return Turn::Nothing;
            }
        }
        let step = stream.memory_width().bytes();
        let burst = [1, 4, 8, 16][(stream.cr >> 23 & 3) as usize] * step;
        // The FIFO threshold has to be a whole number of bursts (RM0090 table 48).
        if !stream.is_direct() && (burst > 16 || !u32::from(stream.threshold()).is_multiple_of(burst)) {
            find(FindingKind::Misuse, "the memory burst does not fit the FIFO threshold: the stream stays off");
            stream.flags |= FEIF;
            return Turn::Nothing;
        }
        if !stream.m0ar.is_multiple_of(step) || !stream.par.is_multiple_of(stream.peripheral_width().bytes()) {
            find(FindingKind::Misuse, "a stream's address is not aligned to its data size");
        }
        let bytes = stream.ndtr * stream.peripheral_width().bytes();
        if !bytes.is_multiple_of(step) {
            find(FindingKind::Misuse, "NDTR is no whole number of memory items, 10.3.11");
        }
        stream.cr |= EN;
        stream.total = stream.ndtr;
        stream.filled = 0;
        stream.begin_lap();
        stream.source = MAP[self.number][(stream.cr >> 25 & 7) as usize][nth];
        if stream.source.1 == 0 && stream.direction() != Direction::MemoryToMemory {
            find(FindingKind::Misuse, "a stream's channel has no request, or one of a peripheral that is not modelled");
        }
        Turn::On(nth)
    }

    /// Switches a stream off because software requested it, and sets its transfer complete flag.
    pub(crate) fn switched_off(&mut self, nth: usize) {
        let stream = &mut self.streams[nth];
        stream.switch_off();
        stream.flags |= TCIF;
    }
}
