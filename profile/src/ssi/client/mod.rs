//! The flight controller's end of the SSI: determines what is sent to the DPR, and evaluates the answer.
//!
//! [`Client`] is a state machine without a bus or a clock, and allocates nothing: [`Client::begin`] returns the bytes
//! to send in the next transaction, [`Client::end`] takes the answer and returns a [`Report`]. It checks every byte
//! that was read and computes every CRC, whatever the bytes are. `blocking` (feature `embedded-hal`) and `asynch`
//! (feature `embedded-hal-async`) run it on an SPI device. `profile/c/horus_dpr.h` is the same client in C11; both give
//! the same report for the same bytes.
//!
//! **One transaction in each control cycle** reads Link-Status and Reported-Position, 96 bytes. [`Client::ask`]
//! requests other objects (a receiver's, Port-Status) in one transaction. The next transaction reads those objects, and
//! [`Client::view`] returns them.
//!
//! **Age.** Link-Status has the age of the sample at the instant at which the image was published. To that age the
//! client adds the time since the last edge of FRESH, if that line is wired, or the time since the last reading that
//! showed another image, whichever is less. It adds at most [`EXPIRY_US`], after which the DPR stops showing an image.
//! So [`Report::age_us`] is never less than the true age. Without FRESH it exceeds the true age by up to one control
//! cycle.
//!
//! **Sequence.** A CRC does not prove that data are new. The client follows HORUS's timestamps on the flight
//! controller's own clock, whatever the DPR reports. Each new sample must be a whole number of cycles after the one
//! before, with at most [`MAX_MISSED`] missing. It must come at the time of its timestamp, within [`TOLERANCE_US`] and
//! [2 %](TOLERANCE_SHARE) of the step. That time is counted from the earliest instant that the samples before it allow,
//! so a delay that grows slowly is detected like a sudden one. At the start, and after any other step, no sample is
//! shown until [`SEARCH_CYCLES`] samples in a row are in sequence.
//!
//! **Output.** [`Report::position`] is the last sample, if it is in sequence, marked valid by HORUS, plausible
//! ([`range`](crate::range)), and not older than [`Config::age_limit_us`]. [`Report::status`] is HORUS's status in that
//! sample, whether its position is valid or not: a HORUS that has fired the emergency measure may have no position. A
//! transaction without data (busy, damaged, empty) keeps both, and they become older. A sample that must not be shown
//! removes both at once. Single values that are not valid are NaN, and their status bit is clear.
//!
//! **Hold.** A reader of a DPR with an active [hold](crate::hold) uses a layout [with a hold](Layout::with_hold), reads
//! or requests the map's end, and passes each [`View`] to a [`HoldTrack`]. A [`Sender`](crate::hold::Sender) puts
//! commands to the hold into the uplinks.
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
//! // The flight controller's SPI driver sends `buffer` and replaces it by the answer: here the DPR is busy.
//! buffer.fill(0xFF);
//! let report = client.end(&buffer, 4_000, None);
//! assert_eq!(report.verdict, Verdict::Busy);
//! assert!(report.must_fall_back());
//! ```

#[cfg(feature = "embedded-hal-async")]
pub mod asynch;
#[cfg(feature = "embedded-hal")]
pub mod blocking;
mod hold;
mod report;
mod track;
mod view;

use core::mem;

pub use hold::{HOLD_FRAME_US, HoldReport, HoldShown, HoldTrack};
pub use report::{AGE_UNKNOWN, Failed, Report, Verdict};
pub use track::{EXPIRY_US, TOLERANCE_US};
pub use view::{Shown, View};

#[doc(no_inline)]
pub use crate::sequence::{MAX_MISSED, SEARCH_CYCLES, TOLERANCE_SHARE};
use crate::ssi::{REQUEST_SIZE, Request, encode};
use crate::uplink::Written;
use crate::{Layout, MAX_RECEIVERS, Rejection, Uplink, image, map::Map};
use track::Track;

/// The number of bytes that hold Link-Status and Reported-Position.
pub const PREFIX_BYTES: u16 = 96;

const _: () = assert!(image::GPS == 96);

/// The size of the longest map, that of five receivers with a hold, bytes.
pub const MAX_MAP: usize = Map::<MAX_RECEIVERS>::LEN_WITH_HOLD;

/// The longest MOSI data that the DPR evaluates, bytes: a request with an object after it.
pub const MAX_WRITE: usize = REQUEST_SIZE + Uplink::SIZE;

/// The settings of the client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// The DPR's layout.
    pub layout: Layout,
    /// The number of bytes that a transaction reads from the start of the map, unless another window was requested: at
    /// least [`PREFIX_BYTES`], at most the whole map.
    pub read_bytes: u16,
    /// The age above which a position is not shown, µs.
    pub age_limit_us: u32,
    /// The time without intact data after which the DPR counts as [silent](Verdict::Silent), µs.
    pub silence_us: u32,
}

