//! A receiver's configuration: UBX-CFG-VALSET, its keys, and the receiver's answers.
//!
//! # Sources
//!
//! The rules follow the u-blox F9 and M9 interface descriptions ("Configuration interface", UBX-CFG-VALSET,
//! UBX-ACK-ACK, UBX-ACK-NAK), with which the key lists of pyubx2 and of SparkFun's u-blox library agree. The factory
//! settings are those of the ZED-F9R data sheet (UBX-22024085), "Default interface settings". The dynamic models and
//! their factory setting are those of the ZED-F9R and ZED-F9P integration manuals (UBX-20039643, UBX-18010802),
//! CFG-NAVSPG-DYNMODEL.
//!
//! # Rules
//!
//! - A message is applied whole or refused whole. It is refused for an unknown key, an impossible value, a layer that
//!   does not exist, an incomplete item, or more than 64 items.
//! - There are two layers: RAM, which a restart clears, and a saved layer, which stands for battery-backed RAM and
//!   flash.
//! - The keys of all of the receiver's ports are accepted, but only those of the connected port have an effect.
//! - The dynamic model is stored and reported, but does not change the solutions.
//! - A receiver without inertial sensors refuses the keys of NAV-ATT and ESF-INS, as its firmware does.
//! - A message with a wrong checksum, and noise between messages, are not answered.
//!
//! # Left out
//!
//! The model leaves out UBX-CFG-VALGET and UBX-CFG-VALDEL, transactions, the configuration messages of generation 8,
//! and input over NMEA or RTCM. It refuses any other message of class CFG, and ignores messages of other classes.

use std::collections::BTreeMap;

use crate::ubx::{self, Frame};

/// The UBX message class CFG, which configures the receiver.
pub const CLASS_CFG: u8 = 0x06;
/// The identifier of UBX-CFG-VALSET within class CFG.
pub const VALSET: u8 = 0x8A;
/// The UBX message class ACK, which answers messages of class CFG.
pub const CLASS_ACK: u8 = 0x05;
/// The identifier of UBX-ACK-ACK within class ACK: the message was applied.
pub const ACK: u8 = 0x01;
/// The identifier of UBX-ACK-NAK within class ACK: the message was refused.
pub const NAK: u8 = 0x00;

const MOST_ITEMS: usize = 64;
/// The longest message that a receiver accepts in this model, bytes: 64 items of eight bytes fit.
const LONGEST: usize = 1024;

/// The key of CFG-RATE-MEAS, the measurement period, ms.
pub const RATE_MEAS: u32 = 0x3021_0001;
/// The key of CFG-RATE-NAV, the number of measurements per navigation solution.
pub const RATE_NAV: u32 = 0x3021_0002;
/// The key of CFG-NAVSPG-DYNMODEL, the motion that the receiver's filter assumes.
pub const NAVSPG_DYNMODEL: u32 = 0x2011_0021;
/// The key of CFG-UART1-BAUDRATE, the bit rate of UART1, bit/s.
pub const UART1_BAUDRATE: u32 = 0x4052_0001;
/// The key of CFG-MSGOUT-UBX_NAV_PVT_I2C, the output rate of NAV-PVT on I2C; see [`Port::output_key`].
pub const MSGOUT_NAV_PVT: u32 = 0x2091_0006;
/// The key of CFG-MSGOUT-UBX_NAV_ATT_I2C, the output rate of NAV-ATT on I2C.
pub const MSGOUT_NAV_ATT: u32 = 0x2091_001F;
/// The key of CFG-MSGOUT-UBX_ESF_INS_I2C, the output rate of ESF-INS on I2C.
pub const MSGOUT_ESF_INS: u32 = 0x2091_0114;
/// The number of the protocol UBX in the keys that switch a port's output protocols.
pub const OUTPROT_UBX: u32 = 1;
/// The number of the protocol NMEA in the keys that switch a port's output protocols.
pub const OUTPROT_NMEA: u32 = 2;

/// The bit rates that a receiver's UART supports (data sheet, UART specifications; interface description).
const BAUD_RATES: [u64; 8] = [9_600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 921_600];

/// The port by which a receiver is connected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Port {
    /// UART1.
    Uart1,
    /// I2C, which u-blox calls DDC.
    I2c,
    /// SPI.
    Spi,
}

impl Port {
    /// The ports that connect the link's receivers 1 to 5 to HORUS (docs/hardware.md).
    pub const OF: [Self; 5] = [Self::Uart1, Self::I2c, Self::Spi, Self::Uart1, Self::Uart1];

