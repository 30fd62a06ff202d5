//! Writes the objects as C structures of bytes, with their fields at the offsets that `profile` uses.

use std::fmt::Write as _;

use anyhow::{Context, Result, ensure};
use profile::criticality::{ActiveLoad, Dpr, FlightController, Writer};
use profile::hold::{Acknowledged, Outcome};
use profile::{
    Command, CommandObject, GpsObject, GpsStatus, GpsValues, HoldStatus, HoldStatusBits, HoldValues, Identifier,
    LinkStatus, LinkStatusBits, LinkValues, PortStatus, PortStatusBits, PortValues, ReportedPosition, ReportedStatus,
    ReportedValues, Uplink, UplinkStatus, UplinkValues, Violation, Violations,
};

/// The number of bytes that a command reserves, between its word and its CRC.
pub(super) const COMMAND_RESERVED: usize = CommandObject::SIZE - 12 - 4;

/// Values whose bytes occur nowhere else in an object.
const U16: u16 = 0x5AC3;
const U32: u32 = 0xA1B2_C3D4;
const F32: f32 = f32::from_bits(0x41A1_B2C3);
const F64: f64 = f64::from_bits(0x4031_A2B3_C4D5_E6F7);

/// A field that was found: its name, its bytes, its meaning.
struct Field {
    name: &'static str,
    place: std::ops::Range<usize>,
    what: &'static str,
}

/// An object, with those of its fields that have been found.
struct Object {
    name: &'static str,
    title: &'static str,
    size: usize,
    fields: Vec<Field>,
}

impl Object {
    fn new(name: &'static str, title: &'static str, size: usize) -> Self {
        Self { name, title, size, fields: vec![] }
    }

    /// Adds the field in which `sealed` holds `value`. The bytes of `value` must occur in `sealed` only once.
    fn field(mut self, name: &'static str, what: &'static str, value: &[u8], sealed: &[u8]) -> Result<Self> {
        ensure!(sealed.len() == self.size, "{} has {} bytes", self.name, sealed.len());
        let mut places = (0..=self.size - value.len()).filter(|at| sealed[*at..].starts_with(value));
        let start = places.next().with_context(|| format!("{} of {} is nowhere", name, self.name))?;
        ensure!(places.next().is_none(), "{} of {} is in more than one place", name, self.name);
        self.fields.push(Field { name, place: start..start + value.len(), what });
        Ok(self)
    }

    /// Adds a field whose value cannot be set: it follows the fields before it.
    fn rest(mut self, name: &'static str, what: &'static str, bytes: usize) -> Self {
        let start = self.fields.iter().map(|field| field.place.end).max().unwrap_or(0);
        self.fields.push(Field { name, place: start..start + bytes, what });
        self
    }

    /// Returns the C structure of the object with assertions about its layout.
    fn structure(mut self) -> Result<String> {
        self.fields.sort_by_key(|field| field.place.start);
        let mut end = 0;
        for Field { name, place, .. } in &self.fields {
            ensure!(place.start == end, "{name} of {} begins at {}, not at {end}", self.name, place.start);
            end = place.end;
        }
        ensure!(end == self.size, "the fields of {} end at {end}", self.name);
        let names = |field: &Field| format!("uint8_t {}[{}];", field.name, field.place.len());
        let width = self.fields.iter().map(|field| names(field).len()).max().unwrap_or(0);
        let mut text = format!("/* {}, {} bytes. */\ntypedef struct {{\n", self.title, self.size);
        for field in &self.fields {
            let _ = writeln!(text, "    {:width$} /* {:2}: {} */", names(field), field.place.start, field.what);
        }
        let structure = format!("horus_dpr_wire_{}_t", self.name);
        let _ = writeln!(text, "}} {structure};");
        let _ = writeln!(text, "HORUS_DPR_ASSERT(sizeof({structure}) == {}U, \"size\");", self.size);
        for Field { name, place, .. } in &self.fields {
            let _ = writeln!(text, "HORUS_DPR_ASSERT(offsetof({structure}, {name}) == {}U, \"{name}\");", place.start);
        }
        text.push('\n');
        Ok(text)
    }
}

/// Returns the C structures of all objects.
pub(super) fn structs() -> Result<String> {
    [link_status()?, reported()?, gps()?, port_status()?, uplink()?, command()?, hold_status()?]
        .into_iter()
        .map(Object::structure)
        .collect()
}

/// Adds the fields of a value type. Each is found by sealing an object in which only that field is set.
macro_rules! fields {
    ($object:ident, $blank:expr, $seal:expr; $($name:ident: $value:expr, $what:literal;)*) => {
        $object$(.field(
            stringify!($name),
            $what,
            &$value.to_le_bytes(),
            &{ let mut values = $blank; values.$name = $value; *$seal(&values).as_bytes() },
        )?)*
    };
}

