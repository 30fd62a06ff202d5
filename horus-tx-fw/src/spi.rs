//! A receiver on SPI: one transfer of constant length in each cycle, and the separation of filler bytes from data
//!
//! # Design
//!
//! u-blox's SPI has no registers and no count of bytes. The receiver sends its stream, or 0xFF when it has no data;
//! HORUS likewise sends data or 0xFF as filler. So each cycle clocks [`TRANSFER`] bytes, which always takes the same
//! time: chip select falls, [`SETUP_US`] pass, DMA transfers the bytes, [`HOLD_US`] pass, and chip select rises.
//!
//! *Filler* is removed by [`Filter`] before the bytes go into the ring. The filter follows the messages, since 0xFF is
//! legal inside a message. It does not follow a message that is longer than the parser takes. Otherwise a damaged
//! length would let 64 KiB of filler pass.
//!
//! *A message to the receiver* is at the start of a transfer: after more than CFG-SPI-MAXFF (factory setting: 50)
//! filler bytes in a row the receiver may ignore its input until chip select rises.
//!
//! # Sources
//!
//! - Timing: u-blox, *NEO-M8P data sheet* (UBX-15016656), "SPI timing diagrams". It recommends > 10 µs from chip select
//!   to the first clock, 1 ms between two selections, at most 5.5 MHz, and **at least 8 µs from byte to byte**. The F9
//!   data sheets also name the resulting 125 kB/s as the maximum transfer rate. A DMA transfer has no gaps between
//!   bytes, so the bit rate has to keep the byte period: 562.5 kHz ([`crate::timing::GNSS_SPI_HZ`]), 14.2 µs a byte.
//! - Source of the rules for filler: u-blox, *ZED-F9T and ZED-F9K integration manuals*, "SPI interface", read access.

use crate::{
    receiver::BUFFER,
    source::{Backlog, RING},
};

/// The number of bytes in a transfer, at most 2^16 - 1 and a multiple of 4. 256 bytes take 3.6 ms of a cycle, and are
/// 25.6 kB/s; a receiver with all three messages at 25 Hz sends 4.6 kB/s.
pub const TRANSFER: usize = 256;

/// The time from chip select's fall to the first clock, µs, at least 10.
pub const SETUP_US: u16 = 20;

/// The time from the last byte's arrival to chip select's rise, µs: longer than the remaining half bit of that byte.
pub const HOLD_US: u16 = 20;

/// The byte that HORUS or the receiver sends when it has no data.
pub const FILLER: u8 = 0xFF;

const _: () = assert!(TRANSFER.is_multiple_of(4) && RING >= 2 * TRANSFER);
// Between two selections of a receiver on SPI there must be at least 1 ms.
const _: () = assert!(
    SETUP_US as u64 + HOLD_US as u64 + TRANSFER as u64 * 8 * 1_000_000 / crate::timing::GNSS_SPI_HZ as u64
        <= 1_000 * profile::CYCLE_MS as u64 - 1_000 - 1_000
);
// On SPI a byte must take at least 8 µs, and the clock may have 5.5 MHz at most.
const _: () = assert!(crate::timing::GNSS_SPI_HZ / 8 <= 125_000 && crate::timing::GNSS_SPI_HZ <= 5_500_000);

/// What the code that accesses the SPI registers has to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// There is nothing to do.
    Nothing,
    /// Lower chip select, and call [`Polling::elapsed`] in [`SETUP_US`].
    Select,
    /// Start both DMA streams.
    Transfer,
    /// Call [`Polling::elapsed`] in [`HOLD_US`].
    Hold,
    /// Raise chip select, and take the bytes of the transfer.
    Finish,
    /// Stop both DMA streams, raise chip select, and reset the peripheral. The transfer has brought no bytes.
    Abort,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    Selected,
    Transferring,
    Holding,
}

/// The state of one receiver's transfers.
#[derive(Clone, Debug)]
pub struct Polling {
    state: State,
    backlog: Backlog,
    /// Whether the previous transfer has brought bytes of the receiver.
    brought: bool,
    timed_out: u32,
    recoveries: u32,
}

impl Default for Polling {
    fn default() -> Self {
        Self::new()
    }
}

impl Polling {
    /// Returns the state before the first transfer of a receiver on SPI.
    #[must_use]
    pub const fn new() -> Self {
        Self { state: State::Idle, backlog: Backlog::new(1), brought: false, timed_out: 0, recoveries: 0 }
    }

