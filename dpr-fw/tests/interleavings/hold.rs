//! Explores every order of events at the registers of the second port: SPIM2, the compare of TIMER4 that starts an
//! answer, chip select, and the interrupts that are masked while the port rests (its budget is used up).
//!
//! All other tasks have higher priorities than the hold's tasks. So at each register access any time may pass, and the
//! hardware may do anything. [`Port`] makes the accesses of `hw/hold.rs` and `hw/rf.rs` in the same order. Plain code
//! replaces the driver: it reads a frame, loads the answer's first bytes, arms the answer and loads the rest. A time
//! limit may expire at any time, even before the operation that it limits could have ended.

use std::{cell::RefCell, rc::Rc};

use super::explorer::{digest, holds, Counterexample, Explored, Explorer};

/// The exploration ends when the timer's counter has the value LAST. ANSWER is the time from the edge of the front
/// end's IRQ to the answer, in counts.
const LAST: u8 = 6;
const ANSWER: u8 = 3;
const SHORTEST: u8 = 1;

/// A rule of the second port's code that a test breaks on purpose, so the exploration must find a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mutation {
    None,
    /// Mutation: the compare for the answer is set without checking whether its value has already passed.
    PassedNotChecked,
    /// Mutation: the compare for the answer is set before the transfer is set up.
    ComparedBeforeSetUp,
    /// Mutation: the compare's event is cleared after the compare is set, which may lose an event.
    EventClearedLast,
    /// Mutation: a transfer is stopped although the compare that starts it is still ahead.
    AbortNotParked,
    /// Mutation: the task raises chip select, which only the end of a transfer should do.
    DeselectedByTask,
    /// Mutation: the interrupt for the front end's IRQ pin stays unmasked after the budget of the second port is spent.
    EdgeNotMasked,
    /// Mutation: the end of a transfer stays masked after a rest.
    EndStaysMasked,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Kind {
    Frame,
    Head,
    Command,
    Rest,
}

/// The state of the hardware. A masked event calls no task.
#[derive(Clone, Debug, Default, Hash)]
struct Hardware {
    now: u8,
    compare: Option<u8>,
    compared: bool,
    set_up: Option<Kind>,
    running: bool,
    end: bool,
    selected: bool,
    irq: bool,
    edge: bool,
    edge_at: u8,
    time_out: bool,
    masked: bool,
    edge_masked: bool,
    end_masked: bool,
    frames: u8,
    time_outs: u8,
    check_ins: u8,
    rests: u8,
    /// The transfer whose bytes were clocked since the chip was selected, and the time of its end.
    clocked: Option<(Kind, u8)>,
    /// The counter value at which the armed answer starts.
    armed_for: Option<u8>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Tick,
    TransferEnds,
    FrameEnds,
    TimeOut,
    CheckIn,
    BudgetSpent,
}

/// The state of the driver between two calls of the task.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
enum Driver {
    #[default]
    Listening,
    Waits(Kind),
}

struct Board {
    explorer: Rc<Explorer>,
    mutation: Mutation,
    hw: RefCell<Hardware>,
    driver: RefCell<Driver>,
    resting: RefCell<bool>,
    /// A hash of all that the task has done and read in this run; 0 while no task runs.
    seen: RefCell<u64>,
    wants_rest: RefCell<bool>,
    called_to_check_in: RefCell<bool>,
}

impl Board {
    fn steps(&self) -> Vec<Step> {
        let hw = self.hw.borrow();
        let mut steps = vec![];
        let mut add = |possible: bool, step| {
            if possible {
                steps.push(step);
            }
        };
        add(hw.now < LAST, Step::Tick);
        add(hw.running, Step::TransferEnds);
        add(!hw.irq && hw.frames < 2 && hw.now + ANSWER < LAST, Step::FrameEnds);
        add(hw.time_outs < 1 && hw.set_up.is_some(), Step::TimeOut);
        add(hw.check_ins < 1 && !*self.called_to_check_in.borrow(), Step::CheckIn);
        add(hw.rests < 1, Step::BudgetSpent);
        steps
    }

    fn happen(&self, step: Step) {
        let mut hw = self.hw.borrow_mut();
        match step {
            Step::Tick => {
                self.explorer.note("tick");
                hw.now += 1;
                if hw.compare == Some(hw.now) {
                    self.explorer.note("  the compare starts SPIM2");
                    hw.compared = true;
                    holds(!hw.running, "a timer starts a transfer while another runs");
                    holds(hw.selected && hw.set_up == Some(Kind::Command), "a timer starts what is not set up");
                    hw.running = true;
                }
            }
            Step::TransferEnds => {
                self.explorer.note("transfer ends");
                holds(hw.selected, "the chip is deselected within a transfer");
                (hw.running, hw.end) = (false, true);
                hw.clocked = hw.set_up.map(|kind| (kind, hw.now));
                if self.mutation != Mutation::DeselectedByTask {
                    self.deselect(&mut hw);
                }
            }
            Step::FrameEnds => {
                self.explorer.note("frame ends");
                (hw.irq, hw.edge, hw.edge_at) = (true, true, hw.now);
                hw.frames += 1;
            }
            Step::TimeOut => {
                self.explorer.note("time-out");
                hw.time_out = true;
                hw.time_outs += 1;
            }
            Step::CheckIn => {
                self.explorer.note("check-in");
                hw.check_ins += 1;
                *self.called_to_check_in.borrow_mut() = true;
            }
            Step::BudgetSpent => {
                self.explorer.note("budget spent");
                hw.rests += 1;
                *self.wants_rest.borrow_mut() = true;
            }
        }
    }

