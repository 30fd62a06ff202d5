//! Reads SEGGER RTT as a debug probe does, and the defmt stream in it.
//!
//! A firmware keeps a control block called `_SEGGER_RTT`: the magic, the numbers of up and down channels, then 24 bytes
//! for each channel {name, buffer, size, write offset, read offset, flags}. The probe reads an up channel from the read
//! offset to the write offset, with a wrap at the size. It then sets the read offset to the write offset, which makes
//! room for more data.
//!
//! | what | how |
//! |---|---|
//! | the channel called `defmt` | frames, decoded with the image's own table |
//! | every other up channel | text, by lines; bytes that are not UTF-8 show as U+FFFD |
//! | a channel that was full at a reading | a finding, unless the firmware waits for room (mode 2) |
//! | a field with an impossible value | a finding, once; the other channels go on |
//! | down channels | not written: the probe sends no input |

use emulator_part::Part;

use super::finding::FindingKind;
use super::{Firmware, memory};

/// The length, bytes, of a short message. It fits into a buffer that is not nearly full.
const SHORT_MESSAGE: u64 = 32;
/// The magic: the first bytes of every initialised control block. The firmware writes them last.
pub(super) const MAGIC: &[u8; 16] = b"SEGGER RTT\0\0\0\0\0\0";
const UP_COUNT: u64 = 16;
const CHANNELS: u64 = 24;
const CHANNEL_BYTES: u64 = 24;
/// The largest number of channels that is accepted. A larger number is taken as garbage.
const MOST_CHANNELS: u64 = 16;
/// The length in bytes of the longest control block, with as many down channels as up channels.
pub(super) const LONGEST: usize = (CHANNELS + 2 * MOST_CHANNELS * CHANNEL_BYTES) as usize;

const LONGEST_NAME: usize = 32;
/// The name of the channel with defmt frames, by the convention of `defmt-rtt`.
const DEFMT: &str = "defmt";
/// The longest line of text in bytes. A longer line is shown in pieces.
const LONGEST_LINE: usize = 4096;
/// The greatest number of bytes that are kept for [`Channels::take_raw`], and for an incomplete frame.
const MOST_RAW: usize = 1 << 16;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum RttFault {
    NotYet,
    Corrupt(String),
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Drained {
    pub(crate) bytes: Vec<u8>,
    pub(crate) in_use: bool,
    /// Whether data was lost, because the buffer was full and the firmware does not wait for room.
    pub(crate) overran: bool,
}

pub(crate) fn count<P: Part>(part: &P, block: u64) -> Result<u64, RttFault> {
    let mut magic = [0; 16];
    if !memory::read(part, block, &mut magic) {
        return Err(RttFault::Corrupt(format!("the RTT control block at {block:#010x} is not in memory")));
    }
    if &magic != MAGIC {
        return Err(RttFault::NotYet);
    }
    match memory::value(part, block + UP_COUNT, 4).unwrap_or(0) {
        count @ 1..=MOST_CHANNELS => Ok(count),
        // The control block has no channels yet: start-up code may be copying it from flash into RAM, its name before
        // its number of channels.
        0 => Err(RttFault::NotYet),
        count => Err(RttFault::Corrupt(format!("the RTT control block counts {count} up channels"))),
    }
}

/// Finds the control block in RAM, for an image whose symbols do not have the block's address. The control block is the
/// first place with the magic, at a multiple of four, and a possible number of channels.
pub(crate) fn find<P: Part>(part: &P) -> Option<u64> {
    P::RAM.iter().find_map(|&(start, size)| {
        let bytes = part.memory(start, size)?;
        let places = (0..bytes.len().saturating_sub(MAGIC.len())).step_by(4);
        let mut found = places.filter(|at| bytes[*at..].starts_with(MAGIC)).map(|at| u64::from(start) + at as u64);
        found.find(|block| count(part, *block).is_ok())
    })
}

pub(crate) fn name<P: Part>(part: &P, block: u64, channel: u64) -> String {
    let entry = block + CHANNELS + CHANNEL_BYTES * channel;
    let Some(at @ 1..) = memory::value(part, entry, 4) else { return String::new() };
    let byte = |index| memory::value(part, at + index, 1).and_then(|byte| u8::try_from(byte).ok());
    let bytes: Vec<u8> = (0..).map_while(byte).take_while(|&byte| byte != 0).take(LONGEST_NAME).collect();
    String::from_utf8_lossy(&bytes).chars().filter(|character| !character.is_control()).collect()
}

pub(crate) fn drain<P: Part>(part: &mut P, block: u64, channel: u64) -> Result<Drained, RttFault> {
    if channel >= count(part, block)? {
        return Ok(Drained::default());
    }
    let word = |part: &P, at| memory::value(part, at, 4).unwrap_or(0);
    let entry = block + CHANNELS + CHANNEL_BYTES * channel;
    let (buffer, size) = (word(part, entry + 4), word(part, entry + 8));
    let (write, read) = (word(part, entry + 12), word(part, entry + 16));
    // A firmware's RAM test writes zeros and ones over the old control block, but the magic may remain.
    if size == 0 || [size, write, read].contains(&u64::from(u32::MAX)) {
        return Ok(Drained::default());
    }
    if write >= size || read >= size {
        let text = format!("RTT up channel {channel} has offsets {write} and {read} in {size} bytes");
        return Err(RttFault::Corrupt(text));
    }
    // The range is checked before the copy, because an invalid size may be large.
    let extent = u32::try_from(buffer).ok().zip(usize::try_from(size).ok());
    if extent.and_then(|(buffer, size)| part.memory(buffer, size)).is_none() {
        let text = format!("RTT up channel {channel}'s buffer, {size} bytes at {buffer:#010x}, is not in memory");
        return Err(RttFault::Corrupt(text));
    }
    let mut bytes = Vec::new();
    let mut take = |from: u64, to: u64| {
        let mut piece = vec![0; usize::try_from(to - from).unwrap_or(0)];
        memory::read(part, buffer + from, &mut piece);
        bytes.append(&mut piece);
    };
    if read <= write {
        take(read, write);
    } else {
        take(read, size);
        take(0, write);
    }
    if read != write {
        let offset = u32::try_from(write).unwrap_or(0);
        memory::write(part, entry + 16, &offset.to_le_bytes());
    }
    // A full buffer would look empty, so one byte always stays free. In RTT's mode 0 a message that does not fit is
    // dropped, so that the last byte is rarely reached. A nearly full buffer therefore counts as full.
    let free = size - 1 - u64::try_from(bytes.len()).unwrap_or(0);
    let overran = match word(part, entry + 20) & 3 {
        0 => free < (size / 4).min(SHORT_MESSAGE),
        1 => free == 0,
        _ => false,
    };
    Ok(Drained { bytes, in_use: true, overran })
}

/// The severity of a log line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LogLevel {
    /// The line has no level, as for `defmt::println!`, plain RTT text or a semihosting console.
    None,
    /// The level of `trace!`.
    Trace,
    /// The level of `debug!`.
    Debug,
    /// The level of `info!`.
    Info,
    /// The level of `warn!`.
    Warn,
    /// The level of `error!`.
    Error,
}

