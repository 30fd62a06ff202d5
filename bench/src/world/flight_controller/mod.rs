//! The aircraft's flight controller at the other end of the SSI.
//!
//! # Design
//!
//! Once in each control cycle (4 ms) the flight controller reads the DPR's image in one SPI transaction, mode 0, 8 MHz.
//! Its own crystal makes this cycle drift through every phase of the DPR's work. [`FlightController::next_at`] gives
//! the instant of its next action on the wires, and [`FlightController::act`] carries that action out through an
//! [`SsiMaster`].
//!
//! The flight controller uses the client that real flight controllers use, [`profile::ssi::client`]. The client
//! determines what each transaction sends, finds the objects in the answer, and decides whether there is a position to
//! fly by ([`Reading::report`]). [`Outcome`] is the bench's own evaluation. The flight controller forwards only whole
//! and new profiles to the base station, unchanged ([`stream`]).
//!
//! While a [`Conduct`] is set, the flight controller misuses the SSI, but still verifies what it reads.
//!
//! | file | what |
//! |---|---|
//! | `config` | the settings of its reads |
//! | [`uplinks`] | its writes, if any |
//! | `hold` | its readings of an active hold, and the commands to it |
//! | `reading` | the evaluation of the bytes that one transaction brought |

mod config;
mod hold;
mod misconduct;
mod reading;
#[cfg(test)]
mod tests;
pub mod uplinks;

use std::collections::VecDeque;

use base_station::carrier::stream;
use profile::Uplink;
use profile::criticality::BaseStation;
use profile::ssi::client::{self, Client, Shown, View};
use profile::ssi::{self, Request};
use profile::uplink::Written;

pub use config::{Config, Placed, Schedule};
pub use hold::{Fates, HoldUser};
pub use reading::{Outcome, Reading};

use misconduct::{Misconduct, Rhythm};

use super::ssi::{Crystal, Order, Progress, SsiMaster, SsiPort, Start, Transaction};
use crate::faults::Conduct;
use crate::faults::wires::Wires;

/// The flight controller's totals since reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stats {
    /// The number of transactions that have ended: the sum of the next four fields.
    pub transactions: u64,
    /// The number of transactions whose outcome was [`Outcome::Fresh`].
    pub fresh: u64,
    /// The number of transactions whose outcome was [`Outcome::Repeated`].
    pub repeated: u64,
    /// The number of transactions whose outcome was [`Outcome::Busy`].
    pub busy: u64,
    /// The number of transactions whose outcome was [`Outcome::BadCrc`].
    pub bad_crc: u64,
    /// The number of profiles forwarded to the base station, one for each fresh transaction.
    pub forwarded: u64,
}

/// A flight controller. The [module](self) describes it.
#[derive(Debug, Clone)]
pub struct FlightController {
    config: Config,
    crystal: Crystal,
    master: SsiMaster,
    next_at: u64,
    cycle: u64,
    /// The transactions that begin at instants that the bench chooses, in order of time.
    placed: VecDeque<Placed>,
    misconduct: Option<Misconduct>,
    episodes: u64,
    /// The earliest instant, ns, at which a further transaction may begin.
    not_before: u64,
    client: Client,
    /// The reader of the hold's object; `None` without a hold.
    hold: Option<HoldUser>,
    /// The windows of the image to request, each in the next transaction that has no other request.
    requests: VecDeque<Request>,
    asked: Option<Request>,
    last: Option<Reading>,
    /// The timestamp of the profile that was forwarded last.
    previous: Option<u32>,
    downlink: Vec<u8>,
    /// The intact images that were read, each with the instant (ns) at which its transaction ended.
    images: Vec<(u64, Vec<u8>)>,
    /// Each intact Port-Status with the base station's uplink, and the instant (ns) at which its transaction ended.
    ports: Vec<(u64, Vec<u8>)>,
    /// The bytes read at the place of the hold's object, each with the instant (ns) at which its transaction ended.
    holds: Vec<(u64, Vec<u8>)>,
    stats: Stats,
}

