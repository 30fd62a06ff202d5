//! Makes the log of a flawless run, which tests then change.
//!
//! A [`Plan`] describes what the DPR publishes and when the flight controller reads. [`Plan::log`] derives all events
//! from the plan. A test may change the plan, and with it all events that follow, or a single event of the log.
#![allow(dead_code, reason = "not every test uses all of it")]

use bench_judge::disturbance::{Conduct, Harm, Memory};
use bench_judge::{Board, Cause, Disturbance, Event, Header, Log, SsiEvent, Verdict, Violation, What, bounds, judge};
use profile::{
    GpsValues, Layout, LinkStatus, LinkStatusBits, LinkValues, Profile, ReportedStatus, ReportedValues, ResetReason,
    air,
};

pub(crate) const FIRST_TICK: u64 = 20_000_000;
pub(crate) const FIRST_IMAGE: u64 = 6_000_000;
/// The time from the end of a cycle's last frame until FRESH rises, ns.
pub(crate) const TO_FRESH: u64 = 60_000;
/// How long before FRESH rises the processor takes the buffers, ns.
pub(crate) const HELD_BEFORE: u64 = 1_000;
/// How long after FRESH rises the processor gives the buffers back, ns.
pub(crate) const RELEASED_AFTER: u64 = 500;
/// The time from the end of a transaction until the DPR can serve the next one, ns.
pub(crate) const TO_READY: u64 = 3_000;
/// The control cycle, ns. It is slightly shorter than 4 ms, so that transactions begin at every phase of HORUS's cycle.
pub(crate) const CONTROL_CYCLE: u64 = 3_997_000;
/// The number of cycles at the beginning that find the sequence. The DPR does not show them.
pub(crate) const SEARCH: u32 = 3;

#[derive(Clone, Debug)]
pub(crate) struct Publication {
    /// The instant, ns, at which FRESH rises for the image.
    pub(crate) at: u64,
    pub(crate) image: Vec<u8>,
}

/// The description of a run, from which a log is made.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    pub(crate) header: Header,
    pub(crate) layout: Layout,
    /// The events of HORUS and of the air.
    pub(crate) upstream: Vec<Event>,
    pub(crate) publications: Vec<Publication>,
    /// The instants, ns, at which the flight controller selects the DPR.
    pub(crate) selects: Vec<u64>,
    pub(crate) end: u64,
}

/// Returns a profile without a position, as HORUS sends before it has received anything from a receiver.
pub(crate) fn profile(gps: usize, stamp: u32) -> Vec<u8> {
    fn of<const N: usize>(stamp: u32) -> Vec<u8> {
        let absent = GpsValues::absent(stamp);
        let silent = GpsValues { status: absent.status.with_stale(true), ..absent };
        let status = ReportedStatus::new().with_degraded(true);
        let reported = ReportedValues { status, ..ReportedValues::absent(stamp) };
        Profile::<N>::seal(&reported, &[silent; N]).as_bytes().to_vec()
    }
    match gps {
        1 => of::<1>(stamp),
        2 => of::<2>(stamp),
        3 => of::<3>(stamp),
        _ => of::<5>(stamp),
    }
}

/// Returns a frame: LEN, payload and a CRC-16 that the judge does not check.
pub(crate) fn frame(payload: &[u8]) -> Vec<u8> {
    let len = u8::try_from(payload.len() + 1).unwrap();
    [&[len], payload, &[0, 0]].concat()
}

/// Returns the payload of each frame of a profile, with the frame's send slot (µs after the tick).
fn frames(gps: usize, profile: &[u8]) -> Vec<(u64, Vec<u8>)> {
    let slot = |frame| match gps {
        1 => air::send_slot_us::<1>(frame),
        2 => air::send_slot_us::<2>(frame),
        3 => air::send_slot_us::<3>(frame),
        _ => air::send_slot_us::<5>(frame),
    };
    let layout = Layout::for_receivers(gps).unwrap();
    let of = |frame| {
        let place = layout.frame(frame).unwrap();
        let payload = profile[place.offset()..place.offset() + place.length()].to_vec();
        (u64::from(slot(frame).unwrap()), payload)
    };
    (0..layout.frames()).map(of).collect()
}

fn event(at: u64, what: What) -> Event {
    Event { at, what }
}

