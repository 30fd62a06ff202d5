//! What bytes on the wires mean, worked out once for all rules: frames on the air, transactions on the SSI.

use std::ops::Range;

use profile::air::{CRC_BYTES, LEN_BYTES};
use profile::ssi::REQUEST_SIZE;
use profile::{GpsValues, Layout, LinkStatus, LinkValues, Object, Rejection, ReportedValues};

/// What an object says.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Reported-Position.
    Reported(ReportedValues),
    /// A GPS object.
    Gps(GpsValues),
}

/// What stands in an object's place.
#[derive(Clone, Debug, PartialEq)]
pub enum State {
    /// An intact object that belongs there.
    Valid {
        /// ms since HORUS's start.
        timestamp: u32,
        /// What it says.
        values: Values,
    },
    /// 0x00 or 0xFF throughout.
    Vacant,
    /// Anything else.
    Unsound(Rejection),
}

/// An object's place and what stands in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// The object's number in the profile: 0 Reported-Position, n GPSn.
    pub index: usize,
    /// What is there.
    pub state: State,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

impl Placed {
    fn of(index: usize, bytes: &[u8]) -> Self {
        let state = match Object::verify(index, bytes) {
            Ok(object) => State::Valid {
                timestamp: object.timestamp(),
                values: match object {
                    Object::Reported(object) => Values::Reported(object.values()),
                    Object::Gps(object) => Values::Gps(object.values()),
                },
            },
            Err(_) if is_vacant(bytes) => State::Vacant,
            Err(rejection) => State::Unsound(rejection),
        };
        Self { index, state, bytes: bytes.to_vec() }
    }

    /// Its timestamp, ms, if it is valid.
    #[must_use]
    pub fn timestamp(&self) -> Option<u32> {
        match self.state {
            State::Valid { timestamp, .. } => Some(timestamp),
            _ => None,
        }
    }
}

/// Whether a place holds nothing: 0x00 or 0xFF throughout, as a scrub leaves it.
#[must_use]
pub fn is_vacant(bytes: &[u8]) -> bool {
    bytes.iter().all(|byte| *byte == 0) || bytes.iter().all(|byte| *byte == 0xFF)
}

/// A frame on the air.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The payload between LEN and CRC-16.
    pub payload: Vec<u8>,
    /// Its number in the cycle by its length, from 0; `None` if no frame of the profile is that long.
    pub number: Option<usize>,
    /// Its objects; none if it has no frame's length.
    pub objects: Vec<Placed>,
}

impl Frame {
    /// The frame in `bytes`: LEN, payload, CRC-16. One that is not `whole` has the payload that its LEN announces if
    /// that arrived before it broke off.
    #[must_use]
    pub fn of(layout: Layout, bytes: &[u8], whole: bool) -> Self {
        let announced = bytes.first().map_or(0, |len| usize::from(*len));
        let end = if whole || bytes.len() < announced {
            bytes.len().saturating_sub(CRC_BYTES).max(LEN_BYTES)
        } else {
            announced.max(LEN_BYTES)
        };
        let payload = bytes.get(LEN_BYTES..end).unwrap_or_default();
        let objects: Vec<Placed> = match layout.objects_of(payload) {
            Ok(parts) => parts.map(|(index, bytes)| Placed::of(index, bytes)).collect(),
            Err(_) => vec![],
        };
        let number = objects.first().map(|object| usize::from(object.index > 0));
        Self { payload: payload.to_vec(), number, objects }
    }

    /// The timestamp of its first valid object, ms.
    #[must_use]
    pub fn timestamp(&self) -> Option<u32> {
        self.objects.iter().find_map(Placed::timestamp)
    }
}

