//! Reports of what goes wrong in a node: findings of its part, faults, panics, lock-ups.

use cortex_m4::{Cost, Register};
use emulator_part::{Part, Reset};

use super::finding::{Finding, FindingKind};
use super::{Board, Node, memory};

/// The maximum number of findings that a node keeps, because a firmware in a loop could make very many.
const MOST_FINDINGS: usize = 200;

/// The addresses of the Configurable Fault Status, HardFault Status and Bus Fault Address registers, ARMv7-M ARM B3.2.
const CFSR: u32 = 0xE000_ED28;
const HFSR: u32 = 0xE000_ED2C;
const BFAR: u32 = 0xE000_ED38;

pub(super) const BRANCH_TO_ITSELF: u64 = 0xE7FE;

/// The exception number of HardFault, ARMv7-M ARM table B1-4. Those of MemManage, BusFault and UsageFault follow.
const HARD_FAULT: u16 = 3;

impl<B: Board, C: Cost> Node<B, C> {
    /// Takes the findings since the last call.
    pub fn take_findings(&mut self) -> Vec<Finding> {
        self.report_errors();
        let mut findings = std::mem::take(&mut self.findings);
        // At one instant the findings of the part come first, because they explain why the core stops.
        findings.sort_by_key(|finding| (finding.at, finding.kind.ends_run()));
        findings
    }

    /// The findings that have not been taken yet.
    #[must_use]
    pub fn findings(&self) -> &[Finding] {
        &self.findings
    }

    pub(super) fn find(&mut self, kind: FindingKind, pc: Option<u64>, text: String) {
        let at = self.now();
        self.add_finding(kind, at, pc, text);
    }

    pub(super) fn add_finding(&mut self, kind: FindingKind, at: u64, pc: Option<u64>, text: String) {
        if self.findings.len() >= MOST_FINDINGS {
            return;
        }
        let symbol = pc.and_then(|pc| self.firmware.place_of(pc));
        self.findings.push(Finding { kind, at, pc, symbol, text });
    }

    /// Adds a finding if the outside input `what`, which was due at `at` (virtual ns), is late by more than one
    /// instruction of the core.
    pub(super) fn note_late(&mut self, at: u64, what: &str) {
        let now = self.now();
        if now > at.saturating_add(self.instruction_ns()) {
            self.find(FindingKind::Late, None, format!("{what} due at {at} ns came at {now} ns"));
        }
    }

    /// Adds the new findings of the part's models and of the core to the node's list.
    fn report_errors(&mut self) {
        self.side.changed(self.present());
        let mut found = std::mem::take(&mut self.side.findings);
        for (address, pc, cycle) in self.core.take_unmodelled() {
            found.push(Finding {
                kind: FindingKind::Unmodelled,
                at: self.side.time.ns(cycle),
                pc: Some(u64::from(pc)),
                symbol: None,
                text: format!("the core's register at {address:#010x} is not modelled"),
            });
        }
        for Finding { kind, at, pc, text, .. } in found {
            if self.reported.insert((kind, text.clone())) {
                self.add_finding(kind, at, pc, text);
            }
        }
    }

    pub(super) fn trapped(&mut self) {
        let pc = u64::from(self.core.pc());
        // A handler that is a branch to itself would reach the node's breakpoint again and again, so the breakpoint is
        // removed.
        if memory::value(&self.side.part, pc, 2) == Some(BRANCH_TO_ITSELF) {
            self.core.clear_breakpoint(self.core.pc());
        }
        if self.traps.panic.contains(&pc) {
            self.report_panic();
        } else if self.traps.default_handler.contains(&pc)
            && self.core.active_exception() != 0
            && !self.is_in_hard_faults_handler()
        {
            self.report_exception(FindingKind::UnhandledInterrupt);
        }
    }

    #[inline(never)]
    pub(super) fn locked_up(&mut self) {
        let pc = u64::from(self.core.pc());
        let (cfsr, hfsr) = (self.word(u64::from(CFSR)).unwrap_or(0), self.word(u64::from(HFSR)).unwrap_or(0));
        let mut text = "the core locked up: a fault inside a fault handler".to_owned();
        if cfsr | hfsr != 0 {
            text += &format!(": {} (CFSR {cfsr:#010x}, HFSR {hfsr:#010x})", fault_names(cfsr, hfsr));
        }
        if self.instructions() == 0 {
            text += "; it has not run one instruction: does the reset vector lead into the image?";
        }
        self.find(FindingKind::Lockup, Some(pc), text);
        if B::Part::RESETS_ON_LOCKUP && !self.debugged {
            self.side.reset = Some(Reset::Lockup);
        }
    }

    /// Locks the core up now, as a fault inside a fault handler does. The core executes nothing until it is reset.
    pub fn lock_up(&mut self) {
        if !self.powered {
            return;
        }
        self.core.lock_up();
        self.locked_up();
    }

    /// Whether the core has just entered the HardFault handler of the vector table, for HardFault or for another fault
    /// with the same handler. A fault with a handler of its own may be normal operation: a system may let a stack grow,
    /// or end one task of many.
    pub(super) fn is_in_hard_faults_handler(&self) -> bool {
        let vector = u64::from(self.core.vector_table()) + 4 * u64::from(HARD_FAULT);
        let handler = memory::value(&self.side.part, vector, 4).map(|handler| handler & !1);
        match self.core.active_exception() {
            HARD_FAULT => true,
            4..=6 => handler == Some(u64::from(self.core.pc())),
            _ => false,
        }
    }

