//! Whether transactions are made, and whether the DPR serves them in time.

use profile::LinkStatus;

use crate::bounds;
use crate::disturbance::{Disturbances, Excuse};
use crate::read::Reading;
use crate::{Findings, Max, Violation};

/// What a transaction says about whether anything could be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Read {
    /// Something was.
    Image,
    /// 0xFF throughout.
    Nothing,
    /// Too few bytes to tell.
    Unknown,
}

impl Read {
    /// What `reading` says; `busy` if the DPR's SPI peripheral did not serve it.
    pub(super) fn of(reading: &Reading, busy: bool) -> Self {
        match reading.silent {
            false => Self::Image,
            // A few bytes of an image may be 0xFF; a whole Link-Status is not, for no CRC accepts it.
            true if busy || reading.miso.len() >= LinkStatus::SIZE => Self::Nothing,
            true => Self::Unknown,
        }
    }
}

/// Why the processor has the SSI's buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Why {
    /// A transaction that was served has ended: hardware gave them back.
    Transaction,
    /// The image's time was over: hardware took them, and there is nothing to give back until the next image.
    Expiry,
    /// It took them itself.
    Own,
}

#[derive(Clone, Copy, Debug)]
struct Hold {
    since: u64,
    why: Why,
}

/// A transaction is over, and the DPR is not ready for the next one yet.
#[derive(Clone, Copy, Debug)]
struct Pending {
    /// Since when readiness is owed: since its end, or since the pause after the one before is over.
    since: u64,
    /// There is an image to be read.
    owed: bool,
}

/// Transactions in a row that read nothing.
#[derive(Clone, Copy, Debug)]
struct Streak {
    /// When chip select fell for the first, ns.
    first: u64,
    /// When it fell for the last, ns.
    last: u64,
    count: u64,
    /// The buffers were held for too long meanwhile, which is a violation of its own.
    explained: bool,
    /// It is noted as silence.
    told: bool,
    /// The first of them had no reason to read nothing.
    unserved: bool,
}

impl Streak {
    fn is_silence(self) -> bool {
        self.last - self.first > bounds::EXPIRY
    }
}

/// See the [module](self).
#[derive(Clone, Debug)]
pub(super) struct Service {
    powered: bool,
    /// The DPR hangs by the bench's hand.
    hung: bool,
    /// When the DPR last started, ns.
    since: u64,
    /// When the DPR was first ready after that, ns.
    started: Option<u64>,
    never_told: bool,
    /// Since when the flight controller has made no transaction, ns.
    quiet_since: u64,
    quiet_told: bool,
    under_way: bool,
    /// When the last transaction began, and when the last that was longer than a cycle ended, ns.
    began: u64,
    long_ended: u64,
    /// The transaction under way is not served.
    busy: bool,
    /// The transaction under way may not be served: the one before has just ended, or the image's time is over.
    may_be_busy: bool,
    /// When FRESH rose first in the transaction under way, ns.
    rose_within: Option<u64>,
    hold: Option<Hold>,
    /// Until when the DPR need not see the end of a transaction, ns.
    paused_until: u64,
    pending: Option<Pending>,
    /// FRESH rose at this instant while nothing was owed, so that no other bound tells when the image has to be
    /// readable.
    claimed: Option<u64>,
    ready_at: Option<u64>,
    rose_at: Option<u64>,
    /// Transactions served since FRESH rose last.
    served: u32,
    streak: Option<Streak>,
    longest: Option<u64>,
}

impl Service {
    pub(super) fn new() -> Self {
        Self {
            powered: true,
            hung: false,
            since: 0,
            started: None,
            never_told: false,
            quiet_since: 0,
            quiet_told: false,
            under_way: false,
            began: 0,
            long_ended: 0,
            busy: false,
            may_be_busy: false,
            rose_within: None,
            hold: None,
            paused_until: 0,
            pending: None,
            claimed: None,
            ready_at: None,
            rose_at: None,
            served: 0,
            streak: None,
            longest: None,
        }
    }

    /// Starts anew: what was under way is not judged, since the restart is.
    fn restart(&mut self, since: u64) {
        let Self { powered, quiet_since, quiet_told, longest, under_way, .. } = *self;
        // A transaction that is under way is none that the DPR's SPI peripheral knows of. When it began, and when one
        // before it ended, need not be kept: they are asked for once the time for a start is over, which is longer than
        // a transaction that is not long.
        let busy = under_way;
        *self = Self { powered, since, quiet_since, quiet_told, longest, under_way, busy, ..Self::new() };
    }

