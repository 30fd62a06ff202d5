//! Measures the fields of the objects at their offsets in `profile`, and writes them as C structures of bytes.

use std::fmt::Write as _;

use anyhow::{Context, Result, ensure};
use profile::criticality::{ActiveLoad, Dpr, FlightController, Writer};
use profile::hold::{Acknowledged, Outcome};
use profile::ssi::{self, Request};
use profile::{
    Command, CommandObject, GpsObject, GpsStatus, GpsValues, HoldStatus, HoldStatusBits, HoldValues, Identifier,
    LinkStatus, LinkStatusBits, LinkValues, PortStatus, PortStatusBits, PortValues, ReportedPosition, ReportedStatus,
    ReportedValues, Uplink, UplinkStatus, UplinkValues, Violation, Violations, crc,
};

pub(super) const COMMAND_RESERVED: usize = CommandObject::SIZE - 12 - 4;

/// Values of fields whose bytes occur nowhere else in an object.
const U16: u16 = 0x5AC3;
const U32: u32 = 0xA1B2_C3D4;
const F32: f32 = f32::from_bits(0x41A1_B2C3);
const F64: f64 = f64::from_bits(0x4031_A2B3_C4D5_E6F7);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    U16,
    U32,
    F32,
    F64,
    Identifier,
    Axes,
    Counts,
    Acknowledged,
    /// A status word, with the prefix of its bits' names in C.
    Status(&'static str),
    Word,
    Bytes,
    Zero,
    /// A CRC of this name, which covers the bytes from the field `from` up to the CRC.
    Crc {
        name: &'static str,
        from: usize,
    },
}

impl Kind {
    const fn c(self) -> &'static str {
        match self {
            Self::U16 | Self::Identifier | Self::Status(_) => "u16",
            Self::U32 | Self::Word => "u32",
            Self::F32 => "binary32",
            Self::F64 => "binary64",
            Self::Axes => "3 x binary32",
            Self::Counts => "u16 of each kind",
            Self::Acknowledged | Self::Bytes | Self::Zero => "",
            Self::Crc { .. } => "u32, big-endian",
        }
    }
}

trait Number {
    const KIND: Kind;
}

impl Number for u16 {
    const KIND: Kind = Kind::U16;
}

impl Number for u32 {
    const KIND: Kind = Kind::U32;
}

impl Number for f32 {
    const KIND: Kind = Kind::F32;
}

impl Number for f64 {
    const KIND: Kind = Kind::F64;
}

fn kind_of<T: Number>(_: T) -> Kind {
    T::KIND
}

pub(crate) struct Field {
    pub(crate) name: &'static str,
    pub(crate) place: std::ops::Range<usize>,
    pub(crate) kind: Kind,
    pub(crate) unit: &'static str,
    pub(crate) what: &'static str,
}

impl Field {
    fn comment(&self) -> String {
        let what = match self.kind {
            Kind::Status(prefix) if !prefix.is_empty() => format!("HORUS_DPR_{prefix}_..."),
            Kind::Word => "HORUS_DPR_COMMAND_...".to_owned(),
            _ => self.what.to_owned(),
        };
        let parts = [self.kind.c(), &what];
        parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ")
    }
}

/// An object of the map, with those of its fields that were found so far.
pub(crate) struct Object {
    pub(crate) name: &'static str,
    pub(crate) title: &'static str,
    pub(crate) identifiers: &'static [Identifier],
    /// The identifiers' names in C.
    names: &'static str,
    pub(crate) size: usize,
    pub(crate) fields: Vec<Field>,
}

impl Object {
    fn new(
        (name, title): (&'static str, &'static str),
        identifiers: &'static [Identifier],
        names: &'static str,
        size: usize,
    ) -> Self {
        Self { name, title, identifiers, names, size, fields: vec![] }
    }

