//! The nRF52840 as a rigless MCU
