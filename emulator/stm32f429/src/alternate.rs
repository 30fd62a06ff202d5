//! The alternate functions: which function connects which pin to which signal (DS9405, alternate function mapping).
//!
//! The table has the functions of the peripherals with a model. [`EXISTS`] has every function of the data sheet below
//! AF15, so that the model can tell a missing model from a missing function.

use crate::cx::{CanPin, I2cPin, SIGNALS, Signal, SpiPin, TimPin, UartPin};

use I2cPin::{Scl, Sda, Smba};
use Signal::{Can, I2c, Mco, RtcReference, Spi, Tim, Uart};
use SpiPin::{Mck, Miso, Mosi, Nss, Sck};
use TimPin::{Bkin, Ch1, Ch1N, Ch2, Ch2N, Ch3, Ch3N, Ch4, Etr};
use UartPin::{Ck, Cts, Rts, Rx, Tx};

/// A signal, an alternate function, and the pins (port, number) that this function connects to the signal.
type Row = (Signal, u8, &'static [(u8, u8)]);

const A: u8 = 0;
const B: u8 = 1;
const C: u8 = 2;
const D: u8 = 3;
const E: u8 = 4;
const F: u8 = 5;
const G: u8 = 6;
const H: u8 = 7;
const I: u8 = 8;

const ROWS: &[Row] = &[
    // AF0: system functions.
    (Mco(1), 0, &[(A, 8)]),
    (Mco(2), 0, &[(C, 9)]),
    (RtcReference, 0, &[(B, 15)]),
    // AF1: TIM1 and TIM2. TIM2's channel 1 is its ETR as well.
    (Tim(2, Ch1), 1, &[(A, 0), (A, 5), (A, 15)]),
    (Tim(2, Ch2), 1, &[(A, 1), (B, 3)]),
    (Tim(2, Ch3), 1, &[(A, 2), (B, 10)]),
    (Tim(2, Ch4), 1, &[(A, 3), (B, 11)]),
    (Tim(1, Bkin), 1, &[(A, 6), (B, 12), (E, 15)]),
    (Tim(1, Ch1N), 1, &[(A, 7), (B, 13), (E, 8)]),
    (Tim(1, Ch2N), 1, &[(B, 0), (B, 14), (E, 10)]),
    (Tim(1, Ch3N), 1, &[(B, 1), (B, 15), (E, 12)]),
    (Tim(1, Ch1), 1, &[(A, 8), (E, 9)]),
    (Tim(1, Ch2), 1, &[(A, 9), (E, 11)]),
    (Tim(1, Ch3), 1, &[(A, 10), (E, 13)]),
    (Tim(1, Ch4), 1, &[(A, 11), (E, 14)]),
    (Tim(1, Etr), 1, &[(A, 12), (E, 7)]),
    // AF2: TIM3, TIM4 and TIM5.
    (Tim(5, Ch1), 2, &[(A, 0), (H, 10)]),
    (Tim(5, Ch2), 2, &[(A, 1), (H, 11)]),
    (Tim(5, Ch3), 2, &[(A, 2), (H, 12)]),
    (Tim(5, Ch4), 2, &[(A, 3), (I, 0)]),
    (Tim(3, Ch1), 2, &[(A, 6), (B, 4), (C, 6)]),
    (Tim(3, Ch2), 2, &[(A, 7), (B, 5), (C, 7)]),
    (Tim(3, Ch3), 2, &[(B, 0), (C, 8)]),
    (Tim(3, Ch4), 2, &[(B, 1), (C, 9)]),
    (Tim(3, Etr), 2, &[(D, 2)]),
    (Tim(4, Ch1), 2, &[(B, 6), (D, 12)]),
    (Tim(4, Ch2), 2, &[(B, 7), (D, 13)]),
    (Tim(4, Ch3), 2, &[(B, 8), (D, 14)]),
    (Tim(4, Ch4), 2, &[(B, 9), (D, 15)]),
    (Tim(4, Etr), 2, &[(E, 0)]),
    // AF3: TIM8 to TIM11.
    (Tim(8, Etr), 3, &[(A, 0), (I, 3)]),
    (Tim(9, Ch1), 3, &[(A, 2), (E, 5)]),
    (Tim(9, Ch2), 3, &[(A, 3), (E, 6)]),
    (Tim(8, Ch1N), 3, &[(A, 5), (A, 7), (H, 13)]),
    (Tim(8, Bkin), 3, &[(A, 6), (I, 4)]),
    (Tim(8, Ch2N), 3, &[(B, 0), (B, 14), (H, 14)]),
    (Tim(8, Ch3N), 3, &[(B, 1), (B, 15), (H, 15)]),
    (Tim(10, Ch1), 3, &[(B, 8), (F, 6)]),
    (Tim(11, Ch1), 3, &[(B, 9), (F, 7)]),
    (Tim(8, Ch1), 3, &[(C, 6), (I, 5)]),
    (Tim(8, Ch2), 3, &[(C, 7), (I, 6)]),
    (Tim(8, Ch3), 3, &[(C, 8), (I, 7)]),
    (Tim(8, Ch4), 3, &[(C, 9), (I, 2)]),
    // AF4: the I2Cs.
    (I2c(3, Scl), 4, &[(A, 8), (H, 7)]),
    (I2c(3, Sda), 4, &[(C, 9), (H, 8)]),
    (I2c(3, Smba), 4, &[(A, 9), (H, 9)]),
    (I2c(1, Smba), 4, &[(B, 5)]),
    (I2c(1, Scl), 4, &[(B, 6), (B, 8)]),
    (I2c(1, Sda), 4, &[(B, 7), (B, 9)]),
    (I2c(2, Scl), 4, &[(B, 10), (F, 1), (H, 4)]),
    (I2c(2, Sda), 4, &[(B, 11), (F, 0), (H, 5)]),
    (I2c(2, Smba), 4, &[(B, 12), (F, 2), (H, 6)]),
    // AF5: SPI1, SPI2, SPI4, SPI5, SPI6, and one pin of SPI3.
    (Spi(1, Nss), 5, &[(A, 4), (A, 15)]),
    (Spi(1, Sck), 5, &[(A, 5), (B, 3)]),
    (Spi(1, Miso), 5, &[(A, 6), (B, 4)]),
    (Spi(1, Mosi), 5, &[(A, 7), (B, 5)]),
    (Spi(2, Nss), 5, &[(B, 9), (B, 12), (I, 0)]),
    (Spi(2, Sck), 5, &[(B, 10), (B, 13), (D, 3), (I, 1)]),
    (Spi(2, Miso), 5, &[(B, 14), (C, 2), (I, 2)]),
    (Spi(2, Mosi), 5, &[(B, 15), (C, 3), (I, 3)]),
    (Spi(2, Mck), 5, &[(C, 6)]),
    (Spi(3, Mosi), 5, &[(D, 6)]),
    (Spi(4, Sck), 5, &[(E, 2), (E, 12)]),
    (Spi(4, Nss), 5, &[(E, 4), (E, 11)]),
    (Spi(4, Miso), 5, &[(E, 5), (E, 13)]),
    (Spi(4, Mosi), 5, &[(E, 6), (E, 14)]),
    (Spi(5, Nss), 5, &[(F, 6), (H, 5)]),
    (Spi(5, Sck), 5, &[(F, 7), (H, 6)]),
    (Spi(5, Miso), 5, &[(F, 8), (H, 7)]),
    (Spi(5, Mosi), 5, &[(F, 9), (F, 11)]),
    (Spi(6, Nss), 5, &[(G, 8)]),
    (Spi(6, Miso), 5, &[(G, 12)]),
    (Spi(6, Sck), 5, &[(G, 13)]),
    (Spi(6, Mosi), 5, &[(G, 14)]),
    // AF6: SPI3.
    (Spi(3, Nss), 6, &[(A, 4), (A, 15)]),
    (Spi(3, Sck), 6, &[(B, 3), (C, 10)]),
    (Spi(3, Miso), 6, &[(B, 4), (C, 11)]),
    (Spi(3, Mosi), 6, &[(B, 5), (C, 12)]),
    (Spi(3, Mck), 6, &[(C, 7)]),
    // AF7: USART1 to USART3.
    (Uart(2, Cts), 7, &[(A, 0), (D, 3)]),
    (Uart(2, Rts), 7, &[(A, 1), (D, 4)]),
    (Uart(2, Tx), 7, &[(A, 2), (D, 5)]),
    (Uart(2, Rx), 7, &[(A, 3), (D, 6)]),
    (Uart(2, Ck), 7, &[(A, 4), (D, 7)]),
    (Uart(1, Ck), 7, &[(A, 8)]),
    (Uart(1, Tx), 7, &[(A, 9), (B, 6)]),
    (Uart(1, Rx), 7, &[(A, 10), (B, 7)]),
    (Uart(1, Cts), 7, &[(A, 11)]),
    (Uart(1, Rts), 7, &[(A, 12)]),
    (Uart(3, Tx), 7, &[(B, 10), (C, 10), (D, 8)]),
    (Uart(3, Rx), 7, &[(B, 11), (C, 11), (D, 9)]),
    (Uart(3, Ck), 7, &[(B, 12), (C, 12), (D, 10)]),
    (Uart(3, Cts), 7, &[(B, 13), (D, 11)]),
    (Uart(3, Rts), 7, &[(B, 14), (D, 12)]),
    // AF8: USART6 and the UARTs.
    (Uart(4, Tx), 8, &[(A, 0), (C, 10)]),
    (Uart(4, Rx), 8, &[(A, 1), (C, 11)]),
    (Uart(6, Tx), 8, &[(C, 6), (G, 14)]),
    (Uart(6, Rx), 8, &[(C, 7), (G, 9)]),
    (Uart(6, Ck), 8, &[(C, 8), (G, 7)]),
    (Uart(6, Rts), 8, &[(G, 8), (G, 12)]),
    (Uart(6, Cts), 8, &[(G, 13), (G, 15)]),
    (Uart(5, Tx), 8, &[(C, 12)]),
    (Uart(5, Rx), 8, &[(D, 2)]),
    (Uart(8, Rx), 8, &[(E, 0)]),
    (Uart(8, Tx), 8, &[(E, 1)]),
    (Uart(7, Rx), 8, &[(E, 7), (F, 6)]),
    (Uart(7, Tx), 8, &[(E, 8), (F, 7)]),
    // AF9: TIM12 to TIM14.
    (Tim(13, Ch1), 9, &[(A, 6), (F, 8)]),
    (Tim(14, Ch1), 9, &[(A, 7), (F, 9)]),
    (Tim(12, Ch1), 9, &[(B, 14), (H, 6)]),
    (Tim(12, Ch2), 9, &[(B, 15), (H, 9)]),
    // AF9: CAN1.
    (Can(1, CanPin::Rx), 9, &[(A, 11), (B, 8), (D, 0), (I, 9)]),
    (Can(1, CanPin::Tx), 9, &[(A, 12), (B, 9), (D, 1), (H, 13)]),
];

/// The index that stands for a function without a modelled signal.
pub(crate) const NONE: u8 = 255;

/// For each port, pin and function, the index of the signal, or [`NONE`].
pub(crate) static SIGNAL_OF: [[[u8; 16]; 16]; 11] = {
    assert!(SIGNALS < NONE as usize);
    let mut table = [[[NONE; 16]; 16]; 11];
    let mut row = 0;
    while row < ROWS.len() {
        let (signal, function, pins) = ROWS[row];
        let mut nth = 0;
        while nth < pins.len() {
            let (port, pin) = pins[nth];
            let entry = &mut table[port as usize][pin as usize][function as usize];
            assert!(*entry == NONE, "two signals on one function of a pin");
            *entry = signal.index() as u8;
            nth += 1;
        }
        row += 1;
    }
    table
};

pub(crate) static SIGNAL: [Option<Signal>; SIGNALS] = {
    let mut table = [None; SIGNALS];
    let mut row = 0;
    while row < ROWS.len() {
        table[ROWS[row].0.index()] = Some(ROWS[row].0);
        row += 1;
    }
    table
};

/// The functions that each pin has in the data sheet, with function n at bit n. AF15 (EVENTOUT) is left out, because
/// every pin has it.
#[rustfmt::skip]
pub(crate) static EXISTS: [[u16; 16]; 11] = [
    // Port A
    [0x098E, 0x0986, 0x088E, 0x4C8E, 0x70E0, 0x042A, 0x622E, 0x0A2E,
     0x4493, 0x2092, 0x2482, 0x4682, 0x4682, 0x0001, 0x0001, 0x0063],
    // Port B
    [0x0E0E, 0x0E0E, 0x0000, 0x0063, 0x00E5, 0x3E74, 0x3294, 0x3094,
     0x7A1C, 0x723C, 0x4CB2, 0x4C92, 0x1EB2, 0x0EA2, 0x12EA, 0x122B],
    // Port C
    [0x1400, 0x0800, 0x1C60, 0x1C20, 0x0800, 0x0800, 0x712C, 0x714C,
     0x310C, 0x303D, 0x71C0, 0x31E0, 0x31C0, 0x0000, 0x0000, 0x0000],
    // Port D
    [0x1200, 0x1200, 0x3104, 0x70A0, 0x1080, 0x1080, 0x70E0, 0x1080,
     0x1080, 0x1080, 0x5080, 0x1080, 0x1084, 0x1004, 0x1004, 0x1004],
    // Port E
    [0x3104, 0x3100, 0x1861, 0x1041, 0x7061, 0x7069, 0x7069, 0x1102,
     0x1102, 0x1002, 0x1002, 0x5022, 0x5022, 0x5022, 0x5022, 0x5002],
    // Port F
    [0x1010, 0x1010, 0x1010, 0x1000, 0x1000, 0x1000, 0x1168, 0x1168,
     0x1260, 0x1260, 0x7000, 0x3020, 0x1000, 0x1000, 0x1000, 0x1000],
    // Port G
    [0x1000, 0x1000, 0x1000, 0x1000, 0x1000, 0x1000, 0x7000, 0x7100,
     0x1920, 0x3100, 0x7200, 0x7800, 0x5320, 0x1920, 0x1920, 0x3100],
    // Port H
    [0x0000, 0x0000, 0x5800, 0x5800, 0x0410, 0x1030, 0x3A30, 0x3830,
     0x7010, 0x7210, 0x7004, 0x7004, 0x7004, 0x5208, 0x7008, 0x7008],
    // Port I
    [0x7024, 0x7020, 0x7068, 0x3028, 0x7008, 0x7008, 0x7008, 0x7008,
     0x0000, 0x5200, 0x5800, 0x0400, 0x4000, 0x4000, 0x4000, 0x4000],
    // Port J
    [0x4000, 0x4000, 0x4000, 0x4000, 0x4000, 0x4000, 0x4000, 0x4000,
     0x4000, 0x4000, 0x4000, 0x4000, 0x4000, 0x4000, 0x4000, 0x4000],
    // Port K
    [0x4000, 0x4000, 0x4000, 0x4000, 0x4000, 0x4000, 0x4000, 0x4000,
     0x0000, 0x0000, 0x0000, 0x0000, 0x0000, 0x0000, 0x0000, 0x0000],
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_modelled_function_is_one_that_the_data_sheet_lists() {
        for (signal, function, pins) in ROWS {
            for &(port, pin) in *pins {
                let has = EXISTS[usize::from(port)][usize::from(pin)] >> function & 1 != 0;
                assert!(has, "{signal:?} on port {port} pin {pin} by AF{function}");
            }
        }
    }

    #[test]
    fn only_sai_and_i2s_functions_below_af9_are_not_modelled() {
        let mut left = Vec::new();
        for (port, pins) in EXISTS.iter().enumerate() {
            for (pin, functions) in pins.iter().enumerate() {
                for (function, &signal) in SIGNAL_OF[port][pin].iter().enumerate().take(9).skip(1) {
                    if functions >> function & 1 != 0 && signal == NONE {
                        left.push((char::from(b'A' + port as u8), pin, function));
                    }
                }
            }
        }
        for (port, pin, function) in left {
            let known = match function {
                // AF6 without a model: SAI1, and the I2S extensions of SPI2.
                6 => matches!(port, 'B' | 'C' | 'D' | 'E' | 'F' | 'I'),
                // AF5 without a model: I2S_CKIN on PC9, I2S3ext on PC11.
                5 => port == 'C' && (pin == 9 || pin == 11),
                // AF7 without a model: I2S3ext on PB4.
                7 => port == 'B' && pin == 4,
                _ => false,
            };
            assert!(known, "P{port}{pin} AF{function}");
        }
    }
}