    #[inline(never)]
    pub(super) fn report_exception(&mut self, kind: FindingKind) {
        let exception = self.core.register(Register::Xpsr) & 0x1FF;
        let returns = self.register(14);
        // Bit 2 of EXC_RETURN says on which stack the core pushed its frame, ARMv7-M ARM table B1-8.
        let stack = self.core.register(if returns & 4 != 0 { Register::Psp } else { Register::Msp });
        let pushed = |index: u64| memory::value(&self.side.part, u64::from(stack) + 4 * index, 4);
        let (lr, pc) = (pushed(5), pushed(6));
        let (cfsr, hfsr) = (self.word(u64::from(CFSR)).unwrap_or(0), self.word(u64::from(HFSR)).unwrap_or(0));
        let mut text = match kind {
            FindingKind::HardFault => {
                format!("HardFault: {} (CFSR {cfsr:#010x}, HFSR {hfsr:#010x})", fault_names(cfsr, hfsr))
            }
            _ => format!("exception {exception} (interrupt {}) has no handler", i64::from(exception) - 16),
        };
        if cfsr & 0x8000 != 0
            && let Some(address) = self.word(u64::from(BFAR))
        {
            text += &format!(", bus fault address {address:#010x}");
        }
        if let Some(caller) = lr.and_then(|lr| self.firmware.name_of(lr)) {
            text += &format!(", called from {caller}");
        }
        if self.reported.insert((kind, text.clone())) {
            self.find(kind, pc, text);
        }
    }

    fn report_panic(&mut self) {
        let place = self.panic_place();
        let lr = u64::from(self.register(14)) & !1;
        let text = match place {
            Some(place) => format!("panicked at {place}; the message is in the log"),
            None => "panicked; the message is in the log".to_owned(),
        };
        let pc = self.panicking_call().unwrap_or(lr.saturating_sub(2));
        self.find(FindingKind::Panic, Some(pc), text);
    }

    /// Returns the address of the call in the firmware's own code that led to the panic. It is the innermost return
    /// address on the stack that is not in a library. A word may look like a return address by chance, but that is
    /// rare.
    #[inline(never)]
    fn panicking_call(&self) -> Option<u64> {
        const LIBRARIES: [&str; 5] = ["core::", "<core::", "alloc::", "<alloc::", "compiler_builtins::"];
        let part = &self.side.part;
        let stack = u64::from(self.register(13));
        (0..128).find_map(|index| {
            let to = memory::value(part, stack + 4 * index, 4).filter(|to| to & 1 != 0)? & !1;
            let half = |back: u64| memory::value(part, to.checked_sub(back)?, 2);
            // A call is a BL, or a BLX of a register: ARMv7-M ARM A7.7.18 and A7.7.19.
            let call = half(4)? & 0xF800 == 0xF000 && half(2)? & 0xD000 == 0xD000 || half(2)? & 0xFF87 == 0x4780;
            let function = self.firmware.name_of(to - 2)?;
            (call && !LIBRARIES.iter().any(|library| function.starts_with(library))).then_some(to - 2)
        })
    }

    /// Returns the source line in a `PanicInfo`. Its layout is not stable, but it holds a `&Location` {file name, its
    /// length, line, column}. The first word that points to something of this form is taken.
    #[inline(never)]
    fn panic_place(&self) -> Option<String> {
        let info = u64::from(self.register(0));
        let part = &self.side.part;
        (0..6).find_map(|index| {
            let location = memory::value(part, info + 4 * index, 4)?;
            let word = |index: u64| memory::value(part, location + 4 * index, 4);
            let (name, length, line, column) = (word(0)?, word(1)?, word(2)?, word(3)?);
            if !(4..=512).contains(&length) || line == 0 || line > 1_000_000 || column > 10_000 {
                return None;
            }
            let mut text = vec![0; usize::try_from(length).ok()?];
            memory::read(part, name, &mut text).then_some(())?;
            let text = String::from_utf8(text).ok().filter(|text| text.trim_end_matches('\0').ends_with(".rs"))?;
            Some(format!("{}:{line}:{column}", text.trim_end_matches('\0')))
        })
    }
}

/// The names of the bits that are set in CFSR and HFSR, ARMv7-M ARM B3.2.15 and B3.2.16.
fn fault_names(cfsr: u32, hfsr: u32) -> String {
    const NAMES: [(u32, &str); 17] = [
        (1 << 0, "instruction access violation"),
        (1 << 1, "data access violation"),
        (1 << 3, "MPU fault on exception return"),
        (1 << 4, "MPU fault on exception entry"),
        (1 << 5, "MPU fault saving FPU state"),
        (1 << 8, "instruction bus error"),
        (1 << 9, "precise data bus error"),
        (1 << 10, "imprecise data bus error"),
        (1 << 11, "bus error on exception return"),
        (1 << 12, "bus error on exception entry"),
        (1 << 13, "bus error saving FPU state"),
        (1 << 16, "undefined instruction"),
        (1 << 17, "invalid state"),
        (1 << 18, "invalid PC load"),
        (1 << 19, "no coprocessor"),
        (1 << 24, "unaligned access"),
        (1 << 25, "division by zero"),
    ];
    let mut names: Vec<&str> = NAMES.iter().filter(|(bit, _)| cfsr & bit != 0).map(|&(_, name)| name).collect();
    if hfsr & 2 != 0 {
        names.push("vector table read");
    }
    if hfsr & (1 << 31) != 0 {
        names.push("breakpoint with no debugger");
    }
    if names.is_empty() { "no cause recorded".to_owned() } else { names.join(", ") }
}