impl FlightController {
    /// Returns a flight controller at reset.
    ///
    /// # Panics
    ///
    /// Panics if a profile cannot have that number of receivers, if a transaction does not fit into the control cycle,
    /// or if the crystal is wrong by more than 1 %.
    #[must_use]
    pub fn new(config: Config) -> Self {
        assert!(config.crystal_ppb.unsigned_abs() <= 10_000_000, "a crystal is off by {} ppb", config.crystal_ppb);
        let longest = config.transaction_ns(config.image_len()) + config.pace.gap_ns;
        assert!(longest <= config.cycle_ns, "a transaction of {longest} ns does not fit into the control cycle");
        let crystal = Crystal { ppb: config.crystal_ppb };
        let read_bytes = u16::try_from(config.image_len()).expect("an image has at most 396 bytes");
        let client = Client::new(client::Config { read_bytes, ..client::Config::new(config.layout()) });
        let mut controller = Self {
            client: client.expect("a transaction reads the image"),
            hold: config.hold.map(|seed| if config.relays { HoldUser::silent() } else { HoldUser::new(seed) }),
            config,
            crystal,
            master: SsiMaster::new(crystal),
            next_at: 0,
            cycle: 0,
            placed: VecDeque::new(),
            misconduct: None,
            episodes: 0,
            not_before: 0,
            requests: VecDeque::new(),
            asked: None,
            last: None,
            previous: None,
            downlink: Vec::new(),
            images: Vec::new(),
            ports: Vec::new(),
            holds: Vec::new(),
            stats: Stats::default(),
        };
        controller.plan();
        controller
    }

    /// Requests a window of the image, in the next transaction that has no other request. The transaction after that
    /// one reads the window. While the DPR is busy the request is repeated. Without a request a transaction reads the
    /// whole image.
    ///
    /// # Panics
    ///
    /// Panics if the window is empty or longer than the image. A window outside the image is allowed, because the DPR
    /// has to refuse it.
    pub fn request(&mut self, window: Request) {
        assert!(
            (1..=self.config.image_len()).contains(&usize::from(window.length)),
            "a window of {} bytes",
            window.length
        );
        self.requests.push_back(window);
    }

    /// Writes `object` in the next ordinary transaction, and again while the DPR is busy.
    pub fn write(&mut self, object: Written<'_>) {
        self.client.write(object);
    }

    /// Places a transaction at a chosen instant.
    ///
    /// # Panics
    ///
    /// Panics if the schedule is not [`Schedule::Placed`], if the number of bytes is zero or exceeds the image, or if
    /// the transaction before and its gap are not over at that instant.
    pub fn place(&mut self, transaction: Placed) {
        let Placed { at_ns, bytes } = transaction;
        assert_eq!(self.config.schedule, Schedule::Placed, "this flight controller keeps its own cycle");
        assert!((1..=self.config.image_len()).contains(&bytes), "a transaction of {bytes} bytes");
        let ready = match self.placed.back() {
            Some(before) => {
                let took = self.config.transaction_ns(before.bytes) + self.config.pace.gap_ns;
                before.at_ns + self.crystal.by_the_bench(took)
            }
            None if self.misconduct.is_some() => 0,
            None => self.master.free_at(),
        };
        assert!(at_ns >= ready, "a transaction at {at_ns} ns, and after the one before it none before {ready} ns");
        self.placed.push_back(transaction);
        self.plan();
    }

    /// Sets the misuse of the SSI from `at` (ns) on; `None` ends it. A misused transaction is cut short, but an
    /// ordinary one is completed first.
    pub fn set_conduct(&mut self, at: u64, conduct: Option<Conduct>) {
        if self.misconduct.take().is_some() {
            self.master.cut(at);
        }
        self.not_before = at;
        if let Some(conduct) = conduct {
            self.misconduct = Some(Misconduct::new(conduct, self.config, self.config.seed ^ self.episodes));
            self.episodes += 1;
        } else {
            // The transaction that is cut short completes its byte, the hold time and the gap.
            let pace = self.config.pace;
            self.not_before += self.crystal.by_the_bench(pace.byte_ns + pace.hold_ns + pace.gap_ns);
            let from = self.not_before;
            self.placed.retain(|placed| placed.at_ns >= from);
        }
        self.plan();
    }

