//! Receives the hold's frames and answers them. All three tasks of the second port run this code.

use core::borrow::{Borrow, BorrowMut};

use profile::hold::Answer;
use rtic_core::Mutex;
use st25r3916::{executor::Executor, Answerer, AnswererEvent, Input, ListenerConfig, ReadMode, Step, Transfer};

use super::{
    budget::{Budget, Turn},
    shared, HoldTelemetry, Shared, ANSWER_US,
};
use crate::{
    rf::{FrontEndPort, LEAD},
    triple::{scrub_waiting, Memory, Rotated, Rotation},
    ReceiveMemory,
};

/// The operations that answering the hold needs beyond those of a front end that only receives.
pub trait AnswerPort: FrontEndPort {
    /// Returns the present value, µs, of the timer that also captures [`FrontEndPort::irq_edge_us`].
    fn now_us(&mut self) -> u32;
    /// Copies the answer to where the driver loads it from. It is never called during a load.
    fn put(&mut self, answer: &Answer);
    /// Sets up the transfer of [`Answerer::transmit`], which the executor starts next. The timer starts it at counter
    /// value `at_us`. Returns false, and sets nothing up, if that instant has passed.
    fn arm(&mut self, at_us: u32) -> bool;
    /// Keeps the timer from starting a transfer within the next 71 minutes, unless an answer is armed.
    fn park(&mut self);
    /// Masks every interrupt by which the front end calls a task.
    fn rest(&mut self);
    /// Unmasks the interrupts that [`AnswerPort::rest`] masked. A pending one calls its task at once.
    fn wake(&mut self);
    /// Returns the number of SPI bytes of the transfers that were started since the last call.
    fn take_carried(&mut self) -> u32;
    /// Whether a transfer could not be stopped. If so, the SPI may still access its buffers.
    fn is_broken(&self) -> bool;
}

/// A resource that only one task uses. It has the interface of a shared resource, but no lock.
struct Alone<'a, T>(&'a mut T);

impl<T> Mutex for Alone<'_, T> {
    type T = T;

    fn lock<R>(&mut self, with: impl FnOnce(&mut T) -> R) -> R {
        with(self.0)
    }
}

/// What is kept about a frame of the hold besides its bytes: the number of payload bytes.
type Length = usize;

/// The driver, the receive buffers and the budget of the second port.
#[derive(Debug)]
pub struct Responder<P: AnswerPort> {
    executor: Executor<Answerer, P>,
    rotation: Rotation<P::Buffer, Length>,
    budget: Budget,
    /// The value of the port's counter at the end of the last frame, µs.
    ended_us: u32,
}