    /// Raises chip select, at which the chip executes the command that was clocked in.
    fn deselect(&self, hw: &mut Hardware) {
        hw.selected = false;
        if let Some((Kind::Command, ended_at)) = hw.clocked.take() {
            holds(hw.armed_for.is_some(), "an answer is sent that was given up");
            holds(hw.now == ended_at, "the answer is late");
        }
    }

    /// Makes a register access of the task. Before the access, any number of hardware events may happen.
    fn access<T: std::hash::Hash>(&self, name: &'static str, act: impl FnOnce(&mut Hardware) -> T) -> T {
        loop {
            let steps = self.steps();
            let taken = self.explorer.choose(1 + steps.len(), || self.state(name));
            let Some(step) = taken.checked_sub(1).map(|index| steps[index]) else { break };
            self.happen(step);
        }
        self.explorer.note(name);
        let value = act(&mut self.hw.borrow_mut());
        let mut seen = self.seen.borrow_mut();
        *seen = digest((*seen, name, digest(&value)));
        value
    }

    fn state(&self, name: &str) -> u64 {
        let more = (*self.resting.borrow(), *self.wants_rest.borrow(), *self.called_to_check_in.borrow());
        digest((&*self.hw.borrow(), &*self.driver.borrow(), *self.seen.borrow(), name, more))
    }

    fn is_called(&self) -> bool {
        let hw = self.hw.borrow();
        hw.end && !hw.end_masked || hw.edge && !hw.edge_masked || hw.time_out && !hw.masked
    }

    fn run(&self) {
        loop {
            if self.is_called() || *self.called_to_check_in.borrow() {
                let by_front_end = self.is_called();
                holds(!(by_front_end && *self.resting.borrow()), "a front end calls a task while the port rests");
                *self.called_to_check_in.borrow_mut() = false;
                self.explorer.note("> hold");
                *self.seen.borrow_mut() = 1;
                self.task();
                *self.seen.borrow_mut() = 0;
                self.explorer.note("<");
                continue;
            }
            let steps = self.steps();
            if steps.is_empty() {
                break;
            }
            let taken = self.explorer.choose(steps.len(), || self.state("idle"));
            self.happen(steps[taken]);
        }
        if *self.resting.borrow() {
            // The budget's window has ended, so this check-in ends the rest. The task then handles the events that
            // wait.
            *self.wants_rest.borrow_mut() = false;
            *self.called_to_check_in.borrow_mut() = true;
            self.wake();
            return self.run();
        }
        let hw = self.hw.borrow();
        holds(!hw.selected && !hw.running, "a transfer that was set up has no end");
        holds(!hw.irq && *self.driver.borrow() == Driver::Listening, "an event is never served");
    }

    fn task(&self) {
        self.access("clears the edge", |hw| hw.edge = false);
        if *self.resting.borrow() {
            return;
        }
        if std::mem::take(&mut *self.wants_rest.borrow_mut()) {
            return self.rest();
        }
        self.drive();
    }

    fn rest(&self) {
        self.access("masks END", |hw| hw.end_masked = true);
        self.access("masks the timer", |hw| hw.masked = true);
        if self.mutation != Mutation::EdgeNotMasked {
            self.access("masks the edge", |hw| hw.edge_masked = true);
        }
        *self.resting.borrow_mut() = true;
    }

    fn wake(&self) {
        *self.resting.borrow_mut() = false;
        let mut hw = self.hw.borrow_mut();
        (hw.masked, hw.edge_masked) = (false, false);
        hw.end_masked &= self.mutation == Mutation::EndStaysMasked;
    }

    /// Does what the driver's executor and state machine would do, with at most one operation of the port for each
    /// event.
    fn drive(&self) {
        let driver = *self.driver.borrow();
        match driver {
            Driver::Listening => {
                if self.access("reads the pin", |hw| hw.irq) {
                    self.start(Kind::Frame);
                } else if self.access("takes the time-out", |hw| std::mem::take(&mut hw.time_out)) {
                    self.listen();
                }
            }
            Driver::Waits(kind) if self.ended() => match kind {
                Kind::Frame => {
                    self.hw.borrow_mut().irq = false;
                    self.start(Kind::Head);
                }
                Kind::Head => {
                    if self.arm() {
                        *self.driver.borrow_mut() = Driver::Waits(Kind::Command);
                    } else {
                        self.listen();
                    }
                }
                Kind::Command => self.start(Kind::Rest),
                Kind::Rest => self.listen(),
            },
            Driver::Waits(_) => {
                if self.access("takes the time-out", |hw| std::mem::take(&mut hw.time_out)) {
                    self.abort();
                    self.hw.borrow_mut().irq = false;
                    self.listen();
                }
            }
        }
    }

