//! Opens the debug port of a part of revision 3. Otherwise such a part answers no debugger after its next reset, unless
//! that is a soft reset.

use dpr_fw::debug_port;
use nrf52840_hal::pac;

/// The registers of the debug port's protection, as in the firmware.
struct Protection<'a> {
    ficr: &'a pac::FICR,
    uicr: &'a pac::UICR,
}

/// The address of APPROTECT.DISABLE, which the PAC does not define.
const APPROTECT_DISABLE: u32 = 0x4000_0558;

impl debug_port::Registers for Protection<'_> {
    fn variant(&self) -> u32 {
        self.ficr.info.variant.read().bits()
    }

    fn uicr_approtect(&self) -> u32 {
        self.uicr.approtect.read().bits()
    }

    fn disable_protection(&mut self) {
        // SAFETY: the register exists on the parts for which this is called; it opens the debug port and does nothing
        // else.
        unsafe { (APPROTECT_DISABLE as *mut u32).write_volatile(debug_port::SW_DISABLE) };
    }
}

pub(crate) fn open(ficr: &pac::FICR, uicr: &pac::UICR) {
    debug_port::open(&mut Protection { ficr, uicr });
}
