//! Restarts of a part, and changes of its supply.

use cortex_m4::Cost;
use emulator_part::{Part, Reset, Supplied};

use super::{Board, FindingKind, Node};

/// A restart of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResetAt {
    /// The instant of the restart, in virtual nanoseconds.
    pub at: u64,
    /// The cause of the restart.
    pub cause: Reset,
}

impl ResetAt {
    /// The cause in words that can follow "restarted".
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

/// The cause of a restart from outside the part, see [`Node::restart`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FromOutside {
    /// The reset pin was pulled low for a moment. RAM keeps its contents.
    Pin,
    /// The supply came on. RAM holds noise that follows from the seed.
    PowerOn(u64),
    /// The supply fell below the brown-out threshold and came back. RAM keeps its contents, which is the harder case
    /// for firmware.
    BrownOut,
    /// The watchdog reset the part. RAM keeps its contents.
    Watchdog,
    /// A debugger reset the part through the part's own access port, with the effect of AIRCR.SYSRESETREQ.
    SoftReset,
}

impl<B: Board, C: Cost> Node<B, C> {
    /// Restarts the part from outside. The part's reset flags and [`Node::resets`] show the cause. A part without
    /// supply can only be restarted by a power-on.
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

    /// Switches the part's supply off. The core executes nothing, and its pins are not driven until [`Node::power_on`].
    /// The board's chips go on, because the caller decides whether they have a supply. A part that is off stays off.
    pub fn power_off(&mut self) {
        if !self.powered {
            return;
        }
        let at = self.present();
        // The log is read now, because the firmware's last lines cannot be read afterwards.
        self.probe_log(self.now());
        self.powered = false;
        // Without a supply the part is put into its state at power-on, in which all pins are open.
        self.side.with(at, |part, view| part.reset(at, Reset::PowerOn, view));
        self.side.reset = None;
        self.side.settle(at);
        self.core.reset(&mut self.side);
        self.note_power();
    }

    /// Switches the part's supply on. RAM holds noise that follows from `seed`, and flash is unchanged.
    /// [`Node::resets`] lists the start as [`Reset::PowerOn`]. If the part is on, its supply is taken to have been off
    /// for no time.
    pub fn power_on(&mut self, seed: u64) {
        self.powered = true;
        self.side.stirred = true;
        self.reset_by(Reset::PowerOn);
        self.come_up(seed, 1);
        self.note_power();
    }

    /// Sets the part's supply to `microvolts`. A supply that holds the part in reset counts as off. When the supply
    /// returns, RAM has kept everything if the voltage stayed above 1.4 V, and nothing if it fell below 0.4 V. In
    /// between RAM keeps some pieces of eight bytes (assumed, since no data sheet says). `seed` decides what is lost,
    /// and what goes wrong at a voltage too low for the part.
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

    /// Returns whether the part has warned its firmware of a falling supply since the last call.
    pub fn take_supply_warning(&mut self) -> bool {
        self.side.part.take_supply_warning()
    }

    /// Makes the core execute nothing and take no interrupt until the part is reset, see [`cortex_m4::Core::hang`]. The
    /// watchdog may reset it, because the firmware no longer feeds it. A part without supply is not affected.
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

    #[inline(never)]
    pub(super) fn reset_by(&mut self, cause: Reset) {
        let at = self.present();
        // The log is read before start-up code clears its buffer.
        self.probe_log(self.now());
        self.resets.push(ResetAt { at: self.now(), cause });
        self.side.with(at, |part, view| part.reset(at, cause, view));
        self.side.reset = None;
        self.side.settle(at);
        self.core.reset(&mut self.side);
        // The models are told again whether the core is halted, because a restart makes some of them anew, and a new
        // model assumes that the core runs.
        self.told_halt = self.told_halt && !self.core.is_halted();
        self.tell_halt();
        let unfinished = self.log.finish(self.now());
        self.lines.extend(unfinished);
        self.clear_log();
        // A fault may happen again after the restart, and must then be reported again.
        self.reported.retain(|(kind, _)| *kind != FindingKind::HardFault && *kind != FindingKind::UnhandledInterrupt);
        self.arm();
        self.hold_after_reset();
    }

    /// Fills one in `one_in` pieces of eight bytes of RAM with noise that follows from `seed` (SplitMix64).
    #[inline(never)]
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

    /// All restarts of the part so far.
    #[must_use]
    pub fn resets(&self) -> &[ResetAt] {
        &self.resets
    }
}