impl Plan {
    pub(crate) fn new(gps: usize, cycles: u32) -> Self {
        let layout = Layout::for_receivers(gps).unwrap();
        let end = FIRST_TICK + u64::from(cycles) * bounds::CYCLE;
        let mut plan = Self {
            header: Header { version: Header::VERSION, gps, seed: 7, clock: "fast".into(), hold: false },
            layout,
            upstream: vec![],
            publications: vec![],
            selects: (1..).map(|cycle| cycle * CONTROL_CYCLE).take_while(|at| at + 500_000 < end).collect(),
            end,
        };
        plan.upstream
            .extend([event(10_000_000, What::Field { on: true }), event(10_000_000, What::FieldHeard { on: true })]);
        let objects = u32::try_from(layout.objects()).unwrap();
        for at in [FIRST_IMAGE, FIRST_IMAGE + bounds::FRAME_DEADLINE] {
            let image = plan.image(at, None, LinkValues { age_100us: u16::MAX, ..LinkValues::default() });
            plan.publications.push(Publication { at, image });
        }
        for cycle in 0..cycles {
            let tick = FIRST_TICK + u64::from(cycle) * bounds::CYCLE;
            let stamp = 10 * (cycle + 1);
            plan.upstream.push(event(tick, What::Tick));
            let mut ended = 0;
            for (slot, payload) in frames(gps, &profile(gps, stamp)) {
                let command = tick + slot * 1_000;
                let started = command + 500;
                ended = started + air::air_time_ns(u8::try_from(payload.len()).unwrap());
                let bytes = frame(&payload);
                plan.upstream.extend([
                    event(command, What::Command),
                    event(ended, What::Sent { started, bit_rate: 423_750, bytes: bytes.clone().into(), whole: true }),
                    event(ended, What::Heard { started, bytes: bytes.into(), whole: true }),
                ]);
            }
            let at = ended + TO_FRESH;
            let shown = (cycle >= SEARCH).then_some(stamp);
            let accepted = (cycle + 1).saturating_sub(SEARCH) * objects;
            let link = LinkValues {
                objects_accepted: accepted,
                objects_rejected: (cycle + 1) * objects - accepted,
                frames_received: (cycle + 1) * u32::try_from(layout.frames()).unwrap(),
                age_100us: shown.map_or(u16::MAX, |_| u16::try_from((at - tick) / 100_000).unwrap()),
                ..LinkValues::default()
            };
            let image = plan.image(at, shown, link);
            plan.publications.push(Publication { at, image });
        }
        plan
    }

    pub(crate) fn image(&self, at: u64, stamp: Option<u32>, values: LinkValues) -> Vec<u8> {
        let status = LinkStatusBits::new()
            .with_link_up(stamp.is_some())
            .with_all_accepted(stamp.is_some())
            .with_out_of_sequence(stamp.is_none())
            .with_reset_reason(ResetReason::PowerOn);
        let timestamp = u32::try_from(at / 1_000_000).unwrap();
        let link = LinkStatus::seal(&LinkValues { timestamp, status, ..values });
        let objects = match stamp {
            Some(stamp) => profile(self.layout.receivers(), stamp),
            None => vec![0; self.layout.profile_len()],
        };
        [link.as_bytes().as_slice(), &objects].concat()
    }

    pub(crate) fn showing(&self, stamp: u32) -> usize {
        let place = self.layout.in_image(0).unwrap();
        let shows = |image: &[u8]| image[place.clone()].starts_with(&stamp.to_le_bytes());
        self.publications.iter().position(|publication| shows(&publication.image)).unwrap()
    }

    pub(crate) fn transaction_ns(&self) -> u64 {
        3_000 + 1_000 * self.layout.image_len() as u64
    }

