//! A debug probe that reads the firmware's log.

use bench_seam::Reset;
use cortex_m4::Cost;

use super::rtt::{self, LogLine};
use super::{Board, Node, ResetAt};

/// How often the node empties the firmware's log, as a debug probe polls RTT, in virtual nanoseconds.
pub const PROBE_PERIOD: u64 = 1_000_000;

/// Start-up code has filled RAM by then, after the supply came on, virtual ns: 6 KB at 16 MHz take less than 1 ms.
const FILLS_RAM_NS: u64 = 2_000_000;

impl<B: Board, C: Cost> Node<B, C> {
    /// The log lines since last asked, console output through semihosting among them.
    pub fn take_log(&mut self) -> Vec<LogLine> {
        self.probe_log(self.now());
        std::mem::take(&mut self.lines)
    }

    /// The log lines since last asked, as [`Node::take_log`], and then the lines that the firmware did not finish.
    pub fn finish_log(&mut self) -> Vec<LogLine> {
        let mut lines = self.take_log();
        let at = self.now();
        lines.extend(self.log.finish(at));
        lines.extend(self.console.finish().map(|bytes| rtt::text_line(at, "", &bytes)));
        lines
    }

    /// The bytes that came over RTT up channel `channel` since last asked, up to the latest 64 KiB. They are in the log
    /// as well.
    pub fn take_channel(&mut self, channel: u64) -> Vec<u8> {
        self.probe_log(self.now());
        self.log.take_raw(channel)
    }

    /// A debug probe's look at the log, on a grid of [`PROBE_PERIOD`].
    pub(super) fn probe(&mut self, now: u64) {
        self.probe_at = (now / PROBE_PERIOD + 1) * PROBE_PERIOD;
        self.probe_log(now);
    }

    /// Whether the supply came on a moment ago: RAM held noise, and start-up code is still writing what it has to hold.
    fn fills_ram(&self, at: u64) -> bool {
        let came_on = |reset: &&ResetAt| reset.cause == Reset::PowerOn;
        self.resets.last().filter(came_on).is_some_and(|reset| at < reset.at + FILLS_RAM_NS)
    }

    pub(super) fn probe_log(&mut self, at: u64) {
        let Some(block) = self.log_block.filter(|_| self.powered && !self.fills_ram(at)) else { return };
        let (lines, troubles) = self.log.probe(&mut self.side.part, block, &self.firmware, at);
        self.lines.extend(lines);
        for (kind, text) in troubles {
            self.add_finding(kind, at, None, text);
        }
    }
}
