//! UBX, the protocol of u-blox receivers: framing, and the three messages that HORUS reads.
//!
//! The source is the u-blox 8 / u-blox M8 receiver description including protocol specification (UBX-13003221), chapter
//! UBX Protocol; the F9 interface descriptions agree with it. Fields are little-endian and in the protocol's units, and
//! their names are those of the specification.

/// The two bytes that begin a frame: 0xB5 and, in ISO 8859-1, a small b.
pub const SYNC: [u8; 2] = [0xb5, 0x62];

/// The number of bytes of a frame without its payload: sync, class, identifier, length and checksum.
pub const OVERHEAD: usize = 8;

/// The message class NAV, navigation results.
pub const CLASS_NAV: u8 = 0x01;
/// The message class ESF, external sensor fusion.
pub const CLASS_ESF: u8 = 0x10;

/// The number of milliseconds in a GPS week, the modulus of `iTOW`.
pub const WEEK_MS: u32 = 7 * 24 * 3_600 * 1_000;

/// The 8-bit Fletcher checksum (RFC 1145) over class, identifier, length and payload.
#[must_use]
pub fn checksum(bytes: &[u8]) -> [u8; 2] {
    bytes.iter().fold([0, 0], |[a, b]: [u8; 2], byte| {
        let a = a.wrapping_add(*byte);
        [a, b.wrapping_add(a)]
    })
}

/// A whole frame around `payload`.
///
/// # Panics
///
/// Panics if the payload exceeds the 65535 bytes that the length field can express.
#[must_use]
pub fn frame(class: u8, id: u8, payload: &[u8]) -> Vec<u8> {
    let length = u16::try_from(payload.len()).expect("a UBX payload has at most 65535 bytes");
    let mut bytes = Vec::with_capacity(payload.len() + OVERHEAD);
    bytes.extend(SYNC);
    bytes.extend([class, id]);
    bytes.extend(length.to_le_bytes());
    bytes.extend(payload);
    let sum = checksum(&bytes[SYNC.len()..]);
    bytes.extend(sum);
    bytes
}

/// A UBX frame in a byte stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame<'a> {
    /// The message class.
    pub class: u8,
    /// The message identifier within its class.
    pub id: u8,
    /// The bytes of the frame between length and checksum.
    pub payload: &'a [u8],
}

impl<'a> Frame<'a> {
    /// The frame at the start of `bytes`, if there is a whole one with a right checksum.
    #[must_use]
    pub fn at_start_of(bytes: &'a [u8]) -> Option<Self> {
        let rest = bytes.strip_prefix(&SYNC)?;
        let [class, id, low, high, ..] = *rest else {
            return None;
        };
        let end = 4 + usize::from(u16::from_le_bytes([low, high]));
        let sum = rest.get(end..end + 2)?;
        (checksum(&rest[..end]) == sum).then(|| Self { class, id, payload: &rest[4..end] })
    }

    /// The number of bytes of the frame on the wire.
    #[must_use]
    pub fn wire_len(&self) -> usize {
        self.payload.len() + OVERHEAD
    }

    /// GPS time of week of the navigation epoch, ms, if this is a message of class NAV that has one.
    #[must_use]
    pub fn itow_ms(&self) -> Option<u32> {
        let offset = match (self.class, self.id) {
            // These messages begin with the time of week: POSECEF, POSLLH, STATUS, DOP, ATT, SOL, PVT, VELECEF, VELNED,
            // TIMEGPS, TIMEUTC, CLOCK, TIMEGLO, TIMEBDS, TIMEGAL, TIMELS, TIMEQZSS, NMI.
            (CLASS_NAV, 0x01..=0x07 | 0x11 | 0x12 | 0x20..=0x28) => 0,
            // These messages begin with the time of week too: SVINFO, DGPS, SBAS, ORB, SAT, COV, GEOFENCE, EELL, SLAS,
            // SIG, AOPSTATUS, EOE.
            (CLASS_NAV, 0x30..=0x32 | 0x34..=0x36 | 0x39 | 0x3d | 0x42 | 0x43 | 0x60 | 0x61) => 0,
            // These messages begin with a version, which the time of week follows: ODO, HPPOSECEF, HPPOSLLH, SVIN,
            // RELPOSNED.
            (CLASS_NAV, 0x09 | 0x13 | 0x14 | 0x3b | 0x3c) => 4,
            _ => return None,
        };
        let field = self.payload.get(offset..offset + 4)?;
        let itow = u32::from_le_bytes(field.try_into().ok()?);
        (itow < WEEK_MS).then_some(itow)
    }
}

