//! The instances of the modelled blocks.

use super::*;
use crate::analog::{Comparator, Saadc};
use crate::ccm::Ccm;
use crate::clock_power::ClockPower;
use crate::ecb::Ecb;
use crate::egu::Egu;
use crate::nvmc::Nvmc;
use crate::ppi::Ppi;
use crate::pwm::Pwm;
use crate::qdec::Qdec;
use crate::rng::Rng;
use crate::rtc::Rtc;
use crate::temp::Temp;
use crate::timer::Timer;
use crate::uarte::Uarte;
use crate::wdt::Wdt;

/// All instances except GPIO.
#[derive(Clone, Debug)]
pub(super) struct Parts {
    pub(super) clock_power: ClockPower,
    pub(super) uarte: [Uarte; 2],
    pub(super) serial: [Serial; 4],
    pub(super) gpiote: Gpiote,
    pub(super) saadc: Saadc,
    pub(super) timer: [Timer; 5],
    pub(super) rtc: [Rtc; 3],
    pub(super) temp: Temp,
    pub(super) rng: Rng,
    pub(super) ecb: Ecb,
    pub(super) ccm: Ccm,
    pub(super) wdt: Wdt,
    pub(super) qdec: Qdec,
    pub(super) comparator: Comparator,
    pub(super) egu: [Egu; 6],
    pub(super) pwm: [Pwm; 4],
    pub(super) nvmc: Nvmc,
    pub(super) ppi: Ppi,
}

impl Parts {
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            clock_power: ClockPower::new(settings),
            uarte: Default::default(),
            serial: [Serial::new(true), Serial::new(true), Serial::new(true), Serial::new(false)],
            gpiote: Gpiote::default(),
            saadc: Saadc::new(settings.supply_microvolts),
            timer: [Timer::new(4), Timer::new(4), Timer::new(4), Timer::new(6), Timer::new(6)],
            rtc: [Rtc::new(3), Rtc::new(4), Rtc::new(4)],
            temp: Temp::new(settings.temperature_quarters),
            rng: Rng::new(settings.seed),
            ecb: Ecb::default(),
            ccm: Ccm::default(),
            wdt: Wdt::default(),
            qdec: Qdec::default(),
            comparator: Comparator::new(settings.supply_microvolts),
            egu: Default::default(),
            pwm: Default::default(),
            nvmc: Nvmc::default(),
            ppi: Ppi::default(),
        }
    }
}

/// Evaluates `$call` for the instance with the ID `$id`, in that instance's own type. The value is `None` if the ID has
/// no model.
macro_rules! instance {
    ($parts:expr, $id:expr, $instance:ident => $call:expr) => {{
        macro_rules! on {
            ($field:expr) => {{
                let $instance = &mut $field;
                Some($call)
            }};
        }
        match $id {
            0x00 => on!($parts.clock_power),
            0x02 => on!($parts.uarte[0]),
            0x28 => on!($parts.uarte[1]),
            0x03 | 0x04 => on!($parts.serial[$id - 0x03]),
            0x23 => on!($parts.serial[2]),
            0x2F => on!($parts.serial[3]),
            0x06 => on!($parts.gpiote),
            0x07 => on!($parts.saadc),
            0x08..=0x0A => on!($parts.timer[$id - 0x08]),
            0x1A | 0x1B => on!($parts.timer[$id - 0x1A + 3]),
            0x0B => on!($parts.rtc[0]),
            0x11 => on!($parts.rtc[1]),
            0x24 => on!($parts.rtc[2]),
            0x0C => on!($parts.temp),
            0x0D => on!($parts.rng),
            0x0E => on!($parts.ecb),
            0x0F => on!($parts.ccm),
            0x10 => on!($parts.wdt),
            0x12 => on!($parts.qdec),
            0x13 => on!($parts.comparator),
            0x14..=0x19 => on!($parts.egu[$id - 0x14]),
            0x1C => on!($parts.pwm[0]),
            0x21 | 0x22 => on!($parts.pwm[$id - 0x20]),
            0x2D => on!($parts.pwm[3]),
            0x1E => on!($parts.nvmc),
            0x1F => on!($parts.ppi),
            _ => None,
        }
    }};
}

macro_rules! call {
    ($soc:expr, $id:expr, $instance:ident, $cx:ident => $call:expr) => {{
        let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = &mut *$soc;
        *touched |= 1 << $id;
        let $cx = &mut Cx { now: *now, clocks, memory, pins: gpio, out, id: $id, name: name_of($id) };
        instance!(parts, $id, $instance => $call)
    }};
}

pub(super) const INSTANCES: u64 = {
    let mut set = 0;
    let mut n = 0;
    while n < BLOCKS.len() {
        if BLOCKS[n].modelled && BLOCKS[n].id != GPIO {
            set |= 1 << BLOCKS[n].id;
        }
        n += 1;
    }
    set
};

#[inline]
pub(super) fn ids(mut set: u64) -> impl Iterator<Item = Id> {
    std::iter::from_fn(move || {
        let id = set.trailing_zeros() as Id;
        (set != 0).then(|| {
            set &= set - 1;
            id
        })
    })
}

pub(super) const SPIS_IDS: [Id; 3] = [0x03, 0x04, 0x23];

pub(super) const UARTE_IDS: [Id; 2] = [0x02, 0x28];

#[inline]
pub(super) fn serial_number(id: Id) -> usize {
    match id {
        0x03 => 0,
        0x04 => 1,
        0x23 => 2,
        _ => 3,
    }
}