    /// The number of ports that u-blox numbers consecutively in the CFG-MSGOUT keys of a message, with USB and UART2.
    const PLACES: u32 = 5;

    /// The key of a message's output rate on this port. `group` is the key of the same message's rate on I2C.
    #[must_use]
    pub const fn output_key(self, group: u32) -> u32 {
        group
            + match self {
                Self::I2c => 0,
                Self::Uart1 => 1,
                Self::Spi => 4,
            }
    }

    /// The key that switches an output protocol on this port on or off.
    #[must_use]
    pub const fn protocol_key(self, protocol: u32) -> u32 {
        protocol
            | match self {
                Self::I2c => 0x1072_0000,
                Self::Uart1 => 0x1074_0000,
                Self::Spi => 0x107A_0000,
            }
    }
}

/// The output of a receiver, as its configuration determines it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Output {
    /// The time from one solution to the next, ms.
    pub period_ms: u32,
    /// The number of solutions per NAV-PVT message; 0 if no NAV-PVT is sent.
    pub position: u32,
    /// The number of solutions per NAV-ATT message; 0 if no NAV-ATT is sent.
    pub attitude: u32,
    /// The number of solutions per ESF-INS message; 0 if no ESF-INS is sent.
    pub inertial: u32,
    /// Whether the receiver sends the NMEA sentences of its factory settings with every solution.
    pub nmea: bool,
    /// The bit rate of UART1, bit/s.
    pub bit_rate: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Abilities {
    pub(crate) attitude: bool,
    pub(crate) inertial: bool,
    pub(crate) fixed_period: bool,
}

#[derive(Debug, Clone)]
pub(crate) struct Configuration {
    port: Port,
    abilities: Abilities,
    factory: BTreeMap<u32, u64>,
    saved: BTreeMap<u32, u64>,
    ram: BTreeMap<u32, u64>,
    /// Received bytes that may be the beginning of a message.
    input: Vec<u8>,
}

impl Configuration {
    /// Returns the factory settings. A receiver with a fixed period has `period_ms` instead of the factory's period.
    pub(crate) fn new(port: Port, abilities: Abilities, period_ms: u32) -> Self {
        let mut factory = BTreeMap::new();
        for protocols in [0x1072_0000, 0x1074_0000, 0x107A_0000] {
            factory.insert(protocols | OUTPROT_UBX, 1);
            factory.insert(protocols | OUTPROT_NMEA, 1);
        }
        let groups =
            [(MSGOUT_NAV_PVT, true), (MSGOUT_NAV_ATT, abilities.attitude), (MSGOUT_ESF_INS, abilities.inertial)];
        for (group, _) in groups.into_iter().filter(|(_, known)| *known) {
            factory.extend((0..Port::PLACES).map(|place| (group + place, 0)));
        }
        factory.insert(RATE_MEAS, if abilities.fixed_period { u64::from(period_ms) } else { 1_000 });
        factory.insert(RATE_NAV, 1);
        factory.insert(UART1_BAUDRATE, 38_400);
        // The factory setting of the dynamic model is automotive with inertial sensors, and portable without.
        factory.insert(NAVSPG_DYNMODEL, if abilities.attitude || abilities.inertial { 4 } else { 0 });
        Self { port, abilities, factory, saved: BTreeMap::new(), ram: BTreeMap::new(), input: vec![] }
    }

    /// Sets and saves the settings that HORUS would send, except the dynamic model.
    pub(crate) fn configured(mut self, period_ms: u32, bit_rate: u32) -> Self {
        let port = self.port;
        let items = [
            (port.protocol_key(OUTPROT_UBX), 1),
            (port.protocol_key(OUTPROT_NMEA), 0),
            (port.output_key(MSGOUT_NAV_PVT), 1),
            (port.output_key(MSGOUT_NAV_ATT), 1),
            (port.output_key(MSGOUT_ESF_INS), 1),
            (RATE_MEAS, period_ms.into()),
            (UART1_BAUDRATE, bit_rate.into()),
        ];
        self.saved.extend(items.into_iter().filter(|(key, _)| self.factory.contains_key(key)));
        self
    }

    /// Restarts the receiver. The settings in RAM are lost and, with `factory`, the saved ones too.
    pub(crate) fn restart(&mut self, factory: bool) {
        self.ram.clear();
        self.input.clear();
        if factory {
            self.saved.clear();
        }
    }

    /// Clears the dynamic model in RAM. The saved model applies, or the factory's if none was saved.
    pub(crate) fn forget_dynamic_model(&mut self) {
        self.ram.remove(&NAVSPG_DYNMODEL);
    }