    /// The instant of the flight controller's next action, ns; `u64::MAX` if there is none.
    #[must_use]
    pub fn next_at(&self) -> u64 {
        self.next_at
    }

    /// Whether the flight controller's next action is a transfer of bytes.
    #[must_use]
    pub fn is_clocking(&self) -> bool {
        self.master.is_clocking()
    }

    /// Carries out the due action on the DPR's pins. `wires` changes the bytes of MISO on the way to the flight
    /// controller. Clocks without chip select are not returned, because they belong to no transaction.
    ///
    /// # Panics
    ///
    /// Panics if there is no action to carry out.
    pub fn act(&mut self, port: &mut impl SsiPort, wires: &mut Wires) -> Option<Progress> {
        if self.master.is_idle() {
            let start = self.start().expect("a transaction is due");
            let order = self.order();
            self.master.begin(start, order);
        }
        let mut told = self.master.act(port);
        if let Some(Progress::Over(transaction)) = &mut told {
            wires.miso(transaction.deselected_ns, usize::from(self.client.window().offset), &mut transaction.miso);
            self.conclude(transaction);
        }
        self.plan();
        told
    }

    /// Returns the evaluation of the last finished transaction.
    #[must_use]
    pub fn last(&self) -> Option<&Reading> {
        self.last.as_ref()
    }

    /// Takes the bytes that the flight controller has sent towards the base station since the last call.
    #[must_use]
    pub fn take_downlink(&mut self) -> Vec<u8> {
        core::mem::take(&mut self.downlink)
    }

    /// Takes the whole images that were read since the last call, each with the instant (ns) at which its transaction
    /// ended. Every object is intact or vacant, and the profile need not be new.
    #[must_use]
    pub fn take_images(&mut self) -> Vec<(u64, Vec<u8>)> {
        core::mem::take(&mut self.images)
    }

    /// Takes each intact Port-Status with the base station's uplink after it (128 bytes) and its transaction's end
    /// (ns).
    #[must_use]
    pub fn take_ports(&mut self) -> Vec<(u64, Vec<u8>)> {
        core::mem::take(&mut self.ports)
    }

    /// Takes the 64 bytes read at the place of the hold's object, each time with the transaction's end (ns).
    #[must_use]
    pub fn take_holds(&mut self) -> Vec<(u64, Vec<u8>)> {
        core::mem::take(&mut self.holds)
    }

    /// The reader of the hold, if there is one.
    #[must_use]
    pub fn hold(&self) -> Option<&HoldUser> {
        self.hold.as_ref()
    }