    /// Adds a field, at the only place where the object `sealed` has the bytes of `value`.
    fn field(
        mut self,
        name: &'static str,
        kind: Kind,
        (unit, what): (&'static str, &'static str),
        value: &[u8],
        sealed: &[u8],
    ) -> Result<Self> {
        ensure!(sealed.len() == self.size, "{} has {} bytes", self.name, sealed.len());
        ensure!(what.contains(unit), "{name} of {} is in {unit}, and its comment does not say so", self.name);
        let mut places = (0..=self.size - value.len()).filter(|at| sealed[*at..].starts_with(value));
        let start = places.next().with_context(|| format!("{} of {} is nowhere", name, self.name))?;
        ensure!(places.next().is_none(), "{} of {} is in more than one place", name, self.name);
        self.fields.push(Field { name, place: start..start + value.len(), kind, unit, what });
        Ok(self)
    }

    /// Adds the fields of the identifier and the status word. The names of the status word's bits begin with `prefix`
    /// in C.
    fn head(self, value: Identifier, prefix: &'static str, status: u16, sealed: &[u8]) -> Result<Self> {
        self.field("identifier", Kind::Identifier, ("", ""), &value.0.to_le_bytes(), sealed)?.field(
            "status",
            Kind::Status(prefix),
            ("", if prefix.is_empty() { "as writer and reader agree" } else { "" }),
            &status.to_le_bytes(),
            sealed,
        )
    }

    fn rest(mut self, name: &'static str, kind: Kind, what: &'static str, bytes: usize) -> Self {
        let start = self.fields.iter().map(|field| field.place.end).max().unwrap_or(0);
        self.fields.push(Field { name, place: start..start + bytes, kind, unit: "", what });
        self
    }

    fn crc(
        self,
        name: &'static str,
        algorithm: &'static str,
        what: &'static str,
        value: u32,
        sealed: &[u8],
    ) -> Result<Self> {
        let blank = Kind::Crc { name: algorithm, from: 0 };
        let mut object = self.field(name, blank, ("", what), &value.to_be_bytes(), sealed)?;
        let of = if algorithm == "frame" { crc::frame } else { crc::position };
        let end = object.fields.last().map_or(0, |field| field.place.start);
        let starts = object.fields.iter().map(|field| field.place.start).filter(|start| *start < end);
        let mut starts = starts.filter(|start| of(&sealed[*start..end]) == value);
        let from = starts.next().with_context(|| format!("{name} of {} covers no fields", object.name))?;
        ensure!(starts.next().is_none(), "{name} of {} covers more than one row of fields", object.name);
        drop(starts);
        object.fields.last_mut().context("just added")?.kind = Kind::Crc { name: algorithm, from };
        Ok(object)
    }

    /// Sorts the fields, and fails unless they fill the object without a gap.
    fn whole(mut self) -> Result<Self> {
        self.fields.sort_by_key(|field| field.place.start);
        let mut end = 0;
        for Field { name, place, .. } in &self.fields {
            ensure!(place.start == end, "{name} of {} begins at {}, not at {end}", self.name, place.start);
            end = place.end;
        }
        ensure!(end == self.size, "the fields of {} end at {end}", self.name);
        Ok(self)
    }

    fn structure(&self) -> String {
        let member = |field: &Field| format!("uint8_t {}[{}];", field.name, field.place.len());
        let width = self.fields.iter().map(|field| member(field).len()).max().unwrap_or(0);
        let Self { name, title, names, size, .. } = self;
        let mut text = format!("/* {title}, identifier {names}, {size} bytes. */\ntypedef struct {{\n");
        for field in &self.fields {
            let _ = writeln!(text, "    {:width$} /* {:2}: {} */", member(field), field.place.start, field.comment());
        }
        let structure = format!("horus_dpr_wire_{name}_t");
        let _ = writeln!(text, "}} {structure};");
        let _ = writeln!(text, "HORUS_DPR_ASSERT(sizeof({structure}) == {size}U, \"size\");");
        for Field { name, place, .. } in &self.fields {
            let _ = writeln!(text, "HORUS_DPR_ASSERT(offsetof({structure}, {name}) == {}U, \"{name}\");", place.start);
        }
        text.push('\n');
        text
    }
}

