//! A board of the bench behind a debug probe of the probe-rs library: `--probe bench`.
//!
//! The board, its debug port and its time are those of the bench ([`emulator_debug_port`]). Like a CMSIS-DAP probe,
//! this module converts the library's requests to transfers on the wires, each of which takes time. A file keeps the
//! board's non-volatile memory. Each command of xtask begins by switching the board on.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result};
use bench::desk::switch_on;
use emulator_debug_port::{Ack, Request, Wire};
use emulator_node::{Finding, FindingKind};
use probe_rs::CoreStatus;
use probe_rs::architecture::arm::sequences::ArmDebugSequence;
use probe_rs::architecture::arm::{
    ArmCommunicationInterface, ArmDebugInterface, ArmError, DapError, DapProbe, RawDapAccess, RegisterAddress,
};
use probe_rs::probe::{DebugProbe, DebugProbeError, WireProtocol};

use crate::Board;
use crate::bench_flash::{self, desk};

/// The time from a command to the probe's answer, ns: full-speed USB's frames are 1 ms apart (USB 2.0, 5.3.3).
const COMMAND_NS: u64 = 1_000_000;

/// The number of clocks of a transfer: request 8, turnaround 1, acknowledge 3, data 33, turnaround 1 (ADIv5.2 B4.1),
/// and two idle clocks.
const TRANSFER_CLOCKS: u64 = 48;

const DEFAULT_KHZ: u32 = 4_000;
/// The highest frequency of SWCLK that the nRF52840 allows, kHz (PS v1.7, 4.8.6).
const MOST_KHZ: u32 = 8_000;

/// The bit of nRESET among the pins of [`RawDapAccess::swj_pins`].
const RESET_PIN: u32 = 1 << 7;

/// The address at which both boards' RAM begins. The firmwares' code runs below that address, so only the probe puts
/// instructions above it.
const RAM: u64 = 0x2000_0000;

const READ_BUFFER: u8 = 0xC;

#[derive(Clone, Debug)]
pub(crate) struct BenchBoard(Arc<Mutex<Switched>>);

#[derive(Debug)]
struct Switched {
    wire: Box<dyn Wire>,
    file: PathBuf,
    unplugged_after: Option<u64>,
    commands: u64,
}

impl BenchBoard {
    pub(crate) fn switch_on(board: Board, file: PathBuf) -> Result<Self> {
        let kept = bench_flash::read(board, &file)?;
        let wire = switch_on(desk(board), kept.as_deref()).context("the board's flash has another size")?;
        Ok(Self(Arc::new(Mutex::new(Switched { wire, file, unplugged_after: None, commands: 0 }))))
    }

    pub(crate) fn probe(&self) -> Box<dyn DebugProbe> {
        let name = format!("bench ({})", self.with(|on| on.wire.part_name()));
        Box::new(BenchProbe { board: self.clone(), name, khz: DEFAULT_KHZ, protocol: None })
    }

    fn with<T>(&self, act: impl FnOnce(&mut Switched) -> T) -> T {
        // A poisoned lock is ignored: after a panic the board keeps its state, as a real board would.
        act(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    pub(crate) fn save(&self) -> Result<()> {
        self.with(Switched::save)
    }

    pub(crate) fn now(&self) -> u64 {
        self.with(|on| on.wire.now())
    }

    /// Returns the errors that the bench has found in the probe's accesses, and in code that the probe put into RAM,
    /// since the last call. Errors of the firmware are left out, because a debugger may stop the firmware at any point.
    pub(crate) fn take_findings(&self) -> Vec<String> {
        let found = self.with(|on| on.wire.take_findings());
        let is_ours = |finding: &&Finding| finding.kind != FindingKind::Lockup && finding.pc.is_none_or(|pc| pc >= RAM);
        found.iter().filter(is_ours).map(ToString::to_string).collect()
    }
}

#[cfg(test)]
impl BenchBoard {
    /// Makes a bit of flash read as `value` from now on, whatever is programmed there.
    pub(crate) fn stick_flash(&self, address: u32, bit: u8, value: bool) {
        assert!(self.with(|on| on.wire.stick_flash(address, bit, value)), "{address:#x} is flash");
    }

    pub(crate) fn unplug_after(&self, commands: u64) {
        self.with(|on| on.unplugged_after = Some(on.commands + commands));
    }

    pub(crate) fn plug_in(&self) {
        self.with(|on| on.unplugged_after = None);
    }

    pub(crate) fn switch_off_and_on(&self) {
        self.with(|on| {
            let board = if on.wire.part_name().starts_with("nRF") { Board::Dpr } else { Board::Horus };
            on.wire = switch_on(desk(board), Some(&on.wire.kept())).unwrap();
        });
    }

    pub(crate) fn commands(&self) -> u64 {
        self.with(|on| on.commands)
    }

    pub(crate) fn restarts(&self) -> Vec<String> {
        self.with(|on| on.wire.resets().iter().map(|reset| format!("{} {}", reset.at, reset.why())).collect())
    }

    pub(crate) fn run(&self, ns: u64) {
        self.with(|on| on.wire.pass(ns));
    }

    pub(crate) fn kept(&self) -> Vec<u8> {
        self.with(|on| on.wire.kept())
    }
}

impl Switched {
    fn save(&mut self) -> Result<()> {
        let folder = self.file.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).with_context(|| format!("could not make {}", folder.display()))?;
        std::fs::write(&self.file, self.wire.kept()).with_context(|| format!("could not write {}", self.file.display()))
    }

    fn command(&mut self) -> Result<(), DebugProbeError> {
        self.commands += 1;
        if self.unplugged_after.is_some_and(|after| self.commands > after) {
            let gone = std::io::Error::new(std::io::ErrorKind::NotConnected, "the probe was unplugged");
            return Err(DebugProbeError::Usb(gone));
        }
        self.wire.pass(COMMAND_NS);
        Ok(())
    }
}

impl Drop for Switched {
    fn drop(&mut self) {
        if let Err(error) = self.save() {
            eprintln!("warning: {error:#}");
        }
    }
}

#[derive(Debug)]
struct BenchProbe {
    board: BenchBoard,
    name: String,
    khz: u32,
    protocol: Option<WireProtocol>,
}

fn transfer(on: &mut Switched, khz: u32, request: Request) -> Result<u32, ArmError> {
    on.wire.pass(TRANSFER_CLOCKS * 1_000_000 / u64::from(khz));
    match on.wire.transfer(request) {
        Ack::Ok(word) => Ok(word),
        Ack::Fault => Err(DapError::FaultResponse.into()),
        Ack::Nothing => Err(DapError::NoAcknowledge.into()),
    }
}

impl BenchProbe {
    fn command<T>(&mut self, act: impl FnOnce(&mut Switched, u32) -> Result<T, ArmError>) -> Result<T, ArmError> {
        let khz = self.khz;
        self.board.with(|on| {
            on.command()?;
            act(on, khz)
        })
    }
}

impl RawDapAccess for BenchProbe {
    fn raw_read_register(&mut self, address: RegisterAddress) -> Result<u32, ArmError> {
        let mut word = [0];
        self.raw_read_block(address, &mut word)?;
        Ok(word[0])
    }

