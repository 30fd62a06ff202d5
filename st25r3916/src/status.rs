//! The status read: interrupts and FIFO level in a single transfer.
//!
//! The transfer reads registers 0x19..=0x1F with auto-increment, eight bytes on the wire: the last mask register, the
//! four interrupt registers (which the read clears), and the two FIFO status registers. One transfer for each interrupt
//! saves time, and the FIFO level is never older than the interrupts. The mask register shows that the chip still has
//! its configuration: this driver keeps it at 0xFB, and a reset makes it 0x00.

use crate::command;
use crate::machine::{Fault, Short};
use crate::register as reg;

pub(crate) const STATUS_READ: Short = Short::new([command::READ | reg::IRQ_MASK_TARGET, 0, 0, 0, 0, 0, 0, 0]);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Status {
    pub(crate) main: u8,
    pub(crate) timer: u8,
    pub(crate) error: u8,
    pub(crate) target: u8,
    pub(crate) count: u16,
    /// The bits of FIFO status 2 that do not belong to the number of bytes.
    pub(crate) fifo: u8,
}

impl Status {
    /// Parses the response to [`STATUS_READ`].
    ///
    /// # Errors
    /// [`Fault::Bus`] if the response cannot come from the chip: it has the wrong length, or a level beyond the FIFO's
    /// size, as on a line that is stuck high. [`Fault::Reset`] if the mask register has its reset value.
    /// [`Fault::Register`] if it differs from its setting in another way.
    pub(crate) fn parse(response: &[u8]) -> Result<Self, Fault> {
        // Not covered: a response of another length than its transfer: the port reports such a transfer as failed.
        let &[_, mask, main, timer, error, target, low, high] = response else {
            return Err(Fault::Bus);
        };
        let count = u16::from(high & 0xC0) << 2 | u16::from(low);
        if count > reg::FIFO_SIZE {
            return Err(Fault::Bus);
        }
        match mask {
            reg::IRQ_MASK_TARGET_ALL => {}
            0 => return Err(Fault::Reset),
            found => {
                let (address, expected) = (reg::IRQ_MASK_TARGET, reg::IRQ_MASK_TARGET_ALL);
                return Err(Fault::Register { address, expected, found });
            }
        }
        Ok(Self { main, timer, error, target, count, fifo: high & 0x3F })
    }

    pub(crate) const fn is_set(self, main: u8) -> bool {
        self.main & main != 0
    }

    pub(crate) const fn is_quiet(self) -> bool {
        self.main | self.timer | self.error | self.target == 0
    }

    /// Whether the FIFO ran dry or over during a frame.
    pub(crate) const fn flow_error(self) -> bool {
        self.fifo & (reg::FIFO_UNDERFLOW | reg::FIFO_OVERFLOW) != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_status_is_read_bit_by_bit() {
        let status = Status::parse(&[0, 0xFB, 0x30, 0x18, 0x80, 0, 0xF7, 0x50]).unwrap();
        assert_eq!(status.count, 0x1F7);
        assert!(status.is_set(reg::IRQ_RXS) && status.is_set(reg::IRQ_RXE) && !status.is_set(reg::IRQ_TXE));
        assert!(status.flow_error() && !status.is_quiet());
        assert_eq!(status.fifo, reg::FIFO_OVERFLOW);
    }

    #[test]
    fn a_dead_line_and_a_reset_chip_are_told_apart() {
        assert_eq!(Status::parse(&[0xFF; 8]), Err(Fault::Bus));
        assert_eq!(Status::parse(&[0x00; 8]), Err(Fault::Reset));
        assert_eq!(Status::parse(&[0xFF; 7]), Err(Fault::Bus));
    }

    #[test]
    fn a_mask_with_one_wrong_bit_is_no_reset() {
        let found = Fault::Register { address: 0x19, expected: 0xFB, found: 0xF9 };
        assert_eq!(Status::parse(&[0, 0xF9, 0, 0, 0, 0, 0, 0]), Err(found));
    }
}
