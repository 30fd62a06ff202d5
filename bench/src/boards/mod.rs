//! The two boards: what is wired to each part.
//!
//! | | HORUS: NUCLEO-F429ZI | DPR: nRF52840-DK |
//! |---|---|---|
//! | front end: SCK, MISO, MOSI | PA5, PA6, PA7 (SPI1) | P1.15, P1.14, P1.13 |
//! | front end: chip select, IRQ | PD14, PA3 | P1.12, P0.03 |
//! | receivers 1 to 5 | PD6, PC7, PC11, PD2, PE7 | – |
//! | inputs of the state: relay, motor cut, emergency measure | PE2 and PE4, PE5 and PE6, PD3 and PD4 | – |
//! | TICK, which falls with each tick | PB10 | – |
//! | SSI: SCK, MOSI, MISO, CSN, FRESH | – | P1.01, P1.02, P1.03, P1.04, P1.05 |

mod dpr;
pub mod front_end;
mod horus;

pub use dpr::{Dpr, FRESH, SSI};
pub use horus::{Horus, InputChange};
