//! The register tables: name, offset, direction and reset value of every register of the part.
//!
//! The tables were generated from Nordic's device description (`nrf52840.svd`, as `nrf52840-pac` 0.12 has it).
//! Instances that share a block share a table. A register that only the second of them has is prefixed with that
//! instance's name.
//!
//! | module | registers of |
//! |---|---|
//! | `system` | CLOCK and POWER, NVMC and ACL, MWU, PPI, EGU, GPIO, GPIOTE |
//! | `serial` | UARTE and UART, the shared SPI and two-wire blocks, SPIM3, I2S, QSPI |
//! | `radio` | RADIO, NFCT, RNG, ECB, CCM and AAR |
//! | `time` | TIMER, RTC, WDT, PWM, QDEC |
//! | `analog` | SAADC, COMP and LPCOMP, TEMP, PDM |
//! | `usb` | USBD |

mod analog;
mod radio;
mod serial;
mod system;
mod time;
mod usb;

pub(crate) use analog::{COMP_LPCOMP, PDM, SAADC, TEMP};
pub(crate) use radio::{CCM_AAR, ECB, NFCT, RADIO, RNG};
pub(crate) use serial::{I2S, QSPI, SERIAL, SPIM3, UART};
pub(crate) use system::{CLOCK_POWER, EGU, GPIO, GPIOTE, MWU, NVMC_ACL, PPI};
pub(crate) use time::{PWM, QDEC, RTC, TIMER, TIMER_WIDE, WDT};
pub(crate) use usb::USBD;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Register {
    pub(crate) name: &'static str,
    pub(crate) offset: u32,
    pub(crate) reset: u32,
    pub(crate) writable: bool,
}

const fn rw(name: &'static str, offset: u32, reset: u32) -> Register {
    Register { name, offset, reset, writable: true }
}

const fn ro(name: &'static str, offset: u32, reset: u32) -> Register {
    Register { name, offset, reset, writable: false }
}

/// Makes a task register, which reads as 0 (PS 6.1).
const fn wo(name: &'static str, offset: u32, reset: u32) -> Register {
    rw(name, offset, reset)
}