/// A transaction on the SSI.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// When chip select fell, ns.
    pub selected: u64,
    /// When it rose, ns.
    pub deselected: u64,
    /// Which byte of the image came first.
    pub offset: usize,
    /// Everything read 0xFF: the DPR was busy, or nothing was readable.
    pub silent: bool,
    /// Link-Status, if all of it was read.
    pub link: Option<Result<LinkValues, Rejection>>,
    /// The objects that were read whole.
    pub objects: Vec<Placed>,
    /// What was read.
    pub miso: Vec<u8>,
}

impl Reading {
    /// What `miso` brought of the image, read from byte `offset` on.
    #[must_use]
    pub fn of(layout: Layout, selected: u64, deselected: u64, offset: usize, miso: &[u8]) -> Self {
        let within = |place: Range<usize>| {
            let start = place.start.checked_sub(offset)?;
            miso.get(start..start + place.len())
        };
        let silent = miso.iter().all(|byte| *byte == 0xFF);
        let read = |index| Some(Placed::of(index, within(layout.in_image(index)?)?));
        let link = within(0..LinkStatus::SIZE).map(|bytes| LinkStatus::verify(bytes).map(LinkStatus::values));
        Self {
            selected,
            deselected,
            offset,
            silent,
            link: link.filter(|_| !silent),
            objects: if silent { vec![] } else { (0..layout.objects()).filter_map(read).collect() },
            miso: miso.to_vec(),
        }
    }

    /// Whether every object that was read whole, and Link-Status, is intact or vacant.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let unsound = |placed: &Placed| matches!(placed.state, State::Unsound(_));
        !self.objects.iter().any(unsound) && !matches!(self.link, Some(Err(_)))
    }

    /// The timestamp of its first valid object, ms.
    #[must_use]
    pub fn timestamp(&self) -> Option<u32> {
        self.objects.iter().find_map(Placed::timestamp)
    }
}

/// Which part of the image the next transaction shows: the request of one chooses the window of the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Window {
    offset: usize,
}

impl Window {
    /// Which byte of the image comes first.
    #[must_use]
    pub fn offset(self) -> usize {
        self.offset
    }

    /// A transaction is over, in which the flight controller sent `mosi`. What a busy DPR was asked for it has not
    /// heard, and it still shows what it was asked for before (`dpr_fw::ssi`).
    pub fn transaction(&mut self, layout: Layout, mosi: &[u8], silent: bool) {
        if silent {
            return;
        }
        self.offset = match Asked::of(mosi, layout.map_len()) {
            Asked::Window { offset } => offset,
            _ => 0,
        };
    }
}

/// What the flight controller asks for with the first bytes of a transaction (docs/design.md#ssi).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// Nothing: the line is idle.
    Nothing,
    /// A window that lies in the map.
    Window {
        /// Its first byte.
        offset: usize,
    },
    /// A window that is empty, or does not lie in the map.
    Outside,
    /// Something whose CRC is wrong.
    Damaged,
    /// The transaction ended in the middle of it.
    Short,
}

impl Asked {
    /// What `mosi` asks of a map of so many bytes.
    #[must_use]
    pub fn of(mosi: &[u8], map_len: usize) -> Self {
        let request = &mosi[..mosi.len().min(REQUEST_SIZE)];
        if is_vacant(request) {
            return Self::Nothing;
        }
        let [o0, o1, l0, l1, ..] = *request else { return Self::Short };
        if request.len() < REQUEST_SIZE {
            return Self::Short;
        }
        let [offset, length] = [[o0, o1], [l0, l1]].map(|bytes| usize::from(u16::from_le_bytes(bytes)));
        match is_intact(request) {
            false => Self::Damaged,
            true if length == 0 || offset + length > map_len => Self::Outside,
            true => Self::Window { offset },
        }
    }
}

/// Whether the last four bytes are the frame CRC of those before them, most significant byte first
/// (docs/design.md#crc).
#[must_use]
pub fn is_intact(bytes: &[u8]) -> bool {
    bytes.split_last_chunk().is_some_and(|(bytes, crc)| profile::crc::frame(bytes).to_be_bytes() == *crc)
}
