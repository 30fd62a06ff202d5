//! The data watchpoint and trace unit, ARM ARM C1.8.
//!
//! | Covered | ARM ARM |
//! |---|---|
//! | CTRL, CYCCNT, PCSR | C1.8.7, C1.8.8 |
//! | comparators: debug events at a match of data address, data value, PC or cycle | C1.8.3 to C1.8.5 |
//!
//! Left out: the profiling counters (CPICNT and others) keep the values written to them and do not count. There are no
//! trace packets, and the comparator functions for trace packets and ETM triggers do nothing. CYCCNT stops while the
//! core is halted, but not in sleep.

const CYCCNTENA: u32 = 1;
const CYCMATCH: u32 = 1 << 7;
const DATAVMATCH: u32 = 1 << 8;
const MATCHED: u32 = 1 << 24;
/// The NUMCOMP field of CTRL: four comparators, TRM 9.2.
const COMPARATORS: u32 = 4 << 28;

#[derive(Clone, Copy, Debug, Default)]
struct Comparator {
    value: u32,
    mask: u32,
    function: u32,
}

impl Comparator {
    fn has(self, address: u32) -> bool {
        (self.value ^ address) & !((1 << self.mask) - 1) == 0
    }
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Dwt {
    control: u32,
    /// While CYCCNT counts, the cycle at which it was 0, modulo 2^32; otherwise its value.
    count: u32,
    counting: bool,
    /// The bit DEMCR.TRCENA, which enables the DWT.
    on: bool,
    paused: bool,
    counters: [u8; 5],
    comparators: [Comparator; 4],
    /// The core's cycle at which the DWT's comparator 0 next matches the cycle counter CYCCNT.
    due: u64,
    pub(crate) watching: bool,
    watches: bool,
    caller_watches: bool,
}

impl Dwt {
    pub(crate) fn new() -> Self {
        Self { due: u64::MAX, ..Self::default() }
    }

    fn cycle_count(&self, cycle: u64) -> u32 {
        if self.counting { (cycle as u32).wrapping_sub(self.count) } else { self.count }
    }

    /// Determines again, after a change of the registers, whether CYCCNT counts and whether accesses are watched.
    fn settle(&mut self, cycle: u64) {
        let now = self.cycle_count(cycle);
        let counting = self.on && self.control & CYCCNTENA != 0 && !self.paused;
        self.set_count(now, counting, cycle);
        self.settle_watching();
    }

    fn settle_watching(&mut self) {
        let watches =
            |comparator: &Comparator| matches!(comparator.function & 0xF, 5..=7) && comparator.function & CYCMATCH == 0;
        self.watches = self.on && self.comparators.iter().any(watches);
        self.watching = self.watches || self.caller_watches;
    }

    pub(crate) fn watches(&self) -> bool {
        self.watches
    }

    pub(crate) fn set_caller_watches(&mut self, on: bool) {
        self.caller_watches = on;
        self.settle_watching();
    }

    pub(crate) fn caller_watches(&self) -> bool {
        self.caller_watches
    }

    fn set_count(&mut self, now: u32, counting: bool, cycle: u64) {
        self.counting = counting;
        self.count = if counting { (cycle as u32).wrapping_sub(now) } else { now };
        let first = self.comparators[0];
        self.due = if counting && first.function & CYCMATCH != 0 && first.function & 0xF == 4 {
            let left = first.value.wrapping_sub(now);
            cycle + if left == 0 { 1 << 32 } else { u64::from(left) }
        } else {
            u64::MAX
        };
    }

    pub(crate) fn set_on(&mut self, on: bool, cycle: u64) {
        self.on = on;
        self.settle(cycle);
    }

    pub(crate) fn pause(&mut self, cycle: u64, paused: bool) {
        // CYCCNT keeps its value, and counts on from it.
        let now = self.cycle_count(cycle);
        self.set_count(now, false, cycle);
        self.paused = paused;
        self.settle(cycle);
    }

    pub(crate) fn due(&self) -> u64 {
        self.due
    }

    /// Whether comparator 0 matched CYCCNT at or before `cycle` since the last call.
    pub(crate) fn advance(&mut self, cycle: u64) -> bool {
        if cycle < self.due {
            return false;
        }
        self.comparators[0].function |= MATCHED;
        while self.due <= cycle {
            self.due += 1 << 32;
        }
        true
    }