    pub(crate) fn log(&self) -> Log {
        let mut events = self.upstream.clone();
        let took = self.transaction_ns();
        let mut ssi = Ssi { held: true, image: None, expires: u64::MAX, rise: None };
        let mut publications = self.publications.iter().peekable();
        let mut forwarded = None;
        for selected in self.selects.iter().copied().chain([u64::MAX]) {
            // The DPR is busy if it is putting an image in when the transaction begins.
            let mut busy = false;
            let before = |publication: &&Publication| publication.at.saturating_sub(HELD_BEFORE) <= selected;
            while let Some(publication) = publications.next_if(before) {
                ssi.expire(publication.at - HELD_BEFORE, &mut events);
                busy |= ssi.put_in(publication, selected, &mut events);
            }
            if selected == u64::MAX {
                break;
            }
            ssi.expire(selected, &mut events);
            let ended = selected + took;
            busy |= ssi.held;
            events.push(event(selected, What::Selected));
            let served = ssi.image.clone().filter(|_| !busy);
            if served.is_none() {
                events.push(event(selected, What::Ssi(SsiEvent::Busy)));
            }
            let miso = served.clone().unwrap_or_else(|| vec![0xFF; self.layout.image_len()]);
            let mosi = vec![0; miso.len()].into();
            events.push(event(ended, What::Transaction { selected, mosi, miso: miso.clone().into() }));
            if served.is_none() {
                if !ssi.held {
                    events.push(event(ended, What::Ssi(SsiEvent::Ready)));
                }
                continue;
            }
            // An image that is published during a transaction is announced at once, but the DPR can put it in only
            // after the transaction.
            let mut ready = ended + TO_READY;
            while let Some(publication) =
                publications.next_if(|publication| publication.at - HELD_BEFORE <= ended + TO_READY)
            {
                ready = ready.max(publication.at + RELEASED_AFTER);
                events.push(event(publication.at, What::Fresh { high: true, offered: None }));
                events.push(event(publication.at + 2_000, What::Fresh { high: false, offered: None }));
                (ssi.image, ssi.expires) = (Some(publication.image.clone()), publication.at + bounds::EXPIRY);
            }
            events.push(event(ended, What::Ssi(SsiEvent::Held)));
            if ssi.expires > ended {
                events.extend([SsiEvent::Released, SsiEvent::Ready].map(|what| event(ready, What::Ssi(what))));
            } else {
                ssi.held = true;
            }
            let place = self.layout.in_image(0).unwrap();
            let profile = miso[place.start..].to_vec();
            let stamp = profile[..4].to_vec();
            if profile.iter().any(|byte| *byte != 0) && forwarded.replace(stamp.clone()) != Some(stamp) {
                let shown = u8::try_from((1 << self.layout.objects()) - 1).unwrap();
                events.push(event(ended, What::Forwarded { profile: profile.clone().into() }));
                events.push(event(ended, What::Arrived { profile: profile.into(), shown }));
            }
        }
        events.push(event(self.end, What::End));
        events.retain(|event| event.at <= self.end);
        events.sort_by_key(|event| (event.at, event.what.rank()));
        Log { header: self.header.clone(), events }
    }
}

struct Ssi {
    held: bool,
    image: Option<Vec<u8>>,
    expires: u64,
    rise: Option<u64>,
}

impl Ssi {
    fn expire(&mut self, now: u64, events: &mut Vec<Event>) {
        if self.expires <= now && !self.held {
            self.held = true;
            events.push(event(self.expires, What::Ssi(SsiEvent::Held)));
        }
    }

    /// Puts an image in between two transactions. Returns whether this makes the next transaction find the DPR busy.
    fn put_in(&mut self, publication: &Publication, selected: u64, events: &mut Vec<Event>) -> bool {
        let Publication { at, image } = publication;
        let released = at + RELEASED_AFTER;
        if !self.held {
            events.push(event(at - HELD_BEFORE, What::Ssi(SsiEvent::Held)));
        }
        events.push(event(*at, What::Fresh { high: true, offered: None }));
        events.push(event(released, What::Ssi(SsiEvent::Released)));
        let busy = selected < released;
        if !busy {
            events.push(event(released, What::Ssi(SsiEvent::Ready)));
        }
        let offered = (selected > at + 2_000).then(|| image.clone().into());
        events.push(event(at + 2_000, What::Fresh { high: false, offered }));
        (self.held, self.image, self.expires, self.rise) = (false, Some(image.clone()), at + bounds::EXPIRY, Some(*at));
        busy
    }
}

/// The violations of the SSI and of the base station. The logs lack events that the other rules need.
const OURS: [Violation; 20] = [
    Violation::Answered,
    Violation::NoTransaction,
    Violation::NeverReady,
    Violation::NotReady,
    Violation::HeldBack,
    Violation::BusyTwice,
    Violation::Silent,
    Violation::Torn,
    Violation::Damaged,
    Violation::Misplaced,
    Violation::FreshUnreadable,
    Violation::FreshNotNew,
    Violation::FreshMissing,
    Violation::LateReadable,
    Violation::LateSample,
    Violation::BaseMissed,
    Violation::BaseChanged,
    Violation::BaseInvalid,
    Violation::BaseMixed,
    Violation::BaseHidden,
];

