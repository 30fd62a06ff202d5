//! A gdb server for one board.
//!
//! [`serve`] runs the whole link ([`crate::sim`]) with a debugger at one board. [`serve_alone`] runs one firmware alone
//! on one board ([`emulator_node::Target::run_connected`]). The debugger uses gdb's remote protocol over any
//! connection. A board that the debugger halts also halts the rest of the bench ([`emulator_node::Halt`]). No frame, no
//! transaction and no watchdog time passes meanwhile, so inspection does not change the run's report.
//!
//! | gdb | here |
//! |---|---|
//! | registers | r0 to pc, xPSR, MSP, PSP, masks, CONTROL, d0 to d15 (so s0 to s31), FPSCR |
//! | memory | flash, RAM; peripherals and the core's own space are read on a copy ([`emulator_node::Node::peek`]) |
//! | `break`, `hbreak` | any number, in flash and RAM; memory is never patched |
//! | `watch`, `rwatch`, `awatch` | any number; loads and stores of the core, not DMA |
//! | `stepi`, `step`, `next` | interrupts that occur run to their ends; faults are stepped into |
//! | `load`, `set` | change the board: the run then differs from the undisturbed one |
//! | Ctrl-C | halts the board within 10 ms of virtual time |
//! | `detach`, or a lost connection | the run goes on to its end without breakpoints |
//! | `kill` | ends the run |
//! | `monitor help` | virtual time, pins, reset, and faults of the link |
//!
//! A firmware that runs alone halts with SIGSEGV at the instruction that ends it: in a HardFault, in an exception
//! without a handler, or in a lock-up. When the debugger continues after that, gdb gets the exit status of `cargo xtask
//! run`.
//!
//! Not available are the erase of gdb's `load` (writes change flash directly, without a flash controller), reverse
//! execution, and debugging of several boards at a time.

mod arch;
mod monitor;
mod target;
mod world;

use std::marker::PhantomData;

use bench_judge::Board as Side;
use cortex_m4::{Cost, Fast, Optimistic, Pessimistic};
use emulator_part::Part;
use gdbstub::conn::ConnectionExt;
use gdbstub::stub::run_blocking::{BlockingEventLoop, Event as Incoming, WaitForStopReasonError};
use gdbstub::stub::{DisconnectReason, GdbStub, SingleThreadStopReason};
use nrf52840::{Nrf52840, Settings};
use stm32f429::{Oscillators, Stm32f429};

use crate::sim::{self, Debugged, Error, Observer, Setup};
use emulator_node::{self as node, Clock, Connected, Event, Firmware, Limits, Running, Target};
use target::Debuggee;
use world::{Link, Solo, World};

/// The end of a run with a debugger; `O` is the run's outcome.
#[derive(Debug)]
pub enum Ended<O = sim::Outcome> {
    /// The run reached its end and had this outcome.
    Finished(Box<O>),
    /// The debugger ended the run at this instant, virtual ns.
    Killed(u64),
}

/// Runs the link to its end with the debugger on `connection` at the board called `side`. The board is halted at
/// power-on until the debugger lets it run. An error of the connection is passed to `lost`, and the run continues
/// without a debugger.
///
/// # Errors
///
/// The errors are those of [`crate::sim::run`].
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
    let run = Debugged::<C>::new(setup)?;
    let link = Link { run, side, observer, gps: setup.gps, seed: setup.seed };
    Ok(match attended(link, connection, lost)? {
        Left::Over(link) => Ended::Finished(Box::new(link.run.finish()?)),
        Left::Killed(at) => Ended::Killed(at),
    })
}

/// A firmware alone on one board, for [`Target::run_connected`].
#[derive(Debug)]
pub struct Alone<'a> {
    /// The type of board.
    pub target: Target,
    /// The cost of processor time.
    pub clock: Clock,
    /// The firmware that runs on the board.
    pub firmware: &'a Firmware,
    /// The connections to the board's pins.
    pub connected: Connected,
    /// The limits of the run.
    pub limits: Limits,
    /// Whether the firmware is meant to run for ever, so that the limit of virtual time counts as a success.
    pub runs_on: bool,
}