pub(crate) fn all() -> Result<Vec<Object>> {
    [link_status()?, reported()?, gps()?, port_status()?, uplink()?, command()?, hold_status()?]
        .into_iter()
        .map(Object::whole)
        .collect()
}

pub(crate) fn request() -> Result<Object> {
    let request = Request { offset: U16, length: !U16 };
    let bytes = ssi::encode(request);
    let [.., c0, c1, c2, c3] = bytes;
    Object::new(("request", "Request of a window"), &[], "none", ssi::REQUEST_SIZE)
        .field("offset", Kind::U16, ("", "the first byte of the map to show"), &request.offset.to_le_bytes(), &bytes)?
        .field("length", Kind::U16, ("bytes", "bytes"), &request.length.to_le_bytes(), &bytes)?
        .crc("crc", "frame", "over all before", u32::from_be_bytes([c0, c1, c2, c3]), &bytes)?
        .whole()
}

pub(super) fn structs() -> Result<String> {
    Ok(all()?.iter().map(Object::structure).collect())
}

/// Adds the fields of a value type. Each is found in an object in which only that field is set.
macro_rules! fields {
    ($object:ident, $blank:expr, $seal:expr; $($name:ident: $value:expr, $unit:literal, $what:literal;)*) => {
        $object$(.field(
            stringify!($name),
            kind_of($value),
            ($unit, $what),
            &$value.to_le_bytes(),
            &{ let mut values = $blank; values.$name = $value; *$seal(&values).as_bytes() },
        )?)*
    };
}

fn link_status() -> Result<Object> {
    let object = Object::new(
        ("link_status", "Link-Status"),
        &[Identifier::LINK_STATUS],
        "HORUS_DPR_ID_LINK_STATUS",
        LinkStatus::SIZE,
    );
    let blank = LinkValues::default();
    let all = LinkStatusBits::from_bits(u16::MAX);
    let status = LinkStatus::seal(&LinkValues { status: all, ..blank });
    let object = fields!(object, blank, LinkStatus::seal;
        timestamp: U32, "ms", "ms since DPR start";
        objects_accepted: U32, "", "objects accepted";
        objects_rejected: U32, "", "objects rejected";
        frames_received: U32, "", "frames received";
        frames_missed: U32, "", "frames missed";
        age_100us: U16, "100 us", "age of Reported-Position, 100 us";
        access_violations: U16, "", "accesses refused";
    );
    object.head(Identifier::LINK_STATUS, "LINK", all.bits(), status.as_bytes())?.crc(
        "crc",
        "frame",
        "over all before",
        status.crc(),
        status.as_bytes(),
    )
}

fn reported() -> Result<Object> {
    let object = Object::new(
        ("reported", "Reported-Position"),
        &[Identifier::REPORTED_POSITION],
        "HORUS_DPR_ID_REPORTED_POSITION",
        ReportedPosition::SIZE,
    );
    let blank = ReportedValues::absent(0);
    let all = ReportedStatus::from_bits(u16::MAX);
    let status = ReportedPosition::seal(&ReportedValues { status: all, ..blank });
    // The CRCs are found later, when latitude and longitude are known fields.
    let sealed = ReportedPosition::seal(&ReportedValues { latitude: F64, longitude: -F64, ..blank });
    let axes = [F32, -F32, F32 + 1.0];
    let accelerated = ReportedPosition::seal(&ReportedValues { acceleration: axes, ..blank });
    let object = fields!(object, blank, ReportedPosition::seal;
        timestamp: U32, "ms", "ms since HORUS start";
        latitude: F64, "degrees", "degrees";
        longitude: F64, "degrees", "degrees";
        altitude: F64, "m", "m";
        pitch: F32, "rad", "rad";
        yaw: F32, "rad", "rad";
        roll: F32, "rad", "rad";
    );
    object
        .field(
            "acceleration",
            Kind::Axes,
            ("m/s2", "m/s2"),
            axes.map(f32::to_le_bytes).as_flattened(),
            accelerated.as_bytes(),
        )?
        .head(Identifier::REPORTED_POSITION, "REPORTED", all.bits(), status.as_bytes())?
        .crc("position_crc", "position", "over latitude and longitude", sealed.position_crc(), sealed.as_bytes())?
        .crc("crc", "frame", "over all before", status.crc(), status.as_bytes())
}

