//! The aircraft's flight controller at the other end of the SSI.
//!
//! # Design
//!
//! An ordinary flight controller: once per control cycle (4 ms) it reads the DPR image in one SPI transaction, mode 0,
//! 8 MHz, and goes on with whatever it got. Its crystal is its own, so its cycle drifts through that of the DPR and
//! meets it in every phase.
//!
//! It is driven, not driving: [`FlightController::act`] gives the next thing that it does on the wire and when, the
//! bench does it to the SPI peripheral's model, and hands back what MISO showed with [`FlightController::miso`]. Chip
//! select falls first; the first clock follows after the set-up time; the bytes follow each other without a gap; chip
//! select rises after the hold time.
//!
//! What it has read it judges: see [`Outcome`]. A profile that it has not seen before goes to the base station, its
//! bytes untouched ([`framing`]). Nothing else does.
//!
//! # What counts as torn
//!
//! The DPR publishes an image per cycle, whole. So all valid objects in what one transaction read carry the same
//! timestamp; if they do not, the image changed while it was read, or was published half-done. A place that holds only
//! 0x00 or only 0xFF is not torn but vacant: that object was not received in that cycle, and its buffer is as the scrub
//! left it.

use std::collections::VecDeque;
use std::ops::Range;

use profile::image;
use profile::ssi::{self, REQUEST_SIZE, Request, timing};
use profile::{Freshness, Layout, LinkStatus, LinkValues, Object, Rejection, freshness};

use super::framing;

/// How many torn reads are kept to be looked at; all are counted.
const TORN_KEPT: usize = 16;

/// When the flight controller's transactions begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Schedule {
    /// One in each of its own control cycles: [`Config::cycle_ns`].
    EveryCycle,
    /// Each at the instant that it was given with [`FlightController::place`], and no other.
    Placed,
}

/// A transaction that is to begin at an instant of the bench's choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Placed {
    /// When chip select falls, ns after reset, by the bench's clock.
    pub at_ns: u64,
    /// How many bytes are clocked: as many as are wanted, or the whole image.
    pub bytes: usize,
}

/// How the flight controller reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Config {
    /// Receivers in the profile: 1, 2, 3 or 5.
    pub receivers: usize,
    /// When transactions begin.
    pub schedule: Schedule,
    /// Control cycle by its own clock, ns.
    pub cycle_ns: u64,
    /// First transaction after reset, by its own clock, ns.
    pub first_ns: u64,
    /// How much faster its crystal runs than it should, parts per billion.
    pub crystal_ppb: i64,
    /// A byte on the wire by its own clock, ns: 8 bits.
    pub byte_ns: u64,
    /// From chip select falling to the first clock edge, ns; at least [`timing::CSN_SETUP_NS`].
    pub setup_ns: u64,
    /// From the last clock edge to chip select rising, ns; at least [`timing::CSN_HOLD_NS`].
    pub hold_ns: u64,
    /// From chip select rising to the earliest time at which it falls again, ns; at least [`timing::GAP_NS`].
    pub gap_ns: u64,
}

impl Config {
    /// 4 ms control cycle, a perfect crystal, first transaction one cycle after reset. On the wire it is as fast as
    /// [`timing`] allows.
    #[must_use]
    pub const fn new(receivers: usize) -> Self {
        Self {
            receivers,
            schedule: Schedule::EveryCycle,
            cycle_ns: 4_000_000,
            first_ns: 4_000_000,
            crystal_ppb: 0,
            byte_ns: 8 * 1_000_000_000 / timing::MAX_CLOCK_HZ as u64,
            setup_ns: timing::CSN_SETUP_NS as u64,
            hold_ns: timing::CSN_HOLD_NS as u64,
            gap_ns: timing::GAP_NS as u64,
        }
    }

    /// Bytes of the image.
    #[must_use]
    pub const fn image_len(&self) -> usize {
        self.layout().image_len()
    }

    /// The profile's layout.
    ///
    /// # Panics
    ///
    /// If there is no profile for so many receivers: a bench set up so is wrong.
    #[must_use]
    pub const fn layout(&self) -> Layout {
        Layout::for_receivers(self.receivers).expect("a profile has 1, 2, 3 or 5 receivers")
    }