impl<P: AnswerPort> Responder<P>
where
    P::Buffer: Memory + BorrowMut<ReceiveMemory>,
{
    /// Starts to bring up the front end.
    pub fn start(port: P, rotation: Rotation<P::Buffer, Length>, now_us: u32) -> Self {
        // The hold's frame is short, so it is read after its end in one piece, which takes fewer calls.
        let config = ListenerConfig { read_mode: ReadMode::StoreAndForward, ..ListenerConfig::new() };
        let mut executor = Executor::new(Answerer::new(config), port);
        let event = executor.resume();
        debug_assert!(event.is_none(), "{event:?}");
        executor.port().park();
        Self { executor, rotation, budget: Budget::new(now_us), ended_us: 0 }
    }

    /// Lets the driver work as far as possible, if the budget allows that. `now_us` reads the DPR's µs counter.
    pub fn serve(&mut self, shared: impl Mutex<T = Shared>, now_us: impl Fn() -> u32, telemetry: &HoldTelemetry) {
        if self.executor.port().is_broken() {
            return;
        }
        match self.budget.call(now_us()) {
            Turn::Resting => return,
            Turn::Rest => {
                telemetry.rests.add(1);
                self.executor.port().rest();
                return;
            }
            Turn::Begin { rested } => {
                self.executor.port().park();
                if rested {
                    self.executor.port().wake();
                }
            }
            Turn::Work => {}
        }
        if self.drive(shared, &now_us, telemetry).is_none() {
            telemetry.out_of_use.set(1);
            self.executor.port().rest();
            return;
        }
        telemetry.scrubbed(scrub_waiting(Alone(&mut self.rotation)));
        let carried = self.executor.port().take_carried();
        self.budget.carry(carried);
        let (calls, bytes) = self.budget.spent();
        telemetry.calls_most.record_max(calls);
        telemetry.bytes_most.record_max(bytes);
    }

    /// Handles every event of the driver. Returns `None` if the second port is out of use.
    fn drive(
        &mut self,
        mut shared: impl Mutex<T = Shared>,
        now_us: &impl Fn() -> u32,
        telemetry: &HoldTelemetry,
    ) -> Option<()> {
        let mut event = self.executor.poll();
        loop {
            if self.executor.port().is_broken() {
                return None;
            }
            let Some(happened) = event else { return Some(()) };
            event = match happened {
                AnswererEvent::Frame { len, .. } => self.frame(len, &mut shared, now_us, telemetry),
                AnswererEvent::Loaded => self.loaded(telemetry),
                AnswererEvent::Answered { .. } => {
                    telemetry.answers.add(1);
                    self.executor.resume()
                }
                AnswererEvent::Unanswered(_) => {
                    telemetry.answers_overtaken.add(1);
                    self.executor.resume()
                }
                AnswererEvent::Listening => {
                    telemetry.bring_ups.add(1);
                    self.executor.resume()
                }
                AnswererEvent::Fault(_) | AnswererEvent::Dropped(_) => {
                    telemetry.faults.add(1);
                    self.replace_buffer(telemetry);
                    self.executor.resume()
                }
                AnswererEvent::FieldOn | AnswererEvent::FieldOff => self.executor.resume(),
            };
        }
    }

    /// Checks a frame of the hold. If the frame is accepted, begins an answer.
    fn frame(
        &mut self,
        len: usize,
        shared: &mut impl Mutex<T = Shared>,
        now_us: &impl Fn() -> u32,
        telemetry: &HoldTelemetry,
    ) -> Option<AnswererEvent> {
        telemetry.frames.add(1);
        let Self { executor, rotation, ended_us, .. } = self;
        *ended_us = executor.port().irq_edge_us();
        executor.port().exchange(|filled| {
            let (next, rotated) = rotation.rotate(filled, len);
            if let Rotated::Overrun(found) = rotated {
                telemetry.overruns.add(1);
                telemetry.scrubbed(found);
            }
            next
        });
        let Some(received) = rotation.read() else { return executor.resume() };
        let bytes: &[u8] = bytemuck::cast_slice(Borrow::<ReceiveMemory>::borrow(received.memory()).as_slice());
        let begin = LEAD + st25r3916::listener::PAYLOAD_OFFSET;
        let payload = bytes.get(begin..begin + received.about()).unwrap_or(&[]);
        let judged = shared.lock(|shared| {
            // The lock is taken before `now_us` is read. Otherwise the task `port` could advance the shared clock
            // beyond `now_us`.
            let (now_us, since_us) = (now_us(), executor.port().now_us().wrapping_sub(*ended_us));
            shared.receive(payload, now_us.wrapping_sub(since_us), now_us)
        });
        rotation.done(received);
        if judged.is_err() {
            telemetry.rejected.add(1);
            return executor.resume();
        }
        telemetry.accepted.add(1);
        let answer = shared.lock(|shared| shared.answer(now_us()));
        executor.port().put(&shared::intact(answer));
        executor.go_on(|machine| match machine.answer(Answer::SIZE) {
            Ok(step) => step,
            Err(_) => machine.step(Input::Start),
        })
    }

    /// Makes the timer start the answer whose first bytes are loaded. If the instant has passed, or too little is left
    /// of the budget to load the others, the answer is dropped.
    fn loaded(&mut self, telemetry: &HoldTelemetry) -> Option<AnswererEvent> {
        let port = self.executor.port();
        if !self.budget.has_answer() || !port.arm(self.ended_us.wrapping_add(ANSWER_US)) {
            telemetry.answers_missed.add(1);
            return self.executor.resume();
        }
        let since_us = port.now_us().wrapping_sub(self.ended_us);
        telemetry.armed_worst_us.record_max(since_us);
        self.executor.go_on(|_| Step::Transfer(Transfer::Short(Answerer::transmit())))
    }

    /// Replaces the receive buffer by a clean one, because bytes of a frame that is given up may be in it.
    fn replace_buffer(&mut self, telemetry: &HoldTelemetry) {
        let Self { executor, rotation, .. } = self;
        executor.port().exchange(|begun| {
            let (next, found) = rotation.replace(begun);
            telemetry.scrubbed(found);
            next
        });
    }

    /// Returns the port, for tests.
    pub fn port(&mut self) -> &mut P {
        self.executor.port()
    }
}
