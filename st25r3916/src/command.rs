//! Direct commands and SPI operation modes (DS13541, tables "SPI operation modes" and "List of direct commands").

use crate::machine::Short;

/// Operation mode: write registers of space A from an address on, auto-increment (`00aaaaaa`).
pub const WRITE: u8 = 0x00;
/// Operation mode: read registers of space A from an address on, auto-increment (`01aaaaaa`).
pub const READ: u8 = 0x40;
/// Operation mode: load the FIFO with the bytes that follow.
pub const FIFO_LOAD: u8 = 0x80;
/// Operation mode: read the FIFO.
pub const FIFO_READ: u8 = 0x9F;
/// Prefix: the register access that follows is in space B.
pub const SPACE_B: u8 = 0xFB;
/// Prefix: the register access that follows is in the test space.
pub const SPACE_TEST: u8 = 0xFC;

/// Set default: every register is as after power-up, oscillator and field are off.
pub const SET_DEFAULT: Short = Short::new([0xC1]);
/// Stop all activities: transmission, reception, timers.
pub const STOP: Short = Short::new([0xC2]);
/// Transmit with CRC: the chip sends the FIFO's content, framed by the mode register.
pub const TRANSMIT_WITH_CRC: Short = Short::new([0xC4]);
/// Mask receive data: the receiver runs but reports nothing.
pub const MASK_RECEIVE_DATA: Short = Short::new([0xD0]);
/// Unmask receive data: the receiver reports the next frame.
pub const UNMASK_RECEIVE_DATA: Short = Short::new([0xD1]);
/// Reset the receiver's gain, which squelch and gain control have changed, to its configured value. ST's library sends
/// this command before each exchange.
pub const RESET_RECEIVER_GAIN: Short = Short::new([0xD5]);
/// Adjust the regulators to the supply. The chip raises I_dct at the end, at most 5 ms later.
pub const ADJUST_REGULATORS: Short = Short::new([0xD6]);
/// Measure the supply that [`crate::register::REGULATOR_CONTROL`] selects. The chip raises I_dct 25 µs later and has
/// the result in [`crate::register::AD_RESULT`]. The oscillator must run.
pub const MEASURE_SUPPLY: Short = Short::new([0xDF]);
/// Clear the FIFO. The data sheet leaves open whether this also clears interrupts; the driver works in either case.
pub const CLEAR_FIFO: Short = Short::new([0xDB]);
/// Calibrate the RC oscillator (ST25R3916B only). The chip raises I_dct at the end, at most 5 ms later.
pub const RC_CALIBRATION: Short = Short::new([0xEA]);