    /// From chip select falling to chip select rising in a transaction of so many bytes, by its own clock, ns.
    #[must_use]
    pub const fn transaction_ns(&self, bytes: usize) -> u64 {
        self.setup_ns + bytes as u64 * self.byte_ns + self.hold_ns
    }
}

/// One thing that the flight controller does on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Chip select falls.
    Select,
    /// Clocks a byte, most significant bit first, with these bits on MOSI. At the instant given, the first clock edge
    /// rises; the byte takes [`Config::byte_ns`]. [`FlightController::miso`] must be told what came back before the
    /// next action.
    Byte(u8),
    /// Chip select rises: the transaction is over.
    Deselect,
}

/// What a transaction amounted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// Everything intact, and the profile is another than the one forwarded last.
    Fresh,
    /// Everything intact, nothing new: the same profile again, none yet, or a window without one.
    Repeated,
    /// 0xFF throughout: the DPR was busy.
    Busy,
    /// Link-Status or an object is neither intact nor vacant. Nothing of it is used.
    BadCrc,
}

/// A transaction that is over.
#[derive(Debug, Clone, PartialEq)]
pub struct Transaction {
    /// Counted from 0.
    pub number: u64,
    /// Chip select fell, ns.
    pub selected_ns: u64,
    /// Chip select rose, ns.
    pub deselected_ns: u64,
    /// What it amounted to.
    pub outcome: Outcome,
    /// Which byte of the image came first.
    pub offset: usize,
    /// What MISO showed.
    pub miso: Vec<u8>,
    /// Link-Status, if it was read and intact.
    pub link: Option<LinkValues>,
    /// Timestamp of the first valid object, ms since HORUS start: that of Reported-Position if it is valid.
    pub timestamp: Option<u32>,
    /// Valid objects of the profile.
    pub valid: usize,
    /// Places of objects that were read and are vacant.
    pub vacant: usize,
    /// The first damaged thing, if any: its offset in the image, and what is wrong with it.
    pub damage: Option<(usize, Rejection)>,
    /// Whether valid objects carried different timestamps.
    pub torn: bool,
}

/// Totals since reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stats {
    /// Transactions that are over: the sum of the next four.
    pub transactions: u64,
    /// [`Outcome::Fresh`].
    pub fresh: u64,
    /// [`Outcome::Repeated`].
    pub repeated: u64,
    /// [`Outcome::Busy`].
    pub busy: u64,
    /// [`Outcome::BadCrc`].
    pub bad_crc: u64,
    /// Transactions whose valid objects carried different timestamps, whatever their outcome.
    pub torn: u64,
    /// Profiles forwarded to the base station: fresh ones that were read whole.
    pub forwarded: u64,
    /// Cycles of HORUS between fresh profiles that were never read.
    pub missed: u64,
    /// Fresh profiles whose timestamp had jumped back.
    pub restarted: u64,
    /// Fresh profiles whose timestamp had advanced by no multiple of the cycle.
    pub irregular: u64,
    /// Vacant places of objects, in transactions that had a valid object.
    pub vacant: u64,
}

/// Where it is in its cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Idle,
    /// So many bytes are done; the MISO of all of them is known.
    Clocking(usize),
    /// MISO of the byte just clocked is not known yet.
    Answering(usize),
}

/// A flight controller. See the [module](self).
#[derive(Debug, Clone)]
pub struct FlightController {
    config: Config,
    stage: Stage,
    number: u64,
    selected_ns: u64,
    /// The transactions that are to begin at instants of the bench's choice, in order of time.
    placed: VecDeque<Placed>,
    /// How many bytes the transaction under way clocks.
    length: usize,
    /// What this transaction reads of the image.
    window: Request,
    mosi: [u8; REQUEST_SIZE],
    miso: Vec<u8>,
    /// What was asked for in this transaction, to be read in the next.
    asked: Option<Request>,
    /// What shall be asked for in the coming transactions.
    requests: VecDeque<Request>,
    last: Option<Transaction>,
    /// Timestamp of the last fresh profile.
    previous: Option<u32>,
    downlink: Vec<u8>,
    stats: Stats,
    torn: Vec<Transaction>,
}