    pub(crate) fn watch(&mut self, address: u32, write: bool, width: u32, value: u32) -> bool {
        if !self.on {
            return false;
        }
        let mut hit = false;
        for index in 0..4 {
            let comparator = self.comparators[index];
            let wanted = match comparator.function & 0xF {
                5 => !write,
                6 => write,
                7 => true,
                _ => false,
            };
            if !wanted {
                continue;
            }
            let matched = if comparator.function & DATAVMATCH != 0 {
                self.value_matches(comparator, address, width, value)
            } else {
                (0..width).any(|byte| comparator.has(address.wrapping_add(byte)))
            };
            if matched {
                self.comparators[index].function |= MATCHED;
                hit = true;
            }
        }
        hit
    }

    /// Returns whether the value of an access matches (DATAVMATCH). The access must have the size DATAVSIZE and be at
    /// the address of a linked comparator (ARM ARM C1.8.5).
    fn value_matches(&self, comparator: Comparator, address: u32, width: u32, value: u32) -> bool {
        let size = 1 << (comparator.function >> 10 & 3).min(2);
        if width != size {
            return false;
        }
        let mask = if size == 4 { u32::MAX } else { (1 << (8 * size)) - 1 };
        if (value ^ comparator.value) & mask != 0 {
            return false;
        }
        let linked = [comparator.function >> 12 & 0xF, comparator.function >> 16 & 0xF];
        let itself = 1;
        if linked == [itself, itself] {
            return true;
        }
        linked.iter().any(|&link| {
            link != itself && self.comparators.get(link as usize).is_some_and(|linked| linked.has(address))
        })
    }

    /// Returns the addresses at which a PC match is a debug event, each with the number of low address bits to ignore.
    pub(crate) fn pc_matches(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.comparators
            .iter()
            .filter(|comparator| self.on && comparator.function & (0xF | CYCMATCH | DATAVMATCH) == 4)
            .map(|comparator| (comparator.value & !1 & !((1 << comparator.mask) - 1), comparator.mask))
    }

    pub(crate) fn pc_matched(&mut self, pc: u32) -> bool {
        let mut hit = false;
        for comparator in &mut self.comparators {
            if comparator.function & (0xF | CYCMATCH | DATAVMATCH) == 4
                && (comparator.value ^ pc) & !((1 << comparator.mask) - 1) & !1 == 0
            {
                comparator.function |= MATCHED;
                hit = true;
            }
        }
        hit && self.on
    }

    pub(crate) fn read(&mut self, offset: u32, cycle: u64, pc: u32, debugger: bool) -> Option<u32> {
        Some(match offset {
            0x00 => self.control | COMPARATORS,
            0x04 => self.cycle_count(cycle),
            0x08..=0x18 => u32::from(self.counters[(offset / 4 - 2) as usize]),
            0x1C => pc,
            0x20..=0x5C => {
                let comparator = &mut self.comparators[(offset / 16 - 2) as usize];
                match offset & 0xF {
                    0x0 => comparator.value,
                    0x4 => comparator.mask,
                    0x8 => {
                        let function = comparator.function;
                        if !debugger {
                            comparator.function &= !MATCHED;
                        }
                        function
                    }
                    _ => return None,
                }
            }
            // The DWT has no lock: writes of LAR are ignored, and LSR reads as 0 (TRM 9.2).
            0xFB0 | 0xFB4 => 0,
            _ => return None,
        })
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, cycle: u64) -> bool {
        match offset {
            0x00 => {
                self.control = value & 0x007F_1FFF;
                self.settle(cycle);
            }
            0x04 => {
                let counting = self.counting;
                self.set_count(value, counting, cycle);
            }
            0x08..=0x18 => self.counters[(offset / 4 - 2) as usize] = value as u8,
            0x1C | 0xFB0 => {}
            0x20..=0x5C => {
                let index = (offset / 16 - 2) as usize;
                match offset & 0xF {
                    0x0 => self.comparators[index].value = value,
                    0x4 => self.comparators[index].mask = value & 0xF,
                    0x8 => {
                        // Only comparator 0 has CYCMATCH, and only comparator 1 compares data values (TRM 9.2).
                        let extra = match index {
                            0 => CYCMATCH,
                            1 => 0x000F_FD00,
                            _ => 0,
                        };
                        self.comparators[index].function = value & (0x2F | extra) | u32::from(index == 1) << 9;
                    }
                    _ => return false,
                }
                self.settle(cycle);
            }
            _ => return false,
        }
        true
    }
}