fn link_status() -> Result<Object> {
    let object = Object::new("link_status", "Link-Status, identifier HORUS_DPR_ID_LINK_STATUS", LinkStatus::SIZE);
    let blank = LinkValues::default();
    let all = LinkStatusBits::from_bits(u16::MAX);
    let status = LinkStatus::seal(&LinkValues { status: all, ..blank });
    let object = fields!(object, blank, LinkStatus::seal;
        timestamp: U32, "u32, ms since DPR start";
        objects_accepted: U32, "u32, objects accepted";
        objects_rejected: U32, "u32, objects rejected";
        frames_received: U32, "u32, frames received";
        frames_missed: U32, "u32, frames missed";
        age_100us: U16, "u16, age of Reported-Position, 100 us";
        access_violations: U16, "u16, accesses refused";
    );
    object
        .field("identifier", "u16", &Identifier::LINK_STATUS.0.to_le_bytes(), status.as_bytes())?
        .field("status", "u16, HORUS_DPR_LINK_...", &all.bits().to_le_bytes(), status.as_bytes())?
        .field("crc", "u32, big-endian, over all before", &status.crc().to_be_bytes(), status.as_bytes())
}

fn reported() -> Result<Object> {
    let object =
        Object::new("reported", "Reported-Position, identifier HORUS_DPR_ID_REPORTED_POSITION", ReportedPosition::SIZE);
    let blank = ReportedValues::absent(0);
    let all = ReportedStatus::from_bits(u16::MAX);
    let status = ReportedPosition::seal(&ReportedValues { status: all, ..blank });
    let axes = [F32, -F32, F32 + 1.0];
    let accelerated = ReportedPosition::seal(&ReportedValues { acceleration: axes, ..blank });
    let object = fields!(object, blank, ReportedPosition::seal;
        timestamp: U32, "u32, ms since HORUS start";
        latitude: F64, "binary64, degrees";
        longitude: F64, "binary64, degrees";
        altitude: F64, "binary64, m";
        pitch: F32, "binary32, rad";
        yaw: F32, "binary32, rad";
        roll: F32, "binary32, rad";
    );
    object
        .field("acceleration", "3 x binary32, m/s2", axes.map(f32::to_le_bytes).as_flattened(), accelerated.as_bytes())?
        .field("identifier", "u16", &Identifier::REPORTED_POSITION.0.to_le_bytes(), status.as_bytes())?
        .field("status", "u16, HORUS_DPR_REPORTED_...", &all.bits().to_le_bytes(), status.as_bytes())?
        .field(
            "position_crc",
            "u32, big-endian, over latitude and longitude",
            &status.position_crc().to_be_bytes(),
            status.as_bytes(),
        )?
        .field("crc", "u32, big-endian, over all before", &status.crc().to_be_bytes(), status.as_bytes())
}

fn gps() -> Result<Object> {
    let object =
        Object::new("gps", "GPS1 to GPS5, identifier HORUS_DPR_ID_REPORTED_POSITION + 1 to 5", GpsObject::SIZE);
    let blank = GpsValues::absent(0);
    let all = GpsStatus::from_bits(u16::MAX);
    let seal = |values: &GpsValues| GpsObject::seal(Identifier::gps(1), values);
    let status = seal(&GpsValues { status: all, ..blank });
    let axes = [F32, -F32, F32 + 1.0];
    let accelerated = seal(&GpsValues { acceleration: axes, ..blank });
    let object = fields!(object, blank, seal;
        timestamp: U32, "u32, ms since HORUS start";
        latitude: F64, "binary64, degrees";
        longitude: F64, "binary64, degrees";
        altitude: F64, "binary64, m";
        pitch: F32, "binary32, rad";
        yaw: F32, "binary32, rad";
        roll: F32, "binary32, rad";
    );
    object
        .field("acceleration", "3 x binary32, m/s2", axes.map(f32::to_le_bytes).as_flattened(), accelerated.as_bytes())?
        .field("identifier", "u16", &Identifier::gps(1).0.to_le_bytes(), status.as_bytes())?
        .field("status", "u16, HORUS_DPR_GPS_...", &all.bits().to_le_bytes(), status.as_bytes())?
        .field("crc", "u32, big-endian, over all before", &status.crc().to_be_bytes(), status.as_bytes())
}

