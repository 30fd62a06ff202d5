//! Both firmware images on an emulated pair of MCUs, with the air between them.
//!
//! [`engine`] runs real ELF files in virtual time, on the core of `cortex-m4` and the parts of `stm32f429` and
//! `nrf52840`. [`sim`] puts both on their boards with the air between them, [`world`] is what stands
//! beside them, and [`report`] is what a run showed.
#![forbid(unsafe_code)]

pub mod engine;
pub mod report;
pub mod sim;
pub mod world;
