//! A debug probe that reads the firmware's log.

use cortex_m4::Cost;

use super::rtt::{self, LogLine};
use super::{Board, Node, Symbol, memory};

/// The time between two readings of the firmware's log, in virtual nanoseconds. Each reading empties the log, as when a
/// debug probe polls RTT.
pub const PROBE_PERIOD: u64 = 1_000_000;

/// The longest time between two searches of RAM for the log, in virtual nanoseconds.
const LONGEST_SEARCH: u64 = 100_000_000;

impl<B: Board, C: Cost> Node<B, C> {
    /// Takes the log lines since the last call, including console output through semihosting.
    pub fn take_log(&mut self) -> Vec<LogLine> {
        self.probe_log(self.now());
        std::mem::take(&mut self.lines)
    }

    /// Takes the log lines since the last call, and then the incomplete lines.
    pub fn finish_log(&mut self) -> Vec<LogLine> {
        let mut lines = self.take_log();
        let at = self.now();
        lines.extend(self.log.finish(at));
        lines.extend(self.console.finish().map(|bytes| rtt::text_line(at, "", &bytes)));
        lines
    }

    /// Takes the bytes of RTT up channel `channel` since the last call, at most the latest 64 KiB. The log has them
    /// too.
    pub fn take_channel(&mut self, channel: u64) -> Vec<u8> {
        self.probe_log(self.now());
        self.log.take_raw(channel)
    }

    pub(super) fn probe(&mut self, now: u64) {
        self.probe_at = (now / PROBE_PERIOD + 1) * PROBE_PERIOD;
        self.probe_log(now);
    }

    /// Overwrites the firmware's log with zeros, as debug probes do before a start. Until start-up code has written a
    /// new control block, RAM holds noise or the block of an earlier start. If another probe is attached, the block is
    /// left to that probe.
    pub(super) fn clear_log(&mut self) {
        if let Some(block) = self.log_block.filter(|_| !self.debugged) {
            let size = usize::try_from(block.size).unwrap_or(0);
            memory::write(&mut self.side.part, block.address, &vec![0; size.clamp(rtt::MAGIC.len(), rtt::LONGEST)]);
        }
    }

    #[inline(never)]
    pub(super) fn probe_log(&mut self, at: u64) {
        // RAM is searched only if the node knows the firmware's ELF file. Otherwise an attached probe that has the file
        // reads the log.
        if self.log_block.is_none() && self.firmware.is_a_file() && at >= self.search_at {
            // A firmware that logs does so early, so the searches become rarer.
            self.search_at = at + at.clamp(PROBE_PERIOD, LONGEST_SEARCH);
            self.log_block = rtt::find(&self.side.part).map(|address| Symbol { address, size: 0 });
        }
        let Some(block) = self.log_block.filter(|_| self.powered) else { return };
        let (lines, troubles) = self.log.probe(&mut self.side.part, block.address, &self.firmware, at);
        self.lines.extend(lines);
        for (kind, text) in troubles {
            self.add_finding(kind, at, None, text);
        }
    }
}