    /// Returns the number of transfers that had not ended by the next tick (wraps).
    #[must_use]
    pub const fn timed_out(&self) -> u32 {
        self.timed_out
    }

    /// Returns how often the SPI peripheral was set up again after a failed transfer (wraps).
    #[must_use]
    pub const fn recoveries(&self) -> u32 {
        self.recoveries
    }

    /// Whether no transfer is in progress, so that the outgoing bytes may be changed.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.state == State::Idle
    }

    /// Serves the tick: starts a transfer, or aborts one that has not ended by now.
    pub fn poll(&mut self) -> Order {
        self.backlog.tick();
        if self.state == State::Idle {
            self.state = State::Selected;
            Order::Select
        } else {
            self.timed_out = self.timed_out.wrapping_add(1);
            self.abort()
        }
    }

    /// Serves the timer, when the time that the last [`Order`] requested is over.
    pub fn elapsed(&mut self) -> Order {
        match self.state {
            State::Selected => {
                self.state = State::Transferring;
                Order::Transfer
            }
            State::Holding => {
                self.state = State::Idle;
                Order::Finish
            }
            State::Idle | State::Transferring => Order::Nothing,
        }
    }

    /// Serves the end of the transfer: all bytes have come in.
    pub fn transferred(&mut self) -> Order {
        if self.state != State::Transferring {
            return Order::Nothing;
        }
        self.state = State::Holding;
        Order::Hold
    }

    /// Whether the bytes of the transfer that has ended are old, and so are to be dropped ([`Backlog`]).
    #[must_use]
    pub const fn is_old(&self) -> bool {
        self.backlog.is_old()
    }

    /// Takes the result of examining a transfer's bytes. `brought` says that some of them were the receiver's.
    /// `is_empty` says that the transfer ended with filler, so the receiver has no more ([`Filter::has_nothing_more`]).
    /// After a pause, a transfer of filler alone usually does not show that the receiver is empty, because a line that
    /// is stuck high reads the same. It shows it only if the transfer before brought bytes, because a message may end
    /// exactly with its transfer.
    pub fn read(&mut self, brought: bool, is_empty: bool) {
        let brought_before = core::mem::replace(&mut self.brought, brought);
        self.backlog.read(is_empty && (brought || brought_before || !self.backlog.is_old()));
    }

    /// Serves the failure of a DMA stream.
    pub fn failed(&mut self) -> Order {
        if self.state != State::Transferring {
            return Order::Nothing;
        }
        self.abort()
    }

    fn abort(&mut self) -> Order {
        self.recoveries = self.recoveries.wrapping_add(1);
        self.brought = false;
        self.state = State::Idle;
        Order::Abort
    }
}

/// Separates a receiver's bytes from its filler.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Filter(Place);

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Place {
    #[default]
    Outside,
    /// The filter is outside of a message. The value is the number of filler bytes, up to [`Filter::NOTHING_MORE`].
    Filler(u8),
    /// The filter has taken the first of a message's two sync bytes.
    Sync,
    /// The filter has taken this many bytes of class, identifier and length. The second value is the message's length
    /// as far as it is known.
    Header(u8, u16),
    /// The filter is inside a message, of which this number of bytes of payload and checksum are left.
    Body(u16),
}

impl Filter {
    /// Returns a filter that has seen no byte, and so is outside of any message.
    #[must_use]
    pub const fn new() -> Self {
        Self(Place::Outside)
    }

    /// Whether the filter is outside of any message. Only there is a byte of value [`FILLER`] filler.
    #[must_use]
    pub fn is_outside(self) -> bool {
        matches!(self.0, Place::Outside | Place::Filler(_))
    }

    /// The number of filler bytes in a row that mean no more data; a single 0xFF may be noise.
    pub const NOTHING_MORE: u8 = 4;

    /// Whether the last [`Self::NOTHING_MORE`] bytes were filler. A 0xFF inside a message is not filler. Neither is the
    /// last byte of a length that is too great for the message to be followed.
    #[must_use]
    pub fn has_nothing_more(self) -> bool {
        self.0 == Place::Filler(Self::NOTHING_MORE)
    }

    /// Takes [`Self::NOTHING_MORE`] bytes of [`FILLER`] at once if they are filler. Returns whether they are.
    pub fn skips(&mut self) -> bool {
        let skips = self.is_outside();
        if skips {
            self.0 = Place::Filler(Self::NOTHING_MORE);
        }
        skips
    }

