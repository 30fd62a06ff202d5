//! The debug port of a board, behind the two wires of Serial Wire Debug.
//!
//! The sources are ARM's *Debug Interface Architecture Specification ADIv5.0 to ADIv5.2* (IHI 0031, "ADI" below), the
//! ARMv7-M Architecture Reference Manual (chapter C1), the Cortex-M4 Technical Reference Manual (100166, "TRM") and the
//! microcontrollers' manuals. No debug tool was a source, because the model serves to check such tools.
//!
//! | covered | by |
//! |---|---|
//! | selection of SWD in the SWJ-DP, line reset, the first read of DPIDR, protocol errors | ADI B4.3, B5.2 |
//! | DPIDR, ABORT, CTRL/STAT, SELECT, RDBUFF, RESEND; posted AP reads; sticky flags and FAULT | ADI B2.2, B4.2 |
//! | power-up requests of the debug and system domains, without which an AP access is a FAULT | ADI B2.4 |
//! | the AHB-AP: CSW, TAR with its increment, DRW by bytes, halfwords, words and packed, BD0 to BD3 | ADI C2, TRM 8 |
//! | core debug, breakpoints, watchpoints, vector catch, reset | `cortex-m4`, ARMv7-M C1 |
//! | which resets of a part reset its core's debug registers | the parts' manuals |
//! | a reset pin, and what a part has beside the AHB-AP ([`Debugged`]) | the parts' manuals |
//!
//! | left out | why |
//! |---|---|
//! | JTAG, dormant state, SWD protocol version 2 | both DPs have version 1 and give no answer |
//! | pushed verify and compare (TRNMODE, TRNCNT), overrun detection | no tool here uses them; TRNMODE reads 0 |
//! | WAIT | a request takes 46 clocks of SWCLK, in which the core completes every access |
//! | a reset of the DWT's comparators and of the AHB-AP with the debug components | no tool here sets any |
//! | the time that a transfer takes | the driver knows its clock and latency, and calls [`DebugPort::pass`] |
//!
//! ADI C2.2.2 promises that TAR increments within 1 KiB, and this model does not exceed that. OpenOCD relies on 4 KiB,
//! which Cortex-M3 and M4 are said to have; a tool that does so fails with this model.

#![forbid(unsafe_code)]

mod access_port;
mod part;

use cortex_m4::{Cost, Width};
use emulator_part::Part;

use access_port::MemoryAp;
use emulator_node::{Board, Finding, FromOutside, Node, ResetAt};
pub use part::{Alone, Debugged, PinReset, restore};

/// A debugger's request in one transfer on the wires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Read the debug port's register at this address: 0, 4, 8 or 0xC.
    ReadPort(u8),
    /// Write the debug port's register at this address: 0, 4, 8 or 0xC.
    WritePort(u8, u32),
    /// Read an access port's register in the selected bank. The next read of an access port or of RDBUFF has the
    /// result.
    ReadAccess(u8),
    /// Write the selected access port's register at this address of the selected bank.
    WriteAccess(u8, u32),
}

/// The port's answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ack {
    /// The transfer is done. The word is the result of a read.
    Ok(u32),
    /// A sticky flag is set, or a power domain has no power. The request had no effect.
    Fault,
    /// No answer came, because the port drives nothing on the line.
    Nothing,
}

/// The wires of a board's debug port, for any microcontroller and clock.
pub trait Wire: Send + std::fmt::Debug {
    /// The microcontroller's name, as its maker writes it.
    fn part_name(&self) -> &'static str;

    /// Sends these bits on SWDIO, the lowest first, one in each clock of SWCLK.
    fn sequence(&mut self, bits: u64, count: u8);

    /// Makes one transfer.
    fn transfer(&mut self, request: Request) -> Ack;

    /// Pulls the microcontroller's reset pin low, or releases it.
    fn reset_pin(&mut self, low: bool);

    /// Lets `ns` nanoseconds of virtual time pass on the board.
    fn pass(&mut self, ns: u64);

    /// The virtual time since the board was switched on, ns.
    fn now(&self) -> u64;

    /// Takes the findings about the board's firmware since the last call.
    fn take_findings(&mut self) -> Vec<Finding>;

    /// Every restart of the microcontroller since the board was switched on.
    fn resets(&self) -> &[ResetAt];