impl FlightController {
    /// A flight controller at reset.
    ///
    /// # Panics
    ///
    /// If there is no profile for so many receivers, or a transaction does not fit into the control cycle, or the
    /// crystal is more than 1 % off: a bench set up so is wrong.
    #[must_use]
    pub fn new(config: Config) -> Self {
        assert!(config.crystal_ppb.unsigned_abs() <= 10_000_000, "a crystal is off by {} ppb", config.crystal_ppb);
        let longest = config.transaction_ns(config.image_len()) + config.gap_ns;
        assert!(longest <= config.cycle_ns, "a transaction of {longest} ns does not fit into the control cycle");
        Self {
            window: whole(&config),
            config,
            stage: Stage::Idle,
            number: 0,
            selected_ns: 0,
            placed: VecDeque::new(),
            length: 0,
            mosi: [0; REQUEST_SIZE],
            miso: Vec::with_capacity(config.image_len()),
            asked: None,
            requests: VecDeque::new(),
            last: None,
            previous: None,
            downlink: Vec::new(),
            stats: Stats::default(),
            torn: Vec::new(),
        }
    }

    /// Asks, in the next transaction that asks for nothing else yet, for a window of the image; the transaction after
    /// that reads just that. One whose request met a busy DPR is repeated. Without a request every transaction reads
    /// the whole image.
    ///
    /// # Panics
    ///
    /// If the window is empty or longer than the image. One that lies outside of the image is sent as it is: the DPR
    /// has to refuse it.
    pub fn request(&mut self, window: Request) {
        assert!(
            (1..=self.config.image_len()).contains(&usize::from(window.length)),
            "a window of {} bytes",
            window.length
        );
        self.requests.push_back(window);
    }

    /// Has a transaction begin at an instant of the bench's choice, [`Schedule::Placed`] alone.
    ///
    /// # Panics
    ///
    /// If the schedule is another one, if so many bytes are none or more than the image has, or if the transaction
    /// before it is not over by then, and the gap after it.
    pub fn place(&mut self, transaction: Placed) {
        let Placed { at_ns, bytes } = transaction;
        assert_eq!(self.config.schedule, Schedule::Placed, "this flight controller keeps its own cycle");
        assert!((1..=self.config.image_len()).contains(&bytes), "a transaction of {bytes} bytes");
        let under_way = (self.stage != Stage::Idle).then_some((self.selected_ns, self.length));
        let before = self.placed.back().map(|before| (before.at_ns, before.bytes)).or(under_way);
        if let Some((from, bytes)) = before {
            let ready = from + self.by_the_bench(self.config.transaction_ns(bytes) + self.config.gap_ns);
            assert!(at_ns >= ready, "a transaction at {at_ns} ns, and after the one before it none before {ready} ns");
        }
        self.placed.push_back(transaction);
    }

    /// When the next action is due, ns after reset. `u64::MAX` if no transaction is placed.
    #[must_use]
    pub fn next_at(&self) -> u64 {
        let Config { byte_ns, setup_ns, hold_ns, .. } = self.config;
        self.instant(match self.stage {
            Stage::Idle => 0,
            Stage::Clocking(done) if done < self.length => setup_ns + done as u64 * byte_ns,
            Stage::Clocking(done) => setup_ns + done as u64 * byte_ns + hold_ns,
            Stage::Answering(number) => setup_ns + number as u64 * byte_ns,
        })
    }

    /// How many bytes of the transaction under way are still to be clocked.
    #[must_use]
    pub fn bytes_left(&self) -> usize {
        match self.stage {
            Stage::Idle => 0,
            Stage::Clocking(done) | Stage::Answering(done) => self.length - done,
        }
    }