pub(crate) fn judged(log: &Log) -> Verdict {
    let mut verdict = judge(log);
    verdict.violations.retain(|broken| OURS.contains(&broken.violation));
    verdict
}

pub(crate) fn found(log: &Log) -> Vec<(Violation, u64)> {
    judged(log).violations.iter().map(|broken| (broken.violation, broken.count)).collect()
}

pub(crate) fn insert(log: &mut Log, at: u64, what: What) {
    let rank = what.rank();
    let place = log.events.partition_point(|event| (event.at, event.what.rank()) <= (at, rank));
    log.events.insert(place, event(at, what));
}

pub(crate) fn sort(log: &mut Log) {
    log.events.sort_by_key(|event| (event.at, event.what.rank()));
}

pub(crate) fn transactions(log: &mut Log) -> impl Iterator<Item = (u64, &mut Vec<u8>)> {
    log.events.iter_mut().filter_map(|event| match &mut event.what {
        What::Transaction { selected, miso, .. } => Some((*selected, &mut miso.0)),
        _ => None,
    })
}

pub(crate) fn dpr_reset(asked: bool) -> What {
    What::Reset { board: Board::Dpr, cause: Cause::Pin, asked }
}

/// Returns the indices of those transactions that read the same image as the transaction before. After such a
/// transaction the flight controller forwards nothing.
pub(crate) fn repeats(log: &Log) -> Vec<usize> {
    let mut last: Option<&[u8]> = None;
    let mut places = vec![];
    for (place, event) in log.events.iter().enumerate() {
        let What::Transaction { miso, .. } = &event.what else { continue };
        if last.replace(miso).is_some_and(|last| last == &**miso) && miso[32] != 0 {
            places.push(place);
        }
    }
    places
}

pub(crate) fn miso(log: &mut Log, place: usize) -> &mut Vec<u8> {
    match &mut log.events[place].what {
        What::Transaction { miso, .. } => &mut miso.0,
        other => panic!("no transaction: {other:?}"),
    }
}

/// Makes each transaction that ends within `from..to` (ns) read only 0xFF.
pub(crate) fn blind(log: &mut Log, from: u64, to: u64) {
    log.events.retain(|event| {
        let forwarding = matches!(event.what, What::Forwarded { .. } | What::Arrived { .. });
        !(forwarding && (from..to).contains(&event.at))
    });
    let mut busy = vec![];
    for event in log.events.iter_mut().filter(|event| (from..to).contains(&event.at)) {
        if let What::Transaction { selected, miso, .. } = &mut event.what {
            miso.0.fill(0xFF);
            busy.push(*selected);
        }
    }
    for selected in busy {
        insert(log, selected, What::Ssi(SsiEvent::Busy));
    }
}

/// Returns a flawless log, and the index of a transaction that reads the same image as the one before it.
pub(crate) fn run(gps: usize) -> (Plan, Log, usize) {
    let plan = Plan::new(gps, 40);
    let log = plan.log();
    let place = repeats(&log)[20];
    (plan, log, place)
}

/// Returns the last image that was read before the transaction at index `place` and differs from the image in that
/// transaction.
pub(crate) fn image_before(log: &Log, place: usize) -> Vec<u8> {
    let mut log = log.clone();
    let now = miso(&mut log, place).clone();
    let before = (0..place).rev().find_map(|place| match &log.events[place].what {
        What::Transaction { miso, .. } if **miso != *now => Some(miso.to_vec()),
        _ => None,
    });
    before.unwrap()
}

pub(crate) const DPR_FRONT_END: Disturbance = Disturbance::FrontEnd { board: Board::Dpr, harm: Harm::Silent };
pub(crate) const HORUS_FRONT_END: Disturbance = Disturbance::FrontEnd { board: Board::Horus, harm: Harm::Silent };
pub(crate) const MISUSE: Disturbance = Disturbance::FlightController { conduct: Conduct::Misuse };
pub(crate) const RECEIVE_BIT: Disturbance = Disturbance::Memory { board: Board::Dpr, memory: Memory::Receive };
pub(crate) const IMAGE_BIT: Disturbance = Disturbance::Memory { board: Board::Dpr, memory: Memory::Images };

pub(crate) fn injected(disturbs: Disturbance, until: u64) -> What {
    What::Injected { kind: format!("{disturbs:?}"), disturbs, until }
}
