//! Compares the verdict of the flight controller's client with the signals on the wires.
//!
//! | the client | violation |
//! |---|---|
//! | uses a position that HORUS did not send as valid, or one older than [`bounds::CLIENT_AGE_LIMIT`] | `ClientWrong` |
//! | states another age than that of the sample that it read last | `ClientAge` |
//! | has no position although it has read [`bounds::CLIENT_FINDS`] valid ones in sequence | `ClientHides` |
//!
//! A sample's age follows from the instant at which its frame reached the DPR's antenna, and from the frame's slot; a
//! delay on the air does not count. If the sample arrived several times, its age may count from any arrival.
//!
//! The client learns the age only from Link-Status and from the time since FRESH rose. It may therefore use an age that
//! Link-Status stated too low; rule `link_status` judges Link-Status.
//!
//! While data are out of sequence or disturbed, the client need not have a position. While [`Excuse::Service`] holds,
//! it need not state an age. Using a forbidden position is always a violation.

use std::collections::VecDeque;

use profile::{CYCLE_MS, Layout};

use super::Rule;
use crate::disturbance::Excuse;
use crate::expectation::age_at_end;
use crate::read::{Reading, State, Values};
use crate::{Context, Event, Findings, Header, Violation, What, bounds};

const AGE_UNIT: u64 = 100_000;

/// How long samples are kept, ns. A client that uses a sample older than this is reported.
const KEPT: u64 = 2_000_000_000;

#[derive(Clone, Copy, Debug)]
struct Sample {
    timestamp: u32,
    valid: bool,
    /// The instant, ns, at which the sample was taken.
    at: u64,
}

#[derive(Clone, Copy, Debug)]
struct Read {
    selected: u64,
    /// The timestamp of the Reported-Position, ms, and whether its position is valid.
    sample: Option<(u32, bool)>,
    /// The age that Link-Status stated, ns.
    told: u64,
}

/// A sample, and the transaction in which the client first read it.
#[derive(Clone, Copy, Debug)]
struct First {
    timestamp: u32,
    /// The beginning, ns, of the transaction that first read the sample.
    selected: u64,
    /// The earliest instant, ns, at which FRESH can have announced the sample to the client.
    announced: u64,
    /// The age, ns, that Link-Status stated when the sample was first read.
    told: u64,
}

impl First {
    /// Returns the least and the greatest age, ns, that the sample can have at the instant `at`, ns, by Link-Status and
    /// FRESH.
    const fn ages(&self, at: u64) -> (u64, u64) {
        let sealed = AGE_UNIT + bounds::SEALED_BEFORE_FRESH;
        (self.told + (at - self.selected), self.told + sealed + (at - self.announced))
    }
}

#[derive(Clone, Copy, Debug)]
struct Row {
    /// The timestamp of the last sample, ms.
    timestamp: u32,
    selected: u64,
    count: u32,
}

/// The rule that judges the verdict of the flight controller's client; see the [module](self).
#[derive(Clone, Debug)]
pub struct Client {
    layout: Layout,
    samples: VecDeque<Sample>,
    fresh: u64,
    read: Option<Read>,
    /// The consecutive cycles whose samples were read as valid, up to the last one.
    row: Option<Row>,
    newest: Option<First>,
    /// The timestamp, ms, of the sample whose wrong age was reported.
    told: Option<u32>,
    hides: bool,
}

impl Rule for Client {
    fn new(header: &Header) -> Self {
        Self {
            layout: Layout::for_receivers(header.gps).expect("a profile has 1, 2, 3 or 5 receivers"),
            samples: VecDeque::new(),
            fresh: 0,
            read: None,
            row: None,
            newest: None,
            told: None,
            hides: false,
        }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        match &event.what {
            What::Heard { .. } => {
                let object = context.frame().and_then(|frame| frame.objects.first());
                if let Some(State::Valid { timestamp, values: Values::Reported(values) }) = object.map(|it| &it.state) {
                    let (timestamp, valid) = (*timestamp, values.status.position_valid());
                    self.samples.push_back(Sample {
                        timestamp,
                        valid,
                        at: event.at.saturating_sub(age_at_end(self.layout, 0)),
                    });
                    while self.samples.pop_front_if(|sample| sample.at + KEPT < event.at).is_some() {}
                }
            }
            What::Fresh { high: true, .. } => self.fresh = event.at,
            What::Transaction { .. } => {
                self.read = context.reading().map(|reading| {
                    let told = match &reading.link {
                        Some(Ok(link)) => u64::from(link.age_100us) * AGE_UNIT,
                        _ => 0,
                    };
                    Read { selected: reading.selected, sample: sample(reading), told }
                });
                self.follow();
            }
            What::Decided { position, age_us } => self.decided(*position, *age_us, context, findings),
            _ => {}
        }
    }
}