    pub(super) fn power(&mut self, at: u64, on: bool) {
        self.restart(at);
        self.powered = on;
        (self.quiet_since, self.quiet_told) = (self.quiet_since.max(at), false);
    }

    pub(super) fn reset(&mut self, at: u64) {
        self.restart(at);
    }

    /// The DPR hangs from `at` on: what had waited too long by then is told, and nothing is owed any more.
    pub(super) fn hang(&mut self, at: u64, findings: &mut Findings) {
        self.settle(at, findings);
        self.end_streak(findings);
        self.hung = true;
    }

    /// The flight controller misuses the SSI: nothing is owed to it.
    pub(super) fn misused(&mut self) {
        (self.claimed, self.streak) = (None, None);
        // Who takes the buffers now does so because of that transaction.
        self.pending.iter_mut().for_each(|pending| pending.owed = false);
    }

    /// Time passes: what should have happened before `now`.
    pub(super) fn pass(&mut self, now: u64, disturbances: &Disturbances, findings: &mut Findings) {
        if !self.powered {
            return;
        }
        // While a flight controller keeps the DPR selected for longer than a cycle, no transaction can be got ready
        // for.
        let due = self.since + bounds::START;
        let free = self.long_ended.saturating_add(bounds::SSI_READY);
        let kept = self.under_way && now > self.began + bounds::CYCLE;
        if self.started.is_none() && !self.never_told && !self.hung && !kept && now > due.max(free) {
            self.never_told = true;
            findings.add(Violation::NeverReady, due, || format!("{} ns after its start", bounds::START));
        }
        let quiet_since = self.quiet_since.max(disturbances.until(Excuse::Transactions));
        let due = quiet_since.saturating_add(bounds::NO_TRANSACTION);
        if !self.quiet_told && now > due {
            self.quiet_told = true;
            findings.add(Violation::NoTransaction, due, || format!("none for {} ns", bounds::NO_TRANSACTION));
        }
    }

    /// FRESH rose; `offers` if a transaction could begin. Whether there is a reason if none could.
    pub(super) fn rise(&mut self, at: u64, offers: bool) -> bool {
        (self.rose_at, self.served) = (Some(at), 0);
        if self.under_way {
            self.rose_within.get_or_insert(at);
        }
        let expired = self.hold.is_some_and(|hold| hold.why == Why::Expiry);
        let unowed = self.pending.is_some_and(|pending| !pending.owed);
        if !offers && (expired || unowed) {
            self.claimed.get_or_insert(at);
        }
        self.started.is_none() || self.under_way || self.hold.is_some() || self.pending.is_some()
    }

    pub(super) fn held(&mut self, at: u64) {
        let why = match self.under_way && !self.busy || self.pending.is_some() {
            true => Why::Transaction,
            false if self.is_expired(at) => Why::Expiry,
            false => Why::Own,
        };
        self.hold.get_or_insert(Hold { since: at, why });
    }

    pub(super) fn released(&mut self, at: u64, findings: &mut Findings) {
        self.served_again(at);
        self.settle(at, findings);
        if self.hold.take().is_some_and(|hold| hold.why == Why::Transaction) {
            self.paused_until = at + bounds::SSI_PAUSE;
        }
    }

    pub(super) fn ready(&mut self, at: u64, findings: &mut Findings) {
        self.served_again(at);
        self.settle(at, findings);
        self.ready_at = Some(at);
        if self.started.is_none() {
            self.started = Some(at);
            (self.hold, self.streak) = (None, None);
        }
    }

    pub(super) fn busy(&mut self) {
        self.busy = true;
    }

    pub(super) fn selected(&mut self, at: u64) {
        (self.under_way, self.began) = (true, at);
        // The one before has just ended, or FRESH has just risen.
        let just = self.quiet_since.max(self.paused_until).max(self.rose_at.unwrap_or(0));
        self.may_be_busy = at <= just + bounds::SSI_READY || self.is_expired(at);
        self.rose_within = None;
        // A flight controller that does not wait for the DPR as long as it has to is no evidence.
        self.pending = self.pending.filter(|pending| at.saturating_sub(pending.since) > bounds::SSI_READY);
    }

