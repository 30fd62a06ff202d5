//! The flight controller's end of the SSI: what to send to the DPR, and what to make of what comes back.
//!
//! # Design
//!
//! [`Client`] is a state machine without input or output of its own: [`Client::begin`] says what to send in the next
//! transaction, [`Client::end`] takes what came back and gives a [`Report`]. It knows no bus and no clock and allocates
//! nothing. Every byte that was read is looked at and every CRC computed, whatever they are; what follows is a handful
//! of comparisons. `blocking` (feature `embedded-hal`) and `asynch` (feature `embedded-hal-async`) put it on an SPI
//! device. `profile/c/horus_dpr.h` is the same client in C11; both give the same report for the same bytes.
//!
//! **One transaction in each control cycle** reads Link-Status and Reported-Position, 96 bytes. What else is wanted (a
//! receiver's object, Port-Status) is asked for with [`Client::ask`] in one transaction, shown in the next, and found
//! with [`Client::view`].
//!
//! **Age.** Link-Status says how old the sample was when its image was published. To this comes the time since the
//! publication, of which the client knows two upper bounds and takes the smaller: the time since the last edge of
//! FRESH, if that line is wired, and the time since the reading before, which still showed another image. It is never
//! more than [`EXPIRY_US`], after which the DPR stops to show an image. So [`Report::age_us`] is never less than the
//! true age, without FRESH by up to one control cycle more.
//!
//! **Sequence.** A reader cannot know from a CRC that data are new. The client follows HORUS's timestamps on the flight
//! controller's own clock, whatever the DPR says: each new sample must be a whole number of cycles after the one
//! before, at most [`MAX_MISSED`] of them missing, and come when the timestamp says, within [`TOLERANCE_US`] and
//! [2 %](TOLERANCE_SHARE) of the step. It is compared with the earliest instant that the samples before it allow, so a
//! delay that grows step by step is found as well as one that comes at once. After any other step nothing is shown
//! until [`SEARCH_CYCLES`] samples in a row are in sequence; so it is at the start.
//!
//! **What is shown.** [`Report::position`] is the last sample if it is in sequence, if HORUS says that its position is
//! valid, if it can be one at all ([`range`](crate::range)), and while its age is not above
//! [`Config::age_limit_us`]. [`Report::status`] is what HORUS says of itself in that sample, whether its position is
//! valid or not: a HORUS that has fired the emergency measure may well have no position any more. A transaction that
//! brings nothing (busy, damaged, empty) lets both age; a sample that must not be shown takes them away at once. Values
//! that are not valid by themselves are NaN, and their status bit is clear.
//!
//! # Example
//!
//! ```
//! use profile::{Layout, ssi::client::{Client, Config, Verdict}};
//!
//! let mut client = Client::new(Config::new(Layout::for_receivers(3).unwrap())).unwrap();
//! let mut buffer = [0; 96];
//! let bytes = client.begin(&mut buffer).unwrap();
//! assert_eq!(bytes, 96);
//! // The flight controller's SPI driver sends `buffer` and leaves there what came back: here, that the DPR is busy.
//! buffer.fill(0xFF);
//! let report = client.end(&buffer, 4_000, None);
//! assert_eq!(report.verdict, Verdict::Busy);
//! assert!(report.must_fall_back());
//! ```

#[cfg(feature = "embedded-hal-async")]
pub mod asynch;
#[cfg(feature = "embedded-hal")]
pub mod blocking;
mod report;
mod track;
mod view;

use core::mem;

pub use report::{AGE_UNKNOWN, Failed, Report, Verdict};
pub use track::{EXPIRY_US, TOLERANCE_US};
pub use view::{Shown, View};

#[doc(no_inline)]
pub use crate::sequence::{MAX_MISSED, SEARCH_CYCLES, TOLERANCE_SHARE};
use crate::ssi::{REQUEST_SIZE, Request, encode};
use crate::uplink::Written;
use crate::{Layout, MAX_RECEIVERS, Rejection, Uplink, image, map::Map};
use track::Track;

