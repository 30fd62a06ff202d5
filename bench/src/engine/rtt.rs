//! SEGGER RTT as a debug probe reads it, and the defmt stream inside it.
//!
//! A firmware keeps a control block called `_SEGGER_RTT`: the magic, the counts of up and down channels, then 24 bytes
//! for each channel {name, buffer, size, write offset, read offset, flags}. The probe empties an up channel from the
//! read to the write offset, wraps at the size, and writes the read offset back, which is what makes room for more.

use super::memory::GuestMemory;

/// What every initialised control block starts with. The firmware writes it last.
const MAGIC: &[u8; 16] = b"SEGGER RTT\0\0\0\0\0\0";
/// Offset of the count of up channels in the control block.
const UP_COUNT: u64 = 16;
/// Offset of the first channel.
const CHANNELS: u64 = 24;
/// Bytes of one channel's description.
const CHANNEL_BYTES: u64 = 24;
/// More channels than any firmware declares; a larger count is garbage.
const MOST_CHANNELS: u64 = 16;

/// Why a channel could not be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum RttFault {
    /// The control block is not there yet, as before the firmware's first log line.
    NotYet,
    /// A field of the control block cannot be true.
    Corrupt(String),
}

/// Empties up channel `channel` of the control block at `block`.
pub(crate) fn drain(memory: &mut GuestMemory, block: u64, channel: u64) -> Result<Vec<u8>, RttFault> {
    let mut magic = [0; 16];
    if !memory.read(block, &mut magic) {
        return Err(RttFault::Corrupt(format!("the control block at {block:#010x} is not in memory")));
    }
    if &magic != MAGIC {
        return Err(RttFault::NotYet);
    }
    let word = |memory: &GuestMemory, at| memory.value(at, 4).unwrap_or(0);
    let count = word(memory, block + UP_COUNT);
    if count == 0 || count > MOST_CHANNELS {
        return Err(RttFault::Corrupt(format!("the control block counts {count} up channels")));
    }
    if channel >= count {
        return Ok(Vec::new());
    }
    let entry = block + CHANNELS + CHANNEL_BYTES * channel;
    let (buffer, size) = (word(memory, entry + 4), word(memory, entry + 8));
    let (write, read) = (word(memory, entry + 12), word(memory, entry + 16));
    if size == 0 {
        return Ok(Vec::new());
    }
    if write >= size || read >= size {
        return Err(RttFault::Corrupt(format!("up channel {channel} has offsets {write} and {read} in {size} bytes")));
    }
    let mut bytes = Vec::new();
    let mut take = |from: u64, to: u64| {
        let mut part = vec![0; usize::try_from(to - from).unwrap_or(0)];
        let there = memory.read(buffer + from, &mut part);
        bytes.append(&mut part);
        there
    };
    let there = if read <= write { take(read, write) } else { take(read, size) && take(0, write) };
    if !there {
        return Err(RttFault::Corrupt(format!("up channel {channel}'s buffer at {buffer:#010x} is not in memory")));
    }
    if read != write {
        memory.put(entry + 16, 4, write);
    }
    Ok(bytes)
}

/// The severity of a log line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LogLevel {
    /// `defmt::println!`, plain RTT text or a semihosting console, which have no level.
    None,
    /// `trace!`
    Trace,
    /// `debug!`
    Debug,
    /// `info!`
    Info,
    /// `warn!`
    Warn,
    /// `error!`
    Error,
}

/// One line the firmware logged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogLine {
    /// When the probe took it, in virtual nanoseconds: up to a probe period after the firmware wrote it.
    pub at: u64,
    /// The firmware's own timestamp, empty where it has none.
    pub timestamp: String,
    /// The severity.
    pub level: LogLevel,
    /// The text.
    pub text: String,
}

impl std::fmt::Display for LogLine {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if !self.timestamp.is_empty() {
            write!(formatter, "{} ", self.timestamp)?;
        }
        match self.level {
            LogLevel::None => write!(formatter, "{}", self.text),
            level => write!(formatter, "{:<5} {}", format!("{level:?}").to_uppercase(), self.text),
        }
    }
}

/// The decoder of a node's log channel.
#[derive(Debug, Default)]
pub(crate) struct LogStream {
    pending: Vec<u8>,
}

