//! The targets of a debugger: a board of the running link, or a board that runs one firmware alone.

use std::fmt::Write as _;

use bench_judge::Board as Side;
use cortex_m4::{Cost, Register, Watchpoint};
use emulator_part::{Part, Pin};

use crate::faults::plan::LAST_BEFORE_END;
use crate::faults::{Episode, Fault, Faults, Kind, PowerFault};
use crate::sim::{self, Debugged, Observer};
use emulator_node::{self as node, Event, FromOutside, Halt, Node, Resume, Running};

pub(super) trait Debuggable {
    fn register(&self, register: Register) -> u32;
    fn set_register(&mut self, register: Register, value: u32);
    fn peek(&self, address: u32, to: &mut [u8]) -> usize;
    fn poke(&mut self, address: u32, from: &[u8]) -> Result<(), node::Error>;
    fn halted(&self) -> Option<Halt>;
    fn halt(&mut self);
    fn resume(&mut self, how: Resume);
    fn set_breakpoint(&mut self, address: u32);
    fn clear_breakpoint(&mut self, address: u32);
    fn set_watchpoint(&mut self, watchpoint: Watchpoint);
    fn clear_watchpoint(&mut self, watchpoint: Watchpoint) -> bool;
    fn halt_after_reset(&mut self, on: bool);
    fn halt_at_end(&mut self, on: bool);
    fn now(&self) -> u64;
    fn instructions(&self) -> u64;
    fn doing(&self) -> String;
    fn pin(&self, pin: Pin) -> bool;
    fn drive(&mut self, pin: Pin, level: Option<bool>);
}

impl<B: node::Board, C: Cost> Debuggable for Node<B, C> {
    fn register(&self, register: Register) -> u32 {
        self.core_register(register)
    }

    fn set_register(&mut self, register: Register, value: u32) {
        self.set_core_register(register, value);
    }

    fn peek(&self, address: u32, to: &mut [u8]) -> usize {
        self.peek(address, to)
    }

    fn poke(&mut self, address: u32, from: &[u8]) -> Result<(), node::Error> {
        self.poke(address, from)
    }

    fn halted(&self) -> Option<Halt> {
        self.halted()
    }

    fn halt(&mut self) {
        self.halt();
    }

    fn resume(&mut self, how: Resume) {
        self.resume(how);
    }

    fn set_breakpoint(&mut self, address: u32) {
        self.set_breakpoint(address);
    }

    fn clear_breakpoint(&mut self, address: u32) {
        self.clear_breakpoint(address);
    }

    fn set_watchpoint(&mut self, watchpoint: Watchpoint) {
        self.set_watchpoint(watchpoint);
    }

    fn clear_watchpoint(&mut self, watchpoint: Watchpoint) -> bool {
        self.clear_watchpoint(watchpoint)
    }

    fn halt_after_reset(&mut self, on: bool) {
        self.halt_after_reset(on);
    }

    fn halt_at_end(&mut self, on: bool) {
        self.halt_at_end(on);
    }

    fn now(&self) -> u64 {
        self.now()
    }

    fn instructions(&self) -> u64 {
        self.instructions()
    }

    fn doing(&self) -> String {
        self.doing()
    }

    fn pin(&self, pin: Pin) -> bool {
        self.pin(pin)
    }

    fn drive(&mut self, pin: Pin, level: Option<bool>) {
        self.drive(pin, level);
    }
}

pub(super) trait World {
    type Error: std::fmt::Display;

    fn side(&self) -> Side;

    fn node(&mut self) -> &mut dyn Debuggable;

    /// Runs until the board halts, for at most 10 ms of virtual time, or to the end of the run.
    fn go(&mut self) -> Result<(), Self::Error>;

    fn is_over(&self) -> bool;

    fn status(&mut self) -> u8;

    fn end(&self) -> u64;

    /// The instant, virtual ns, that all boards of the run have reached.
    fn now(&mut self) -> u64;

    fn pull_reset(&mut self);

    /// The line of `monitor help` that describes `monitor faults`.
    const FAULTS_HELP: &'static str;

    /// Adds faults of the kinds in `list` from now on and returns a message for the user.
    fn faults(&mut self, list: &str) -> String;
}

