//! Both firmware images on an emulated pair of MCUs, with the air between them.
//!
//! [`engine`] runs real ELF files in virtual time; [`stm32f427`] is the microcontroller of the HORUS board, the DPR's
//! is the crate `nrf52840-model`. [`sim`] puts both on their boards with the air between them, [`world`] is what stands
//! beside them, and [`report`] is what a run showed.
#![deny(unsafe_code)]

pub mod engine;
pub mod report;
pub mod sim;
pub mod stm32f427;
pub mod world;