    /// When the last clock edge of the byte that is `bytes` further on will be, ns after reset.
    #[must_use]
    pub fn clocked_at(&self, bytes: usize) -> u64 {
        let Config { byte_ns, setup_ns, .. } = self.config;
        let (Stage::Clocking(done) | Stage::Answering(done)) = self.stage else { return self.next_at() };
        self.instant(setup_ns + (done + bytes) as u64 * byte_ns)
    }

    /// What MOSI will carry in the next `bytes` bytes.
    #[must_use]
    pub fn upcoming(&self, bytes: usize) -> Vec<u8> {
        let (Stage::Clocking(done) | Stage::Answering(done)) = self.stage else { return vec![] };
        (done..done + bytes).map(|byte| self.mosi.get(byte).copied().unwrap_or(0)).collect()
    }

    /// Does the next thing: when, and what. There is always one.
    ///
    /// # Panics
    ///
    /// If [`Self::miso`] was not told what the last byte brought.
    pub fn act(&mut self) -> (u64, Action) {
        let at = self.next_at();
        let action = match self.stage {
            Stage::Idle => {
                self.select(at);
                Action::Select
            }
            Stage::Clocking(done) if done < self.length => {
                self.stage = Stage::Answering(done);
                Action::Byte(self.mosi.get(done).copied().unwrap_or(0))
            }
            Stage::Clocking(_) => {
                self.conclude(at);
                Action::Deselect
            }
            Stage::Answering(number) => panic!("byte {number} of transaction {} has no answer", self.number),
        };
        (at, action)
    }

    /// What MISO showed during the byte that was clocked last.
    ///
    /// # Panics
    ///
    /// If no byte was.
    pub fn miso(&mut self, byte: u8) {
        let Stage::Answering(number) = self.stage else {
            panic!("an answer, but no byte was clocked");
        };
        self.miso.push(byte);
        self.stage = Stage::Clocking(number + 1);
    }

    /// The transaction that was over last.
    #[must_use]
    pub fn last(&self) -> Option<&Transaction> {
        self.last.as_ref()
    }

    /// What it has sent to the base station since this was last called.
    #[must_use]
    pub fn take_downlink(&mut self) -> Vec<u8> {
        core::mem::take(&mut self.downlink)
    }