/// Bytes that hold Link-Status and Reported-Position.
pub const PREFIX_BYTES: u16 = 96;

const _: () = assert!(image::GPS == 96);

/// Bytes of the longest map, that of five receivers.
pub const MAX_MAP: usize = Map::<MAX_RECEIVERS>::LEN;

/// The longest MOSI that says something: a request, and an object after it.
pub const MAX_WRITE: usize = REQUEST_SIZE + Uplink::SIZE;

/// How the client reads, and what it accepts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// The DPR's layout.
    pub layout: Layout,
    /// Bytes that a transaction reads from the start of the map unless another window was asked for: at least
    /// [`PREFIX_BYTES`], at most the map.
    pub read_bytes: u16,
    /// A position older than this is not shown, µs.
    pub age_limit_us: u32,
    /// When nothing intact has been read for longer than this, the DPR is [silent](Verdict::Silent), µs.
    pub silence_us: u32,
}

impl Config {
    /// [`Config::age_limit_us`] unless it is set: ten cycles of HORUS.
    pub const AGE_LIMIT_US: u32 = 100_000;

    /// [`Config::silence_us`] unless it is set: the DPR stops to show an image after 25 ms, and a cycle of 5 ms more.
    pub const SILENCE_US: u32 = 30_000;

    /// 96 bytes in each transaction, a position of at most 100 ms.
    #[must_use]
    pub const fn new(layout: Layout) -> Self {
        Self { layout, read_bytes: PREFIX_BYTES, age_limit_us: Self::AGE_LIMIT_US, silence_us: Self::SILENCE_US }
    }
}

/// The flight controller's client. See the [module](self).
#[derive(Clone, Debug)]
pub struct Client {
    config: Config,
    /// What the next transaction shows, or the one under way: a window that the DPR has heard of, or the default.
    window: Option<Request>,
    /// What the transaction that ended last showed.
    shown: Request,
    /// To be asked for in the next transaction.
    asked: Option<Request>,
    /// To be written in the next transaction, until it is known that the DPR has heard it.
    object: Option<[u8; Uplink::SIZE]>,
    /// Whether the transaction under way writes it.
    object_under_way: bool,
    /// What the transaction under way asks for, until it is known that the DPR has heard it.
    sent: Option<Request>,
    track: Track,
}

impl Client {
    /// A client that has read nothing yet.
    ///
    /// # Errors
    ///
    /// [`Rejection::Window`] if [`Config::read_bytes`] are fewer than [`PREFIX_BYTES`] or more than the map has.
    pub const fn new(config: Config) -> Result<Self, Rejection> {
        let shown = Request { offset: 0, length: config.read_bytes };
        if config.read_bytes < PREFIX_BYTES || !shown.is_inside(config.layout.map_len()) {
            return Err(Rejection::Window);
        }
        Ok(Self {
            config,
            window: None,
            shown,
            asked: None,
            object: None,
            object_under_way: false,
            sent: None,
            track: Track::new(),
        })
    }

    /// Its configuration.
    #[must_use]
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// The window of the next transaction is to be asked for in it, and is shown by the one after it. A later call
    /// before [`Client::begin`] replaces it. A request that met a busy DPR is repeated.
    ///
    /// # Errors
    ///
    /// [`Rejection::Window`] if it is empty or does not lie in the map; nothing is asked for.
    pub const fn ask(&mut self, window: Request) -> Result<(), Rejection> {
        if !window.is_inside(self.config.layout.map_len()) {
            return Err(Rejection::Window);
        }
        self.asked = Some(window);
        Ok(())
    }