    /// The memory that the microcontroller keeps without supply, in the order of [`Debugged::KEPT`].
    fn kept(&self) -> Vec<u8>;

    /// Makes a bit of flash read `value` regardless of what is programmed there. Returns whether `address` is in flash.
    fn stick_flash(&mut self, address: u32, bit: u8, value: bool) -> bool;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Line {
    /// JTAG, which an SWJ-DP selects at power-on (ADI B5.2.1).
    Jtag,
    /// SWD is selected or a protocol error has occurred, and the port waits for a line reset (ADI B4.2.5).
    Lost,
    /// A line reset has ended, and the port answers only a read of DPIDR (ADI B4.3.3).
    Reset,
    /// The port answers all requests.
    Open,
}

/// The number of successive one bits on SWDIO that make a line reset (ADI B4.3.3).
const LINE_RESET: u32 = 50;
/// The sequences that select SWD and JTAG, the lowest bit first (ADI B5.2.2).
const TO_SWD: u16 = 0xE79E;
const TO_JTAG: u16 = 0xE73C;

/// The identifier of an SW-DP of version 1 by Arm (TRM; RM0090 38.8.3).
const DPIDR: u32 = 0x2BA0_1477;

/// The bits of the register CTRL/STAT (ADI B2.2.2).
const STICKY_ORUN: u32 = 1 << 1;
const STICKY_CMP: u32 = 1 << 4;
const STICKY_ERR: u32 = 1 << 5;
const READ_OK: u32 = 1 << 6;
const WRITE_ERR: u32 = 1 << 7;
const STICKY: u32 = STICKY_ORUN | STICKY_CMP | STICKY_ERR | WRITE_ERR;
const DEBUG_POWER_REQUEST: u32 = 1 << 28;
const DEBUG_POWER_ACK: u32 = 1 << 29;
const SYSTEM_POWER_REQUEST: u32 = 1 << 30;
const SYSTEM_POWER_ACK: u32 = 1 << 31;
/// The bits of CTRL/STAT that a write sets: MASKLANE, TRNCNT, and the two power requests.
const CONTROL_KEPT: u32 = 0x00FF_FF00 | DEBUG_POWER_REQUEST | SYSTEM_POWER_REQUEST;
const DLCR: u32 = 0x40;

/// A board together with the debug port of its microcontroller.
#[derive(Clone, Debug)]
pub struct DebugPort<B: Board, C: Cost> {
    node: Node<B, C>,
    line: Line,
    ones: u32,
    since_reset: u32,
    latest: u16,
    control: u32,
    select: u32,
    /// The result of the last read of an access port, which the next read returns.
    read_buffer: u32,
    resend: u32,
    memory_ap: MemoryAp,
    held: bool,
    pin_low: bool,
    stuck: Option<(u32, u8, bool)>,
}

impl<B: Alone, C: Cost> DebugPort<B, C>
where
    B::Part: Debugged,
{
    /// Returns the debug port of `node`'s board, with no debugger connected yet.
    #[must_use]
    pub fn new(node: Node<B, C>) -> Self {
        Self {
            node,
            line: Line::Jtag,
            ones: 0,
            since_reset: u32::MAX,
            latest: 0,
            control: 0,
            select: 0,
            read_buffer: 0,
            resend: 0,
            memory_ap: MemoryAp::default(),
            held: false,
            pin_low: false,
            stuck: None,
        }
    }

    /// The board that the port belongs to.
    #[must_use]
    pub fn node(&self) -> &Node<B, C> {
        &self.node
    }

    /// The board that the port belongs to, for changes.
    pub fn node_mut(&mut self) -> &mut Node<B, C> {
        &mut self.node
    }

    fn bit(&mut self, bit: bool) {
        self.latest = self.latest >> 1 | u16::from(bit) << 15;
        self.since_reset = self.since_reset.saturating_add(1);
        self.ones = if bit { self.ones + 1 } else { 0 };
        if self.ones >= LINE_RESET {
            self.since_reset = 0;
            if self.line != Line::Jtag {
                self.line = Line::Reset;
                // A line reset selects the banks as at power-up, but keeps flags and power requests (ADI B4.3.3).
                self.select &= !0xF;
            }
        }
        if self.since_reset == 16 {
            match self.latest {
                TO_SWD => self.line = Line::Lost,
                TO_JTAG => self.line = Line::Jtag,
                _ => {}
            }
        }
    }

    fn answer(&mut self, request: Request) -> Ack {
        match (self.line, request) {
            (Line::Open, _) | (Line::Reset, Request::ReadPort(0)) => {}
            (Line::Jtag | Line::Lost, _) => return Ack::Nothing,
            (Line::Reset, _) => {
                self.line = Line::Lost;
                return Ack::Nothing;
            }
        }
        self.line = Line::Open;
        // While a sticky flag is set, only DPIDR, CTRL/STAT and ABORT can be accessed (ADI B4.2.4).
        let always =
            matches!(request, Request::ReadPort(0) | Request::WritePort(0, _)) || request == Request::ReadPort(4);
        if self.control & STICKY != 0 && !always {
            return Ack::Fault;
        }
        let bank = self.select & 0xF;
        match request {
            Request::ReadPort(address) => {
                let word = match address {
                    0 => DPIDR,
                    4 if bank == 0 => self.status(),
                    4 if bank == 1 => DLCR,
                    8 => self.resend,
                    0xC => self.read_buffer,
                    _ => 0,
                };
                self.resend = if address == 0xC { word } else { self.resend };
                Ack::Ok(word)
            }
            Request::WritePort(address, value) => {
                match address {
                    0 => self.abort(value),
                    4 if bank == 0 => self.write_control(value),
                    8 => self.select = value,
                    _ => {}
                }
                Ack::Ok(0)
            }
            Request::ReadAccess(_) | Request::WriteAccess(..) if !self.has_power() => {
                self.control |= STICKY_ERR;
                Ack::Fault
            }
            Request::ReadAccess(address) => {
                let before = self.read_buffer;
                let read = self.access_read(self.access_register(address));
                self.control = self.control & !READ_OK | if read.is_some() { READ_OK } else { STICKY_ERR };
                self.read_buffer = read.unwrap_or(0);
                self.resend = before;
                Ack::Ok(before)
            }
            Request::WriteAccess(address, value) => {
                if !self.access_write(self.access_register(address), value) {
                    self.control |= STICKY_ERR;
                }
                Ack::Ok(0)
            }
        }
    }

    fn status(&self) -> u32 {
        let acknowledged = |request, ack| if self.control & request != 0 { ack } else { 0 };
        self.control
            | acknowledged(DEBUG_POWER_REQUEST, DEBUG_POWER_ACK)
            | acknowledged(SYSTEM_POWER_REQUEST, SYSTEM_POWER_ACK)
    }

    fn has_power(&self) -> bool {
        let both = DEBUG_POWER_REQUEST | SYSTEM_POWER_REQUEST;
        self.control & both == both
    }

    fn write_control(&mut self, value: u32) {
        self.control = self.control & !CONTROL_KEPT | value & CONTROL_KEPT;
        self.node.set_debugged(self.control & DEBUG_POWER_REQUEST != 0);
    }

    fn abort(&mut self, value: u32) {
        for (bit, flag) in [(1, STICKY_CMP), (2, STICKY_ERR), (3, WRITE_ERR), (4, STICKY_ORUN)] {
            if value >> bit & 1 != 0 {
                self.control &= !flag;
            }
        }
    }

    /// The 8-bit address of an access port's register, made of the bank that SELECT selects and the address in it.
    const fn access_register(&self, address: u8) -> u8 {
        (self.select & 0xF0) as u8 | address & 0xC
    }

    const fn selected(&self) -> u8 {
        (self.select >> 24) as u8
    }

    /// Reads a register of the selected access port. An access port that does not exist reads zero (ADI B2.2.11).
    fn access_read(&mut self, register: u8) -> Option<u32> {
        match self.selected() {
            0 if !self.node.part().is_open() => Some(0),
            0 => {
                let mut ap = std::mem::take(&mut self.memory_ap);
                let read = ap.read(register, self);
                self.memory_ap = ap;
                read
            }
            ap => Some(self.node.part().read_port(ap, register)),
        }
    }

    fn access_write(&mut self, register: u8, value: u32) -> bool {
        match self.selected() {
            0 if !self.node.part().is_open() => true,
            0 => {
                let mut ap = std::mem::take(&mut self.memory_ap);
                let written = ap.write(register, value, self);
                self.memory_ap = ap;
                written
            }
            ap => {
                match self.node.with_part(|part, at| part.write_port(ap, register, value, at)) {
                    PinReset::Unchanged => {}
                    PinReset::Hold => self.held = true,
                    PinReset::Release => self.release(FromOutside::SoftReset),
                }
                true
            }
        }
    }

    fn release(&mut self, why: FromOutside) {
        self.held = false;
        self.node.restart(why);
        self.reset_debug();
    }

    /// Gives the debug registers their power-on values if the last reset was one that resets them.
    fn reset_debug(&mut self) {
        /// The writes that reset DHCSR and FP_CTRL (both with their keys) and DEMCR (ARMv7-M ARM C1.6.2, C1.11.3,
        /// C1.6.5).
        const RESET: [(u32, u32); 3] = [(0xE000_EDF0, 0xA05F_0000), (0xE000_2000, 2), (0xE000_EDFC, 0)];
        if self.node.resets().last().is_some_and(|reset| B::Part::resets_debug(reset.cause)) {
            for (address, value) in RESET {
                let _ = self.node.access_port_write(address, Width::Word, value);
            }
        }
    }

    /// Returns whether a debugger can access `address`. While reset is held, only the private peripheral space is
    /// accessible.
    fn reachable(&self, address: u32) -> bool {
        !self.held || address >> 20 == 0xE00
    }

    fn keep_stuck(&mut self) {
        if let Some((address, bit, value)) = self.stuck
            && let mut byte = [0]
            && self.node.read(u64::from(address), &mut byte).is_ok()
            && (byte[0] >> bit & 1 != 0) != value
        {
            byte[0] ^= 1 << bit;
            // A byte was just read from this address, so the write must succeed.
            self.node.write(u64::from(address), &byte).expect("memory");
        }
    }
}

impl<B: Alone, C: Cost> access_port::Target for DebugPort<B, C>
where
    B::Part: Debugged,
{
    fn read(&mut self, address: u32, width: Width) -> Option<u32> {
        if !self.reachable(address) {
            return None;
        }
        self.node.access_port_read(address, width).ok()
    }

    fn write(&mut self, address: u32, width: Width, value: u32) -> bool {
        self.reachable(address) && self.node.access_port_write(address, width, value).is_ok()
    }
}

impl<B: Alone, C: Cost> Wire for DebugPort<B, C>
where
    B::Part: Debugged,
{
    fn part_name(&self) -> &'static str {
        B::Part::NAME
    }