    /// Totals.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.stats
    }

    /// The first torn reads; [`Stats::torn`] counts all.
    #[must_use]
    pub fn torn(&self) -> &[Transaction] {
        &self.torn
    }

    /// How it reads.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The instant by the bench's clock, `own_ns` by its own clock after the beginning of the transaction that is under
    /// way or comes next.
    fn instant(&self, own_ns: u64) -> u64 {
        match (self.config.schedule, self.stage) {
            (Schedule::EveryCycle, _) => {
                self.by_the_bench(self.config.first_ns + self.number * self.config.cycle_ns + own_ns)
            }
            (Schedule::Placed, Stage::Idle) => self.placed.front().map_or(u64::MAX, |placed| placed.at_ns),
            (Schedule::Placed, _) => self.selected_ns + self.by_the_bench(own_ns),
        }
    }

    /// From its own clock to the bench's: a fast crystal gets there early.
    fn by_the_bench(&self, own_ns: u64) -> u64 {
        const BILLION: u64 = 1_000_000_000;
        let rate = BILLION.checked_add_signed(self.config.crystal_ppb).expect("a crystal that swings");
        // own_ns * BILLION / rate to the nearest, whole turns of `rate` apart so that it fits 64 bits.
        own_ns / rate * BILLION + (own_ns % rate * BILLION + rate / 2) / rate
    }

    fn select(&mut self, at: u64) {
        self.selected_ns = at;
        self.miso.clear();
        self.window = self.asked.take().unwrap_or(whole(&self.config));
        // What it reads, but no fewer bytes than a request takes.
        self.length = match self.placed.pop_front() {
            Some(placed) => placed.bytes,
            None => usize::from(self.window.length).max(REQUEST_SIZE),
        };
        self.asked = self.requests.pop_front();
        self.mosi = self.asked.map_or([0; REQUEST_SIZE], ssi::encode);
        self.stage = Stage::Clocking(0);
    }

    fn conclude(&mut self, at: u64) {
        let transaction = self.judge(at);
        self.stats.transactions += 1;
        *match transaction.outcome {
            Outcome::Fresh => &mut self.stats.fresh,
            Outcome::Repeated => &mut self.stats.repeated,
            Outcome::Busy => &mut self.stats.busy,
            Outcome::BadCrc => &mut self.stats.bad_crc,
        } += 1;
        if transaction.valid > 0 {
            self.stats.vacant += transaction.vacant as u64;
        }
        if transaction.torn {
            self.stats.torn += 1;
            if self.torn.len() < TORN_KEPT {
                self.torn.push(transaction.clone());
            }
        }
        if let (Outcome::Fresh, Some(timestamp)) = (transaction.outcome, transaction.timestamp) {
            match freshness(self.previous, timestamp) {
                Freshness::Fresh { missed } => self.stats.missed += u64::from(missed),
                Freshness::Restarted => self.stats.restarted += 1,
                Freshness::Irregular => self.stats.irregular += 1,
                Freshness::First | Freshness::Frozen => {}
            }
            self.previous = Some(timestamp);
            self.stats.forwarded += 1;
            let profile = &transaction.miso[image::REPORTED_POSITION..self.config.image_len()];
            framing::encode(profile, &mut self.downlink);
        }
        if transaction.outcome == Outcome::Busy
            && let Some(unheard) = self.asked.take()
        {
            self.requests.push_front(unheard);
        }
        self.last = Some(transaction);
        self.number += 1;
        self.stage = Stage::Idle;
    }

    /// Makes out what was read.
    fn judge(&self, at: u64) -> Transaction {
        let mut transaction = Transaction {
            number: self.number,
            selected_ns: self.selected_ns,
            deselected_ns: at,
            outcome: Outcome::Repeated,
            offset: usize::from(self.window.offset),
            miso: self.miso.clone(),
            link: None,
            timestamp: None,
            valid: 0,
            vacant: 0,
            damage: None,
            torn: false,
        };
        if self.miso.iter().all(|byte| *byte == 0xff) {
            transaction.outcome = Outcome::Busy;
            return transaction;
        }
        if let Some(bytes) = self.read(image::LINK_STATUS..image::LINK_STATUS + LinkStatus::SIZE) {
            match LinkStatus::verify(bytes) {
                Ok(link) => transaction.link = Some(link.values()),
                Err(why) => transaction.damage = Some((image::LINK_STATUS, why)),
            }
        }
        let layout = self.config.layout();
        for (index, place) in (0..layout.objects()).filter_map(|index| Some((index, layout.in_image(index)?))) {
            let offset = place.start;
            let Some(bytes) = self.read(place) else {
                continue;
            };
            match Object::verify(index, bytes) {
                Ok(object) => {
                    transaction.valid += 1;
                    let first = *transaction.timestamp.get_or_insert(object.timestamp());
                    transaction.torn |= first != object.timestamp();
                }
                Err(_) if is_vacant(bytes) => transaction.vacant += 1,
                Err(why) => {
                    transaction.damage.get_or_insert((offset, why));
                }
            }
        }
        transaction.outcome = if transaction.damage.is_some() {
            Outcome::BadCrc
        } else if self.window == whole(&self.config)
            && self.miso.len() >= self.config.image_len()
            && transaction.timestamp.is_some_and(|now| self.previous != Some(now))
        {
            Outcome::Fresh
        } else {
            Outcome::Repeated
        };
        transaction
    }

    /// These bytes of the image, if the transaction read all of them.
    fn read(&self, place: Range<usize>) -> Option<&[u8]> {
        let window = self.miso.get(..usize::from(self.window.length)).unwrap_or(&self.miso);
        let start = place.start.checked_sub(usize::from(self.window.offset))?;
        window.get(start..start + place.len())
    }
}

/// The window that a transaction reads unless another was asked for.
fn whole(config: &Config) -> Request {
    let length = u16::try_from(config.image_len()).expect("an image has at most 396 bytes");
    Request { offset: 0, length }
}