    /// A read of an access port returns the result of the previous read (posted reads), and RDBUFF returns the last
    /// result.
    fn raw_read_block(&mut self, address: RegisterAddress, values: &mut [u32]) -> Result<(), ArmError> {
        let register = address.a2_and_3();
        self.command(|on, khz| {
            if !address.is_ap() {
                for value in values {
                    *value = transfer(on, khz, Request::ReadPort(register))?;
                }
                return Ok(());
            }
            let Some(last) = values.len().checked_sub(1) else { return Ok(()) };
            transfer(on, khz, Request::ReadAccess(register))?;
            for value in &mut values[..last] {
                *value = transfer(on, khz, Request::ReadAccess(register))?;
            }
            values[last] = transfer(on, khz, Request::ReadPort(READ_BUFFER))?;
            Ok(())
        })
    }

    fn raw_write_register(&mut self, address: RegisterAddress, value: u32) -> Result<(), ArmError> {
        self.raw_write_block(address, &[value])
    }

    /// Reads RDBUFF after the last write to an access port, since only the next transfer tells whether that write
    /// succeeded.
    fn raw_write_block(&mut self, address: RegisterAddress, values: &[u32]) -> Result<(), ArmError> {
        let register = address.a2_and_3();
        self.command(|on, khz| {
            for &value in values {
                let write = if address.is_ap() { Request::WriteAccess } else { Request::WritePort };
                transfer(on, khz, write(register, value))?;
            }
            if address.is_ap() {
                transfer(on, khz, Request::ReadPort(READ_BUFFER))?;
            }
            Ok(())
        })
    }

    fn jtag_sequence(&mut self, _: u8, _: bool, _: u64) -> Result<(), DebugProbeError> {
        Err(DebugProbeError::UnsupportedProtocol(WireProtocol::Jtag))
    }

    fn swj_sequence(&mut self, bit_len: u8, bits: u64) -> Result<(), DebugProbeError> {
        self.board.with(|on| {
            on.command()?;
            on.wire.sequence(bits, bit_len);
            Ok(())
        })
    }

    fn swj_pins(&mut self, pin_out: u32, pin_select: u32, _: u32) -> Result<u32, DebugProbeError> {
        self.board.with(|on| {
            on.command()?;
            if pin_select & RESET_PIN != 0 {
                on.wire.reset_pin(pin_out & RESET_PIN == 0);
            }
            Ok(pin_out & pin_select)
        })
    }

    fn into_probe(self: Box<Self>) -> Box<dyn DebugProbe> {
        self
    }

    fn core_status_notification(&mut self, _: CoreStatus) -> Result<(), DebugProbeError> {
        Ok(())
    }
}

impl DapProbe for BenchProbe {}

impl DebugProbe for BenchProbe {
    fn get_name(&self) -> &str {
        &self.name
    }

    fn speed_khz(&self) -> u32 {
        self.khz
    }

    fn set_speed(&mut self, speed_khz: u32) -> Result<u32, DebugProbeError> {
        if speed_khz == 0 {
            return Err(DebugProbeError::UnsupportedSpeed(speed_khz));
        }
        self.khz = speed_khz.min(MOST_KHZ);
        Ok(self.khz)
    }

    fn attach(&mut self) -> Result<(), DebugProbeError> {
        self.protocol.get_or_insert(WireProtocol::Swd);
        Ok(())
    }

    fn detach(&mut self) -> Result<(), probe_rs::Error> {
        Ok(())
    }

    fn target_reset(&mut self) -> Result<(), DebugProbeError> {
        self.target_reset_assert()?;
        self.target_reset_deassert()
    }

    fn target_reset_assert(&mut self) -> Result<(), DebugProbeError> {
        self.swj_pins(0, RESET_PIN, 0).map(drop)
    }

    fn target_reset_deassert(&mut self) -> Result<(), DebugProbeError> {
        self.swj_pins(RESET_PIN, RESET_PIN, 0).map(drop)
    }

    fn select_protocol(&mut self, protocol: WireProtocol) -> Result<(), DebugProbeError> {
        if protocol != WireProtocol::Swd {
            return Err(DebugProbeError::UnsupportedProtocol(protocol));
        }
        self.protocol = Some(protocol);
        Ok(())
    }

    fn active_protocol(&self) -> Option<WireProtocol> {
        self.protocol
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