impl LogStream {
    /// Takes `bytes` as they came from the channel and hands every complete line to `line`. Answers how many frames did
    /// not decode.
    pub(crate) fn take(
        &mut self,
        table: Option<&defmt_decoder::Table>,
        at: u64,
        bytes: &[u8],
        mut line: impl FnMut(LogLine),
    ) -> u32 {
        self.pending.extend_from_slice(bytes);
        let Some(table) = table else {
            while let Some(end) = self.pending.iter().position(|&byte| byte == b'\n') {
                let text: Vec<u8> = self.pending.drain(..=end).collect();
                let text = String::from_utf8_lossy(&text).trim_end().to_owned();
                line(LogLine { at, timestamp: String::new(), level: LogLevel::None, text });
            }
            return 0;
        };
        let mut malformed = 0;
        match table.encoding() {
            // A frame ends with a zero, which no encoded byte is.
            defmt_decoder::Encoding::Rzcobs => {
                while let Some(end) = self.pending.iter().position(|&byte| byte == 0) {
                    let encoded: Vec<u8> = self.pending.drain(..=end).collect();
                    if encoded.len() == 1 {
                        continue;
                    }
                    let mut decoder = table.new_stream_decoder();
                    decoder.received(&encoded);
                    match decoder.decode() {
                        Ok(frame) => line(render(at, &frame)),
                        Err(_) => malformed += 1,
                    }
                }
            }
            _ => loop {
                match table.decode(&self.pending) {
                    Ok((frame, consumed)) => {
                        line(render(at, &frame));
                        self.pending.drain(..consumed);
                    }
                    Err(defmt_decoder::DecodeError::UnexpectedEof) => break,
                    Err(defmt_decoder::DecodeError::Malformed) => {
                        malformed += 1;
                        self.pending.clear();
                        break;
                    }
                }
            },
        }
        malformed
    }

    /// Forgets a line the firmware never finished, as its restart does.
    pub(crate) fn restart(&mut self) {
        self.pending.clear();
    }
}

fn render(at: u64, frame: &defmt_decoder::Frame<'_>) -> LogLine {
    LogLine {
        at,
        timestamp: frame.display_timestamp().map_or_else(String::new, |time| time.to_string()),
        level: frame.level().map_or(LogLevel::None, |level| match level.as_str() {
            "trace" => LogLevel::Trace,
            "debug" => LogLevel::Debug,
            "info" => LogLevel::Info,
            "warn" => LogLevel::Warn,
            _ => LogLevel::Error,
        }),
        text: frame.display_message().to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rigless::soc::Region;

    const BLOCK: u64 = 0x2000_0100;
    const BUFFER: u64 = 0x2000_0200;
    const SIZE: u64 = 16;

    /// A control block of two up channels, the second with `text` from offset `read` on.
    fn memory(text: &[u8], read: u64) -> GuestMemory {
        let mut memory = GuestMemory::new(&[Region::ram("ram", 0x2000_0000, 4096)], &[]);
        memory.write(BLOCK, MAGIC);
        memory.put(BLOCK + UP_COUNT, 4, 2);
        let entry = BLOCK + CHANNELS + CHANNEL_BYTES;
        for (offset, value) in [(4, BUFFER), (8, SIZE), (12, (read + text.len() as u64) % SIZE), (16, read)] {
            memory.put(entry + offset, 4, value);
        }
        for (index, byte) in (0..).zip(text) {
            memory.write(BUFFER + (read + index) % SIZE, &[*byte]);
        }
        memory
    }

    #[test]
    fn a_channel_is_read_across_the_end_of_its_buffer_and_makes_room() {
        let mut memory = memory(b"over the end", 9);
        assert_eq!(drain(&mut memory, BLOCK, 1).unwrap(), b"over the end");
        assert_eq!(drain(&mut memory, BLOCK, 1).unwrap(), b"");
        let entry = BLOCK + CHANNELS + CHANNEL_BYTES;
        assert_eq!(memory.value(entry + 16, 4), Some(5));
    }

    #[test]
    fn a_channel_that_is_not_there_is_empty() {
        let mut memory = memory(b"text", 0);
        assert_eq!(drain(&mut memory, BLOCK, 0).unwrap(), b"");
        assert_eq!(drain(&mut memory, BLOCK, 2).unwrap(), b"");
    }

    #[test]
    fn before_the_firmware_sets_it_up_there_is_nothing_yet() {
        let mut memory = memory(b"text", 0);
        memory.write(BLOCK, b"_");
        assert_eq!(drain(&mut memory, BLOCK, 1), Err(RttFault::NotYet));
    }

    #[test]
    fn offsets_past_the_buffer_are_corrupt() {
        let mut memory = memory(b"text", 0);
        memory.put(BLOCK + CHANNELS + CHANNEL_BYTES + 12, 4, SIZE);
        assert!(matches!(drain(&mut memory, BLOCK, 1), Err(RttFault::Corrupt(_))));
    }

    #[test]
    fn a_buffer_outside_memory_is_corrupt() {
        let mut memory = memory(b"text", 0);
        memory.put(BLOCK + CHANNELS + CHANNEL_BYTES + 4, 4, 0x3000_0000);
        assert!(matches!(drain(&mut memory, BLOCK, 1), Err(RttFault::Corrupt(_))));
    }

    #[test]
    fn text_without_a_table_comes_line_by_line() {
        let mut stream = LogStream::default();
        let mut lines = Vec::new();
        stream.take(None, 5, b"one\r\ntw", |line| lines.push(line.text));
        stream.take(None, 6, b"o\n", |line| lines.push(line.text));
        assert_eq!(lines, ["one", "two"]);
    }
}