/// Whether the place of an object is as a scrub leaves it.
pub(super) fn is_vacant(bytes: &[u8]) -> bool {
    bytes.iter().all(|byte| *byte == 0) || bytes.iter().all(|byte| *byte == 0xff)
}

#[cfg(test)]
mod tests {
    use profile::image::Image;
    use profile::{GpsObject, GpsStatus, GpsValues, Identifier, LinkStatusBits, Profile, ReportedValues};

    use super::super::BaseStation;
    use super::*;

    fn profile(timestamp: u32) -> Profile<3> {
        let position = GpsValues {
            status: GpsStatus::new().with_position_valid(true),
            latitude: 47.4979,
            longitude: 8.7289,
            altitude: 470.0,
            ..GpsValues::absent(timestamp)
        };
        Profile::seal(
            &ReportedValues { latitude: 47.4979, longitude: 8.7289, ..ReportedValues::absent(timestamp) },
            &[position; 3],
        )
    }

    fn link() -> LinkStatus {
        LinkStatus::seal(&LinkValues {
            timestamp: 77,
            status: LinkStatusBits::new().with_link_up(true),
            objects_accepted: 4,
            objects_rejected: 0,
            frames_received: 1,
            frames_missed: 0,
            age_100us: 60,
            access_violations: 0,
        })
    }

    fn image_of(profile: &Profile<3>) -> Vec<u8> {
        [link().as_bytes().as_slice(), profile.as_bytes()].concat()
    }

    /// Runs one transaction against a DPR that shows `shown`, and zeros after it. Gives what was on MOSI.
    fn transact(controller: &mut FlightController, shown: &[u8]) -> Vec<u8> {
        let mut mosi = Vec::new();
        assert_eq!(controller.act().1, Action::Select);
        loop {
            match controller.act().1 {
                Action::Byte(byte) => {
                    controller.miso(shown.get(mosi.len()).copied().unwrap_or(0));
                    mosi.push(byte);
                }
                Action::Deselect => return mosi,
                Action::Select => panic!("selected twice"),
            }
        }
    }

    fn outcome(controller: &FlightController) -> Outcome {
        controller.last().expect("a transaction is over").outcome
    }

    #[test]
    fn a_transaction_keeps_the_timing_that_its_configuration_states() {
        let config = Config { first_ns: 1_000_000, ..Config::new(3) };
        let mut controller = FlightController::new(config);
        let image = image_of(&profile(10));
        for cycle in 0..3 {
            let start = 1_000_000 + cycle * 4_000_000;
            assert_eq!(controller.act(), (start, Action::Select));
            for (number, byte) in (0..).zip(&image) {
                assert_eq!(controller.next_at(), start + 1_000 + number * 1_000);
                assert_eq!(controller.act(), (start + 1_000 + number * 1_000, Action::Byte(0)));
                controller.miso(*byte);
            }
            assert_eq!(controller.act(), (start + 1_000 + 276_000 + 2_000, Action::Deselect));
        }
        assert_eq!(Image::<3>::LEN, config.image_len());
    }

    #[test]
    fn a_fast_crystal_gets_there_early_and_a_slow_one_late() {
        let at_cycle_1000 = |crystal_ppb| {
            let mut controller = FlightController::new(Config { first_ns: 0, crystal_ppb, ..Config::new(1) });
            for _ in 0..1_000 {
                transact(&mut controller, &[]);
            }
            controller.next_at()
        };
        assert_eq!(at_cycle_1000(0), 4_000_000_000);
        // 50 ppm of 4 s are 200 µs, less a second-order 10 ns.
        assert_eq!(at_cycle_1000(50_000), 4_000_000_000 - 199_990);
        assert_eq!(at_cycle_1000(-50_000), 4_000_000_000 + 200_010);
    }

