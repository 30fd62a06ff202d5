//! A model of an ST25R3916B with what the driver's state machines need to set the chip up: its registers read back as
//! they were written.

use st25r3916::Short;

/// The addresses of registers (DS13541): main interrupts, timer and NFC interrupts, result of the A/D converter,
/// auxiliary display, identity.
const IRQ_MAIN: usize = 0x1A;
const IRQ_TIMER: usize = 0x1B;
const AD_RESULT: usize = 0x25;
const AUX_DISPLAY: usize = 0x31;
const IDENTITY: usize = 0x3F;

/// The bit I_osc of the main interrupt register. The same bit of the timer's interrupt register is I_dct.
const DONE: u8 = 0x80;
const SPACE_B: u8 = 0xFB;
const READ: u8 = 0x40;

/// Interrupts, errors and FIFO level of the chip, as the driver reads them in one status read.
#[derive(Clone, Copy, Debug, Default)]
pub struct Status {
    /// The main interrupts.
    pub main: u8,
    /// The bits of the error and wake-up interrupt register.
    pub error: u8,
    /// The number of bytes in the FIFO, below 256.
    pub count: u8,
    /// The value of the register FIFO status 2.
    pub fifo: u8,
}

/// The registers of the chip.
pub struct Chip {
    registers: [u8; 64],
    space_b: [u8; 64],
}

impl Default for Chip {
    fn default() -> Self {
        Self::new()
    }
}

impl Chip {
    /// Returns a chip at 5 V whose oscillator start, calibration and measurements end at once.
    #[must_use]
    pub const fn new() -> Self {
        let mut registers = [0; 64];
        registers[IRQ_MAIN] = DONE;
        registers[IRQ_TIMER] = DONE;
        registers[AD_RESULT] = 214; // 5.0 V in steps of 23.4 mV
        registers[AUX_DISPLAY] = 0x30; // oscillator stable, transmitter on
        registers[IDENTITY] = 0x31;
        Self { registers, space_b: [0; 64] }
    }

    /// Sets the status that the driver reads from now on.
    pub fn set_status(&mut self, status: Status) {
        let Status { main, error, count, fifo } = status;
        for (register, value) in self.registers[IRQ_MAIN..].iter_mut().zip([main, 0, error, 0, count, fifo]) {
            *register = value;
        }
    }

    /// Carries out a short transfer of the bytes `out`. Returns the bytes that the driver clocks in.
    pub fn respond(&mut self, out: &[u8]) -> [u8; Short::MAX] {
        let mut into = [0; Short::MAX];
        let (space, header) = if out[0] == SPACE_B { (&mut self.space_b, 1) } else { (&mut self.registers, 0) };
        let address = out[header];
        if address >= 2 * READ {
            return into;
        }
        let register = usize::from(address & (READ - 1));
        for (register, index) in space[register..].iter_mut().zip(header + 1..out.len()) {
            if address & READ == 0 {
                *register = out[index];
            } else {
                into[index] = *register;
            }
        }
        into
    }
}