fn port_status() -> Result<Object> {
    let object = Object::new("port_status", "Port-Status, identifier HORUS_DPR_ID_PORT_STATUS", PortStatus::SIZE);
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
        timestamp: U32, "u32, ms since DPR start";
        uplinks_accepted: U32, "u32, uplinks stored";
        commands_carried_out: U32, "u32, commands carried out";
        last_command_timestamp: U32, "u32, ms, timestamp of the last command";
        last_command: U32, "u32, its word";
        base_station_age_ms: U16, "u16, ms since the base station's uplink";
        flight_controller_age_ms: U16, "u16, ms since the flight controller's uplink";
        integrity_faults: U16, "u16, faults found in images";
        flash_passes: U16, "u16, passes over the flash";
        stuck_bits: U16, "u16, stuck bits found";
        buffers_out_of_use: U16, "u16, buffers out of use";
        last_stop: U32, "u32, reason of the last safe state";
    );
    object
        .field("violations", "u16 of each kind", &counts, counted.as_bytes())?
        .field("identifier", "u16", &Identifier::PORT_STATUS.0.to_le_bytes(), status.as_bytes())?
        .field("status", "u16, HORUS_DPR_PORT_...", &all.bits().to_le_bytes(), status.as_bytes())?
        .field("crc", "u32, big-endian, over all before", &status.crc().to_be_bytes(), status.as_bytes())
}

fn uplink() -> Result<Object> {
    let title = "Uplink, identifier HORUS_DPR_ID_UPLINK_BASE_STATION or HORUS_DPR_ID_UPLINK_FLIGHT_CONTROLLER";
    let mut payload = [0; Uplink::PAYLOAD];
    payload.iter_mut().zip(1..).for_each(|(byte, value)| *byte = value);
    let values = UplinkValues { timestamp: U32, status: UplinkStatus::from_bits(U16), payload };
    let sealed = Uplink::seal(Writer::<FlightController>::claim(), &values);
    let bytes = sealed.as_bytes();
    Object::new("uplink", title, Uplink::SIZE)
        .field("timestamp", "u32, ms on the writer's clock", &U32.to_le_bytes(), bytes)?
        .field("identifier", "u16", &Identifier::UPLINK_FLIGHT_CONTROLLER.0.to_le_bytes(), bytes)?
        .field("status", "u16, as writer and reader agree", &U16.to_le_bytes(), bytes)?
        .field("payload", "the writer's", &payload, bytes)?
        .field("crc", "u32, big-endian, over all before", &sealed.crc().to_be_bytes(), bytes)
}

fn command() -> Result<Object> {
    let word = Command::SelfTest;
    let sealed = CommandObject::seal(Writer::<FlightController>::claim(), U32, word);
    let bytes = sealed.as_bytes();
    let object = Object::new("command", "Command, identifier HORUS_DPR_ID_COMMAND", CommandObject::SIZE)
        .field("timestamp", "u32, ms on the flight controller's clock", &U32.to_le_bytes(), bytes)?
        .field("identifier", "u16", &Identifier::COMMAND.0.to_le_bytes(), bytes)?
        .rest("status", "u16, not evaluated", 2)
        .field("word", "u32, HORUS_DPR_COMMAND_...", &word.word().to_le_bytes(), bytes)?
        .rest("reserved", "zero", COMMAND_RESERVED);
    object.field("crc", "u32, big-endian, over all before", &sealed.crc().to_be_bytes(), bytes)
}

fn hold_status() -> Result<Object> {
    let object = Object::new("hold_status", "Hold-Status, identifier HORUS_DPR_ID_HOLD_STATUS", HoldStatus::SIZE);
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
        timestamp: U32, "u32, ms since the hold's start";
        temperature: F32, "binary32, degrees Celsius";
        humidity: F32, "binary32, relative, %";
        set_point: F32, "binary32, degrees Celsius";
        greatest_shock: F32, "binary32, m/s2";
        supply: F32, "binary32, V";
        output: F32, "binary32, -1 to 1";
        seconds: U32, "u32, s since the hold's start";
    );
    object
        .rest("reserved", "zero", 4)
        .field("vibration", "3 x binary32, m/s2", axes.map(f32::to_le_bytes).as_flattened(), vibrating.as_bytes())?
        .field(
            "acknowledged",
            "u16 number, u16 outcome: base station's, own",
            numbers.as_flattened(),
            acknowledged.as_bytes(),
        )?
        .field("identifier", "u16", &Identifier::HOLD_STATUS.0.to_le_bytes(), status.as_bytes())?
        .field("status", "u16, HORUS_DPR_HOLD_STATUS_...", &all.bits().to_le_bytes(), status.as_bytes())?
        .field("crc", "u32, big-endian, over all before", &status.crc().to_be_bytes(), status.as_bytes())
}
