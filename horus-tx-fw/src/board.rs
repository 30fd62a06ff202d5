//! Every pin, DMA stream, interrupt vector and clock that the firmware uses
//!
//! The board is a NUCLEO-F429ZI with an X-NUCLEO-NFC08A1 or NFC06A1 on its Arduino header.
//!
//! | use | peripheral | pins | DMA |
//! |---|---|---|---|
//! | front end, clocked in | SPI1 | MISO PA6 | DMA2 stream 0 channel 3 |
//! | front end, clocked out | SPI1 | MOSI PA7, SCK PA5, chip select PD14 | DMA2 stream 3 channel 3 |
//! | front end's interrupt request | EXTI line 3 | IRQ PA3 | – |
//! | waits of the front end's driver | TIM5 | – | – |
//! | inputs of HORUS's state | – | relay PE2, PE4; motor cut PE5, PE6; emergency measure PD3, PD4 | – |
//! | cycle and slots | TIM2 | TICK PB10 (channel 3) | – |
//! | calls of tasks of lower priority | vectors of CAN1 and CAN2, which stay off | – | – |
//! | receivers | see [`RECEIVER_PORTS`] | | |
//!
//! Streams and channels are those of RM0090 "DMA controller", DMA1 and DMA2 request mapping (tables 42 and 43).
//!
//! # To add or move a receiver
//!
//! To add or move a receiver, change its row in [`RECEIVER_PORTS`]. RTIC binds vectors by name, so the receiver's tasks
//! in `main.rs` must have the row's vectors; a vector that is in no row does not compile. No other file names a
//! receiver's hardware.
//!
//! A new kind of interface needs a variant of [`Hardware`], and a type in `hw/` that implements
//! `horus_tx_fw::source::Source`; `hw/gnss.rs` dispatches to these types.

use horus_tx_fw::{
    configuration::Interface,
    source::Vector,
    state_inputs::INPUTS,
    task::{Task, TASKS},
    timing,
};
use profile::MAX_RECEIVERS;
use stm32f4xx_hal::{
    pac::{self, i2c1, spi1, tim3, uart4, Interrupt},
    rcc::Enable,
};

horus_tx_fw::each_task!(firmware_common::task_vectors);