    /// A transaction is over; `whole` if the DPR ran all the while.
    pub(super) fn transaction(&mut self, reading: &Reading, whole: bool, findings: &mut Findings) {
        let at = reading.deselected;
        let busy = std::mem::take(&mut self.busy);
        self.under_way = false;
        if at > self.began + bounds::CYCLE {
            self.long_ended = at;
        }
        self.quiet_told = false;
        self.quiet_since = self.quiet_since.max(at);
        // One that began before the DPR was ready for any is none that its SPI peripheral knows of.
        if !whole || self.started.is_none_or(|started| reading.selected < started) {
            return;
        }
        self.served = self.served.saturating_add(u32::from(!busy));
        let spent = self.served >= bounds::SSI_BUDGET;
        if self.ready_at == Some(at) {
            self.took(0);
        } else if self.hold.is_none_or(|hold| hold.why == Why::Transaction) {
            let owed = !spent && !self.is_expired(at);
            self.pending.get_or_insert(Pending { since: at.max(self.paused_until), owed });
        }
        match Read::of(reading, busy) {
            Read::Image => self.end_streak(findings),
            Read::Nothing if !(busy && spent) && !self.hung => {
                let soon = self.rose_within.is_some_and(|rose| rose <= reading.selected + bounds::SSI_READY);
                self.read_nothing(reading.selected, !self.may_be_busy && !soon, findings);
            }
            Read::Nothing | Read::Unknown => {}
        }
    }

    /// Whether the image's time may be over.
    fn is_expired(&self, at: u64) -> bool {
        self.rose_at.is_some_and(|rose| at >= rose + bounds::EXPIRY_EARLIEST)
    }

    fn took(&mut self, ns: u64) {
        self.longest = self.longest.max(Some(ns));
    }

    /// The DPR can serve the next transaction.
    fn served_again(&mut self, at: u64) {
        if let Some(Pending { since, owed: true }) = self.pending {
            self.took(at.saturating_sub(since));
        }
    }

    /// The DPR can serve the next transaction, or the run is over: what had to wait has waited until now.
    fn settle(&mut self, now: u64, findings: &mut Findings) {
        if let Some(Pending { since, owed: true }) = self.pending.take() {
            self.waited(Violation::NotReady, since, now, findings);
        }
        if let Some(Hold { since, why: Why::Own }) = self.hold {
            self.waited(Violation::HeldBack, since, now, findings);
        }
        if let Some(since) = self.claimed.take() {
            self.waited(Violation::FreshUnreadable, since, now, findings);
        }
    }

    fn waited(&mut self, violation: Violation, since: u64, now: u64, findings: &mut Findings) {
        let took = now.saturating_sub(since);
        let silence = self.streak.is_some_and(Streak::is_silence);
        if self.started.is_none() || self.hung || took <= bounds::SSI_READY || silence {
            return;
        }
        findings.add(violation, since, || format!("{took} ns, the bound is {} ns", bounds::SSI_READY));
        if let Some(streak) = &mut self.streak {
            streak.explained = true;
        }
    }

    /// A transaction has read nothing, and had no reason to if `unserved`.
    fn read_nothing(&mut self, selected: u64, unserved: bool, findings: &mut Findings) {
        let new = Streak { first: selected, last: selected, count: 0, explained: false, told: false, unserved };
        let streak = self.streak.get_or_insert(new);
        streak.last = selected;
        streak.count += 1;
        // A DPR that hangs is restarted by its watchdog, which is another violation. This is longer than that takes.
        if streak.last - streak.first > bounds::EXPIRY + bounds::START {
            self.silence(findings);
        }
    }

    fn silence(&mut self, findings: &mut Findings) {
        let Some(streak) = self.streak.as_mut().filter(|streak| !streak.told) else { return };
        streak.told = true;
        let (first, took, count) = (streak.first, streak.last - streak.first, streak.count);
        findings.add(Violation::Silent, first, || format!("{count} transactions in {took} ns read 0xFF throughout"));
    }

    fn end_streak(&mut self, findings: &mut Findings) {
        let Some(streak) = self.streak else { return };
        if streak.is_silence() {
            self.silence(findings);
        } else if streak.count > 1 && !streak.explained {
            findings.add(Violation::BusyTwice, streak.first, || format!("{} in a row", streak.count));
        } else if streak.count == 1 && streak.unserved && !streak.explained {
            findings.add(Violation::Unserved, streak.first, || "it is not the DPR that was busy".into());
        }
        self.streak = None;
    }

    pub(super) fn finish(&mut self, now: u64, disturbances: &Disturbances, findings: &mut Findings) {
        self.pass(now, disturbances, findings);
        self.settle(now, findings);
        self.end_streak(findings);
    }

    /// From chip select rising to the DPR being able to serve the next transaction.
    pub(super) fn figure(&self) -> Option<Max> {
        Max::of(self.longest)
    }
}
