//! Restarts of a part, and its supply.

use cortex_m4::Cost;
use emulator_part::{Part, Reset, Supplied};

use super::{Board, FindingKind, Node};

/// A restart of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResetAt {
    /// When, in virtual nanoseconds.
    pub at: u64,
    /// Why.
    pub cause: Reset,
}

impl ResetAt {
    /// Why, in words that follow "restarted".
    #[must_use]
    pub fn why(&self) -> String {
        match self.cause {
            Reset::Software => "by software".to_owned(),
            Reset::Watchdog(name) => format!("by its watchdog {name}"),
            Reset::Lockup => "from a lock-up".to_owned(),
            Reset::Wakeup(name) => format!("waking up by {name}"),
            cause @ (Reset::PowerOn | Reset::BrownOut | Reset::Pin) => format!("{cause:?}"),
        }
    }
}

/// What restarts a part from outside, see [`Node::restart`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FromOutside {
    /// Its reset pin was pulled low for a moment. RAM keeps its contents.
    Pin,
    /// Its supply came on. RAM holds what it came up with: noise that follows from the seed.
    PowerOn(u64),
    /// Its supply dipped below the brown-out threshold. RAM keeps its contents, which is the harder case for a
    /// firmware.
    BrownOut,
    /// Its watchdog bit, whatever the firmware did. RAM keeps its contents.
    Watchdog,
    /// A debugger resets it through the part's own access port, as by AIRCR.SYSRESETREQ.
    SoftReset,
}

impl<B: Board, C: Cost> Node<B, C> {
    /// Restarts the part from outside, now. Its flags say why, as far as it has flags for it, and [`Node::resets`]
    /// lists it. A part whose supply is off begins with its power-on only.
    pub fn restart(&mut self, why: FromOutside) {
        match why {
            FromOutside::PowerOn(seed) => self.power_on(seed),
            FromOutside::Pin if self.powered => self.reset_by(Reset::Pin),
            FromOutside::BrownOut if self.powered => self.reset_by(Reset::BrownOut),
            FromOutside::Watchdog if self.powered => self.reset_by(Reset::Watchdog("of the board")),
            FromOutside::SoftReset if self.powered => self.reset_by(Reset::Software),
            FromOutside::Pin | FromOutside::BrownOut | FromOutside::Watchdog | FromOutside::SoftReset => {}
        }
    }

    /// The part's supply goes off, now: its core runs nothing and its pins let go until [`Node::power_on`]. Time goes
    /// on for the board, whose chips act as before: what becomes of them is the caller's to say. Does nothing to a part
    /// that is off.
    pub fn power_off(&mut self) {
        if !self.powered {
            return;
        }
        let at = self.present();
        // What the firmware logged last: nobody can read it afterwards.
        self.probe_log(self.now());
        self.powered = false;
        // Without a supply a part does what it does at power-on before its core begins: nothing, with all pins open.
        self.side.with(at, |part, view| part.reset(at, Reset::PowerOn, view));
        self.side.reset = None;
        self.side.settle(at);
        self.core.reset(&mut self.side);
        self.note_power();
    }

    /// The part's supply comes on, now. RAM holds noise that follows from `seed`, flash is as it was, and the part
    /// starts as [`Reset::PowerOn`] has it, which [`Node::resets`] lists. A part that is on was without its supply for
    /// no time.
    pub fn power_on(&mut self, seed: u64) {
        self.powered = true;
        self.side.stirred = true;
        self.reset_by(Reset::PowerOn);
        self.come_up(seed, 1);
        self.note_power();
    }

    /// The part's supply has `microvolts` from now on. Where that holds the part in reset its supply counts as off, and
    /// when it comes back RAM has what is left of it: all above 1.4 V, nothing below 0.4 V, and in between of each
    /// eight bytes all or nothing (assumed: no data sheet says). What is lost, and what goes wrong at a voltage that is
    /// too low for what the part does, follows from `seed`.
    pub fn supply(&mut self, microvolts: u32, seed: u64) {
        let supplied = self.input(|part, view, at| part.supply(at, microvolts, seed, view));
        match supplied {
            Supplied::Enough => {}
            Supplied::HeldInReset => {
                self.lowest = if self.powered { microvolts } else { self.lowest.min(microvolts) };
                self.power_off();
            }
            Supplied::Restarts(cause) => {
                self.powered = true;
                self.side.stirred = true;
                self.reset_by(cause);
                match self.lowest {
                    1_400_000.. => {}
                    400_000.. => self.come_up(seed, 2),
                    _ => self.come_up(seed, 1),
                }
                self.note_power();
            }
        }
    }

    /// Whether the part has warned its firmware of a supply that falls, since this was last asked.
    pub fn take_supply_warning(&mut self) -> bool {
        self.side.part.take_supply_warning()
    }

    /// The core executes nothing and takes no interrupt from now on, as [`cortex_m4::Core::hang`] has it, until
    /// something resets the part: the watchdog that nobody feeds, if it runs. Everything else goes on. Does nothing to
    /// a part without its supply.
    pub fn hang(&mut self) {
        if self.powered {
            self.core.hang();
        }
    }

    /// Whether the core hangs, see [`Node::hang`].
    #[must_use]
    pub fn is_hung(&self) -> bool {
        self.core.is_hung()
    }

    /// Whether the part has its supply.
    #[must_use]
    pub fn is_powered(&self) -> bool {
        self.powered
    }

    pub(super) fn reset_by(&mut self, cause: Reset) {
        let at = self.present();
        // What the firmware logged last, before its start-up code clears the buffer.
        self.probe_log(self.now());
        self.resets.push(ResetAt { at: self.now(), cause });
        self.side.with(at, |part, view| part.reset(at, cause, view));
        self.side.reset = None;
        self.side.settle(at);
        self.core.reset(&mut self.side);
        // Some of the part's models are new and take the core for running, others are as they were.
        self.told_halt = self.told_halt && !self.core.is_halted();
        self.tell_halt();
        let unfinished = self.log.finish(self.now());
        self.lines.extend(unfinished);
        self.clear_log();
        // What the last start did, the next may do again.
        self.reported.retain(|(kind, _)| *kind != FindingKind::HardFault && *kind != FindingKind::UnhandledInterrupt);
        self.arm();
        self.hold_after_reset();
    }

    /// Fills RAM with noise that follows from `seed` (SplitMix64), as RAM comes up: one in so many pieces of eight
    /// bytes.
    fn come_up(&mut self, seed: u64, one_in: u64) {
        let mut state = seed;
        for (start, size) in B::Part::RAM {
            let Some(bytes) = self.side.part.memory_mut(*start, *size) else { continue };
            for chunk in bytes.chunks_mut(8) {
                state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
                let mut word = (state ^ state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
                word = (word ^ word >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
                let noise = (word ^ word >> 31).to_le_bytes();
                if (word >> 7).is_multiple_of(one_in) {
                    chunk.copy_from_slice(&noise[..chunk.len()]);
                }
            }
        }
        self.clear_log();
    }

    /// Every restart of the part so far.
    #[must_use]
    pub fn resets(&self) -> &[ResetAt] {
        &self.resets
    }
}