    /// The flight controller's totals since reset.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.stats
    }

    /// The settings.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    fn plan(&mut self) {
        if self.master.is_idle() {
            let from = self.master.free_at().max(self.not_before);
            while self.in_cycle().and(0, self.crystal) < from {
                self.cycle += 1;
            }
            self.next_at = self.start().map_or(u64::MAX, |start| start.and(0, self.crystal));
        } else {
            self.next_at = self.master.next_at();
        }
    }

    fn in_cycle(&self) -> Start {
        Start { bench_ns: 0, own_ns: self.config.first_ns + self.cycle * self.config.cycle_ns }
    }

    fn start(&self) -> Option<Start> {
        let at = |bench_ns| Start { bench_ns, own_ns: 0 };
        match (self.misconduct.as_ref().map(Misconduct::rhythm), self.config.schedule) {
            (Some(Rhythm::Never), _) => None,
            (Some(Rhythm::AtOnce), _) => Some(at(self.master.free_at().max(self.not_before))),
            (Some(Rhythm::InCycle), _) | (None, Schedule::EveryCycle) => Some(self.in_cycle()),
            (None, Schedule::Placed) => self.placed.front().map(|placed| at(placed.at_ns)),
        }
    }

    fn order(&mut self) -> Order {
        self.asked = None;
        if let Some(misconduct) = &mut self.misconduct {
            return misconduct.order();
        }
        self.asked = self.requests.pop_front();
        let refused = self.asked.filter(|window| self.client.ask(*window).is_err());
        let mut mosi = vec![0; self.client.capacity()];
        let bytes = self.client.begin(&mut mosi).expect("room for any transaction");
        if let Some(window) = refused {
            // The client refuses to request a window outside the map, so that request is encoded here.
            mosi[..ssi::REQUEST_SIZE].copy_from_slice(&ssi::encode(window));
        }
        mosi.truncate(bytes);
        let own_ns = self.config.first_ns + self.cycle * self.config.cycle_ns;
        let made_up = self.config.writes.then(|| uplinks::written(self.cycle, own_ns, self.hold.as_mut())).flatten();
        let of_base_station = |object: &[u8; Uplink::SIZE]| Uplink::verify::<BaseStation>(object).is_ok();
        let is_free = uplinks::is_free(&mosi);
        let made_up = made_up.filter(|object| is_free && !(self.config.relays && of_base_station(object)));
        if let Some(object) = made_up {
            uplinks::put(&object, &mut mosi);
        }
        let bytes = self.placed.pop_front().map_or(bytes, |placed| placed.bytes);
        // The client evaluates the image, and the judge the rest of the map.
        let reads_map = self.config.writes && bytes == self.config.image_len() && uplinks::reads_map(self.cycle);
        let bytes = if reads_map { self.config.layout().map_len() } else { bytes };
        Order { mosi, pace: self.config.pace, ..Order::read(bytes) }
    }

    fn conclude(&mut self, transaction: &Transaction) {
        let own_us = self.crystal.own_ns(transaction.selected_ns) / 1_000;
        let image = transaction.miso.get(..self.config.image_len()).unwrap_or(&transaction.miso);
        let report = self.client.end(image, own_us, None);
        let view = self.client.view(image);
        let layout = self.config.layout();
        let reading = Reading::of(transaction.selected_ns, &view, layout, report, self.previous);
        self.stats.transactions += 1;
        *match reading.outcome {
            Outcome::Fresh => &mut self.stats.fresh,
            Outcome::Repeated => &mut self.stats.repeated,
            Outcome::Busy => &mut self.stats.busy,
            Outcome::BadCrc => &mut self.stats.bad_crc,
        } += 1;
        if let Some(profile) = &reading.forwarded {
            self.previous = reading.timestamp;
            self.stats.forwarded += 1;
            stream::encode(profile, &mut self.downlink);
        }
        if matches!(reading.outcome, Outcome::Fresh | Outcome::Repeated)
            && let Some(whole) = view.find(0..self.config.image_len())
        {
            self.images.push((transaction.deselected_ns, whole.to_vec()));
        }
        let map = Request { offset: 0, length: u16::try_from(layout.map_len()).expect("a map has at most 652 bytes") };
        let whole = View::new(layout, map, &transaction.miso);
        if view.window().offset == 0 && matches!(whole.port_status(), Some(Shown::Intact(_))) {
            let (status, uplink) = (layout.port_status(), layout.uplink::<BaseStation>());
            let read = whole.find(status.start..uplink.end).filter(|_| status.end == uplink.start);
            self.ports.extend(read.map(|port| (transaction.deselected_ns, port.to_vec())));
        }
        if let Some(hold) = self.hold.as_mut().filter(|_| view.window().offset == 0) {
            hold.read(&whole, own_us);
            let read = layout.hold().and_then(|place| whole.find(place)).filter(|_| !whole.is_busy());
            self.holds.extend(read.map(|hold| (transaction.deselected_ns, hold.to_vec())));
        }
        if reading.outcome == Outcome::Busy
            && let Some(unheard) = self.asked.take()
        {
            self.requests.push_front(unheard);
        }
        self.last = Some(reading);
    }
}