    pub(crate) fn dynamic_model(&self) -> u8 {
        u8::try_from(self.value(NAVSPG_DYNMODEL)).unwrap_or(u8::MAX)
    }

    fn value(&self, key: u32) -> u64 {
        let layers = [&self.ram, &self.saved, &self.factory];
        layers.into_iter().find_map(|layer| layer.get(&key)).copied().unwrap_or(0)
    }

    pub(crate) fn output(&self) -> Output {
        let small = |key| u32::try_from(self.value(key)).unwrap_or(u32::MAX);
        let ubx = self.value(self.port.protocol_key(OUTPROT_UBX)) != 0;
        let every = |group| if ubx { small(self.port.output_key(group)) } else { 0 };
        Output {
            period_ms: small(RATE_MEAS).saturating_mul(small(RATE_NAV)),
            position: every(MSGOUT_NAV_PVT),
            attitude: every(MSGOUT_NAV_ATT),
            inertial: every(MSGOUT_ESF_INS),
            nmea: self.value(self.port.protocol_key(OUTPROT_NMEA)) != 0,
            bit_rate: small(UART1_BAUDRATE),
        }
    }

    /// Processes a received byte, which is `None` if it was unreadable. Returns the answer to a completed message.
    pub(crate) fn hear(&mut self, byte: Option<u8>) -> Option<Vec<u8>> {
        let Some(byte) = byte else {
            self.input.clear();
            return None;
        };
        self.input.push(byte);
        loop {
            let length = match self.input[..] {
                [] => return None,
                [first, ..] if first != ubx::SYNC[0] => 0,
                [_, second, ..] if second != ubx::SYNC[1] => 0,
                [_, _, _, _, low, high, ..] => usize::from(u16::from_le_bytes([low, high])) + ubx::OVERHEAD,
                _ => return None,
            };
            if length == 0 || length > LONGEST {
                self.input.remove(0);
                continue;
            }
            if self.input.len() < length {
                return None;
            }
            let Some(message) = Frame::at_start_of(&self.input) else {
                self.input.remove(0);
                continue;
            };
            let (class, id, payload) = (message.class, message.id, message.payload.to_vec());
            self.input.drain(..length);
            if class != CLASS_CFG {
                continue;
            }
            let taken = id == VALSET && self.set(&payload).is_some();
            return Some(ubx::frame(CLASS_ACK, if taken { ACK } else { NAK }, &[class, id]));
        }
    }

    /// Applies the payload of UBX-CFG-VALSET; `None` if the message is refused.
    fn set(&mut self, payload: &[u8]) -> Option<()> {
        // The payload begins with version 0, the layers (RAM, battery-backed RAM, flash), and reserved bytes.
        let ([0, layers @ 1..=7, _, _], mut rest) = payload.split_first_chunk::<4>()? else { return None };
        let mut items = vec![];
        while !rest.is_empty() {
            let (key, after) = rest.split_first_chunk::<4>()?;
            let key = u32::from_le_bytes(*key);
            // Bits 28 to 30 of a key give the size of its value: a bit (in a byte), 1, 2, 4 or 8 bytes.
            let size = match key >> 28 & 7 {
                1 | 2 => 1,
                3 => 2,
                4 => 4,
                5 => 8,
                _ => return None,
            };
            let (value, after) = after.split_at_checked(size)?;
            let value = value.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte));
            if !self.factory.contains_key(&key) || !self.can_be(key, value) {
                return None;
            }
            items.push((key, value));
            rest = after;
        }
        if items.is_empty() || items.len() > MOST_ITEMS {
            return None;
        }
        if layers & 1 != 0 {
            self.ram.extend(items.iter().copied());
        }
        if layers & 6 != 0 {
            self.saved.extend(items);
        }
        Some(())
    }

    fn can_be(&self, key: u32, value: u64) -> bool {
        match key {
            // The shortest measurement period of this generation is 25 ms (NEO-M9N: 40 ms with several constellations).
            RATE_MEAS => !self.abilities.fixed_period && (25..=65_535).contains(&value),
            RATE_NAV => !self.abilities.fixed_period && (1..=127).contains(&value),
            UART1_BAUDRATE => BAUD_RATES.contains(&value),
            // Model 0 is portable, and models 2 to 9 range from stationary to wrist.
            NAVSPG_DYNMODEL => matches!(value, 0 | 2..=9),
            _ if key >> 28 == 1 => value <= 1,
            _ => true,
        }
    }
}