    /// Whether `byte` comes from the receiver and is not filler.
    pub fn keeps(&mut self, byte: u8) -> bool {
        /// The longest payload whose message, with header and checksum, fits into the parser's buffer.
        const LONGEST: u16 = BUFFER as u16 - 8;
        match self.0 {
            Place::Outside | Place::Filler(_) | Place::Sync if byte == FILLER => {
                let before = if let Place::Filler(count) = self.0 { count } else { 0 };
                self.0 = Place::Filler((before + 1).min(Self::NOTHING_MORE));
                false
            }
            Place::Sync if byte == 0x62 => {
                self.0 = Place::Header(0, 0);
                true
            }
            Place::Outside | Place::Filler(_) | Place::Sync => {
                self.0 = if byte == 0xB5 { Place::Sync } else { Place::Outside };
                true
            }
            Place::Header(count, length) => {
                let length = match count {
                    2 => u16::from(byte),
                    3 => length | u16::from(byte) << 8,
                    _ => 0,
                };
                self.0 = match count {
                    0..=2 => Place::Header(count + 1, length),
                    _ if length <= LONGEST => Place::Body(length + 2),
                    _ => Place::Outside,
                };
                true
            }
            Place::Body(left) => {
                self.0 = if left > 1 { Place::Body(left - 1) } else { Place::Outside };
                true
            }
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    #[test]
    fn a_cycle_selects_transfers_holds_and_takes() {
        let mut polling = Polling::new();
        for _ in 0..3 {
            assert!(polling.is_idle());
            assert_eq!(polling.poll(), Order::Select);
            assert_eq!(polling.transferred(), Order::Nothing, "of a transfer that has not begun");
            assert_eq!(polling.elapsed(), Order::Transfer);
            assert_eq!(polling.elapsed(), Order::Nothing);
            assert_eq!(polling.transferred(), Order::Hold);
            assert_eq!(polling.transferred(), Order::Nothing);
            assert!(!polling.is_idle(), "chip select is still low");
            assert_eq!(polling.elapsed(), Order::Finish);
        }
        assert_eq!((polling.timed_out(), polling.recoveries()), (0, 0));
    }

    #[test]
    fn the_next_tick_aborts_a_transfer_that_hangs_anywhere() {
        for calls in 0..3 {
            let mut polling = Polling::new();
            polling.poll();
            if calls > 0 {
                polling.elapsed();
            }
            if calls > 1 {
                polling.transferred();
            }
            assert_eq!(polling.poll(), Order::Abort);
            assert_eq!((polling.timed_out(), polling.recoveries()), (1, 1));
            assert_eq!(polling.poll(), Order::Select);
        }
    }

    #[test]
    fn a_stream_that_fails_ends_its_transfer_at_once_and_no_other() {
        let mut polling = Polling::new();
        assert_eq!(polling.failed(), Order::Nothing);
        polling.poll();
        polling.elapsed();
        assert_eq!(polling.failed(), Order::Abort);
        assert_eq!(polling.failed(), Order::Nothing);
        assert_eq!((polling.timed_out(), polling.recoveries()), (0, 1));
    }

    fn message() -> impl Strategy<Value = Vec<u8>> {
        let ubx = (any::<[u8; 2]>(), proptest::collection::vec(prop_oneof![any::<u8>(), Just(0xFF)], 0..=248));
        let ubx = ubx.prop_map(|(kind, payload)| {
            let mut bytes = Vec::from([0xB5, 0x62, kind[0], kind[1]]);
            bytes.extend((payload.len() as u16).to_le_bytes());
            bytes.extend(payload);
            bytes.extend([0xFF, 0xFF]);
            bytes
        });
        let nmea = "[ -~]{0,80}".prop_map(|text| std::format!("${text}\r\n").into_bytes());
        prop_oneof![ubx, nmea]
    }

    #[test]
    fn four_bytes_of_filler_outside_a_message_end_the_stream() {
        let ends = |filter: &mut Filter, count: usize| {
            (0..count).map(|_| (filter.keeps(FILLER), filter.has_nothing_more())).collect::<Vec<_>>()
        };
        let [more, no_more] = [(false, false), (false, true)];
        // A message whose length bytes are 0xFF is too long to be followed, but these length bytes are not filler.
        let mut filter = Filter::new();
        for byte in [0xB5, 0x62, 0x01, 0x07, 0xFF, 0xFF].repeat(50) {
            assert!(filter.keeps(byte) && !filter.has_nothing_more(), "{byte:#04x}");
        }
        assert_eq!(ends(&mut filter, 6), [more, more, more, no_more, no_more, no_more]);
        for byte in [0xB5, 0x62, 0x01, 0x07, 3, 0, FILLER, FILLER, FILLER, FILLER, FILLER] {
            assert!(filter.keeps(byte) && !filter.has_nothing_more());
        }
        assert!(filter.skips() && filter.has_nothing_more(), "four at once");
        assert!(filter.keeps(b'$') && !filter.has_nothing_more());
        assert_eq!(ends(&mut filter, 3), [more; 3]);
        assert!(filter.keeps(0xB5) && !filter.skips() && !filter.has_nothing_more(), "a message may begin");
        assert_eq!(ends(&mut filter, 4), [more, more, more, no_more], "and has not");
    }

    #[test]
    fn a_message_is_followed_up_to_the_longest_that_the_parser_takes() {
        let is_followed = |length: u16| {
            let mut filter = Filter::new();
            let [low, high] = length.to_le_bytes();
            assert!([0xB5, 0x62, 0x01, 0x07, low, high].into_iter().all(|byte| filter.keeps(byte)));
            filter.keeps(FILLER)
        };
        assert!(is_followed(0) && is_followed(248));
        assert!(!is_followed(249) && !is_followed(0x0107) && !is_followed(u16::MAX));
    }

    #[test]
    fn a_byte_of_sync_without_the_other_begins_no_message() {
        let mut filter = Filter::new();
        assert!([0xB5, 0x61, 0x01, 0x07, 20, 0].into_iter().all(|byte| filter.keeps(byte)));
        assert!(!filter.keeps(FILLER));
    }

    #[test]
    fn bytes_that_waited_before_the_first_transfer_are_old() {
        let mut polling = Polling::new();
        for (is_empty, is_old) in [(false, true), (true, false), (false, false), (false, true), (true, false)] {
            polling.read(true, is_empty);
            assert_eq!(polling.is_old(), is_old);
        }
    }

    #[test]
    fn bytes_that_waited_stay_old_while_only_filler_comes() {
        let mut polling = Polling::new();
        // The stuck line works again. Two transfers bring old bytes, and later ones bring silence, a message, and
        // silence.
        for (brought, is_empty, is_old) in [
            (false, true, true),
            (false, true, true),
            (false, true, true),
            (true, false, true),
            (true, true, false),
            (false, true, false),
            (true, true, false),
            (false, true, false),
        ] {
            polling.poll();
            polling.elapsed();
            polling.transferred();
            polling.elapsed();
            polling.read(brought, is_empty);
            assert_eq!(polling.is_old(), is_old, "{brought} {is_empty}");
        }
    }

    #[test]
    fn filler_after_a_message_that_fills_its_transfer_proves_the_receiver_empty() {
        let mut polling = Polling::new();
        polling.read(true, false);
        polling.read(false, true);
        assert!(!polling.is_old());
        let mut polling = Polling::new();
        polling.read(true, false);
        polling.poll();
        polling.poll();
        polling.read(false, true);
        assert!(polling.is_old(), "one that failed lies between");
    }

    proptest! {
        #[test]
        fn filler_between_messages_goes_and_every_byte_of_a_message_stays(
            parts in proptest::collection::vec((message(), 0..300_usize), 1..20),
        ) {
            let mut filter = Filter::new();
            let (mut wanted, mut kept) = (Vec::new(), Vec::new());
            for (message, filler) in parts {
                for byte in message.iter().copied().chain(std::iter::repeat_n(FILLER, filler)) {
                    if filter.keeps(byte) {
                        kept.push(byte);
                    }
                }
                wanted.extend(message);
            }
            prop_assert_eq!(kept, wanted);
        }

        #[test]
        fn after_any_bytes_at_most_a_message_of_filler_passes(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
            let mut filter = Filter::new();
            for byte in bytes {
                filter.keeps(byte);
            }
            let passed = (0..2_000).filter(|_| filter.keeps(FILLER)).count();
            prop_assert!(passed <= BUFFER);
            prop_assert!(filter.is_outside());
        }
    }
}
