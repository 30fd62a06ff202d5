//! Keeps a firmware's watchdog from resetting a board while a probe uses the board. A halt of the core does not stop
//! the watchdog.
//!
//! Both firmwares begin with the start of a watchdog of 100 ms. The library halts the core for about that time when it
//! attaches, and when it loads its flash algorithm. A reset by the watchdog would let the firmware run again during
//! such a step, which would then end with a time-out.
//!
//! | part | measure | reason |
//! |---|---|---|
//! | nRF52840 | fed between the probe's transfers ([`fed`]) | soft resets do not end it, nothing stops it (PS v1.7) |
//! | STM32F429 | a halt stops it (DBG_IWDG_STOP) | a reset ends it; HORUS clears that bit (RM0090, 38.16.4) |
//!
//! The core is halted before the watchdog is handled, because a running or half-written firmware would undo what is
//! done to the watchdog.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Result, bail};
use probe_rs::architecture::arm::memory::ArmMemoryInterface;
use probe_rs::architecture::arm::sequences::ArmDebugSequence;
use probe_rs::architecture::arm::{
    ArmCommunicationInterface, ArmDebugInterface, ArmError, DapProbe, FullyQualifiedApAddress, RawDapAccess,
    RegisterAddress,
};
use probe_rs::config::{DebugSequence, Registry};
use probe_rs::probe::{DebugProbe, DebugProbeError, WireProtocol};
use probe_rs::{CoreStatus, CoreType, Permissions, Target};

use super::DHCSR;
use crate::Board;
use crate::access::chip;

/// The value of DHCSR that halts the core: the key, C_HALT and C_DEBUGEN (ARMv7-M ARM C1.6.2).
const HALT: u32 = 0xA05F_0003;
/// S_HALT of DHCSR, set while the core is halted.
const S_HALT: u32 = 1 << 17;

/// The address of the nRF52840's `WDT.RR[0]`, the register that the firmware has enabled.
const RELOAD: u32 = 0x4001_0600;
/// The value of `WDT.RR[0]` that reloads the watchdog.
const RELOADED: u32 = 0x6E52_4635;

/// The address of the STM32F429's DBGMCU_APB1_FZ.
const APB1_FREEZE: u64 = 0xE004_2008;
/// DBG_IWDG_STOP of DBGMCU_APB1_FZ, which stops the watchdog while the core is halted.
const IWDG_STOP: u32 = 1 << 12;

/// How often to try to halt the core. An attempt fails if the watchdog resets the core during it. Two such resets are
/// 100 ms apart.
const HALTS: usize = 3;

pub(super) fn target(board: Board) -> Result<Target> {
    let mut target = Registry::from_builtin_families().get_target_by_name(chip(board))?;
    let DebugSequence::Arm(library) = target.debug_sequence else { bail!("{} is no Arm part", chip(board)) };
    target.debug_sequence = DebugSequence::Arm(Arc::new(Watched { board, library }));
    Ok(target)
}

/// Makes the probe feed an nRF52840's watchdog between its transfers. Returns the probe, and the handle that ends the
/// feeding. A probe without single transfers is returned unchanged.
pub(super) fn fed(mut probe: Box<dyn DebugProbe>) -> (Box<dyn DebugProbe>, Feeding) {
    let feeding = Feeding(Arc::new(AtomicBool::new(true)));
    if probe.try_as_dap_probe().is_none() {
        return (probe, feeding);
    }
    (Box::new(Fed { probe, feeding: feeding.clone(), select: None, is_word: false, passed: 0 }), feeding)
}

/// Whether the watchdog is fed. The feeding must end before the firmware runs without the library.
#[derive(Clone, Debug, Default)]
pub(super) struct Feeding(Arc<AtomicBool>);