    /// Writes an object in the next transaction. A later call before [`Client::begin`] replaces it. An object that met
    /// a busy DPR is written again in the next transaction; one that was heard is not, and Port-Status says what became
    /// of it.
    ///
    /// ```
    /// use profile::criticality::{FlightController, Writer};
    /// use profile::{Command, CommandObject, Uplink, UplinkValues, uplink::Written};
    /// # use profile::{Layout, ssi::client::{Client, Config}};
    /// # let mut client = Client::new(Config::new(Layout::for_receivers(3).unwrap())).unwrap();
    ///
    /// // What the flight controller itself has to say. Its timestamp must be later than that of the one before.
    /// let values = UplinkValues { timestamp: 1_200, payload: [7; 52], ..UplinkValues::default() };
    /// client.write(Written::FlightController(&Uplink::seal(Writer::<FlightController>::claim(), &values)));
    ///
    /// // What the base station has sent by radio: passed on as it is, if it is intact.
    /// # let received = *CommandObject::seal(Writer::<FlightController>::claim(), 1_210, Command::SelfTest).as_bytes();
    /// if let Ok(written) = Written::verify(&received) {
    ///     client.write(written);
    /// }
    /// ```
    pub const fn write(&mut self, object: Written<'_>) {
        self.object = Some(match object {
            Written::BaseStation(uplink) | Written::FlightController(uplink) => *uplink.as_bytes(),
            Written::Command(_, command) => *command.as_bytes(),
        });
        self.object_under_way = false;
    }

    /// What the next transaction is: fills the first bytes of `mosi` and says how many they are, all of which are to be
    /// clocked. At most [`Client::capacity`].
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `mosi` is shorter than that; nothing was changed.
    pub fn begin(&mut self, mosi: &mut [u8]) -> Result<usize, Rejection> {
        let asked = self.asked.or(self.sent);
        let object = self.object;
        let window = self.window();
        let written = if object.is_some() { MAX_WRITE } else { REQUEST_SIZE };
        let bytes = usize::from(window.length).max(written);
        let mosi = mosi.get_mut(..bytes).ok_or(Rejection::Length)?;
        mosi.fill(0);
        let (request, rest) = mosi.split_at_mut(REQUEST_SIZE);
        if let Some(asked) = asked {
            request.copy_from_slice(&encode(asked));
        }
        if let (Some(object), Some(place)) = (object, rest.first_chunk_mut()) {
            *place = object;
        }
        self.asked = None;
        self.sent = asked;
        self.object_under_way = object.is_some();
        Ok(bytes)
    }

    /// The transaction is over. `miso` is what came back, as many bytes as were clocked; none if the bus failed.
    /// `began_us` is when chip select fell, `fresh_us` when the last edge of FRESH before that came, if the line is
    /// wired: both µs on the flight controller's monotonic clock.
    pub fn end(&mut self, miso: &[u8], began_us: u64, fresh_us: Option<u64>) -> Report {
        self.shown = self.window();
        let view = self.view(miso);
        let (busy, prefix) = (view.is_busy(), view.prefix());
        if !busy {
            // It was heard. A busy DPR has not heard it, and goes on to show what it was asked for before.
            self.window = mem::take(&mut self.sent);
            self.object = self.object.filter(|_| !self.object_under_way);
            self.object_under_way = false;
        }
        let another = self.shown.offset != 0 || self.shown.length < PREFIX_BYTES;
        let brought = track::Brought { busy, another, intact: another && view.is_any_intact(), prefix };
        self.track.report(&self.config, brought, began_us, fresh_us)
    }

    /// What the next transaction shows, or the one under way, if the DPR has heard what it was asked for.
    #[must_use]
    pub fn window(&self) -> Request {
        self.window.unwrap_or(self.default_window())
    }

    /// The objects in `miso`, which the transaction that ended last brought.
    #[must_use]
    pub fn view<'a>(&self, miso: &'a [u8]) -> View<'a> {
        View::new(self.config.layout, self.shown, miso)
    }

    /// Bytes that the longest transaction of this configuration takes.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.config.layout.map_len()
    }

    const fn default_window(&self) -> Request {
        Request { offset: 0, length: self.config.read_bytes }
    }
}
