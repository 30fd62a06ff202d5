//! The watchdogs of the boards' images, which no halt stops: what keeps them from resetting a board that a probe holds.
//!
//! Both images start a watchdog of 100 ms with their first instructions, and it counts on while the core is halted. The
//! library attaches, and then brings its flash algorithm into RAM, with the core halted for about as long, so that the
//! watchdog bites in between. The core then runs the image again behind the library's back: a step that it asks for
//! never ends, and it reports a time-out.
//!
//! | part | what is done | why |
//! |---|---|---|
//! | nRF52840 | fed in our halts and resets | soft resets do not end it; it cannot be stopped (PS v1.7, WDT) |
//! | STM32F429 | DBGMCU stops it in the first halt | a reset ends it; the image clears the bit (RM0090, 38.16.4) |
//!
//! Halting comes first, since an image that runs, or one half written that nothing feeds, would undo the rest.

use std::sync::Arc;

use anyhow::{Result, bail};
use probe_rs::architecture::arm::memory::ArmMemoryInterface;
use probe_rs::architecture::arm::sequences::ArmDebugSequence;
use probe_rs::architecture::arm::{ArmDebugInterface, ArmError, FullyQualifiedApAddress};
use probe_rs::config::{DebugSequence, Registry};
use probe_rs::{Core, CoreType, MemoryInterface, Permissions, Target};

use super::DHCSR;
use crate::Board;
use crate::access::chip;

/// DHCSR: its key with C_HALT and C_DEBUGEN, and S_HALT (ARMv7-M ARM C1.6.2).
const HALT: u32 = 0xA05F_0003;
const S_HALT: u32 = 1 << 17;

/// WDT.RR[0] to RR[7] of the nRF52840, and what reloads it. Those that are not enabled take it for nothing.
const RELOAD: u64 = 0x4001_0600;
const RELOADS: [u32; 8] = [0x6E52_4635; 8];

/// DBGMCU_APB1_FZ of the STM32F429, and DBG_IWDG_STOP.
const APB1_FREEZE: u64 = 0xE004_2008;
const IWDG_STOP: u32 = 1 << 12;

/// How often the core is halted anew because the watchdog was just biting: twice in a row is 100 ms apart.
const HALTS: usize = 3;

/// The board's part as the library knows it, with the watchdog seen to.
pub(super) fn target(board: Board) -> Result<Target> {
    let mut target = Registry::from_builtin_families().get_target_by_name(chip(board))?;
    let DebugSequence::Arm(library) = target.debug_sequence else { bail!("{} is no Arm part", chip(board)) };
    target.debug_sequence = DebugSequence::Arm(Arc::new(Watched { board, library }));
    Ok(target)
}

/// Feeds an nRF52840's watchdog.
pub(super) fn feed(core: &mut Core<'_>) -> Result<(), probe_rs::Error> {
    core.write_32(RELOAD, &RELOADS)
}

/// The library's sequence for a part, between whose steps the watchdog is seen to. What the library has of its own for
/// either part is passed on to it; everything else is the default of both.
#[derive(Debug)]
struct Watched {
    board: Board,
    library: Arc<dyn ArmDebugSequence>,
}

impl Watched {
    fn see_to(&self, memory: &mut dyn ArmMemoryInterface) -> Result<(), ArmError> {
        match self.board {
            Board::Dpr => memory.write_32(RELOAD, &RELOADS),
            Board::Horus => {
                let stopped = memory.read_word_32(APB1_FREEZE)?;
                memory.write_word_32(APB1_FREEZE, stopped | IWDG_STOP)
            }
        }
    }
}

impl ArmDebugSequence for Watched {
    fn debug_device_unlock(
        &self,
        interface: &mut dyn ArmDebugInterface,
        default_ap: &FullyQualifiedApAddress,
        permissions: &Permissions,
    ) -> Result<(), ArmError> {
        self.library.debug_device_unlock(interface, default_ap, permissions)
    }

    /// The core stays halted from here on until it is let run, instead of for a part of the library's attaching.
    fn debug_core_start(
        &self,
        interface: &mut dyn ArmDebugInterface,
        core_ap: &FullyQualifiedApAddress,
        core_type: CoreType,
        debug_base: Option<u64>,
        cti_base: Option<u64>,
    ) -> Result<(), ArmError> {
        self.library.debug_core_start(interface, core_ap, core_type, debug_base, cti_base)?;
        let mut memory = interface.memory_interface(core_ap)?;
        for _ in 0..HALTS {
            memory.write_word_32(DHCSR, HALT)?;
            self.see_to(&mut *memory)?;
            // A reset in between lets the core run.
            if memory.read_word_32(DHCSR)? & S_HALT != 0 {
                return Ok(());
            }
        }
        Err(ArmError::Timeout)
    }

    /// The last that happens between a reset with the core halted and what the library or we then do with it.
    fn reset_catch_clear(
        &self,
        core: &mut dyn ArmMemoryInterface,
        core_type: CoreType,
        debug_base: Option<u64>,
    ) -> Result<(), ArmError> {
        self.library.reset_catch_clear(core, core_type, debug_base)?;
        match self.board {
            Board::Dpr => core.write_32(RELOAD, &RELOADS),
            // The reset ended it.
            Board::Horus => Ok(()),
        }
    }

    fn debug_core_stop(&self, memory: &mut dyn ArmMemoryInterface, core_type: CoreType) -> Result<(), ArmError> {
        self.library.debug_core_stop(memory, core_type)
    }
}