/// UBX-NAV-PVT (0x01 0x07): navigation position velocity time solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NavPvt {
    /// GPS time of week, ms, of the navigation epoch.
    pub itow_ms: u32,
    /// Year (UTC).
    pub year: u16,
    /// Month, 1 ..= 12 (UTC).
    pub month: u8,
    /// Day of month, 1 ..= 31 (UTC).
    pub day: u8,
    /// Hour, 0 ..= 23 (UTC).
    pub hour: u8,
    /// Minute, 0 ..= 59 (UTC).
    pub minute: u8,
    /// Second, 0 ..= 60 (UTC).
    pub second: u8,
    /// Flags of the time: bit 0 date valid, bit 1 time of day valid, bit 2 time of day fully resolved, bit 3 magnetic
    /// declination valid.
    pub valid: u8,
    /// Time accuracy estimate, ns.
    pub time_accuracy_ns: u32,
    /// Fraction of the second, ns, −1e9 ..= 1e9.
    pub nano: i32,
    /// The type of the fix: 0 none, 1 dead reckoning, 2 2D, 3 3D, 4 GNSS and dead reckoning, 5 time only.
    pub fix_type: u8,
    /// Flags of the fix: bit 0 gnssFixOK, bit 1 differential corrections used, bit 5 vehicle heading valid.
    pub flags: u8,
    /// Flags of the time's confirmation: bit 5 confirmation available, bit 6 date confirmed, bit 7 time confirmed.
    pub flags2: u8,
    /// The number of satellites used.
    pub satellites: u8,
    /// Longitude, 1e-7 deg.
    pub longitude_1e7: i32,
    /// Latitude, 1e-7 deg.
    pub latitude_1e7: i32,
    /// Height above the ellipsoid, mm.
    pub height_mm: i32,
    /// Height above mean sea level, mm.
    pub height_msl_mm: i32,
    /// Horizontal accuracy estimate, mm.
    pub horizontal_accuracy_mm: u32,
    /// Vertical accuracy estimate, mm.
    pub vertical_accuracy_mm: u32,
    /// Velocity north, east, down, mm/s.
    pub velocity_mm_s: [i32; 3],
    /// Ground speed, mm/s.
    pub ground_speed_mm_s: i32,
    /// Heading of motion, 1e-5 deg.
    pub heading_of_motion_1e5: i32,
    /// Speed accuracy estimate, mm/s.
    pub speed_accuracy_mm_s: u32,
    /// Heading accuracy estimate, 1e-5 deg.
    pub heading_accuracy_1e5: u32,
    /// The position dilution of precision, in units of 0.01.
    pub pdop_1e2: u16,
    /// Further flags: with bit 0 set, longitude, latitude, height and hMSL are invalid.
    pub flags3: u8,
    /// The heading of the vehicle, 1e-5 deg; valid if bit 5 of `flags` is set.
    pub heading_of_vehicle_1e5: i32,
}

impl NavPvt {
    /// The message identifier within class NAV.
    pub const ID: u8 = 0x07;
    /// The number of bytes of the payload (protocol version 15 and later).
    pub const PAYLOAD: usize = 92;
    /// The number of bytes of the message on the wire.
    pub const WIRE: usize = Self::PAYLOAD + OVERHEAD;
    /// The bit of `flags` for a fix that is valid within the receiver's accuracy masks.
    pub const FLAG_FIX_OK: u8 = 1;
    /// The bit of `flags` for a valid heading of the vehicle.
    pub const FLAG_HEADING_OF_VEHICLE: u8 = 1 << 5;
    /// The bit of `flags3` for invalid longitude, latitude, height and hMSL.
    pub const FLAG3_INVALID_LLH: u8 = 1;