impl Config {
    /// The default of [`Config::age_limit_us`]: ten cycles of HORUS.
    pub const AGE_LIMIT_US: u32 = 100_000;

    /// The default of [`Config::silence_us`]: the 25 ms after which the DPR stops showing an image, and a control cycle
    /// of 5 ms.
    pub const SILENCE_US: u32 = 30_000;

    /// The default settings: 96 bytes in each transaction, and a position that is at most 100 ms old.
    #[must_use]
    pub const fn new(layout: Layout) -> Self {
        Self { layout, read_bytes: PREFIX_BYTES, age_limit_us: Self::AGE_LIMIT_US, silence_us: Self::SILENCE_US }
    }
}

/// The flight controller's client of the DPR. See the [module](self).
#[derive(Clone, Debug)]
pub struct Client {
    config: Config,
    /// The window of the transaction in progress, or of the next one; `None` stands for the default window.
    window: Option<Request>,
    shown: Request,
    asked: Option<Request>,
    /// The object to write, kept until the DPR is known to have received it.
    object: Option<[u8; Uplink::SIZE]>,
    object_under_way: bool,
    /// The request of the present transaction, kept until the DPR is known to have received it.
    sent: Option<Request>,
    track: Track,
}

impl Client {
    /// A client before its first transaction.
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

    /// The configuration of the client.
    #[must_use]
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// Requests a window in the next transaction; the transaction after that reads the window. A later call before
    /// [`Client::begin`] replaces the request. A request that met a busy DPR is repeated.
    ///
    /// # Errors
    ///
    /// [`Rejection::Window`] if the window is empty or not in the map; no request is made then.
    pub const fn ask(&mut self, window: Request) -> Result<(), Rejection> {
        if !window.is_inside(self.config.layout.map_len()) {
            return Err(Rejection::Window);
        }
        self.asked = Some(window);
        Ok(())
    }

    /// Writes an object in the next transaction. A later call before [`Client::begin`] replaces the object. An object
    /// that met a busy DPR is written again, one that the DPR received is not; Port-Status has the outcome.
    ///
    /// ```
    /// use profile::criticality::{FlightController, Writer};
    /// use profile::{Command, CommandObject, Uplink, UplinkValues, uplink::Written};
    /// # use profile::{Layout, ssi::client::{Client, Config}};
    /// # let mut client = Client::new(Config::new(Layout::for_receivers(3).unwrap())).unwrap();
    ///
    /// // The flight controller's own uplink. Its timestamp must be later than that of the one before.
    /// let values = UplinkValues { timestamp: 1_200, payload: [7; 52], ..UplinkValues::default() };
    /// client.write(Written::FlightController(&Uplink::seal(Writer::<FlightController>::claim(), &values)));
    ///
    /// // The base station's object from the radio is passed on unchanged, if it is intact.
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

    /// Fills the beginning of `mosi` for the next transaction and returns the number of bytes to clock, at most
    /// [`Client::capacity`].
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `mosi` is shorter than the transaction; nothing is changed then.
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

    /// Ends the transaction. `miso` is the answer, empty if the bus failed. `began_us` is the instant at which chip
    /// select fell, `fresh_us` that of the last edge of FRESH before it, if that line is wired; both are µs on the
    /// flight controller's monotonic clock.
    pub fn end(&mut self, miso: &[u8], began_us: u64, fresh_us: Option<u64>) -> Report {
        self.shown = self.window();
        let view = self.view(miso);
        let (busy, prefix) = (view.is_busy(), view.prefix());
        if !busy {
            self.window = mem::take(&mut self.sent);
            self.object = self.object.filter(|_| !self.object_under_way);
            self.object_under_way = false;
        }
        let another = self.shown.offset != 0 || self.shown.length < PREFIX_BYTES;
        let brought = track::Brought { busy, another, intact: another && view.is_any_intact(), prefix };
        self.track.report(&self.config, brought, began_us, fresh_us)
    }

    /// The window of the transaction in progress, or of the next one. A requested window counts once its request has
    /// reached the DPR.
    #[must_use]
    pub fn window(&self) -> Request {
        self.window.unwrap_or(self.default_window())
    }

    /// The objects in `miso`, the answer of the last transaction.
    #[must_use]
    pub fn view<'a>(&self, miso: &'a [u8]) -> View<'a> {
        View::new(self.config.layout, self.shown, miso)
    }

    /// The size of the longest transaction that this configuration allows, bytes.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.config.layout.map_len()
    }

    const fn default_window(&self) -> Request {
        Request { offset: 0, length: self.config.read_bytes }
    }
}