/// One line that the firmware logged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogLine {
    /// The instant at which the probe read the line, in virtual nanoseconds: up to [`crate::PROBE_PERIOD`] after the
    /// firmware wrote it.
    pub at: u64,
    /// The firmware's own timestamp, empty if there is none.
    pub timestamp: String,
    /// The severity of the line.
    pub level: LogLevel,
    /// The RTT channel of the line, empty if the firmware has only one channel and for a semihosting console.
    pub channel: String,
    /// The text of the line.
    pub text: String,
}

impl std::fmt::Display for LogLine {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if !self.channel.is_empty() {
            write!(formatter, "[{}] ", self.channel)?;
        }
        if !self.timestamp.is_empty() {
            write!(formatter, "{} ", self.timestamp)?;
        }
        match self.level {
            LogLevel::None => write!(formatter, "{}", self.text),
            level => write!(formatter, "{:<5} {}", format!("{level:?}").to_uppercase(), self.text),
        }
    }
}

pub(crate) fn text_line(at: u64, channel: &str, bytes: &[u8]) -> LogLine {
    let text = String::from_utf8_lossy(bytes).trim_end_matches(['\r', '\n']).to_owned();
    LogLine { at, timestamp: String::new(), level: LogLevel::None, channel: channel.to_owned(), text }
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Text {
    pending: Vec<u8>,
}

impl Text {
    /// Calls `line` with every line that `bytes` complete, including its end, and with lines that become too long.
    pub(crate) fn take(&mut self, bytes: &[u8], mut line: impl FnMut(&[u8])) {
        for piece in bytes.split_inclusive(|&byte| byte == b'\n') {
            self.pending.extend_from_slice(piece);
            if piece.ends_with(b"\n") || self.pending.len() >= LONGEST_LINE {
                line(&self.pending);
                self.pending.clear();
            }
        }
    }

    /// Returns the last line, which the firmware did not end.
    pub(crate) fn finish(&mut self) -> Option<Vec<u8>> {
        (!self.pending.is_empty()).then(|| std::mem::take(&mut self.pending))
    }
}

#[derive(Clone, Debug, Default)]
struct Frames {
    pending: Vec<u8>,
}

impl Frames {
    /// Calls `line` with every frame that `bytes` complete. Returns the number of frames that could not be decoded.
    fn take(
        &mut self,
        table: &defmt_decoder::Table,
        bytes: &[u8],
        mut line: impl FnMut(&defmt_decoder::Frame<'_>),
    ) -> usize {
        self.pending.extend_from_slice(bytes);
        let mut malformed = 0;
        match table.encoding() {
            // A frame ends with a zero, and no encoded byte is zero.
            defmt_decoder::Encoding::Rzcobs => {
                while let Some(end) = self.pending.iter().position(|&byte| byte == 0) {
                    let encoded: Vec<u8> = self.pending.drain(..=end).collect();
                    if encoded.len() == 1 {
                        continue;
                    }
                    let mut decoder = table.new_stream_decoder();
                    decoder.received(&encoded);
                    match decoder.decode() {
                        Ok(frame) => line(&frame),
                        Err(_) => malformed += 1,
                    }
                }
            }
            _ => loop {
                match table.decode(&self.pending) {
                    Ok((frame, consumed)) => {
                        line(&frame);
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
        if self.pending.len() > MOST_RAW {
            malformed += 1;
            self.pending.clear();
        }
        malformed
    }
}

#[derive(Clone, Debug, Default)]
struct Channel {
    label: String,
    text: Text,
    frames: Frames,
    raw: Vec<u8>,
    /// Whether the channel was already reported as corrupt. It is reported once.
    told_corrupt: bool,
    told_overrun: bool,
    told_malformed: bool,
    told_encoding: bool,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Channels {
    list: Vec<Channel>,
    told_corrupt: bool,
}

pub(crate) type ChannelOutput = (Vec<LogLine>, Vec<(FindingKind, String)>);

impl Channels {
    /// Reads and empties all up channels of the control block at `block`. The lines get the instant `at`.
    pub(crate) fn probe<P: Part>(&mut self, part: &mut P, block: u64, firmware: &Firmware, at: u64) -> ChannelOutput {
        let mut output = (Vec::new(), Vec::new());
        let count = match count(part, block) {
            Ok(count) => usize::try_from(count).unwrap_or(0),
            Err(RttFault::NotYet) => return output,
            Err(RttFault::Corrupt(text)) => {
                if !std::mem::replace(&mut self.told_corrupt, true) {
                    output.1.push((FindingKind::LogCorrupt, text));
                }
                return output;
            }
        };
        if self.list.len() < count {
            self.list.resize_with(count, Channel::default);
        }
        let mut drained = Vec::new();
        for (number, channel) in (0..).zip(&mut self.list) {
            drained.push(match drain(part, block, number) {
                Ok(drained) => drained,
                Err(RttFault::Corrupt(text)) if !std::mem::replace(&mut channel.told_corrupt, true) => {
                    output.1.push((FindingKind::LogCorrupt, text));
                    Drained::default()
                }
                Err(_) => Drained::default(),
            });
        }
        if drained.iter().all(|drained| drained.bytes.is_empty()) {
            return output;
        }
        let several = drained.iter().filter(|drained| drained.in_use).count() > 1;
        let names: Vec<String> = (0..).zip(&drained).map(|(number, _)| name(part, block, number)).collect();
        let decoded = names.iter().any(|name| name == DEFMT);
        for (number, (drained, name)) in drained.iter().zip(&names).enumerate() {
            if drained.bytes.is_empty() {
                continue;
            }
            let channel = &mut self.list[number];
            let title = if name.is_empty() { number.to_string() } else { name.clone() };
            channel.label = if several { title.clone() } else { String::new() };
            channel.raw.extend_from_slice(&drained.bytes);
            let excess = channel.raw.len().saturating_sub(MOST_RAW);
            channel.raw.drain(..excess);
            if drained.overran && !std::mem::replace(&mut channel.told_overrun, true) {
                let text = format!(
                    "RTT channel {title} was full when the probe looked: the firmware logs faster than it is read, and \
                     some of it is lost"
                );
                output.1.push((FindingKind::LogOverrun, text));
            }
            channel.take(firmware, name == DEFMT, decoded, &title, at, &drained.bytes, &mut output);
        }
        output
    }

    pub(crate) fn take_raw(&mut self, channel: u64) -> Vec<u8> {
        let channel = usize::try_from(channel).ok().and_then(|channel| self.list.get_mut(channel));
        channel.map(|channel| std::mem::take(&mut channel.raw)).unwrap_or_default()
    }

    /// Ends the streams, because the firmware has ended or restarts. Incomplete lines count as lines, and incomplete
    /// frames are dropped.
    pub(crate) fn finish(&mut self, at: u64) -> Vec<LogLine> {
        self.list
            .iter_mut()
            .filter_map(|channel| {
                channel.frames = Frames::default();
                channel.text.finish().map(|bytes| text_line(at, &channel.label, &bytes))
            })
            .collect()
    }
}

impl Channel {
    /// Makes log lines of `bytes`. `decoded` says that a channel of the firmware has the name of the defmt channel.
    #[expect(clippy::too_many_arguments, reason = "all of a look's circumstances")]
    fn take(
        &mut self,
        firmware: &Firmware,
        framed: bool,
        decoded: bool,
        title: &str,
        at: u64,
        bytes: &[u8],
        output: &mut ChannelOutput,
    ) {
        let Self { label, text, frames, told_encoding, told_malformed, .. } = self;
        let (lines, troubles) = output;
        let table = firmware.log_table();
        match table {
            Some(table) if framed => {
                let malformed = frames.take(table, bytes, |frame| {
                    let mut line = render(at, frame);
                    line.channel.clone_from(label);
                    lines.push(line);
                });
                if malformed > 0 && !std::mem::replace(told_malformed, true) {
                    let words = "of the log did not decode: the log buffer overran, or something wrote into it";
                    troubles.push((FindingKind::LogOverrun, format!("{malformed} frames {words}")));
                }
            }
            None if framed => {
                if !std::mem::replace(told_encoding, true) {
                    let why = firmware.log_error().map(|error| format!(" ({error})")).unwrap_or_default();
                    let text = format!(
                        "RTT channel {title} carries defmt frames, but the image has no table to decode them \
                         with{why}, and they are dropped: link it with -Tdefmt.x, with the defmt that this bench \
                         reads, and do not strip it"
                    );
                    troubles.push((FindingKind::LogCorrupt, text));
                }
            }
            _ => {
                let foreign = table.is_some_and(|table| !table.is_empty()) && !decoded;
                if foreign && bytes.contains(&0) && !std::mem::replace(told_encoding, true) {
                    let words = "carries no text, and the image logs with defmt: call the channel \"defmt\" to have it \
                                 decoded";
                    troubles.push((FindingKind::LogCorrupt, format!("RTT channel {title} {words}")));
                }
                text.take(bytes, |bytes| lines.push(text_line(at, label, bytes)));
            }
        }
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
        channel: String::new(),
        text: frame.display_message().to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nrf52840::{Nrf52840, Settings};

    const BLOCK: u64 = 0x2000_0100;
    const BUFFER: u64 = 0x2000_0200;
    const SIZE: u64 = 16;

    fn put(part: &mut Nrf52840, address: u64, value: u64) {
        memory::write(part, address, &u32::try_from(value).unwrap().to_le_bytes());
    }

    /// Returns a part whose RAM has a control block with two up channels. The second channel holds `text`, to be read
    /// from the offset `read` on.
    fn part(text: &[u8], read: u64) -> Nrf52840 {
        let mut part = Nrf52840::new(Settings::default());
        memory::write(&mut part, BLOCK, MAGIC);
        put(&mut part, BLOCK + UP_COUNT, 2);
        let entry = BLOCK + CHANNELS + CHANNEL_BYTES;
        for (offset, value) in [(4, BUFFER), (8, SIZE), (12, (read + text.len() as u64) % SIZE), (16, read)] {
            put(&mut part, entry + offset, value);
        }
        for (index, byte) in (0..).zip(text) {
            memory::write(&mut part, BUFFER + (read + index) % SIZE, &[*byte]);
        }
        part
    }

    #[test]
    fn a_channel_is_read_across_the_end_of_its_buffer() {
        let mut part = part(b"over the end", 9);
        assert_eq!(drain(&mut part, BLOCK, 1).unwrap().bytes, b"over the end");
        assert_eq!(drain(&mut part, BLOCK, 1).unwrap().bytes, b"");
        let entry = BLOCK + CHANNELS + CHANNEL_BYTES;
        assert_eq!(memory::value(&part, entry + 16, 4), Some(5));
    }

    #[test]
    fn a_control_block_is_found_by_its_magic_and_a_plausible_count() {
        assert_eq!(find(&part(b"text", 0)), Some(BLOCK));
        assert_eq!(find(&Nrf52840::new(Settings::default())), None);
        // Copies of the magic must not be taken for the block: one is before the block, and one is not at a multiple of
        // four.
        let mut part = part(b"text", 0);
        for copy in [BLOCK - 0x40, BLOCK - 0x81] {
            memory::write(&mut part, copy, MAGIC);
        }
        put(&mut part, BLOCK - 0x40 + UP_COUNT, 1_000);
        assert_eq!(find(&part), Some(BLOCK));
        put(&mut part, BLOCK + UP_COUNT, 0);
        assert_eq!(find(&part), None);
    }

    #[test]
    fn a_channel_that_is_not_there_is_empty() {
        let mut part = part(b"text", 0);
        assert_eq!(drain(&mut part, BLOCK, 0).unwrap().bytes, b"");
        assert_eq!(drain(&mut part, BLOCK, 2).unwrap().bytes, b"");
    }

    #[test]
    fn before_the_firmware_sets_it_up_there_is_nothing_yet() {
        let mut part = part(b"text", 0);
        memory::write(&mut part, BLOCK, b"_");
        assert_eq!(drain(&mut part, BLOCK, 1), Err(RttFault::NotYet));
    }

    #[test]
    fn offsets_past_the_buffer_are_corrupt() {
        let mut part = part(b"text", 0);
        put(&mut part, BLOCK + CHANNELS + CHANNEL_BYTES + 12, SIZE);
        assert!(matches!(drain(&mut part, BLOCK, 1), Err(RttFault::Corrupt(_))));
    }

    #[test]
    fn a_channel_filled_with_ones_is_treated_as_absent() {
        for offset in [8, 12, 16] {
            let mut part = part(b"text", 0);
            put(&mut part, BLOCK + CHANNELS + CHANNEL_BYTES + offset, u32::MAX.into());
            assert_eq!(drain(&mut part, BLOCK, 1), Ok(Drained::default()), "{offset}");
        }
    }

    #[test]
    fn a_buffer_outside_memory_is_corrupt() {
        let mut part = part(b"text", 0);
        put(&mut part, BLOCK + CHANNELS + CHANNEL_BYTES + 4, 0x3000_0000);
        assert!(matches!(drain(&mut part, BLOCK, 1), Err(RttFault::Corrupt(_))));
    }

    #[test]
    fn text_comes_line_by_line_and_the_last_one_at_the_end() {
        let mut part = part(b"one\r\ntw", 0);
        let mut channels = Channels::default();
        let text = |lines: Vec<LogLine>| lines.into_iter().map(|line| line.text).collect::<Vec<_>>();
        let (lines, troubles) = channels.probe(&mut part, BLOCK, &Firmware::raw("text", Vec::new()), 5);
        assert_eq!((text(lines), troubles), (vec!["one".to_owned()], vec![]));
        assert_eq!(text(channels.finish(6)), ["tw"]);
        assert_eq!(channels.take_raw(1), b"one\r\ntw");
        assert_eq!(channels.take_raw(1), b"");
    }

    #[test]
    fn a_name_that_points_nowhere_or_never_ends_is_cut() {
        let mut part = part(b"", 0);
        let entry = BLOCK + CHANNELS + CHANNEL_BYTES;
        put(&mut part, entry, 0x3000_0000);
        assert_eq!(name(&part, BLOCK, 1), "");
        memory::write(&mut part, BUFFER, &[b'x'; 100]);
        put(&mut part, entry, BUFFER);
        assert_eq!(name(&part, BLOCK, 1), "x".repeat(LONGEST_NAME));
    }

    #[test]
    fn a_line_without_an_end_is_shown_in_pieces() {
        let mut text = Text::default();
        let mut lines = 0;
        for _ in 0..100 {
            text.take(&[b'.'; 100], |line| lines += line.len());
        }
        assert!(lines > 0 && text.pending.len() < LONGEST_LINE + 100);
    }

    #[test]
    fn a_full_buffer_that_the_firmware_does_not_wait_for_overran() {
        let flags = BLOCK + CHANNELS + CHANNEL_BYTES + 20;
        for (mode, overran) in [(0, true), (1, true), (2, false)] {
            let mut part = part(b"fifteen bytes..", 3);
            put(&mut part, flags, mode);
            assert_eq!(drain(&mut part, BLOCK, 1).unwrap().overran, overran, "mode {mode}");
        }
        assert!(!drain(&mut part(b"a few", 3), BLOCK, 1).unwrap().overran);
    }
}