    /// The encoded message.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut p = Vec::with_capacity(Self::PAYLOAD);
        p.extend(self.itow_ms.to_le_bytes());
        p.extend(self.year.to_le_bytes());
        p.extend([self.month, self.day, self.hour, self.minute, self.second, self.valid]);
        p.extend(self.time_accuracy_ns.to_le_bytes());
        p.extend(self.nano.to_le_bytes());
        p.extend([self.fix_type, self.flags, self.flags2, self.satellites]);
        p.extend(self.longitude_1e7.to_le_bytes());
        p.extend(self.latitude_1e7.to_le_bytes());
        p.extend(self.height_mm.to_le_bytes());
        p.extend(self.height_msl_mm.to_le_bytes());
        p.extend(self.horizontal_accuracy_mm.to_le_bytes());
        p.extend(self.vertical_accuracy_mm.to_le_bytes());
        p.extend(self.velocity_mm_s.iter().flat_map(|v| v.to_le_bytes()));
        p.extend(self.ground_speed_mm_s.to_le_bytes());
        p.extend(self.heading_of_motion_1e5.to_le_bytes());
        p.extend(self.speed_accuracy_mm_s.to_le_bytes());
        p.extend(self.heading_accuracy_1e5.to_le_bytes());
        p.extend(self.pdop_1e2.to_le_bytes());
        p.push(self.flags3);
        p.extend([0; 5]);
        p.extend(self.heading_of_vehicle_1e5.to_le_bytes());
        // The magnetic declination and its accuracy are not valid (bit 3 of `valid`).
        p.extend([0; 4]);
        debug_assert_eq!(p.len(), Self::PAYLOAD);
        frame(CLASS_NAV, Self::ID, &p)
    }
}

/// UBX-NAV-ATT (0x01 0x05): attitude solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NavAtt {
    /// GPS time of week, ms, of the navigation epoch.
    pub itow_ms: u32,
    /// Vehicle roll, 1e-5 deg.
    pub roll_1e5: i32,
    /// Vehicle pitch, 1e-5 deg.
    pub pitch_1e5: i32,
    /// Vehicle heading, 1e-5 deg, 0 ..= 360.
    pub heading_1e5: i32,
    /// The accuracy estimates of roll, pitch and heading, 1e-5 deg.
    pub accuracy_1e5: [u32; 3],
}

impl NavAtt {
    /// The message identifier within class NAV.
    pub const ID: u8 = 0x05;
    /// The number of bytes of the payload.
    pub const PAYLOAD: usize = 32;
    /// The number of bytes of the message on the wire.
    pub const WIRE: usize = Self::PAYLOAD + OVERHEAD;

    /// The encoded message.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut p = Vec::with_capacity(Self::PAYLOAD);
        p.extend(self.itow_ms.to_le_bytes());
        // Version 0 and three reserved bytes.
        p.extend([0; 4]);
        for angle in [self.roll_1e5, self.pitch_1e5, self.heading_1e5] {
            p.extend(angle.to_le_bytes());
        }
        p.extend(self.accuracy_1e5.iter().flat_map(|a| a.to_le_bytes()));
        debug_assert_eq!(p.len(), Self::PAYLOAD);
        frame(CLASS_NAV, Self::ID, &p)
    }
}

/// UBX-ESF-INS (0x10 0x15): vehicle dynamics, compensated for sensor errors and gravity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EsfIns {
    /// GPS time of week, ms, of the navigation epoch.
    pub itow_ms: u32,
    /// The turn rates about the body axes front, right and down, 1e-3 deg/s; all are valid.
    pub rates_1e3: [i32; 3],
    /// The accelerations along the body axes front, right and down without gravity, 1e-2 m/s²; all are valid.
    pub accelerations_1e2: [i32; 3],
}

impl EsfIns {
    /// The message identifier within class ESF.
    pub const ID: u8 = 0x15;
    /// The number of bytes of the payload.
    pub const PAYLOAD: usize = 36;
    /// The number of bytes of the message on the wire.
    pub const WIRE: usize = Self::PAYLOAD + OVERHEAD;
    /// The message's first field: version 1 in bits 0 to 7, and in bits 8 to 13 the flags of six valid values.
    const BITFIELD: u32 = 0x3f01;

    /// The encoded message.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut p = Vec::with_capacity(Self::PAYLOAD);
        p.extend(Self::BITFIELD.to_le_bytes());
        p.extend([0; 4]);
        p.extend(self.itow_ms.to_le_bytes());
        for value in self.rates_1e3.iter().chain(&self.accelerations_1e2) {
            p.extend(value.to_le_bytes());
        }
        debug_assert_eq!(p.len(), Self::PAYLOAD);
        frame(CLASS_ESF, Self::ID, &p)
    }
}
