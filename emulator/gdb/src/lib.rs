//! A gdb server for one board.
//!
//! [`serve`] runs a [`World`] with a board in it. A debugger is connected to that board. The debugger uses gdb's remote
//! protocol over any connection. If the debugger halts the board, everything else in the world halts too
//! ([`emulator_node::Halt`]). Nothing moves and no watchdog time passes meanwhile, so inspection does not change the
//! run's outcome.
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
//! | `monitor help` | virtual time, pins, reset, and what the world adds |
//!
//! A firmware that runs alone halts with SIGSEGV at the instruction that ends it: in a HardFault, in an exception
//! without a handler, or in a lock-up. When the debugger continues after that, gdb gets the exit status of the
//! run ([`emulator_node::Outcome::status`]).
//!
//! The erase of gdb's `load` (writes change flash directly, without a flash controller), reverse execution, and
//! debugging of several boards at a time are not available.

#![forbid(unsafe_code)]

mod arch;
mod monitor;
mod target;
mod wait;

use std::marker::PhantomData;

use emulator_node::AnyNode;
use gdbstub::conn::ConnectionExt;
use gdbstub::stub::run_blocking::{BlockingEventLoop, Event as Incoming, WaitForStopReasonError};
use gdbstub::stub::{DisconnectReason, GdbStub, SingleThreadStopReason};

use target::Debuggee;
pub use wait::{PORT, say_killed, say_lost, wait};

/// A run of which one board has a debugger connected.
pub trait World {
    /// The failure of a run.
    type Error: std::fmt::Display;

    /// The board with the debugger.
    fn node(&mut self) -> &mut dyn AnyNode;

    /// Runs until the board halts, for at most 10 ms of virtual time, or to the end of the run.
    ///
    /// # Errors
    ///
    /// The run has failed.
    fn go(&mut self) -> Result<(), Self::Error>;

    /// Whether the run is over.
    fn is_over(&self) -> bool;

    /// The exit status of the run so far, which gdb shows at the end.
    fn status(&mut self) -> u8;

    /// The end of the run, virtual ns; `u64::MAX` if it is not known.
    fn end(&self) -> u64;

    /// The instant, virtual ns, that all boards of the run have reached.
    fn now(&mut self) -> u64;

    /// Pulls the board's reset pin low and releases it.
    fn pull_reset(&mut self);

    /// The lines of `monitor help` about the commands of [`World::monitor`].
    const HELP: &'static str = "";

    /// Carries out a command of gdb's `monitor` that only this world has. Returns a message for the user; `None` if the
    /// command is another one.
    fn monitor(&mut self, words: &[&str]) -> Option<String> {
        let _ = words;
        None
    }
}

/// The end of a run with a debugger; `O` is the run's outcome.
#[derive(Debug)]
pub enum Ended<O> {
    /// The run reached its end and had this outcome.
    Finished(Box<O>),
    /// The debugger ended the run at this instant, virtual ns.
    Killed(u64),
}

/// Serves the debugger on `connection` until it disconnects, then runs `world` to its end and returns it. The board is
/// halted until the debugger lets it run. An error of the connection is passed to `lost`, and the run continues without
/// a debugger.
///
/// # Errors
///
/// The errors are those of [`World::go`].
pub fn serve<W: World, T>(world: W, connection: T, lost: &mut dyn FnMut(String)) -> Result<Ended<W>, W::Error>
where
    T: ConnectionExt,
    T::Error: std::fmt::Display,
{
    let mut debuggee = Debuggee::new(world);
    match GdbStub::new(connection).run_blocking::<Loop<W, T>>(&mut debuggee) {
        Ok(DisconnectReason::Kill) => return Ok(Ended::Killed(debuggee.world.now())),
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
    Ok(Ended::Finished(Box::new(debuggee.world)))
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