pub(super) struct Link<'a, C: Cost> {
    pub(super) run: Debugged<C>,
    pub(super) side: Side,
    pub(super) observer: &'a mut dyn Observer,
    pub(super) gps: usize,
    pub(super) seed: u64,
}

impl<C: Cost> World for Link<'_, C> {
    type Error = sim::Error;

    const FAULTS_HELP: &'static str = "\
monitor faults LIST             what goes wrong from now on, drawn from the seed as --faults does:
                                of air, gnss, fc, power, buffers, inputs, hang
";

    fn side(&self) -> Side {
        self.side
    }

    fn node(&mut self) -> &mut dyn Debuggable {
        match self.side {
            Side::Horus => self.run.horus(),
            Side::Dpr => self.run.dpr(),
        }
    }

    fn go(&mut self) -> Result<(), sim::Error> {
        self.run.run(self.observer).map(drop)
    }

    fn is_over(&self) -> bool {
        self.run.is_over()
    }

    fn status(&mut self) -> u8 {
        0
    }

    fn end(&self) -> u64 {
        self.run.end()
    }

    fn now(&mut self) -> u64 {
        self.run.now()
    }

    /// The reset is injected as a fault, so the event log shows it.
    fn pull_reset(&mut self) {
        let now = self.node().now();
        let fault = Fault::Power(self.side, PowerFault::Pin);
        self.run.add_faults(&Faults::none().with(now, now, fault));
    }

    fn faults(&mut self, list: &str) -> String {
        let kinds: Result<Vec<Kind>, _> = list.split(',').map(str::parse).collect();
        let kinds = match kinds {
            Ok(kinds) => kinds,
            Err(error) => return format!("{error}\n"),
        };
        if let Some(upset) = kinds.iter().find(|kind| kind.is_upset()) {
            return format!(
                "{upset}: upsets are tried on copies of the bench, by `cargo xtask sim --faults {upset}`\n"
            );
        }
        let now = self.run.now();
        let left = self.run.end().saturating_sub(now);
        let drawn = Faults::drawn(&kinds, self.gps, self.seed, left);
        let mut faults = Faults::none();
        for Episode { at, until, fault } in drawn.episodes().iter().cloned() {
            faults.add(Episode { at: now + at, until: until.saturating_add(now), fault });
        }
        self.run.add_faults(&faults);
        let mut text = format!("{} episodes from now to the end\n", faults.episodes().len());
        for Episode { at, fault, .. } in faults.episodes() {
            let _ = writeln!(text, "{:>12.3} ms  {}", *at as f64 / 1e6, fault.name());
        }
        if faults.episodes().is_empty() {
            let _ = writeln!(
                text,
                "too little of the run is left: none lasts into its last {} ms",
                LAST_BEFORE_END / 1_000_000
            );
        }
        text
    }
}

pub(super) struct Solo<'a, P: Part, C: Cost> {
    pub(super) run: Running<P, C>,
    pub(super) side: Side,
    /// Whether the firmware is meant to run for ever, so that the limit of virtual time counts as a success.
    pub(super) runs_on: bool,
    pub(super) event: &'a mut dyn FnMut(Event<'_>),
}

impl<P: Part, C: Cost> World for Solo<'_, P, C> {
    type Error = node::Error;

    const FAULTS_HELP: &'static str = "";

    fn side(&self) -> Side {
        self.side
    }

    fn node(&mut self) -> &mut dyn Debuggable {
        self.run.node()
    }

    fn go(&mut self) -> Result<(), node::Error> {
        if !self.run.is_over() {
            self.run.go(self.event);
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.run.is_over()
    }

    fn status(&mut self) -> u8 {
        self.run.status(self.runs_on).try_into().unwrap_or(1)
    }

    fn end(&self) -> u64 {
        self.run.end()
    }

    fn now(&mut self) -> u64 {
        self.run.node().now()
    }

    fn pull_reset(&mut self) {
        self.run.node().restart(FromOutside::Pin);
    }

    fn faults(&mut self, _: &str) -> String {
        "this board is alone: faults are of the link, at which `cargo xtask gdb` is\n".to_owned()
    }
}