    #[test]
    fn a_profile_is_fresh_once_then_repeated_and_forwarded_once_as_it_is() {
        let mut controller = FlightController::new(Config::new(3));
        let mut line = Vec::new();
        for timestamp in [10, 10, 10, 20, 20, 50] {
            transact(&mut controller, &image_of(&profile(timestamp)));
            line.extend(controller.take_downlink());
        }
        let stats = controller.stats();
        assert_eq!((stats.transactions, stats.fresh, stats.repeated, stats.busy, stats.bad_crc), (6, 3, 3, 0, 0));
        assert_eq!((stats.forwarded, stats.missed, stats.torn, stats.vacant), (3, 2, 0, 0));
        assert_eq!(controller.last().and_then(|last| last.link), Some(link().values()));

        let mut deframer = framing::Deframer::new(Profile::<3>::SIZE);
        let frames: Vec<_> = line.iter().filter_map(|byte| deframer.push(*byte)).collect();
        let sent: Vec<_> = [10, 20, 50].iter().map(|t| Ok(profile(*t).as_bytes().to_vec())).collect();
        assert_eq!(frames, sent);
    }

    #[test]
    fn a_busy_dpr_is_told_from_a_damaged_image() {
        let mut controller = FlightController::new(Config::new(3));
        transact(&mut controller, &[0xff; 276]);
        assert_eq!(outcome(&controller), Outcome::Busy);
        // A bus that reads zero has no Link-Status.
        transact(&mut controller, &[]);
        assert_eq!(outcome(&controller), Outcome::BadCrc);
        let image = image_of(&profile(10));
        for bit in 0..image.len() * 8 {
            let mut damaged = image.clone();
            damaged[bit / 8] ^= 0x80 >> (bit % 8);
            transact(&mut controller, &damaged);
            assert_eq!(outcome(&controller), Outcome::BadCrc, "bit {bit}");
        }
        assert!(controller.take_downlink().is_empty(), "nothing damaged is forwarded");
        // The same profile, read well at last, is still new.
        transact(&mut controller, &image);
        assert_eq!(outcome(&controller), Outcome::Fresh);
        let stats = controller.stats();
        assert_eq!((stats.busy, stats.bad_crc, stats.fresh), (1, 1 + 276 * 8, 1));
    }

    #[test]
    fn damage_is_reported_where_it_is() {
        let mut controller = FlightController::new(Config::new(3));
        let mut image = image_of(&profile(10));
        image[96 + 60 + 30] ^= 1;
        transact(&mut controller, &image);
        let last = controller.last().expect("a transaction is over");
        assert_eq!(last.damage, Some((156, Rejection::Crc)));
        assert_eq!((last.valid, last.timestamp), (3, Some(10)));
    }

    #[test]
    fn an_image_without_a_profile_is_nothing_new_and_a_vacant_place_is_no_damage() {
        let mut controller = FlightController::new(Config::new(3));
        let empty = image_of(&Profile::<3>::EMPTY);
        transact(&mut controller, &empty);
        assert_eq!(outcome(&controller), Outcome::Repeated);
        for fill in [0x00, 0xff] {
            let timestamp = 10 + u32::from(fill == 0xff) * 10;
            let mut image = image_of(&profile(timestamp));
            image[216..276].fill(fill);
            transact(&mut controller, &image);
            let last = controller.last().expect("a transaction is over");
            assert_eq!((last.outcome, last.valid, last.vacant), (Outcome::Fresh, 3, 1));
        }
        assert_eq!(controller.stats().vacant, 2);
    }

    #[test]
    fn an_image_of_two_cycles_is_torn() {
        let mut controller = FlightController::new(Config::new(3));
        let (before, after) = (image_of(&profile(10)), image_of(&profile(20)));
        for cut in [96, 156, 216] {
            let torn = [&after[..cut], &before[cut..]].concat();
            transact(&mut controller, &torn);
            assert!(controller.last().is_some_and(|last| last.torn), "{cut}");
        }
        transact(&mut controller, &after);
        assert_eq!(controller.stats().torn, 3);
        assert_eq!(controller.torn().len(), 3);
    }

    #[test]
    fn a_valid_object_in_anothers_place_is_damage() {
        let mut controller = FlightController::new(Config::new(3));
        let mut image = image_of(&profile(10));
        image.copy_within(96..156, 156);
        transact(&mut controller, &image);
        let last = controller.last().expect("a transaction is over");
        assert_eq!((last.outcome, last.damage), (Outcome::BadCrc, Some((156, Rejection::Identifier))));
    }

