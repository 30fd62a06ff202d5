//! The board: every pin, DMA stream, interrupt vector and clock that the firmware uses, each in one place
//!
//! NUCLEO-F429ZI with an X-NUCLEO-NFC08A1 or NFC06A1 on its Arduino header.
//!
//! | use | peripheral | pins | DMA | vectors |
//! |---|---|---|---|---|
//! | front end, clocked in | SPI1 | MISO PA6 | DMA2 stream 0 channel 3 | DMA2_STREAM0 |
//! | front end, clocked out | SPI1 | MOSI PA7, SCK PA5, chip select PD14 | DMA2 stream 3 channel 3 | DMA2_STREAM3 |
//! | front end's interrupt request | EXTI line 3 | IRQ PA3 | – | EXTI3 |
//! | front end's waits | TIM5 | – | – | TIM5 |
//! | inputs of the state | – | relay PE2, PE4; motor cut PE5, PE6; emergency measure PD3, PD4 | – | – |
//! | cycle and slots | TIM2 | TICK PB10 (channel 3) | – | TIM2 |
//! | calls of tasks of lower priority | CAN1, which stays off | – | – | CAN1_TX, CAN1_RX0, CAN1_RX1 |
//! | receivers | see [`RECEIVER_PORTS`] | | | |
//!
//! Streams and channels are those of RM0090 "DMA controller", DMA1 and DMA2 request mapping.
//!
//! # To add or move a receiver interface
//!
//! Change its row in [`RECEIVER_PORTS`]. RTIC binds vectors by name, so the row's two vectors also have to be those of
//! the receiver's two tasks in `main.rs`; each of those looks its row up by the vector, and a vector that is in no row
//! does not compile. Nothing else names a receiver's hardware.

use horus_tx_fw::{state_inputs::INPUTS, task::TASKS, timing};
use profile::MAX_RECEIVERS;
use stm32f4xx_hal::{
    pac::{self, uart4, Interrupt},
    rcc::Enable,
};

/// The vectors of the tasks, in the order of [`TASKS`].
const TASK_VECTORS: [Interrupt; TASKS.len()] = [
    Interrupt::TIM2,
    Interrupt::DMA2_STREAM0,
    Interrupt::DMA2_STREAM3,
    Interrupt::EXTI3,
    Interrupt::TIM5,
    Interrupt::CAN1_TX,
    Interrupt::CAN1_RX0,
    Interrupt::USART2,
    Interrupt::USART6,
    Interrupt::UART4,
    Interrupt::UART5,
    Interrupt::UART7,
    Interrupt::DMA1_STREAM5,
    Interrupt::DMA2_STREAM1,
    Interrupt::DMA1_STREAM2,
    Interrupt::DMA1_STREAM0,
    Interrupt::DMA1_STREAM3,
    Interrupt::CAN1_RX1,
];

/// The name of the task whose exception has this number: that of its interrupt and 16 (ARMv7-M ARM B1.5.2).
pub(crate) fn task_of(exception: u16) -> &'static str {
    let is_its = |vector: &Interrupt| *vector as u16 + 16 == exception;
    let task = TASK_VECTORS.iter().position(is_its).and_then(|index| TASKS.get(index));
    task.map_or(if exception == 0 { "idle" } else { "none" }, |(name, _)| name)
}

/// A GPIO port.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Port {
    A,
    B,
    C,
    D,
    E,
}

/// A pin, from 0 to 15 of its port.
#[derive(Clone, Copy)]
pub(crate) struct Pin {
    pub(crate) port: Port,
    pub(crate) number: u8,
}

/// A pin and the number of the alternate function that connects it to a peripheral (DS9405, alternate function
/// mapping).
#[derive(Clone, Copy)]
pub(crate) struct AlternatePin {
    pub(crate) pin: Pin,
    pub(crate) function: u8,
}

/// A DMA controller.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dma {
    /// DMA1 serves the peripherals of APB1.
    One,
    /// DMA2 serves those of APB2.
    Two,
}

/// A stream of a DMA controller, 0 to 7, and the channel that connects it to its peripheral's requests, 0 to 7.
#[derive(Clone, Copy)]
pub(crate) struct Stream {
    pub(crate) dma: Dma,
    pub(crate) number: u8,
    pub(crate) channel: u8,
}

// ---- Cycle

/// Where the cycle timer shows each tick to a logic analyser: TIM2 channel 3, CN10 pin 32 of the NUCLEO (D36). High for
/// the last [`timing::TICK_PULSE_TICKS`] of each cycle; it falls with the tick.
pub(crate) const TICK: AlternatePin = AlternatePin { pin: Pin { port: Port::B, number: 10 }, function: 1 };

// ---- State

/// An input of two pins whose levels are opposite while it is sound (decision 18).
pub(crate) struct InputPair {
    /// High while the input is active.
    pub(crate) active: Pin,
    /// High while it is not.
    pub(crate) inactive: Pin,
}

/// What tells HORUS's state, the least severe first: relay (D56, D57), motor cut (D58, D59), emergency measure (D55,
/// D54).
pub(crate) const STATE_INPUTS: [InputPair; INPUTS] = [
    InputPair { active: Pin { port: Port::E, number: 2 }, inactive: Pin { port: Port::E, number: 4 } },
    InputPair { active: Pin { port: Port::E, number: 5 }, inactive: Pin { port: Port::E, number: 6 } },
    InputPair { active: Pin { port: Port::D, number: 3 }, inactive: Pin { port: Port::D, number: 4 } },
];

// ---- Front end