fn gps() -> Result<Object> {
    let object = Object::new(
        ("gps", "GPS1 to GPS5"),
        &Identifier::GPS,
        "HORUS_DPR_ID_REPORTED_POSITION + 1 to 5",
        GpsObject::SIZE,
    );
    let blank = GpsValues::absent(0);
    let all = GpsStatus::from_bits(u16::MAX);
    let seal = |values: &GpsValues| GpsObject::seal(Identifier::gps(1), values);
    let status = seal(&GpsValues { status: all, ..blank });
    let axes = [F32, -F32, F32 + 1.0];
    let accelerated = seal(&GpsValues { acceleration: axes, ..blank });
    let object = fields!(object, blank, seal;
        timestamp: U32, "ms", "ms since HORUS start";
        latitude: F64, "degrees", "degrees";
        longitude: F64, "degrees", "degrees";
        altitude: F64, "m", "m";
        pitch: F32, "rad", "rad";
        yaw: F32, "rad", "rad";
        roll: F32, "rad", "rad";
    );
    object
        .field(
            "acceleration",
            Kind::Axes,
            ("m/s2", "m/s2"),
            axes.map(f32::to_le_bytes).as_flattened(),
            accelerated.as_bytes(),
        )?
        .head(Identifier::gps(1), "GPS", all.bits(), status.as_bytes())?
        .crc("crc", "frame", "over all before", status.crc(), status.as_bytes())
}

fn port_status() -> Result<Object> {
    let object = Object::new(
        ("port_status", "Port-Status"),
        &[Identifier::PORT_STATUS],
        "HORUS_DPR_ID_PORT_STATUS",
        PortStatus::SIZE,
    );
    let blank = PortValues::default();
    let all = PortStatusBits::from_bits(u16::MAX);
    let seal = |values: &PortValues| PortStatus::seal(Writer::<Dpr>::claim(), values);
    let status = seal(&PortValues { status: all, ..blank });
    let mut violations = Violations::new();
    let counts: Vec<_> = Violation::ALL.into_iter().zip(U16..).collect();
    counts.iter().for_each(|(kind, count)| violations.count(*kind, *count));
    let counted = seal(&PortValues { violations, ..blank });
    let counts: Vec<_> = counts.iter().flat_map(|(_, count)| count.to_le_bytes()).collect();
    let object = fields!(object, blank, seal;
        timestamp: U32, "ms", "ms since DPR start";
        uplinks_accepted: U32, "", "uplinks stored";
        commands_carried_out: U32, "", "commands carried out";
        last_command_timestamp: U32, "ms", "ms, timestamp of the last command";
        last_command: U32, "", "its word";
        base_station_age_ms: U16, "ms", "ms since the base station's uplink";
        flight_controller_age_ms: U16, "ms", "ms since the flight controller's uplink";
        integrity_faults: U16, "", "faults found in images";
        flash_passes: U16, "", "passes over the flash";
        stuck_bits: U16, "", "stuck bits found";
        buffers_out_of_use: U16, "", "buffers out of use";
        last_stop: U32, "", "reason of the last safe state";
    );
    object
        .field("violations", Kind::Counts, ("", ""), &counts, counted.as_bytes())?
        .head(Identifier::PORT_STATUS, "PORT", all.bits(), status.as_bytes())?
        .crc("crc", "frame", "over all before", status.crc(), status.as_bytes())
}