impl Feeding {
    pub(super) fn end(&self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

/// The address of CSW in bank 0 of the AHB-AP, by address bits A\[3:2\] (ADIv5.2 C2.6).
const CSW: u8 = 0x0;
/// TAR of the AHB-AP in its bank 0.
const TAR: u8 = 0x4;
/// DRW of the AHB-AP in its bank 0.
const DRW: u8 = 0xC;
/// SELECT of the debug port (ADIv5.2 B2.2).
const SELECT: u8 = 0x8;

/// The bits of CSW that hold the size of accesses.
const SIZE: u32 = 7;
/// The value of [`SIZE`] for accesses of a word.
const WORD: u32 = 2;

/// The number of writes of TAR from one feeding of the watchdog to the next. Each write comes with one or more
/// transfers of data. With 1 ms for a command, 40 ms to 100 ms pass between two feedings.
const FEED_EVERY: u32 = 16;

/// A probe that feeds the watchdog just before the library writes TAR of the AHB-AP, so that TAR need not be restored.
#[derive(Debug)]
struct Fed {
    probe: Box<dyn DebugProbe>,
    feeding: Feeding,
    /// The last value of SELECT, with the access port and its bank.
    select: Option<u32>,
    is_word: bool,
    passed: u32,
}

impl Fed {
    fn dap(&mut self) -> &mut dyn DapProbe {
        self.probe.try_as_dap_probe().expect("asked when it was made")
    }

    fn writes(&mut self, address: RegisterAddress, value: u32) -> Result<(), ArmError> {
        let register = address.a2_and_3();
        match (address.is_ap(), register) {
            (false, SELECT) => self.select = Some(value),
            (true, CSW) if self.select == Some(0) => self.is_word = value & SIZE == WORD,
            (true, TAR) if self.select == Some(0) && self.is_word && self.feeding.0.load(Ordering::Relaxed) => {
                self.passed += 1;
                if self.passed >= FEED_EVERY {
                    self.passed = 0;
                    self.dap().raw_write_register(address, RELOAD)?;
                    return self.dap().raw_write_register(RegisterAddress::ApRegister(DRW), RELOADED);
                }
            }
            _ => {}
        }
        Ok(())
    }
}

impl RawDapAccess for Fed {
    fn raw_read_register(&mut self, address: RegisterAddress) -> Result<u32, ArmError> {
        self.dap().raw_read_register(address)
    }

    fn raw_read_block(&mut self, address: RegisterAddress, values: &mut [u32]) -> Result<(), ArmError> {
        self.dap().raw_read_block(address, values)
    }

    fn raw_write_register(&mut self, address: RegisterAddress, value: u32) -> Result<(), ArmError> {
        self.writes(address, value)?;
        self.dap().raw_write_register(address, value)
    }

    fn raw_write_block(&mut self, address: RegisterAddress, values: &[u32]) -> Result<(), ArmError> {
        self.dap().raw_write_block(address, values)
    }

    fn raw_flush(&mut self) -> Result<(), ArmError> {
        self.dap().raw_flush()
    }

    fn configure_jtag(&mut self, skip_scan: bool) -> Result<(), DebugProbeError> {
        self.dap().configure_jtag(skip_scan)
    }

    fn jtag_sequence(&mut self, cycles: u8, tms: bool, tdi: u64) -> Result<(), DebugProbeError> {
        self.dap().jtag_sequence(cycles, tms, tdi)
    }

    fn swj_sequence(&mut self, bit_len: u8, bits: u64) -> Result<(), DebugProbeError> {
        self.dap().swj_sequence(bit_len, bits)
    }

    fn swj_pins(&mut self, pin_out: u32, pin_select: u32, pin_wait: u32) -> Result<u32, DebugProbeError> {
        self.dap().swj_pins(pin_out, pin_select, pin_wait)
    }

    fn into_probe(self: Box<Self>) -> Box<dyn DebugProbe> {
        self
    }

    fn core_status_notification(&mut self, state: CoreStatus) -> Result<(), DebugProbeError> {
        self.dap().core_status_notification(state)
    }
}

impl DapProbe for Fed {}

impl DebugProbe for Fed {
    fn get_name(&self) -> &str {
        self.probe.get_name()
    }

    fn speed_khz(&self) -> u32 {
        self.probe.speed_khz()
    }

    fn set_speed(&mut self, speed_khz: u32) -> Result<u32, DebugProbeError> {
        self.probe.set_speed(speed_khz)
    }

    fn attach(&mut self) -> Result<(), DebugProbeError> {
        self.probe.attach()
    }

    fn detach(&mut self) -> Result<(), probe_rs::Error> {
        self.probe.detach()
    }

    fn target_reset(&mut self) -> Result<(), DebugProbeError> {
        self.probe.target_reset()
    }

    fn target_reset_assert(&mut self) -> Result<(), DebugProbeError> {
        self.probe.target_reset_assert()
    }

    fn target_reset_deassert(&mut self) -> Result<(), DebugProbeError> {
        self.probe.target_reset_deassert()
    }

    fn select_protocol(&mut self, protocol: WireProtocol) -> Result<(), DebugProbeError> {
        self.probe.select_protocol(protocol)
    }

    fn active_protocol(&self) -> Option<WireProtocol> {
        self.probe.active_protocol()
    }

    fn has_arm_interface(&self) -> bool {
        true
    }

    fn try_get_arm_debug_interface<'probe>(
        self: Box<Self>,
        sequence: Arc<dyn ArmDebugSequence>,
    ) -> Result<Box<dyn ArmDebugInterface + 'probe>, (Box<dyn DebugProbe>, ArmError)> {
        Ok(ArmCommunicationInterface::create(self, sequence, false))
    }

    fn into_probe(self: Box<Self>) -> Box<dyn DebugProbe> {
        self
    }

    fn try_as_dap_probe(&mut self) -> Option<&mut dyn DapProbe> {
        Some(self)
    }
}

/// The library's steps for a chip, with the care for the watchdog between them.
#[derive(Debug)]
struct Watched {
    board: Board,
    library: Arc<dyn ArmDebugSequence>,
}

impl Watched {
    fn see_to(&self, memory: &mut dyn ArmMemoryInterface) -> Result<(), ArmError> {
        match self.board {
            Board::Dpr => memory.write_word_32(RELOAD.into(), RELOADED),
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

    /// Keeps the core halted from this step on until it is started.
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
            // A reset may have come after the request to halt the core.
            if memory.read_word_32(DHCSR)? & S_HALT != 0 {
                return Ok(());
            }
        }
        Err(ArmError::Timeout)
    }

    fn debug_core_stop(&self, memory: &mut dyn ArmMemoryInterface, core_type: CoreType) -> Result<(), ArmError> {
        self.library.debug_core_stop(memory, core_type)
    }
}