    fn sequence(&mut self, bits: u64, count: u8) {
        (0..count.min(64)).for_each(|n| self.bit(bits >> n & 1 != 0));
    }

    fn transfer(&mut self, request: Request) -> Ack {
        // The transfer's zero bits end a sequence of ones that could have become a line reset.
        self.ones = 0;
        self.since_reset = u32::MAX;
        self.answer(request)
    }

    fn reset_pin(&mut self, low: bool) {
        if low == self.pin_low || !self.node.part().has_reset_pin() {
            return;
        }
        self.pin_low = low;
        if low {
            self.held = true;
        } else {
            self.release(FromOutside::Pin);
        }
    }

    fn pass(&mut self, ns: u64) {
        // While the microcontroller is held in reset, the board's time stands still.
        if self.held {
            return;
        }
        let to = self.node.now() + ns;
        while self.node.now() < to {
            if self.node.advance_to_restart(to) {
                self.reset_debug();
            }
            self.node.board_mut(B::forget_outgoing);
        }
        self.node.with_part(Debugged::port_advances);
        self.keep_stuck();
    }

    fn now(&self) -> u64 {
        self.node.now()
    }

    fn take_findings(&mut self) -> Vec<Finding> {
        self.node.take_findings()
    }

    fn resets(&self) -> &[ResetAt] {
        self.node.resets()
    }

    fn kept(&self) -> Vec<u8> {
        let stretch = |&(address, size): &(u32, usize)| self.node.part().memory(address, size).unwrap_or_default();
        B::Part::KEPT.iter().flat_map(stretch).copied().collect()
    }

    fn stick_flash(&mut self, address: u32, bit: u8, value: bool) -> bool {
        let flash = B::Part::KEPT.iter().any(|&(from, size)| (address.wrapping_sub(from) as usize) < size);
        self.stuck = flash.then_some((address, bit & 7, value));
        self.keep_stuck();
        flash
    }
}