impl Client {
    fn follow(&mut self) {
        let Some(Read { selected, sample: Some((timestamp, valid)), .. }) = self.read else { return };
        let row = self.row.filter(|row| selected <= row.selected + bounds::EXPIRY);
        self.row = match row {
            _ if !valid => None,
            Some(row) if row.timestamp == timestamp => Some(row),
            Some(row) if timestamp == row.timestamp.wrapping_add(CYCLE_MS) => {
                Some(Row { timestamp, selected, count: row.count + 1 })
            }
            _ => Some(Row { timestamp, selected, count: 1 }),
        };
    }

    fn decided(&mut self, position: Option<u32>, age_us: Option<u32>, context: &Context, findings: &mut Findings) {
        let Some(Read { selected, sample, told: by_link }) = self.read else { return };
        let of = |timestamp: u32| {
            self.samples.iter().filter(move |sample| sample.timestamp == timestamp && sample.at <= selected)
        };
        let ages = |timestamp| {
            let ages = of(timestamp).map(|sample| selected - sample.at);
            ages.clone().min().zip(ages.max())
        };
        // The client cannot recognise data that have expired or are older than data read before. Another rule reports
        // such data.
        let before = self.newest;
        if let Some((timestamp, _)) = sample
            && before.is_none_or(|before| before.timestamp != timestamp)
        {
            let announced = Some(self.fresh).filter(|fresh| *fresh <= selected).unwrap_or(0);
            let announced = announced.max(selected.saturating_sub(bounds::EXPIRY));
            self.newest = Some(First { timestamp, selected, announced, told: by_link });
        }
        let by_link =
            |timestamp: u32| self.newest.filter(|first| first.timestamp == timestamp).map(|first| first.ages(selected));
        if let Some(timestamp) = position {
            let wrong = match ages(timestamp) {
                None => Some("it was not sent".to_owned()),
                Some(_) if of(timestamp).all(|sample| !sample.valid) => Some("it is not valid".to_owned()),
                Some((youngest, _)) => {
                    let least = by_link(timestamp).map_or(youngest, |(_, most)| youngest.min(most));
                    let too_old = least > bounds::CLIENT_AGE_LIMIT + bounds::CLIENT_AGE_SHORT;
                    too_old.then(|| format!("it is {youngest} ns old"))
                }
            };
            if let Some(wrong) = wrong {
                findings.add(Violation::ClientWrong, selected, || format!("the position of {timestamp} ms: {wrong}"));
            }
        }
        if context.disturbances().excuse(Excuse::Service, selected) {
            (self.row, self.hides) = (None, false);
            return;
        }
        let back = |stamp: u32| before.is_some_and(|it| it.timestamp.wrapping_sub(stamp).cast_signed() > 0);
        if let (Some((timestamp, _)), Some(age_us)) = (sample, age_us)
            && self.told != Some(timestamp)
            && !back(timestamp)
            && let Some((youngest, oldest)) = ages(timestamp)
        {
            let told = u64::from(age_us) * 1_000;
            let (least, most) = by_link(timestamp).unwrap_or((youngest, oldest));
            if told + bounds::CLIENT_AGE_SHORT < youngest.min(most)
                || told > oldest.max(least) + bounds::CLIENT_AGE_LONG
            {
                self.told = Some(timestamp);
                findings.add(Violation::ClientAge, selected, || format!("{told} ns instead of {youngest} ns"));
            }
        }
        let found = sample.is_some() && self.row.is_some_and(|row| row.count >= bounds::CLIENT_FINDS);
        let hides = found && position.is_none();
        if hides && !std::mem::replace(&mut self.hides, hides) {
            findings.add(Violation::ClientHides, selected, || "what it reads is valid and in sequence".into());
        }
        self.hides = hides;
    }
}