fn uplink() -> Result<Object> {
    let names = "HORUS_DPR_ID_UPLINK_BASE_STATION or HORUS_DPR_ID_UPLINK_FLIGHT_CONTROLLER";
    let mut payload = [0; Uplink::PAYLOAD];
    payload.iter_mut().zip(1..).for_each(|(byte, value)| *byte = value);
    let values = UplinkValues { timestamp: U32, status: UplinkStatus::from_bits(U16), payload };
    let sealed = Uplink::seal(Writer::<FlightController>::claim(), &values);
    let bytes = sealed.as_bytes();
    Object::new(
        ("uplink", "Uplink"),
        &[Identifier::UPLINK_BASE_STATION, Identifier::UPLINK_FLIGHT_CONTROLLER],
        names,
        Uplink::SIZE,
    )
    .field("timestamp", Kind::U32, ("ms", "ms on the writer's clock"), &U32.to_le_bytes(), bytes)?
    .head(Identifier::UPLINK_FLIGHT_CONTROLLER, "", U16, bytes)?
    .field("payload", Kind::Bytes, ("", "the writer's"), &payload, bytes)?
    .crc("crc", "frame", "over all before", sealed.crc(), bytes)
}

fn command() -> Result<Object> {
    let word = Command::SelfTest;
    let sealed = CommandObject::seal(Writer::<FlightController>::claim(), U32, word);
    let bytes = sealed.as_bytes();
    let object =
        Object::new(("command", "Command"), &[Identifier::COMMAND], "HORUS_DPR_ID_COMMAND", CommandObject::SIZE)
            .field("timestamp", Kind::U32, ("ms", "ms on the flight controller's clock"), &U32.to_le_bytes(), bytes)?
            .field("identifier", Kind::Identifier, ("", ""), &Identifier::COMMAND.0.to_le_bytes(), bytes)?
            .rest("status", Kind::Status(""), "not evaluated", 2)
            .field("word", Kind::Word, ("", ""), &word.word().to_le_bytes(), bytes)?
            .rest("reserved", Kind::Zero, "zero", COMMAND_RESERVED);
    object.crc("crc", "frame", "over all before", sealed.crc(), bytes)
}

fn hold_status() -> Result<Object> {
    let object = Object::new(
        ("hold_status", "Hold-Status"),
        &[Identifier::HOLD_STATUS],
        "HORUS_DPR_ID_HOLD_STATUS",
        HoldStatus::SIZE,
    );
    let blank = HoldValues::absent(0);
    let all = HoldStatusBits::from_bits(u16::MAX);
    let seal = |values: &HoldValues| HoldStatus::seal(Writer::<ActiveLoad>::claim(), values);
    let status = seal(&HoldValues { status: all, ..blank });
    let axes = [F32, -F32, F32 + 1.0];
    let vibrating = seal(&HoldValues { vibration: axes, ..blank });
    let numbers = [Acknowledged::new(U16, Outcome::TooOld), Acknowledged::new(U16 + 1, Outcome::Refused)];
    let acknowledged = seal(&HoldValues { acknowledged: numbers, ..blank });
    let numbers: Vec<_> =
        numbers.iter().flat_map(|one| [one.number().to_le_bytes(), one.code().to_le_bytes()]).collect();
    let object = fields!(object, blank, seal;
        timestamp: U32, "ms", "ms since the hold's start";
        temperature: F32, "degrees Celsius", "degrees Celsius";
        humidity: F32, "%", "relative, %";
        set_point: F32, "degrees Celsius", "degrees Celsius";
        greatest_shock: F32, "m/s2", "m/s2, since the start or since it was cleared";
        supply: F32, "V", "V";
        output: F32, "", "-1 (cooling) to 1 (heating)";
        seconds: U32, "s", "s since the hold's start";
    );
    object
        .rest("reserved", Kind::Zero, "zero", 4)
        .field(
            "vibration",
            Kind::Axes,
            ("m/s2", "m/s2, RMS over the last second"),
            axes.map(f32::to_le_bytes).as_flattened(),
            vibrating.as_bytes(),
        )?
        .field(
            "acknowledged",
            Kind::Acknowledged,
            ("", "u16 number, u16 outcome: base station's, own"),
            numbers.as_flattened(),
            acknowledged.as_bytes(),
        )?
        .head(Identifier::HOLD_STATUS, "HOLD_STATUS", all.bits(), status.as_bytes())?
        .crc("crc", "frame", "over all before", status.crc(), status.as_bytes())
}