    #[test]
    fn restarts_and_timestamps_off_the_grid_are_counted_and_forwarded() {
        let mut controller = FlightController::new(Config::new(3));
        for timestamp in [1_000, 0, 10, 15, u32::MAX - 5] {
            transact(&mut controller, &image_of(&profile(timestamp)));
        }
        let stats = controller.stats();
        assert_eq!((stats.fresh, stats.restarted, stats.irregular, stats.forwarded), (5, 2, 1, 5));
    }

    #[test]
    fn a_request_goes_out_in_one_transaction_and_the_next_reads_its_window() {
        let mut controller = FlightController::new(Config::new(3));
        let window = Request { offset: 32, length: 64 };
        controller.request(window);
        let image = image_of(&profile(10));
        let mosi = transact(&mut controller, &image);
        assert_eq!(mosi.len(), 276);
        let request = mosi.first_chunk().expect("eight bytes");
        assert_eq!(ssi::parse(request, 276), Ok(ssi::Parsed::Window(window)));
        assert!(mosi[8..].iter().all(|byte| *byte == 0));

        let mosi = transact(&mut controller, &image[32..]);
        assert_eq!(mosi, [0; 64], "it asks for nothing");
        let last = controller.last().expect("a transaction is over");
        assert_eq!((last.offset, last.valid, last.timestamp), (32, 1, Some(10)));
        assert_eq!((last.outcome, last.link), (Outcome::Repeated, None));
        assert_eq!(transact(&mut controller, &image).len(), 276, "and is back at the whole image");
    }

    #[test]
    fn a_short_window_leaves_room_for_the_next_request() {
        let mut controller = FlightController::new(Config::new(3));
        controller.request(Request { offset: 32, length: 4 });
        controller.request(Request { offset: 36, length: 2 });
        let image = image_of(&profile(10));
        transact(&mut controller, &image);
        let mosi = transact(&mut controller, &image[32..36]);
        let request = mosi.first_chunk().expect("eight bytes");
        assert_eq!(ssi::parse(request, 276), Ok(ssi::Parsed::Window(Request { offset: 36, length: 2 })));
        assert_eq!(outcome(&controller), Outcome::Repeated);
    }

    #[test]
    fn a_request_that_met_a_busy_dpr_is_made_again() {
        let mut controller = FlightController::new(Config::new(3));
        controller.request(Request { offset: 96, length: 60 });
        let asking = transact(&mut controller, &[0xff; 276]);
        let again = transact(&mut controller, &image_of(&profile(10)));
        assert_eq!(asking, again);
        assert_eq!(transact(&mut controller, profile(10).gps()[0].as_bytes()).len(), 60);
        assert_eq!(controller.last().map(|last| last.valid), Some(1));
    }

    #[test]
    #[should_panic(expected = "has no answer")]
    fn a_byte_that_is_not_answered_is_a_fault_of_the_bench() {
        let mut controller = FlightController::new(Config::new(1));
        let _ = controller.act();
        let _ = controller.act();
        let _ = controller.act();
    }

    #[test]
    fn every_size_of_profile_reaches_the_base_station() {
        for receivers in [1, 2, 3, 5] {
            let mut controller = FlightController::new(Config::new(receivers));
            let mut base = BaseStation::new(receivers);
            for timestamp in [10, 20] {
                let reported = profile(timestamp);
                let mut image = [link().as_bytes().as_slice(), reported.reported().as_bytes()].concat();
                for identifier in &Identifier::GPS[..receivers] {
                    image.extend(GpsObject::seal(*identifier, &GpsValues::absent(timestamp)).as_bytes());
                }
                transact(&mut controller, &image);
                base.receive(0, &controller.take_downlink());
            }
            let counts = base.counts();
            assert_eq!((counts.profiles, counts.fresh, counts.bad_crc, counts.vacant), (2, 2, 0, 0), "{receivers}");
        }
    }
}