/// Returns the timestamp of an intact Reported-Position beside an intact Link-Status, and whether its position is
/// valid. A position does not count as valid if its sample may become too old to fly by before its image expires.
fn sample(reading: &Reading) -> Option<(u32, bool)> {
    let placed = reading.objects.first().filter(|placed| placed.index == 0)?;
    match &placed.state {
        State::Valid { timestamp, values: Values::Reported(values) } => {
            let Some(Ok(link)) = &reading.link else { return None };
            let young = u64::from(link.age_100us) * AGE_UNIT + bounds::CLIENT_AGE_LONG <= bounds::CLIENT_AGE_LIMIT;
            Some((*timestamp, values.status.position_valid() && young))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use profile::{LinkStatus, LinkValues, ReportedPosition, ReportedValues};

    use super::*;
    use crate::testing::{Events, MISUSE, MS, found, header, injected, silent_reported};

    const fn sampled(n: u64) -> u64 {
        100 * MS + n * bounds::CYCLE
    }

    fn stamp(n: u64) -> u32 {
        n as u32 * CYCLE_MS
    }

    fn values(n: u64, valid: bool) -> ReportedValues {
        let silent = silent_reported(stamp(n));
        ReportedValues { status: silent.status.with_position_valid(valid), ..silent }
    }

    fn heard(log: &mut Events, n: u64, valid: bool) {
        let layout = crate::testing::layout(1);
        let gps = vec![crate::testing::silent_gps(stamp(n))];
        let payload = crate::testing::objects(&values(n, valid), &gps).concat();
        let bytes = [vec![payload.len() as u8 + 1], payload, vec![0, 0]].concat();
        let ended = sampled(n) + age_at_end(layout, 0);
        log.add(ended, What::Heard { started: ended - MS, bytes: bytes.into(), whole: true });
    }

    /// Logs a transaction that began at `selected` and read cycle `n`, and the client's verdict.
    fn read(log: &mut Events, selected: u64, n: u64, valid: bool, position: Option<u64>, age: Option<u64>) {
        read_as(log, selected, (selected - sampled(n)) / AGE_UNIT, n, valid, position, age);
    }

    /// Logs a transaction like [`read`], with the age `told` (in units of Link-Status) in Link-Status.
    fn read_as(
        log: &mut Events,
        selected: u64,
        told: u64,
        n: u64,
        valid: bool,
        position: Option<u64>,
        age: Option<u64>,
    ) {
        let link = *LinkStatus::seal(&LinkValues { age_100us: told as u16, ..LinkValues::default() }).as_bytes();
        let miso = [&link[..], ReportedPosition::seal(&values(n, valid)).as_bytes()].concat();
        let at = selected + MS / 10;
        log.add(at, What::Transaction { selected, mosi: vec![0; 8].into(), miso: miso.into() });
        let age_us = age.map(|age| (age / 1_000) as u32);
        log.add(at, What::Decided { position: position.map(stamp), age_us });
    }

    fn broken(log: &Events) -> Vec<(Violation, u64, u64)> {
        found(Client::new(&header(1)), &log.log()).0
    }

    fn once(after: u64, valid: bool, position: Option<u64>, age: Option<u64>, more: &[(u64, What)]) -> Vec<Violation> {
        let mut log = Events::new(1);
        heard(&mut log, 1, valid);
        more.iter().for_each(|(at, what)| _ = log.add(*at, what.clone()));
        read(&mut log, sampled(1) + after, 1, valid, position, age);
        broken(&log).into_iter().map(|(violation, ..)| violation).collect()
    }

    #[test]
    fn the_client_may_only_use_a_recent_position_sent_as_valid() {
        let limit = bounds::CLIENT_AGE_LIMIT + bounds::CLIENT_AGE_SHORT;
        let flown = |after, valid, position| once(after, valid, Some(position), Some(after), &[]);
        assert_eq!(flown(limit, true, 1), []);
        assert_eq!(flown(limit + 1, true, 1), [Violation::ClientWrong]);
        assert_eq!(flown(20 * MS, false, 1), [Violation::ClientWrong], "not valid");
        assert_eq!(flown(20 * MS, true, 2), [Violation::ClientWrong], "not sent");
        let misuse = [(MS, injected(MISUSE, u64::MAX))];
        let late = once(limit + 1, true, Some(1), Some(limit), &misuse);
        assert_eq!(late, [Violation::ClientWrong], "whatever the flight controller does");
    }

    #[test]
    fn the_age_that_a_client_tells_is_that_of_the_sample() {
        let told = |age| once(20 * MS, true, Some(1), Some(age), &[]);
        let wrong = [Violation::ClientAge];
        let short = 20 * MS - bounds::CLIENT_AGE_SHORT;
        assert_eq!(told(short), []);
        assert_eq!(told(short - 1_000), wrong);
        let long = 20 * MS + bounds::CLIENT_AGE_LONG;
        assert_eq!(told(long), []);
        assert_eq!(told(long + 1_000), wrong);
        assert_eq!(once(20 * MS, true, Some(1), None, &[]), [], "it says that it does not know");
        let misuse = [(MS, injected(MISUSE, u64::MAX))];
        assert_eq!(once(20 * MS, true, Some(1), Some(0), &misuse), []);
        // One frame arrives twice, 5 ms apart, and the DPR may have shown the sample of either arrival.
        let mut log = Events::new(1);
        heard(&mut log, 1, true);
        let mut again = Events::new(1);
        heard(&mut again, 1, true);
        let Event { at, what } = again.events.remove(0);
        log.add(at + 5 * MS, what);
        read(&mut log, sampled(1) + 20 * MS, 1, true, Some(1), Some(15 * MS));
        assert_eq!(broken(&log), []);
    }

    #[test]
    fn a_sample_older_than_the_last_read_needs_no_age() {
        let then = |first: u64, next: u64| {
            let mut log = Events::new(1);
            (1..=2).for_each(|n| heard(&mut log, n, true));
            let at = sampled(2) + 20 * MS;
            read(&mut log, at, first, true, Some(first), Some(at - sampled(first)));
            read(&mut log, at + 4 * MS, next, true, Some(next), Some(0));
            broken(&log).len()
        };
        assert_eq!((then(1, 2), then(2, 2), then(2, 1)), (1, 1, 0));
    }

    #[test]
    fn an_age_counts_on_from_the_samples_first_link_status() {
        let told = |first: u64, age: u64| {
            let mut log = Events::new(1);
            heard(&mut log, 1, true);
            read_as(&mut log, sampled(1) + 20 * MS, first / AGE_UNIT, 1, true, Some(1), Some(first));
            read(&mut log, sampled(1) + 24 * MS, 1, true, Some(1), Some(age));
            let last = log.events.iter_mut().rfind(|event| matches!(event.what, What::Transaction { .. }));
            let What::Transaction { miso, .. } = &mut last.unwrap().what else { unreachable!("it is one") };
            let link = LinkStatus::seal(&LinkValues { age_100us: 4_000, ..LinkValues::default() });
            miso.0[..LinkStatus::SIZE].copy_from_slice(link.as_bytes());
            broken(&log).len()
        };
        assert_eq!((told(20 * MS, 24 * MS), told(20 * MS, 400 * MS)), (0, 1));
        let long = 34 * MS + bounds::CLIENT_AGE_LONG;
        assert_eq!((told(30 * MS, long), told(30 * MS, long + 1_000)), (0, 1), "as Link-Status told it wrongly");
    }

    #[test]
    fn the_client_may_count_the_younger_age_that_link_status_reported() {
        let flown = |fresh: &[u64], told: u64, last: u64| {
            let (first, limit) = (sampled(1) + 10 * MS, bounds::CLIENT_AGE_LIMIT + bounds::CLIENT_AGE_SHORT);
            let mut log = Events::new(1);
            heard(&mut log, 1, true);
            fresh.iter().for_each(|at| _ = log.add(*at, What::Fresh { high: true, offered: None }));
            read_as(&mut log, first, told, 1, true, Some(1), Some(10 * MS));
            let at = sampled(1) + limit + MS;
            let link = LinkStatus::seal(&LinkValues::default());
            log.add(
                at,
                What::Transaction { selected: at, mosi: vec![0; 8].into(), miso: link.as_bytes().to_vec().into() },
            );
            log.add(at, What::Decided { position: Some(stamp(last)), age_us: None });
            broken(&log).into_iter().map(|(violation, ..)| violation).collect::<Vec<_>>()
        };
        let fresh = sampled(1) + 6 * MS;
        let wrong = vec![Violation::ClientWrong];
        assert_eq!(flown(&[fresh], 60, 1), wrong);
        assert_eq!(flown(&[fresh], 47, 1), []);
        assert_eq!(flown(&[fresh], 48, 1), wrong, "not young enough");
        assert_eq!(flown(&[], 47, 1), wrong, "FRESH may have risen when it was sampled");
        assert_eq!(flown(&[fresh, sampled(1) + 11 * MS], 47, 1), [], "a later rise is another image's");
        assert_eq!(flown(&[fresh], 47, 2), wrong, "another sample");
    }

    #[test]
    fn a_client_that_reads_a_sequence_has_a_position() {
        let run = |cycles: &[(u64, bool)], hides: bool| {
            let mut log = Events::new(1);
            for (n, valid) in cycles {
                heard(&mut log, *n, *valid);
                let position = (!hides).then_some(*n);
                for after in [6 * MS, 7 * MS] {
                    read(&mut log, sampled(*n) + after, *n, *valid, position, Some(after));
                }
            }
            broken(&log).into_iter().map(|(violation, count, _)| (violation, count)).collect::<Vec<_>>()
        };
        let finds = u64::from(bounds::CLIENT_FINDS);
        let row = |cycles: u64| (1..=cycles).map(|n| (n, true)).collect::<Vec<_>>();
        assert_eq!(run(&row(finds - 1), true), []);
        assert_eq!(run(&row(finds), true), [(Violation::ClientHides, 1)]);
        assert_eq!(run(&row(finds + 5), true), [(Violation::ClientHides, 1)], "it is told once");
        assert_eq!(run(&row(finds + 5), false), []);
        let with = |change: fn(u64) -> (u64, bool)| run(&(1..=finds).map(change).collect::<Vec<_>>(), true);
        assert_eq!(with(|n| (n, n != 3)), [], "one is not valid");
        assert_eq!(with(|n| (n + u64::from(n > 3), true)), [], "one is missing");
        let late = |by: u64, told: u64| {
            let mut log = Events::new(1);
            for n in 1..=finds {
                heard(&mut log, n, true);
                let after = 6 * MS + if n == finds { by } else { 0 };
                read_as(&mut log, sampled(n) + after, told, n, true, None, None);
            }
            broken(&log).len()
        };
        let expired = bounds::EXPIRY - bounds::CYCLE;
        assert_eq!((late(expired, 0), late(expired + 1, 0)), (1, 0));
        let too_old = (bounds::CLIENT_AGE_LIMIT - bounds::CLIENT_AGE_LONG) / AGE_UNIT;
        assert_eq!((late(0, too_old), late(0, too_old + 1)), (1, 0), "it will not be young enough");
        // After a restart of HORUS, the timestamps of later samples may repeat those of earlier ones.
        let mut log = Events::new(1);
        for n in 1..=finds {
            heard(&mut log, n, true);
            let after = if n > 3 { 200 * MS } else { 6 * MS };
            read_as(&mut log, sampled(n) + after, 0, n, true, None, Some(after));
        }
        assert_eq!(broken(&log), [], "too long after the one before");
    }

    #[test]
    fn samples_are_forgotten_that_are_older_than_any_that_is_shown() {
        let mut log = Events::new(1);
        let cycles = 2 * KEPT / bounds::CYCLE;
        (0..cycles).for_each(|n| heard(&mut log, n, true));
        let log = log.end(sampled(cycles)).log();
        let (mut client, mut context) = (Client::new(&log.header), Context::new(&log.header));
        for event in &log.events {
            context.take(event);
            client.take(event, &context, &mut Findings::default());
            assert!(client.samples.iter().all(|sample| event.at <= sample.at + KEPT + bounds::CYCLE));
        }
        assert!(client.samples.len() as u64 >= KEPT / bounds::CYCLE - 1);
    }
}
