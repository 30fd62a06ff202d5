//! The nested vectored interrupt controller: which exceptions are pending, enabled and active, and which is next.
//!
//! | Covered | ARM ARM |
//! |---|---|
//! | pending, enabled and active states of all exceptions, not only of interrupts | B1.5.1, B3.4 |
//! | priorities, priority grouping, the priority of active exceptions | B1.5.4 |
//! | level-sensitive lines and pulses | B3.4.1 |
//!
//! Left out: a pulse is detected only if the line is still high at the next call of the core's `look_at_exceptions`.

/// A set of exceptions: exception number n is bit n % 64 of word n / 64. Interrupt line n is exception 16 + n.
pub(crate) type Set = [u64; 4];

/// Exception numbers, ARM ARM table B1-4.
pub(crate) const NMI: u16 = 2;
pub(crate) const HARD_FAULT: u16 = 3;
pub(crate) const MEM_MANAGE: u16 = 4;
pub(crate) const BUS_FAULT: u16 = 5;
pub(crate) const USAGE_FAULT: u16 = 6;
pub(crate) const SV_CALL: u16 = 11;
pub(crate) const DEBUG_MONITOR: u16 = 12;
pub(crate) const PEND_SV: u16 = 14;
pub(crate) const SYS_TICK: u16 = 15;

/// A priority below all others: that of thread mode with no mask, ARM ARM B1.5.4.
pub(crate) const IDLE_PRIORITY: i16 = 256;

/// The exceptions without an enable bit.
const ALWAYS_ENABLED: u64 =
    1 << NMI | 1 << HARD_FAULT | 1 << SV_CALL | 1 << DEBUG_MONITOR | 1 << PEND_SV | 1 << SYS_TICK;

#[derive(Clone, Debug)]
pub(crate) struct Nvic {
    pub(crate) pending: Set,
    pub(crate) enabled: Set,
    pub(crate) active: Set,
    /// The levels of the inputs when the core last checked them. NMI is bit 2.
    level: Set,
    implemented: Set,
    /// The priorities by exception number. Those of Reset, NMI and HardFault are fixed and not in this list.
    priority: [u8; 256],
    pub(crate) priority_mask: u8,
    group: u8,
    /// The bit DHCSR.C_MASKINTS, which holds back interrupts, SysTick and PendSV.
    masked: bool,
    /// The pending and enabled exception of highest priority, 0 for none.
    pub(crate) best: u16,
    /// The group priority of `best`, [`IDLE_PRIORITY`] for none.
    pub(crate) best_priority: i16,
    /// The highest group priority of the active exceptions.
    pub(crate) active_priority: i16,
    /// Whether an exception has become pending since this flag was last cleared. SCR.SEVONPEND needs it.
    pub(crate) newly_pending: bool,
}

fn bit(number: u16) -> (usize, u64) {
    (usize::from(number >> 6) & 3, 1 << (number & 63))
}

pub(crate) fn contains(set: &Set, number: u16) -> bool {
    let (word, bit) = bit(number);
    set[word] & bit != 0
}

impl Nvic {
    pub(crate) fn new(lines: u16, priority_bits: u8) -> Self {
        let lines = lines.min(240);
        let mut implemented = [0; 4];
        for number in 16..16 + lines {
            let (word, bit) = bit(number);
            implemented[word] |= bit;
        }
        Self {
            pending: [0; 4],
            enabled: [ALWAYS_ENABLED, 0, 0, 0],
            active: [0; 4],
            level: [0; 4],
            implemented,
            priority: [0; 256],
            priority_mask: !(0xFFu16 >> priority_bits.clamp(1, 8)) as u8,
            group: 0,
            masked: false,
            best: 0,
            best_priority: IDLE_PRIORITY,
            active_priority: IDLE_PRIORITY,
            newly_pending: false,
        }
    }

    pub(crate) fn priority(&self, number: u16) -> i16 {
        match number {
            0 => IDLE_PRIORITY,
            1..=HARD_FAULT => i16::try_from(number).unwrap_or(0) - 4,
            _ => i16::from(self.priority[usize::from(number) & 255]),
        }
    }

    /// A priority without its subpriority, ARM ARM B1.5.4.
    pub(crate) fn group_of(&self, priority: i16) -> i16 {
        if (0..IDLE_PRIORITY).contains(&priority) { priority & !((2 << self.group) - 1) } else { priority }
    }

    pub(crate) fn group_priority(&self, number: u16) -> i16 {
        self.group_of(self.priority(number))
    }

    pub(crate) fn priority_byte(&self, number: u16) -> u8 {
        self.priority[usize::from(number) & 255]
    }

    pub(crate) fn set_priority_byte(&mut self, number: u16, value: u8) {
        if number < 16 || contains(&self.implemented, number) {
            self.priority[usize::from(number) & 255] = value & self.priority_mask;
        }
    }

    pub(crate) fn prigroup(&self) -> u8 {
        self.group
    }

    pub(crate) fn set_prigroup(&mut self, group: u8) {
        self.group = group & 7;
        self.refresh();
    }

    pub(crate) fn set_masked(&mut self, masked: bool) {
        self.masked = masked;
        self.refresh();
    }

    pub(crate) fn refresh(&mut self) {
        self.refresh_best();
        let mut least = IDLE_PRIORITY;
        for (index, &word) in self.active.iter().enumerate() {
            let mut bits = word;
            while bits != 0 {
                let number = (index as u16) << 6 | bits.trailing_zeros() as u16;
                bits &= bits - 1;
                least = least.min(self.group_priority(number));
            }
        }
        self.active_priority = least;
    }