/// The front end's SPI: SPI1.
pub(crate) const SCK: AlternatePin = AlternatePin { pin: Pin { port: Port::A, number: 5 }, function: 5 };
pub(crate) const MISO: AlternatePin = AlternatePin { pin: Pin { port: Port::A, number: 6 }, function: 5 };
pub(crate) const MOSI: AlternatePin = AlternatePin { pin: Pin { port: Port::A, number: 7 }, function: 5 };
pub(crate) const CHIP_SELECT: Pin = Pin { port: Port::D, number: 14 };
/// The front end's interrupt request, rising. Its number is also that of its EXTI line: vector EXTI3.
pub(crate) const IRQ: Pin = Pin { port: Port::A, number: 3 };
/// What the SPI clocks in.
pub(crate) const SPI_IN: Stream = Stream { dma: Dma::Two, number: 0, channel: 3 };
/// What the SPI clocks out.
pub(crate) const SPI_OUT: Stream = Stream { dma: Dma::Two, number: 3, channel: 3 };

// ---- Receivers

/// Where one GNSS receiver is connected. All run at [`timing::GNSS_BAUD`], 8N1; only the line towards HORUS is used.
pub(crate) struct ReceiverPort {
    /// The UART's registers. A USART's begin with the same ones and have one more at the end, which is not used.
    pub(crate) uart: *const uart4::RegisterBlock,
    /// Switches the UART's clock on.
    pub(crate) enable: fn(&mut pac::RCC),
    /// The frequency of the bus the UART is on, from which its baud rate is derived, Hz.
    pub(crate) bus_hz: u32,
    /// The UART's input.
    pub(crate) rx: AlternatePin,
    /// The DMA stream of the UART's input.
    pub(crate) stream: Stream,
    /// The vector of the UART: the line is idle, or has an error.
    pub(crate) uart_vector: Interrupt,
    /// The vector of the DMA stream: half a ring is full.
    pub(crate) stream_vector: Interrupt,
}

/// GPS1 to GPS5. The first [`horus_tx_fw::RECEIVERS`] are in use.
pub(crate) const RECEIVER_PORTS: [ReceiverPort; MAX_RECEIVERS] = [
    ReceiverPort {
        uart: pac::USART2::ptr().cast(),
        enable: pac::USART2::enable,
        bus_hz: timing::APB1_HZ,
        rx: AlternatePin { pin: Pin { port: Port::D, number: 6 }, function: 7 },
        stream: Stream { dma: Dma::One, number: 5, channel: 4 },
        uart_vector: Interrupt::USART2,
        stream_vector: Interrupt::DMA1_STREAM5,
    },
    ReceiverPort {
        uart: pac::USART6::ptr().cast(),
        enable: pac::USART6::enable,
        bus_hz: timing::APB2_HZ,
        rx: AlternatePin { pin: Pin { port: Port::C, number: 7 }, function: 8 },
        stream: Stream { dma: Dma::Two, number: 1, channel: 5 },
        uart_vector: Interrupt::USART6,
        stream_vector: Interrupt::DMA2_STREAM1,
    },
    ReceiverPort {
        uart: pac::UART4::ptr(),
        enable: pac::UART4::enable,
        bus_hz: timing::APB1_HZ,
        rx: AlternatePin { pin: Pin { port: Port::C, number: 11 }, function: 8 },
        stream: Stream { dma: Dma::One, number: 2, channel: 4 },
        uart_vector: Interrupt::UART4,
        stream_vector: Interrupt::DMA1_STREAM2,
    },
    ReceiverPort {
        uart: pac::UART5::ptr().cast(),
        enable: pac::UART5::enable,
        bus_hz: timing::APB1_HZ,
        rx: AlternatePin { pin: Pin { port: Port::D, number: 2 }, function: 8 },
        stream: Stream { dma: Dma::One, number: 0, channel: 4 },
        uart_vector: Interrupt::UART5,
        stream_vector: Interrupt::DMA1_STREAM0,
    },
    ReceiverPort {
        uart: pac::UART7::ptr().cast(),
        enable: pac::UART7::enable,
        bus_hz: timing::APB1_HZ,
        rx: AlternatePin { pin: Pin { port: Port::E, number: 7 }, function: 8 },
        stream: Stream { dma: Dma::One, number: 3, channel: 5 },
        uart_vector: Interrupt::UART7,
        stream_vector: Interrupt::DMA1_STREAM3,
    },
];

/// The receiver, from 0, one of whose two vectors `vector` is. To be evaluated at compile time.
///
/// # Panics
///
/// If it is no receiver's.
pub(crate) const fn receiver_of(vector: Interrupt) -> usize {
    let mut receiver = 0;
    while receiver < MAX_RECEIVERS {
        let port = &RECEIVER_PORTS[receiver];
        if port.uart_vector as u16 == vector as u16 || port.stream_vector as u16 == vector as u16 {
            return receiver;
        }
        receiver += 1;
    }
    panic!("this vector is in no row of RECEIVER_PORTS")
}

const fn is_same(one: Stream, other: Stream) -> bool {
    matches!((one.dma, other.dma), (Dma::One, Dma::One) | (Dma::Two, Dma::Two)) && one.number == other.number
}

// No stream has two users, and each receiver has vectors of its own.
const _: () = {
    assert!(IRQ.number == 3, "the vector of the task `rf_irq` is that of EXTI line 3");
    assert!(!is_same(SPI_IN, SPI_OUT));
    let mut receiver = 0;
    while receiver < MAX_RECEIVERS {
        let port = &RECEIVER_PORTS[receiver];
        assert!(!is_same(port.stream, SPI_IN) && !is_same(port.stream, SPI_OUT), "a stream of the front end's");
        assert!(receiver_of(port.uart_vector) == receiver && receiver_of(port.stream_vector) == receiver);
        let mut other = 0;
        while other < receiver {
            assert!(!is_same(port.stream, RECEIVER_PORTS[other].stream), "two receivers on one stream");
            other += 1;
        }
        receiver += 1;
    }
};
