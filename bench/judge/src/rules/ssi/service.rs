//! Judges whether the flight controller makes transactions, and whether the DPR serves them in time.

use profile::LinkStatus;

use crate::bounds;
use crate::disturbance::{Disturbances, Excuse};
use crate::read::Reading;
use crate::{Findings, Max, Violation};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Read {
    Image,
    /// The transaction read 0xFF throughout.
    Nothing,
    /// The transaction read too few bytes to recognise an image.
    Unknown,
}

impl Read {
    /// Returns what the transaction `reading` read. `busy` says that the DPR's SPI peripheral did not serve it.
    pub(super) fn of(reading: &Reading, busy: bool) -> Self {
        match reading.silent {
            false => Self::Image,
            // A short part of an image may consist of 0xFF bytes. A whole Link-Status cannot, because its CRC would be
            // wrong.
            true if busy || reading.miso.len() >= LinkStatus::SIZE => Self::Nothing,
            true => Self::Unknown,
        }
    }
}

/// The reason why the SSI's buffers belong to the processor and not to the SPI peripheral.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Why {
    /// A transaction ended, and the SPI peripheral gave the buffers to the processor.
    Transaction,
    /// Hardware took the buffers, because the image's time is over. They must be back only with the next image.
    Expiry,
    /// The processor took the buffers.
    Own,
}

#[derive(Clone, Copy, Debug)]
struct Hold {
    since: u64,
    why: Why,
}

/// A transaction has ended, and the DPR is not ready for the next one yet.
#[derive(Clone, Copy, Debug)]
struct Pending {
    /// The instant, ns, from which [`bounds::SSI_READY`] counts: the end of the transaction, or of a pause.
    since: u64,
    /// Whether there is an image to be read, so that the DPR must become ready.
    owed: bool,
}

/// A series of consecutive transactions that read only 0xFF.
#[derive(Clone, Copy, Debug)]
struct Streak {
    /// The instant, ns, at which the first transaction began.
    first: u64,
    last: u64,
    count: u64,
    /// Whether the processor kept the buffers for too long, which is reported by itself.
    explained: bool,
    /// Whether [`Violation::Silent`] has been reported for the series.
    told: bool,
    /// Whether the DPR should have served the first transaction.
    unserved: bool,
}

impl Streak {
    fn is_silence(self) -> bool {
        self.last - self.first > bounds::EXPIRY
    }
}

#[derive(Clone, Debug)]
pub(super) struct Service {
    powered: bool,
    hung: bool,
    since: u64,
    /// The instant, ns, at which the DPR was first ready after its last start.
    started: Option<u64>,
    never_told: bool,
    /// The instant, ns, since which the flight controller has made no transaction.
    quiet_since: u64,
    quiet_told: bool,
    under_way: bool,
    began: u64,
    /// The end, ns, of the last transaction that was longer than a cycle.
    long_ended: u64,
    busy: bool,
    /// Whether the DPR may leave the present transaction unserved.
    may_be_busy: bool,
    /// The instant, ns, of the first rise of FRESH during the transaction that is under way.
    rose_within: Option<u64>,
    hold: Option<Hold>,
    /// The instant, ns, until which the DPR pauses and need not detect that a transaction has ended.
    paused_until: u64,
    pending: Option<Pending>,
    /// The instant, ns, of a rise of FRESH whose image must become readable. `None` if another limit of time applies to
    /// that image.
    claimed: Option<u64>,
    ready_at: Option<u64>,
    rose_at: Option<u64>,
    /// The number of transactions served since FRESH last rose.
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

    /// Resets the state at a start of the DPR. Overdue service is not reported here, because the restart is.
    fn restart(&mut self, since: u64) {
        let Self { powered, quiet_since, quiet_told, longest, under_way, .. } = *self;
        // The DPR need not serve a transaction that is under way when the DPR starts.
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

    /// Records that the DPR hangs from the instant `at` on. Service that was overdue by then is reported.
    pub(super) fn hang(&mut self, at: u64, findings: &mut Findings) {
        self.settle(at, findings);
        self.end_streak(findings);
        self.hung = true;
    }

    /// Records that the flight controller misuses the SSI, so that the DPR need not serve it.
    pub(super) fn misused(&mut self) {
        (self.claimed, self.streak) = (None, None);
        // The misused transaction may keep the processor from giving the buffers back soon.
        self.pending.iter_mut().for_each(|pending| pending.owed = false);
    }

    /// Reports that the DPR is not ready by `now` although it should be, or that the flight controller makes no
    /// transaction.
    pub(super) fn pass(&mut self, now: u64, disturbances: &Disturbances, findings: &mut Findings) {
        if !self.powered {
            return;
        }
        // A flight controller that keeps the DPR selected for longer than a cycle keeps the DPR from becoming ready.
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

    /// Records a rise of FRESH. `offers` states whether a transaction could begin. Returns whether the DPR has a reason
    /// to refuse transactions.
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
        // The DPR may be busy just after the end of a transaction or a rise of FRESH.
        let just = self.quiet_since.max(self.paused_until).max(self.rose_at.unwrap_or(0));
        self.may_be_busy = at <= just + bounds::SSI_READY || self.is_expired(at);
        self.rose_within = None;
        // A flight controller that selects the DPR too soon after a transaction cannot rely on being served.
        self.pending = self.pending.filter(|pending| at.saturating_sub(pending.since) > bounds::SSI_READY);
    }

    /// Judges a transaction. `whole` says that the DPR was running from the transaction's beginning to its end.
    pub(super) fn transaction(&mut self, reading: &Reading, whole: bool, findings: &mut Findings) {
        let at = reading.deselected;
        let busy = std::mem::take(&mut self.busy);
        self.under_way = false;
        if at > self.began + bounds::CYCLE {
            self.long_ended = at;
        }
        self.quiet_told = false;
        self.quiet_since = self.quiet_since.max(at);
        // A transaction that began before the DPR was first ready need not be served.
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

    fn is_expired(&self, at: u64) -> bool {
        self.rose_at.is_some_and(|rose| at >= rose + bounds::EXPIRY_EARLIEST)
    }

    fn took(&mut self, ns: u64) {
        self.longest = self.longest.max(Some(ns));
    }

    fn served_again(&mut self, at: u64) {
        if let Some(Pending { since, owed: true }) = self.pending {
            self.took(at.saturating_sub(since));
        }
    }

    /// Reports each action of the DPR that is overdue at `now`. At this instant the DPR is ready for the next
    /// transaction, or the run ends.
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

    /// Records a transaction that read only 0xFF. `unserved` says that there was no reason for that.
    fn read_nothing(&mut self, selected: u64, unserved: bool, findings: &mut Findings) {
        let new = Streak { first: selected, last: selected, count: 0, explained: false, told: false, unserved };
        let streak = self.streak.get_or_insert(new);
        streak.last = selected;
        streak.count += 1;
        // A series of unserved transactions counts as a silence only if it is longer than a restart of a hung DPR
        // takes.
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

    pub(super) fn figure(&self) -> Option<Max> {
        Max::of(self.longest)
    }
}