/// Runs one firmware alone on one board to its end, with the debugger on `connection`. The board is halted at power-on
/// until the debugger lets it run. The board's events are passed to `event`. An error of the connection is passed to
/// `lost`, and the run continues without a debugger.
///
/// Halts do not change the outcome of [`Target::run_connected`]; only a debugger that changes a register, memory or a
/// pin does.
///
/// # Errors
///
/// The errors are those of [`node::run`].
pub fn serve_alone<T>(
    alone: Alone<'_>,
    connection: T,
    event: &mut dyn FnMut(Event<'_>),
    lost: &mut dyn FnMut(String),
) -> Result<Ended<node::Outcome>, node::Error>
where
    T: ConnectionExt,
    T::Error: std::fmt::Display,
{
    match alone.clock {
        Clock::Fast => serve_alone_on::<Fast, T>(alone, connection, event, lost),
        Clock::Optimistic => serve_alone_on::<Optimistic, T>(alone, connection, event, lost),
        Clock::Pessimistic => serve_alone_on::<Pessimistic, T>(alone, connection, event, lost),
    }
}

fn serve_alone_on<C: Cost, T>(
    alone: Alone<'_>,
    connection: T,
    event: &mut dyn FnMut(Event<'_>),
    lost: &mut dyn FnMut(String),
) -> Result<Ended<node::Outcome>, node::Error>
where
    T: ConnectionExt,
    T::Error: std::fmt::Display,
{
    let Alone { target, firmware, connected, limits, runs_on, .. } = alone;
    match target {
        Target::Dpr => {
            let run = Running::<_, C>::new(Nrf52840::new(Settings::default()), firmware, connected, limits)?;
            serve_solo(Solo { run, side: Side::Dpr, runs_on, event }, connection, lost)
        }
        Target::Horus => {
            let run = Running::<_, C>::new(
                Stm32f429::new(Oscillators::default()).with_brown_out_level_3(),
                firmware,
                connected,
                limits,
            )?;
            serve_solo(Solo { run, side: Side::Horus, runs_on, event }, connection, lost)
        }
    }
}

fn serve_solo<P: Part, C: Cost, T>(
    mut solo: Solo<'_, P, C>,
    connection: T,
    lost: &mut dyn FnMut(String),
) -> Result<Ended<node::Outcome>, node::Error>
where
    T: ConnectionExt,
    T::Error: std::fmt::Display,
{
    solo.node().halt_at_end(true);
    Ok(match attended(solo, connection, lost)? {
        Left::Over(solo) => Ended::Finished(Box::new(solo.run.finish())),
        Left::Killed(at) => Ended::Killed(at),
    })
}

enum Left<W> {
    Over(W),
    /// The debugger ended the run at this instant, virtual ns.
    Killed(u64),
}

/// Serves the debugger at the board of `world` until the debugger disconnects, then runs `world` to its end.
fn attended<W: World, T>(world: W, connection: T, lost: &mut dyn FnMut(String)) -> Result<Left<W>, W::Error>
where
    T: ConnectionExt,
    T::Error: std::fmt::Display,
{
    let mut debuggee = Debuggee::new(world);
    match GdbStub::new(connection).run_blocking::<Loop<W, T>>(&mut debuggee) {
        Ok(DisconnectReason::Kill) => return Ok(Left::Killed(debuggee.world.now())),
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
    while !debuggee.world.is_over() {
        debuggee.go()?;
    }
    Ok(Left::Over(debuggee.world))
}

/// The event loop of the gdb server, which waits for a halt of the board and for a message of gdb.
struct Loop<W, T>(PhantomData<(W, T)>);

impl<W: World, T: ConnectionExt> BlockingEventLoop for Loop<W, T> {
    type Target = Debuggee<W>;
    type Connection = T;
    type StopReason = SingleThreadStopReason<u32>;

    fn wait_for_stop_reason(
        target: &mut Debuggee<W>,
        connection: &mut T,
    ) -> Result<Incoming<Self::StopReason>, WaitForStopReasonError<W::Error, T::Error>> {
        loop {
            if connection.peek().map_err(WaitForStopReasonError::Connection)?.is_some() {
                let byte = connection.read().map_err(WaitForStopReasonError::Connection)?;
                return Ok(Incoming::IncomingData(byte));
            }
            if let Some(reason) = target.go().map_err(WaitForStopReasonError::Target)? {
                return Ok(Incoming::TargetStopped(reason));
            }
        }
    }

    fn on_interrupt(target: &mut Debuggee<W>) -> Result<Option<Self::StopReason>, W::Error> {
        Ok(Some(target.interrupt()))
    }
}
