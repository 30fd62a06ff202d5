//! The two boards: each part with its front end, and the pins between them.
//!
//! | | HORUS: NUCLEO-F429ZI | DPR: nRF52840-DK |
//! |---|---|---|
//! | front end: SCK, MISO, MOSI | PA5, PA6, PA7 (SPI1) | P1.15, P1.14, P1.13 |
//! | front end: chip select, IRQ | PD14, PA3 | P1.12, P0.03 |
//! | receivers 1 to 5 | PD6, PC7, PC11, PD2, PE7 | – |
//! | SSI: SCK, MOSI, MISO, CSN, FRESH | – | P1.01, P1.02, P1.03, P1.04, P1.05 |

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use nrf52840_model::{Nrf52840, Pin, SpiBus, SpiMode};
use rigless::chip::{Timeline, uart};
use rigless::mcu::Mcu;
use rigless::snapshot::Store;
use rigless::soc::stm32f427::generated::tim2;
use rigless::time::VirtualNanos;

use super::front_end::FrontEnd;
use crate::engine::Wiring;
use crate::stm32f427::{PinId, SerialPort, Stm32f427Part};

/// The front end's SPI clock on the HORUS side, as the firmware sets it, Hz.
pub const HORUS_SPI_HZ: u32 = horus_tx_fw::timing::SPI_HZ;
/// The front end's SPI clock at the DPR, as the firmware sets it: the highest of SPIM0, Hz.
pub const DPR_SPI_HZ: u32 = 8_000_000;
/// Where the SSI's chip select arrives.
pub const SSI_CSN: Pin = Pin::p1(4);
/// Where the DPR announces a new image.
pub const FRESH: Pin = Pin::p1(5);
/// The front end's interrupt output at the DPR.
const DPR_IRQ: Pin = Pin::p0(3);
/// The front end's wires at the DPR; the chip samples on the second edge of an idle-low clock (DS13541, SPI interface).
const DPR_FRONT_END: SpiBus =
    SpiBus { sck: Pin::p1(15), mosi: Pin::p1(13), miso: Pin::p1(14), cs: Pin::p1(12), mode: SpiMode::Mode1 };
/// The front end's interrupt output on the HORUS side.
const HORUS_IRQ: PinId = PinId::new('A', 3);
/// The front end's chip select on the HORUS side.
const HORUS_CS: PinId = PinId::new('D', 14);
/// TIM2's update flag in its status register, RM0090 section 18.4.5.
const UIF: u64 = 1;
/// The ports of receivers 1 to 5.
const RECEIVER_PORTS: [SerialPort; 5] =
    [SerialPort::Usart2, SerialPort::Usart6, SerialPort::Uart4, SerialPort::Uart5, SerialPort::Uart7];

/// The wire from a receiver: bytes wait here until the line takes them, back to back.
#[derive(Clone, Debug, Default)]
pub struct Line(Arc<Mutex<VecDeque<u8>>>);

impl Line {
    /// The receiver begins to send these bytes.
    pub fn send(&self, bytes: &[u8]) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend(bytes);
    }
}

/// A run starts from its images and seed alone; there are no snapshots.
impl Store for Line {}

impl uart::Peer for Line {
    /// HORUS says nothing to its receivers; they are configured.
    fn receive(&mut self, _word: u16, _context: &mut Timeline<'_, '_>) {}

    fn transmit(&mut self, _now: VirtualNanos) -> Option<u16> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop_front().map(u16::from)
    }
}

/// The HORUS side.
#[derive(Debug)]
pub struct Horus {
    part: Stm32f427Part,
    front_end: FrontEnd,
    /// What the front end's interrupt output was last driven to.
    irq: Option<bool>,
    /// TIM2's place on the part's bus.
    timer: usize,
    /// Whether its update flag was set when last looked at.
    updated: bool,
    ticks: Vec<u64>,
}

impl Horus {
    /// The board, and the lines of its receivers.
    ///
    /// # Panics
    ///
    /// If the part's own tables lack TIM2, which no input changes.
    #[must_use]
    pub fn new(mut part: Stm32f427Part, front_end: FrontEnd, receivers: usize) -> (Self, Vec<Line>) {
        front_end.with(|chip| chip.spi_clock_hz(HORUS_SPI_HZ));
        part.attach_spi(1, front_end.clone(), HORUS_CS);
        let lines: Vec<Line> = std::iter::repeat_with(Line::default).take(receivers).collect();
        for (line, port) in lines.iter().zip(RECEIVER_PORTS) {
            part.attach_serial(port, line.clone());
        }
        let timer = part.bus().slot("TIM2").expect("an instance of the part");
        (Self { part, front_end, irq: None, timer, updated: false, ticks: vec![] }, lines)
    }

    /// The 10 ms timer's ticks since the last call: each the instant TIM2's update flag rose, in ns.
    pub fn take_ticks(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.ticks)
    }

    fn watch_tick(&mut self, at: u64) {
        let timer = self.part.bus().slots()[self.timer].registers();
        let updated = timer.get(tim2::Register::Sr) & UIF != 0;
        if updated && !self.updated {
            self.ticks.push(at);
        }
        self.updated = updated;
    }
}

impl Wiring for Horus {
    type Part = Stm32f427Part;

    fn part(&self) -> &Stm32f427Part {
        &self.part
    }

    fn part_mut(&mut self) -> &mut Stm32f427Part {
        &mut self.part
    }

    fn next_event(&self) -> u64 {
        self.front_end.next_event()
    }

    fn settle(&mut self, at: u64) -> bool {
        self.watch_tick(at);
        let irq = self.front_end.irq_at(at);
        self.irq.replace(irq) != Some(irq) && self.part.drive_pin(at, HORUS_IRQ, irq)
    }

    fn outgoing(&self) -> bool {
        self.front_end.has_air()
    }
}

/// The DPR.
#[derive(Debug)]
pub struct Dpr {
    part: Nrf52840,
    front_end: FrontEnd,
    irq: bool,
}

impl Dpr {
    /// The board, with nobody selected on its SSI.
    #[must_use]
    pub fn new(mut part: Nrf52840, front_end: FrontEnd) -> Self {
        front_end.with(|chip| chip.spi_clock_hz(DPR_SPI_HZ));
        part.attach_spi(DPR_FRONT_END, Box::new(front_end.clone()));
        part.drive_pin(VirtualNanos(0), SSI_CSN, true);
        part.drive_pin(VirtualNanos(0), DPR_IRQ, false);
        Self { part, front_end, irq: false }
    }
}

impl Wiring for Dpr {
    type Part = Nrf52840;

    fn part(&self) -> &Nrf52840 {
        &self.part
    }

    fn part_mut(&mut self) -> &mut Nrf52840 {
        &mut self.part
    }

    fn next_event(&self) -> u64 {
        self.front_end.next_event()
    }

    fn settle(&mut self, at: u64) -> bool {
        let irq = self.front_end.irq_at(at);
        if irq == self.irq {
            return false;
        }
        self.irq = irq;
        self.part.drive_pin(VirtualNanos(at), DPR_IRQ, irq);
        true
    }

    fn outgoing(&self) -> bool {
        self.front_end.has_air()
    }
}
