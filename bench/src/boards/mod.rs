//! The boards: a microcontroller with everything that is wired to it.
//!
//! | | HORUS: NUCLEO-F429ZI | DPR: nRF52840-DK |
//! |---|---|---|
//! | front end: SCK, MISO, MOSI | PA5, PA6, PA7 (SPI1) | P1.15, P1.14, P1.13 |
//! | front end: chip select, IRQ | PD14, PA3 | P1.12, P0.03 |
//! | receiver 1: UART to HORUS, from HORUS | PD6, PD5 (USART2) | – |
//! | receiver 2: SCL, SDA, both with pull-ups | PF1, PF0 (I2C2) | – |
//! | receiver 3: SCK, MISO, MOSI, chip select | PF7, PF8, PF9 (SPI5), PE3 | – |
//! | receiver 4: UART to HORUS, from HORUS | PD2, PC12 (UART5) | – |
//! | receiver 5: UART to HORUS, from HORUS | PE7, PE8 (UART7) | – |
//! | inputs of the state: relay, motor cut, emergency measure | PE2 and PE4, PE5 and PE6, PD3 and PD4 | – |
//! | TICK, which falls with each tick | PB10 | – |
//! | SSI: SCK, MOSI, MISO, CSN, FRESH | – | P1.01, P1.02, P1.03, P1.04, P1.05 |
//! | second front end, with a hold: SCK, MISO, MOSI | – | P1.08, P1.06, P1.07 |
//! | second front end: chip select, IRQ | – | P1.10, P1.11 |
//!
//! | | active hold: nRF52840-DK |
//! |---|---|
//! | front end | as the DPR's first one |
//! | I2C: SDA, SCL, with pull-ups; SHT4x and LIS3DH | P0.26, P0.27 |
//! | heater, cooler, lock | P1.05, P1.06, P1.07 |

mod dpr;
pub mod front_end;
mod hold;
mod horus;
pub mod receivers;
mod supply;

pub use dpr::{Dpr, FRESH, SSI};
pub use hold::{Hold, Outputs};
pub use horus::{Horus, InputChange};
pub use supply::{Powered, supply};
