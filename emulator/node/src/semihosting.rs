//! A debug probe that serves semihosting: "Semihosting for AArch32 and AArch64", Arm 2021.

use cortex_m4::Cost;

use super::rtt;
use super::{Board, FindingKind, Node, memory};

impl<B: Board, C: Cost> Node<B, C> {
    /// Makes the node serve the firmware's semihosting calls: console output, and an exit that stops the core.
    #[must_use]
    pub fn with_semihosting(mut self) -> Self {
        self.semihosting = true;
        self
    }

    /// Serves a semihosting call, as section 3 (operations) of Arm's semihosting specification defines it.
    #[inline(never)]
    pub(super) fn host_call(&mut self) {
        if !self.semihosting {
            self.core.finish_host_call(None);
            return;
        }
        let (operation, parameter) = (self.register(0), u64::from(self.register(1)));
        let argument = |node: &Self, index: u64| memory::value(&node.side.part, parameter + 4 * index, 4).unwrap_or(0);
        const FAILED: u32 = u32::MAX;
        let answer = match operation {
            // SYS_OPEN opens only the console, ":tt".
            0x01 => {
                let mut name = vec![0; usize::try_from(argument(self, 2)).unwrap_or(0).min(64)];
                let read = memory::read(&self.side.part, argument(self, 0), &mut name);
                // Modes 0 to 3 read, 4 to 7 write, and 8 to 11 append (standard error).
                if read && name == b":tt" { u32::try_from(argument(self, 1) / 4).unwrap_or(0) } else { FAILED }
            }
            // SYS_CLOSE
            0x02 => 0,
            // SYS_WRITEC
            0x03 => {
                let character = memory::value(&self.side.part, parameter, 1).unwrap_or(0);
                self.print(&[u8::try_from(character).unwrap_or(0)]);
                0
            }
            // SYS_WRITE0
            0x04 => {
                let mut at = parameter;
                while let Some(byte @ 1..) = memory::value(&self.side.part, at, 1) {
                    self.print(&[u8::try_from(byte).unwrap_or(0)]);
                    at += 1;
                }
                0
            }
            // SYS_WRITE returns the number of bytes that it did not write.
            0x05 => {
                let length = argument(self, 2);
                let mut text = vec![0; usize::try_from(length).unwrap_or(0).min(1 << 20)];
                let there = memory::read(&self.side.part, argument(self, 1), &mut text);
                self.print(&text);
                if there { 0 } else { u32::try_from(length).unwrap_or(FAILED) }
            }
            // SYS_ISTTY
            0x09 => u32::from(argument(self, 0) <= 2),
            // SYS_CLOCK returns hundredths of a second, and SYS_TIME seconds since power-on.
            0x10 => u32::try_from(self.now() / 10_000_000).unwrap_or(FAILED),
            0x11 => u32::try_from(self.now() / 1_000_000_000).unwrap_or(FAILED),
            // SYS_ERRNO
            0x13 => 0,
            // SYS_EXIT has a reason, with ADP_Stopped_ApplicationExit for success. SYS_EXIT_EXTENDED has a reason and a
            // status.
            0x18 => self.ended(if parameter == 0x2_0026 { 0 } else { 1 }),
            0x20 => {
                let status = argument(self, 1);
                self.ended(u32::try_from(status).unwrap_or(1))
            }
            // SYS_ELAPSED and SYS_TICKFREQ count nanoseconds.
            0x30 => {
                let now = self.now().to_le_bytes();
                if memory::write(&mut self.side.part, parameter, &now) { 0 } else { FAILED }
            }
            0x31 => 1_000_000_000,
            // Calls for files and input fail, as on a host without a file system.
            0x06 | 0x07 | 0x0A | 0x0C..=0x0F | 0x12 | 0x15 | 0x16 => FAILED,
            _ => {
                let text = format!("semihosting operation {operation:#x} is not served");
                self.find(FindingKind::Unmodelled, Some(u64::from(self.core.pc())), text);
                FAILED
            }
        };
        self.core.finish_host_call(Some(answer));
    }

    fn ended(&mut self, status: u32) -> u32 {
        self.exit = Some(status);
        if status != 0 {
            let pc = u64::from(self.core.pc());
            self.find(FindingKind::ExitStatus, Some(pc), format!("the firmware ended the run with status {status}"));
        }
        0
    }

    fn print(&mut self, text: &[u8]) {
        let at = self.now();
        let Self { console, lines, .. } = self;
        console.take(text, |line| lines.push(rtt::text_line(at, "", line)));
    }
}
