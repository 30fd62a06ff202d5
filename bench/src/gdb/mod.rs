//! gdb at one board of the running link.
//!
//! [`serve`] runs the whole link ([`crate::sim`]) with a debugger at one board, which speaks gdb's remote protocol
//! over any connection (`gdbstub` reads and writes it). What a debugger does to a board on a desk, it does here without
//! being noticed: a halted board halts the world ([`crate::node::Halt`]), so no frame, no transaction and no
//! watchdog passes meanwhile, and what is only looked at leaves the run's report as it would have been, byte for byte.
//!
//! | gdb | here |
//! |---|---|
//! | registers | r0 to pc, xPSR, MSP, PSP, masks, CONTROL, d0 to d15 (so s0 to s31), FPSCR |
//! | memory | flash, RAM; peripherals and the core's own space are read on a copy ([`crate::node::Node::peek`]) |
//! | `break`, `hbreak` | as many as wanted, in flash and RAM; memory is never patched |
//! | `watch`, `rwatch`, `awatch` | as many as wanted; loads and stores of the core, not DMA |
//! | `stepi`, `step`, `next` | interrupts on the way are handled to their ends; faults are stepped into |
//! | `load`, `set` | changes the board: from there on it is another run |
//! | Ctrl-C | halts the board within 10 ms of virtual time |
//! | `detach`, or a lost connection | the run goes on to its end without breakpoints |
//! | `kill` | ends the run |
//! | `monitor help` | virtual time, pins, reset, faults |
//!
//! Left out: `load`'s erase (writes change flash as they are, without a flash controller), reverse execution, and more
//! than one board at a time.

mod arch;
mod monitor;
mod target;

use std::marker::PhantomData;

use bench_judge::Board as Side;
use cortex_m4::{Cost, Fast, Optimistic, Pessimistic};
use gdbstub::conn::ConnectionExt;
use gdbstub::stub::run_blocking::{BlockingEventLoop, Event, WaitForStopReasonError};
use gdbstub::stub::{DisconnectReason, GdbStub, SingleThreadStopReason};

use crate::node::Clock;
use crate::sim::{Debugged, Error, Observer, Outcome, Setup};
use target::Debuggee;

/// How a run with a debugger ended.
#[derive(Debug)]
pub enum Ended {
    /// It came to its end.
    Finished(Box<Outcome>),
    /// The debugger ended it at this instant, virtual ns.
    Killed(u64),
}

/// Runs the link with the debugger on `connection` at the board called `side`, which begins halted at power-on, to its
/// end. What went wrong with the connection is told to `lost`; the run then goes on without a debugger.
///
/// # Errors
///
/// As [`crate::sim::run`].
pub fn serve<T>(
    setup: &Setup,
    side: Side,
    connection: T,
    observer: &mut dyn Observer,
    lost: &mut dyn FnMut(String),
) -> Result<Ended, Error>
where
    T: ConnectionExt,
    T::Error: std::fmt::Display,
{
    match setup.clock {
        Clock::Fast => serve_on::<Fast, T>(setup, side, connection, observer, lost),
        Clock::Optimistic => serve_on::<Optimistic, T>(setup, side, connection, observer, lost),
        Clock::Pessimistic => serve_on::<Pessimistic, T>(setup, side, connection, observer, lost),
    }
}

fn serve_on<C: Cost, T>(
    setup: &Setup,
    side: Side,
    connection: T,
    observer: &mut dyn Observer,
    lost: &mut dyn FnMut(String),
) -> Result<Ended, Error>
where
    T: ConnectionExt,
    T::Error: std::fmt::Display,
{
    let mut debuggee = Debuggee::new(Debugged::<C>::new(setup)?, side, observer, (setup.gps, setup.seed));
    match GdbStub::new(connection).run_blocking::<Loop<'_, C, T>>(&mut debuggee) {
        Ok(DisconnectReason::Kill) => return Ok(Ended::Killed(debuggee.run.now())),
        Ok(_) => {}
        Err(error) => {
            let text = error.to_string();
            match error.into_target_error() {
                Some(error) => return Err(error),
                None => lost(text),
            }
        }
    }
    debuggee.release();
    while !debuggee.run.is_over() {
        debuggee.go()?;
    }
    Ok(Ended::Finished(Box::new(debuggee.run.finish()?)))
}

/// What waits for the board and for gdb while the board runs.
struct Loop<'a, C: Cost, T>(PhantomData<(Debuggee<'a, C>, T)>);

impl<'a, C: Cost, T: ConnectionExt> BlockingEventLoop for Loop<'a, C, T> {
    type Target = Debuggee<'a, C>;
    type Connection = T;
    type StopReason = SingleThreadStopReason<u32>;

    fn wait_for_stop_reason(
        target: &mut Debuggee<'a, C>,
        connection: &mut T,
    ) -> Result<Event<Self::StopReason>, WaitForStopReasonError<Error, T::Error>> {
        loop {
            if connection.peek().map_err(WaitForStopReasonError::Connection)?.is_some() {
                let byte = connection.read().map_err(WaitForStopReasonError::Connection)?;
                return Ok(Event::IncomingData(byte));
            }
            if let Some(reason) = target.go().map_err(WaitForStopReasonError::Target)? {
                return Ok(Event::TargetStopped(reason));
            }
        }
    }

    fn on_interrupt(target: &mut Debuggee<'a, C>) -> Result<Option<Self::StopReason>, Error> {
        Ok(Some(target.interrupt()))
    }
}
