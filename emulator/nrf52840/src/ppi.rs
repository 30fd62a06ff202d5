//! PPI: events trigger tasks without the CPU (PS 6.16).
//!
//! | covered | PS |
//! |---|---|
//! | 20 programmable channels, CHEN, CHENSET, CHENCLR | 6.16 |
//! | 12 fixed channels | 6.16 |
//! | FORK of every channel | 6.16 |
//! | 6 groups with their EN and DIS tasks, which other channels may trigger | 6.16 |
//!
//! Left out: the PCLK16M cycle that a channel takes. Tasks of one event run in the order of the channels, each before
//! its fork.
use crate::clocks::Clocks;
use crate::instance::{Act, Block, Cx, Instance, address_of, event, index};
use std::collections::VecDeque;

const CHANNELS: usize = 32;
const PROGRAMMABLE: u32 = 20;
const GROUPS: u32 = 6;

const TIMER0: u32 = address_of(0x08);
const RTC0: u32 = address_of(0x0B);
const RADIO: u32 = address_of(0x01);
const CCM: u32 = address_of(0x0F);

/// The event and the task of each of the channels 20 to 31 (PS 6.16, *Pre-programmed channels*).
const FIXED: [(u32, u32); CHANNELS - PROGRAMMABLE as usize] = [
    (TIMER0 + event(16), RADIO),         // COMPARE[0] to TXEN
    (TIMER0 + event(16), RADIO + 0x004), // COMPARE[0] to RXEN
    (TIMER0 + event(17), RADIO + 0x010), // COMPARE[1] to DISABLE
    (RADIO + event(10), CCM),            // BCMATCH to AAR START
    (RADIO + event(0), CCM),             // READY to CCM KSGEN
    (RADIO + event(1), CCM + 0x004),     // ADDRESS to CCM CRYPT
    (RADIO + event(1), TIMER0 + 0x044),  // ADDRESS to CAPTURE[1]
    (RADIO + event(3), TIMER0 + 0x048),  // END to CAPTURE[2]
    (RTC0 + event(16), RADIO),           // COMPARE[0] to TXEN
    (RTC0 + event(16), RADIO + 0x004),   // COMPARE[0] to RXEN
    (RTC0 + event(16), TIMER0 + 0x00C),  // COMPARE[0] to CLEAR
    (RTC0 + event(16), TIMER0),          // COMPARE[0] to START
];

#[derive(Clone, Debug)]
pub(crate) struct Ppi {
    block: Block,
    enabled: u32,
    ends: [(u32, u32); CHANNELS],
    forks: [u32; CHANNELS],
    groups: [u32; GROUPS as usize],
}

impl Default for Ppi {
    fn default() -> Self {
        let mut ends = [(0, 0); CHANNELS];
        ends[PROGRAMMABLE as usize..].copy_from_slice(&FIXED);
        Self { block: Block::default(), enabled: 0, ends, forks: [0; CHANNELS], groups: [0; GROUPS as usize] }
    }
}

impl Ppi {
    #[inline]
    pub(crate) fn route(&self, address: u32, acts: &mut VecDeque<Act>) {
        let mut left = self.enabled;
        while left != 0 {
            let n = left.trailing_zeros() as usize;
            left &= left - 1;
            if self.ends[n].0 == address {
                for task in [self.ends[n].1, self.forks[n]] {
                    if task != 0 {
                        acts.push_back(Act::Task(task));
                    }
                }
            }
        }
    }
}

impl Instance for Ppi {
    crate::instance::block!();

    fn task(&mut self, offset: u32, _: &mut Cx<'_>) -> bool {
        let Some(n) = index(offset, 0, 4, 2 * GROUPS) else {
            return false;
        };
        let group = self.groups[n / 2];
        self.enabled = if n % 2 == 0 { self.enabled | group } else { self.enabled & !group };
        true
    }

    fn read(&self, offset: u32, _: u64, _: &Clocks) -> Option<u32> {
        Some(match offset {
            0x500 | 0x504 | 0x508 => self.enabled,
            _ => {
                if let Some(n) = index(offset, 0x510, 4, 2 * PROGRAMMABLE) {
                    let (event, task) = self.ends[n / 2];
                    if n % 2 == 0 { event } else { task }
                } else if let Some(n) = index(offset, 0x800, 4, GROUPS) {
                    self.groups[n]
                } else {
                    self.forks[index(offset, 0x910, 4, CHANNELS as u32)?]
                }
            }
        })
    }

    fn write(&mut self, offset: u32, value: u32, _: &mut Cx<'_>) -> bool {
        match offset {
            0x500 => self.enabled = value,
            0x504 => self.enabled |= value,
            0x508 => self.enabled &= !value,
            _ => {
                if let Some(n) = index(offset, 0x510, 4, 2 * PROGRAMMABLE) {
                    let ends = &mut self.ends[n / 2];
                    *(if n % 2 == 0 { &mut ends.0 } else { &mut ends.1 }) = value;
                } else if let Some(n) = index(offset, 0x800, 4, GROUPS) {
                    self.groups[n] = value;
                } else if let Some(n) = index(offset, 0x910, 4, CHANNELS as u32) {
                    self.forks[n] = value;
                } else {
                    return false;
                }
            }
        }
        true
    }
}