    fn listen(&self) {
        *self.driver.borrow_mut() = Driver::Listening;
        self.access("starts the wait", |hw| hw.time_out = false);
        if self.access("reads the pin", |hw| hw.irq) {
            self.start(Kind::Frame);
        }
    }

    fn set_up(&self, kind: Kind) {
        self.access("sets SPIM2 up", |hw| {
            holds(!hw.running, "a transfer is set up while another runs");
            (hw.set_up, hw.end, hw.armed_for) = (Some(kind), false, None);
        });
        self.access("selects", |hw| hw.selected = true);
    }

    fn start(&self, kind: Kind) {
        self.set_up(kind);
        self.access("starts SPIM2", |hw| hw.running = true);
        self.access("starts the time limit", |hw| hw.time_out = false);
        *self.driver.borrow_mut() = Driver::Waits(kind);
    }

    fn ended(&self) -> bool {
        let ended = self.access("takes END", |hw| std::mem::take(&mut hw.end));
        if ended {
            self.finish();
        }
        ended
    }

    fn finish(&self) {
        self.disarm();
        self.access("deselects", |hw| {
            self.deselect(hw);
            (hw.set_up, hw.armed_for) = (None, None);
        });
    }

    fn disarm(&self) {
        if self.hw.borrow().armed_for.is_some() {
            self.access("parks the compare", |hw| hw.compare = None);
        }
    }

    fn arm(&self) -> bool {
        let at = self.hw.borrow().edge_at + ANSWER;
        if self.access("reads the counter", |hw| hw.now + SHORTEST >= at) {
            return false;
        }
        if self.mutation == Mutation::ComparedBeforeSetUp {
            self.access("sets the compare", |hw| hw.compare = Some(at));
        }
        self.set_up(Kind::Command);
        if self.mutation != Mutation::EventClearedLast {
            self.access("clears the compare's event", |hw| hw.compared = false);
        }
        self.access("sets the compare", |hw| (hw.compare, hw.armed_for) = (Some(at), Some(at)));
        if self.mutation == Mutation::EventClearedLast {
            self.access("clears the compare's event", |hw| hw.compared = false);
        }
        if self.mutation == Mutation::PassedNotChecked {
            return true;
        }
        let passed = self.access("reads the counter again", |hw| hw.now >= at);
        if passed && !self.access("reads the compare's event", |hw| hw.compared) {
            self.access("parks the compare", |hw| (hw.compare, hw.armed_for) = (None, None));
            self.finish();
            return false;
        }
        self.access("starts the time limit", |hw| hw.time_out = false);
        true
    }

    fn abort(&self) {
        if self.mutation != Mutation::AbortNotParked {
            self.disarm();
        }
        self.access("stops SPIM2", |hw| hw.running = false);
        self.access("clears END", |hw| hw.end = false);
        self.finish();
    }
}

fn explore(mutation: Mutation) -> Result<Explored, Counterexample> {
    Explorer::explore(|explorer| {
        Board {
            explorer,
            mutation,
            hw: RefCell::default(),
            driver: RefCell::default(),
            resting: RefCell::default(),
            seen: RefCell::default(),
            wants_rest: RefCell::default(),
            called_to_check_in: RefCell::default(),
        }
        .run();
    })
}

fn breaks(mutation: Mutation, rule: &str) {
    let counterexample = explore(mutation).expect_err("a rule is broken");
    assert_eq!(counterexample.broken, rule, "{counterexample:?}");
}

// Shows HOLD-8.
#[test]
fn an_answer_is_sent_at_its_instant_or_given_up() {
    let explored = explore(Mutation::None).expect("no rule is broken");
    assert_eq!(explored.states, 86_139, "docs/decisions/0012-exhaustive-interleavings.md gives this number, too");
}

#[test]
fn an_instant_that_passes_unnoticed_is_found() {
    breaks(Mutation::PassedNotChecked, "a transfer that was set up has no end");
}

#[test]
fn a_compare_that_is_set_too_early_is_found() {
    breaks(Mutation::ComparedBeforeSetUp, "an answer is sent that was given up");
}

#[test]
fn a_compare_event_that_is_cleared_too_late_is_found() {
    breaks(Mutation::EventClearedLast, "the chip is deselected within a transfer");
}

#[test]
fn a_stop_before_the_compare_is_found() {
    breaks(Mutation::AbortNotParked, "the chip is deselected within a transfer");
}

#[test]
fn a_chip_that_is_deselected_by_the_task_is_found() {
    breaks(Mutation::DeselectedByTask, "the answer is late");
}

#[test]
fn an_edge_that_calls_a_resting_port_is_found() {
    breaks(Mutation::EdgeNotMasked, "a front end calls a task while the port rests");
}

#[test]
fn an_end_that_stays_masked_after_a_rest_is_found() {
    breaks(Mutation::EndStaysMasked, "an event is never served");
}
