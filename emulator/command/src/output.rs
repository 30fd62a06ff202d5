//! Prints what happens in a run.

use std::collections::BTreeMap;
use std::io::Write;

use emulator_node::{LogLine, SentByte};
use emulator_part::{Pad, Pin};

pub(crate) const fn pad_text(pad: Pad) -> &'static str {
    match pad {
        Pad::Driven(true) => "high",
        Pad::Driven(false) => "low",
        Pad::Pulled(true) => "pulled high",
        Pad::Pulled(false) => "pulled low",
        Pad::Floating => "floats",
    }
}

pub(crate) struct Output<W> {
    stdout: W,
    /// Whether the reader has closed the output, as `head` does. The run goes on, because its exit code is still
    /// needed.
    closed: bool,
    /// For each UART, the unfinished line: the instant of its first byte, ns, and its bytes.
    half: BTreeMap<Pin, (u64, Vec<u8>)>,
}

const LONGEST_LINE: usize = 4096;

impl<W: Write> Output<W> {
    pub(crate) fn new(stdout: W) -> Self {
        Self { stdout, closed: false, half: BTreeMap::new() }
    }

    /// Prints a line of the log. A line without a time stamp gets the virtual time at which the probe read it, up to 1
    /// ms after the firmware wrote it.
    pub(crate) fn line(&mut self, line: &LogLine) {
        if line.timestamp.is_empty() {
            self.text(format_args!("{:>14.6} ms  {line}", milliseconds(line.at)));
        } else {
            self.text(format_args!("{line}"));
        }
    }

    pub(crate) fn byte(&mut self, SentByte { at, pin, byte }: SentByte) {
        let (_, bytes) = self.half.entry(pin).or_insert((at, vec![]));
        if byte != b'\n' {
            bytes.push(byte);
        }
        if (byte == b'\n' || bytes.len() == LONGEST_LINE)
            && let Some((at, bytes)) = self.half.remove(&pin)
        {
            self.half_line(at, &bytes);
        }
    }

    fn half_line(&mut self, at: u64, bytes: &[u8]) {
        let line = String::from_utf8_lossy(bytes);
        self.text(format_args!("{:>14.6} ms  {}", milliseconds(at), line.trim_end_matches('\r')));
    }

    pub(crate) fn finish(&mut self) {
        for (at, bytes) in std::mem::take(&mut self.half).into_values() {
            self.half_line(at, &bytes);
        }
    }

    pub(crate) fn text(&mut self, text: std::fmt::Arguments<'_>) {
        self.closed = self.closed || writeln!(self.stdout, "{text}").is_err();
    }
}

pub(crate) fn milliseconds(ns: u64) -> f64 {
    ns as f64 / 1e6
}

#[cfg(test)]
mod tests {
    use emulator_node::LogLevel;

    use super::*;

    struct Pipe(Vec<u8>, usize);

    impl Write for Pipe {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            if self.0.iter().filter(|byte| **byte == b'\n').count() >= self.1 {
                return Err(std::io::ErrorKind::BrokenPipe.into());
            }
            self.0.extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn text_gets_virtual_time_and_stops_when_its_reader_closes() {
        let line = |timestamp: &str, text: &str| LogLine {
            at: 1_500_000,
            timestamp: timestamp.to_owned(),
            level: LogLevel::None,
            channel: String::new(),
            text: text.to_owned(),
        };
        let mut output = Output::new(Pipe(vec![], 2));
        ["", "0.001"].into_iter().for_each(|timestamp| output.line(&line(timestamp, "hello")));
        assert!(!output.closed);
        output.line(&line("", "too late"));
        assert!(output.closed);
        output.stdout.1 = 9;
        output.line(&line("", "never"));
        assert_eq!(String::from_utf8(output.stdout.0).unwrap(), "      1.500000 ms  hello\n0.001 hello\n");
    }

    #[test]
    fn lines_of_a_uart_get_the_time_of_their_first_byte() {
        let mut output = Output::new(vec![]);
        let (one, other) = (Pin::new(0, 6), Pin::new(0, 8));
        for (at, pin, byte) in [(1, one, b'a'), (2, other, b'x'), (3, one, b'b'), (4, one, b'\r'), (5, one, b'\n')] {
            output.byte(SentByte { at: at * 1_000_000, pin, byte });
        }
        output.byte(SentByte { at: 6_000_000, pin: one, byte: b'\n' });
        output.finish();
        let text = String::from_utf8(output.stdout).unwrap();
        assert_eq!(text, "      1.000000 ms  ab\n      6.000000 ms  \n      2.000000 ms  x\n");
    }
}