    fn refresh_best(&mut self) {
        let (mut best, mut least) = (0, IDLE_PRIORITY);
        for index in 0..4 {
            let mut bits = self.pending[index] & self.enabled[index];
            if self.masked {
                bits &= if index == 0 { 0x3FFF } else { 0 };
            }
            while bits != 0 {
                let number = (index as u16) << 6 | bits.trailing_zeros() as u16;
                bits &= bits - 1;
                let priority = self.priority(number);
                // Among equal priorities the lowest exception number comes first.
                if priority < least {
                    (best, least) = (number, priority);
                }
            }
        }
        self.best = best;
        self.best_priority = self.group_of(least);
    }

    /// Takes in the levels of the interrupt lines and of NMI. A rising edge makes the exception pending, even if the
    /// line falls again.
    #[inline]
    pub(crate) fn set_levels(&mut self, lines: &[u64; 4], nmi: bool) {
        let mut level = [
            lines[0] << 16,
            lines[1] << 16 | lines[0] >> 48,
            lines[2] << 16 | lines[1] >> 48,
            lines[3] << 16 | lines[2] >> 48,
        ];
        for (level, implemented) in level.iter_mut().zip(&self.implemented) {
            *level &= implemented;
        }
        level[0] |= u64::from(nmi) << NMI;
        if level != self.level {
            let mut risen = false;
            for ((pending, old), new) in self.pending.iter_mut().zip(&self.level).zip(&level) {
                let edges = new & !old & !*pending;
                *pending |= edges;
                risen |= edges != 0;
            }
            self.level = level;
            if risen {
                self.newly_pending = true;
                self.refresh_best();
            }
        }
    }

    pub(crate) fn pend(&mut self, number: u16) {
        let (word, bit) = bit(number);
        self.newly_pending |= self.pending[word] & bit == 0;
        self.pending[word] |= bit;
        self.refresh_best();
    }

    /// Clears the pending state of an exception. The exception stays pending if its line is still high and it is not
    /// active, ARM ARM B3.4.1.
    pub(crate) fn unpend(&mut self, number: u16) {
        let (word, bit) = bit(number);
        self.pending[word] &= !bit;
        self.pending[word] |= self.level[word] & !self.active[word] & bit;
        self.refresh_best();
    }

    pub(crate) fn set_active(&mut self, number: u16, active: bool) {
        let (word, bit) = bit(number);
        if active {
            self.active[word] |= bit;
        } else {
            self.active[word] &= !bit;
        }
        self.refresh();
    }

    pub(crate) fn set_enabled(&mut self, number: u16, enabled: bool) {
        let (word, bit) = bit(number);
        if enabled {
            self.enabled[word] |= bit;
        } else {
            self.enabled[word] &= !bit;
        }
        self.refresh_best();
    }

    pub(crate) fn activate(&mut self, number: u16) {
        let (word, bit) = bit(number);
        self.pending[word] &= !bit;
        self.active[word] |= bit;
        self.refresh();
    }

    /// Ends the active state of an exception. If the exception's line is still high, the exception is pending again.
    pub(crate) fn deactivate(&mut self, number: u16) {
        let (word, bit) = bit(number);
        self.active[word] &= !bit;
        let again = self.level[word] & bit & !self.pending[word];
        self.newly_pending |= again != 0;
        self.pending[word] |= again;
        self.refresh();
    }

    pub(crate) fn active_count(&self) -> u32 {
        self.active.iter().map(|word| word.count_ones()).sum()
    }

    /// ICSR.ISRPENDING: whether any interrupt (not a system exception) is pending.
    pub(crate) fn interrupt_pending(&self) -> bool {
        self.pending[0] >> 16 != 0 || self.pending[1..].iter().any(|&word| word != 0)
    }

    /// The 32 bits of `set` for the lines from 32 * `index` on.
    pub(crate) fn register(set: &Set, index: u32) -> u32 {
        let first = 16 + 32 * index;
        let word = (first >> 6) as usize;
        let low = set.get(word).map_or(0, |bits| bits >> (first & 63));
        let high = if first & 63 == 48 { set.get(word + 1).map_or(0, |bits| bits << 16) } else { 0 };
        (low | high) as u32
    }

    /// Returns a set of implemented lines: those from 32 * `index` on whose bits are set in `value`.
    fn named(&self, index: u32, value: u32) -> Set {
        let mut set = [0; 4];
        let first = 16 + 32 * index;
        let word = (first >> 6) as usize;
        if let Some(bits) = set.get_mut(word) {
            *bits = u64::from(value) << (first & 63);
        }
        if first & 63 == 48
            && let Some(bits) = set.get_mut(word + 1)
        {
            *bits = u64::from(value) >> 16;
        }
        for (bits, implemented) in set.iter_mut().zip(&self.implemented) {
            *bits &= implemented;
        }
        set
    }

    pub(crate) fn write_enable(&mut self, index: u32, value: u32, enable: bool) {
        let named = self.named(index, value);
        for (enabled, bits) in self.enabled.iter_mut().zip(&named) {
            *enabled = if enable { *enabled | bits } else { *enabled & !bits };
        }
        self.refresh_best();
    }

    pub(crate) fn write_pending(&mut self, index: u32, value: u32, pend: bool) {
        let named = self.named(index, value);
        for (word, bits) in named.iter().enumerate() {
            if pend {
                self.newly_pending |= bits & !self.pending[word] != 0;
                self.pending[word] |= bits;
            } else {
                self.pending[word] &= !bits;
                self.pending[word] |= self.level[word] & !self.active[word] & bits;
            }
        }
        self.refresh_best();
    }

    pub(crate) fn trigger(&mut self, line: u32) {
        self.write_pending(line >> 5, 1 << (line & 31), true);
    }
}