/// Calls every task that otherwise only hardware calls. The watchdog is fed only when these tasks have checked in too.
pub(crate) fn ask_for_signs_of_life() {
    Task::ALL.into_iter().filter(|task| task.calls_for_sign_of_life()).for_each(call);
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum GpioPort {
    A,
    B,
    C,
    D,
    E,
    F,
}

#[derive(Clone, Copy)]
pub(crate) struct Pin {
    pub(crate) port: GpioPort,
    pub(crate) number: u8,
}

/// A pin and its alternate function, which connects it to a peripheral (DS9405, alternate function mapping).
#[derive(Clone, Copy)]
pub(crate) struct AlternatePin {
    pub(crate) pin: Pin,
    pub(crate) function: u8,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dma {
    /// DMA1 serves the peripherals of APB1.
    One,
    /// DMA2 serves the peripherals of APB2.
    Two,
}

/// A stream of a DMA controller, 0 to 7, and the channel, 0 to 7, by which the peripheral's requests reach it.
#[derive(Clone, Copy)]
pub(crate) struct Stream {
    pub(crate) dma: Dma,
    pub(crate) number: u8,
    pub(crate) channel: u8,
}

// ---- Cycle

/// The pin that shows each tick to a logic analyser: TIM2 channel 3, CN10 pin 32 of the NUCLEO (D36). It is high for
/// the last [`timing::TICK_PULSE_TICKS`] of each cycle, and falls with the tick.
pub(crate) const TICK: AlternatePin = AlternatePin { pin: Pin { port: GpioPort::B, number: 10 }, function: 1 };

// ---- State

/// An input of two pins whose levels are opposite unless a wire is broken (decision 18).
pub(crate) struct InputPair {
    /// The pin that is high while the input is active.
    pub(crate) active: Pin,
    /// The pin that is high while the input is not active.
    pub(crate) inactive: Pin,
}

/// The input pairs from which HORUS derives its state: relay (D56, D57), motor cut (D58, D59), emergency measure (D55,
/// D54).
pub(crate) const STATE_INPUTS: [InputPair; INPUTS] = [
    InputPair { active: Pin { port: GpioPort::E, number: 2 }, inactive: Pin { port: GpioPort::E, number: 4 } },
    InputPair { active: Pin { port: GpioPort::E, number: 5 }, inactive: Pin { port: GpioPort::E, number: 6 } },
    InputPair { active: Pin { port: GpioPort::D, number: 3 }, inactive: Pin { port: GpioPort::D, number: 4 } },
];

// ---- Front end

/// The clock pin of the front end's SPI (SPI1).
pub(crate) const SCK: AlternatePin = AlternatePin { pin: Pin { port: GpioPort::A, number: 5 }, function: 5 };
pub(crate) const MISO: AlternatePin = AlternatePin { pin: Pin { port: GpioPort::A, number: 6 }, function: 5 };
pub(crate) const MOSI: AlternatePin = AlternatePin { pin: Pin { port: GpioPort::A, number: 7 }, function: 5 };
pub(crate) const CHIP_SELECT: Pin = Pin { port: GpioPort::D, number: 14 };
/// The pin of the front end's interrupt request, a rising edge. It has number 3, so its vector is EXTI3.
pub(crate) const IRQ: Pin = Pin { port: GpioPort::A, number: 3 };
pub(crate) const SPI_IN: Stream = Stream { dma: Dma::Two, number: 0, channel: 3 };
pub(crate) const SPI_OUT: Stream = Stream { dma: Dma::Two, number: 3, channel: 3 };

// ---- Receivers

/// A 16-bit timer of APB1, which counts at [`timing::TIMER_HZ`].
#[derive(Clone, Copy)]
pub(crate) struct Timer {
    pub(crate) registers: fn() -> *const tim3::RegisterBlock,
    pub(crate) enable: fn(&mut pac::RCC),
    pub(crate) vector: Interrupt,
}

pub(crate) struct UartPort {
    /// The registers of a UART. Those of a USART begin in the same way.
    pub(crate) registers: fn() -> *const uart4::RegisterBlock,
    pub(crate) enable: fn(&mut pac::RCC),
    /// The frequency of the bus that the UART is on, Hz, from which its baud rate is derived.
    pub(crate) bus_hz: u32,
    pub(crate) rx: AlternatePin,
    pub(crate) tx: AlternatePin,
    pub(crate) stream: Stream,
    /// The interrupt vector of the UART. It is raised by an idle line, an error, or a sent byte.
    pub(crate) uart_vector: Interrupt,
    /// The interrupt vector of the DMA stream. It is raised when half a ring is full.
    pub(crate) stream_vector: Interrupt,
}

/// The hardware of a receiver on I2C (u-blox's DDC). The board has the bus's pull-up resistors.
pub(crate) struct DdcPort {
    pub(crate) registers: fn() -> *const i2c1::RegisterBlock,
    pub(crate) enable: fn(&mut pac::RCC),
    /// The frequency of the bus that the I2C peripheral is on, Hz: a whole number of MHz.
    pub(crate) bus_hz: u32,
    pub(crate) scl: AlternatePin,
    pub(crate) sda: AlternatePin,
    /// The DMA stream of the bytes that come in. The processor writes the outgoing bytes itself.
    pub(crate) stream: Stream,
    /// The timer that times the levels of SCL while a stuck I2C bus is recovered.
    pub(crate) timer: Timer,
    pub(crate) event_vector: Interrupt,
    pub(crate) error_vector: Interrupt,
    pub(crate) stream_vector: Interrupt,
}

/// The hardware of a receiver on SPI, mode 0 at [`timing::GNSS_SPI_HZ`].
pub(crate) struct SpiPort {
    pub(crate) registers: fn() -> *const spi1::RegisterBlock,
    pub(crate) enable: fn(&mut pac::RCC),
    pub(crate) sck: AlternatePin,
    pub(crate) miso: AlternatePin,
    pub(crate) mosi: AlternatePin,
    pub(crate) chip_select: Pin,
    pub(crate) stream_in: Stream,
    pub(crate) stream_out: Stream,
    /// The timer for the set-up and hold times of chip select.
    pub(crate) timer: Timer,
    pub(crate) in_vector: Interrupt,
    pub(crate) out_vector: Interrupt,
}

pub(crate) enum Hardware {
    Uart(UartPort),
    Ddc(DdcPort),
    Spi(SpiPort),
}

const fn pin(port: GpioPort, number: u8, function: u8) -> AlternatePin {
    AlternatePin { pin: Pin { port, number }, function }
}

/// The connection of one GNSS receiver, and the period of its solutions that HORUS requests.
pub(crate) struct ReceiverPort {
    /// The period of the receiver's solutions, ms: 25 to 1000 (u-blox, CFG-RATE-MEAS).
    pub(crate) period_ms: u16,
    pub(crate) hardware: Hardware,
}

/// The connections of GPS1 to GPS5. The first [`horus_tx_fw::RECEIVERS`] are in use.
pub(crate) const RECEIVER_PORTS: [ReceiverPort; MAX_RECEIVERS] = [
    ReceiverPort {
        period_ms: 100,
        hardware: Hardware::Uart(UartPort {
            registers: || pac::USART2::ptr().cast(),
            enable: pac::USART2::enable,
            bus_hz: timing::APB1_HZ,
            rx: pin(GpioPort::D, 6, 7),
            tx: pin(GpioPort::D, 5, 7),
            stream: Stream { dma: Dma::One, number: 5, channel: 4 },
            uart_vector: Interrupt::USART2,
            stream_vector: Interrupt::DMA1_STREAM5,
        }),
    },
    ReceiverPort {
        period_ms: 125,
        hardware: Hardware::Ddc(DdcPort {
            registers: pac::I2C2::ptr,
            enable: pac::I2C2::enable,
            bus_hz: timing::APB1_HZ,
            scl: pin(GpioPort::F, 1, 4),
            sda: pin(GpioPort::F, 0, 4),
            stream: Stream { dma: Dma::One, number: 2, channel: 7 },
            timer: Timer { registers: pac::TIM4::ptr, enable: pac::TIM4::enable, vector: Interrupt::TIM4 },
            event_vector: Interrupt::I2C2_EV,
            error_vector: Interrupt::I2C2_ER,
            stream_vector: Interrupt::DMA1_STREAM2,
        }),
    },
    ReceiverPort {
        period_ms: 200,
        hardware: Hardware::Spi(SpiPort {
            registers: pac::SPI5::ptr,
            enable: pac::SPI5::enable,
            sck: pin(GpioPort::F, 7, 5),
            miso: pin(GpioPort::F, 8, 5),
            mosi: pin(GpioPort::F, 9, 5),
            chip_select: Pin { port: GpioPort::E, number: 3 },
            stream_in: Stream { dma: Dma::Two, number: 5, channel: 7 },
            stream_out: Stream { dma: Dma::Two, number: 6, channel: 7 },
            timer: Timer { registers: pac::TIM3::ptr, enable: pac::TIM3::enable, vector: Interrupt::TIM3 },
            in_vector: Interrupt::DMA2_STREAM5,
            out_vector: Interrupt::DMA2_STREAM6,
        }),
    },
    ReceiverPort {
        period_ms: 40,
        hardware: Hardware::Uart(UartPort {
            registers: pac::UART5::ptr,
            enable: pac::UART5::enable,
            bus_hz: timing::APB1_HZ,
            rx: pin(GpioPort::D, 2, 8),
            tx: pin(GpioPort::C, 12, 8),
            stream: Stream { dma: Dma::One, number: 0, channel: 4 },
            uart_vector: Interrupt::UART5,
            stream_vector: Interrupt::DMA1_STREAM0,
        }),
    },
    ReceiverPort {
        period_ms: 100,
        hardware: Hardware::Uart(UartPort {
            registers: pac::UART7::ptr,
            enable: pac::UART7::enable,
            bus_hz: timing::APB1_HZ,
            rx: pin(GpioPort::E, 7, 8),
            tx: pin(GpioPort::E, 8, 8),
            stream: Stream { dma: Dma::One, number: 3, channel: 5 },
            uart_vector: Interrupt::UART7,
            stream_vector: Interrupt::DMA1_STREAM3,
        }),
    },
];

impl Hardware {
    /// Returns the interface of the receiver, which selects the keys of its configuration.
    pub(crate) const fn interface(&self) -> Interface {
        match self {
            Self::Uart(_) => Interface::Uart,
            Self::Ddc(_) => Interface::Ddc,
            Self::Spi(_) => Interface::Spi,
        }
    }

    /// Returns which part of this receiver's hardware raises `vector`; `None` if `vector` belongs to another receiver.
    const fn meaning_of(&self, vector: Interrupt) -> Option<Vector> {
        const fn is(vector: Interrupt, other: Interrupt) -> bool {
            vector as u16 == other as u16
        }
        let [peripheral, stream, timer] = match self {
            Self::Uart(port) => [is(vector, port.uart_vector), is(vector, port.stream_vector), false],
            Self::Ddc(port) => [
                is(vector, port.event_vector) || is(vector, port.error_vector),
                is(vector, port.stream_vector),
                is(vector, port.timer.vector),
            ],
            Self::Spi(port) => {
                [false, is(vector, port.in_vector) || is(vector, port.out_vector), is(vector, port.timer.vector)]
            }
        };
        match (peripheral, stream, timer) {
            (true, false, false) => Some(Vector::Peripheral),
            (false, true, false) => Some(Vector::Stream),
            (false, false, true) => Some(Vector::Timer),
            _ => None,
        }
    }

    /// Returns the two DMA streams of this receiver. A receiver with a single stream has it twice in the result.
    const fn streams(&self) -> [Stream; 2] {
        match self {
            Self::Uart(port) => [port.stream, port.stream],
            Self::Ddc(port) => [port.stream, port.stream],
            Self::Spi(port) => [port.stream_in, port.stream_out],
        }
    }
}

/// Returns the number of the receiver, from 0, to which the vector of `task` belongs, and what raises that vector. For
/// compile time only.
///
/// # Panics
///
/// Panics if the vector belongs to no receiver, or to more than one.
pub(crate) const fn source_of(task: Task) -> (usize, Vector) {
    let vector = TASK_VECTORS[task as usize];
    let mut found = None;
    let mut receiver = 0;
    while receiver < MAX_RECEIVERS {
        if let Some(meaning) = RECEIVER_PORTS[receiver].hardware.meaning_of(vector) {
            assert!(found.is_none(), "two receivers with one vector");
            found = Some((receiver, meaning));
        }
        receiver += 1;
    }
    match found {
        Some(found) => found,
        None => panic!("this vector is in no row of RECEIVER_PORTS"),
    }
}

const fn is_same(one: Stream, other: Stream) -> bool {
    matches!((one.dma, other.dma), (Dma::One, Dma::One) | (Dma::Two, Dma::Two)) && one.number == other.number
}

const fn meet(one: [Stream; 2], other: [Stream; 2]) -> bool {
    is_same(one[0], other[0]) || is_same(one[0], other[1]) || is_same(one[1], other[0]) || is_same(one[1], other[1])
}

// A receiver on I2C or SPI uses the one static buffer of `hw/ddc.rs` or `hw/spi.rs`, so each kind serves one receiver
// at most.
const _: () = {
    let (mut ddc, mut spi) = (0, 0);
    let mut receiver = 0;
    while receiver < MAX_RECEIVERS {
        match RECEIVER_PORTS[receiver].hardware {
            Hardware::Uart(_) => {}
            Hardware::Ddc(_) => ddc += 1,
            Hardware::Spi(_) => spi += 1,
        }
        receiver += 1;
    }
    assert!(ddc <= 1 && spi <= 1, "the buffer of this kind has one user");
};

// No DMA stream has two users.
const _: () = {
    assert!(IRQ.number == 3, "the vector of the task `rf_irq` is that of EXTI line 3");
    assert!(!is_same(SPI_IN, SPI_OUT));
    let mut receiver = 0;
    while receiver < MAX_RECEIVERS {
        let streams = RECEIVER_PORTS[receiver].hardware.streams();
        assert!(!meet(streams, [SPI_IN, SPI_OUT]), "a stream of the front end's");
        if let Hardware::Spi(port) = &RECEIVER_PORTS[receiver].hardware {
            assert!(!is_same(port.stream_in, port.stream_out));
        }
        let mut other = 0;
        while other < receiver {
            assert!(!meet(streams, RECEIVER_PORTS[other].hardware.streams()), "two receivers on one stream");
            other += 1;
        }
        receiver += 1;
    }
};
