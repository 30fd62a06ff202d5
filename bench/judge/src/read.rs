//! Decodes the bytes on the wires for all rules: frames on the air, and transactions on the SSI.

use std::ops::Range;

use profile::air::{CRC_BYTES, LEN_BYTES};
use profile::ssi::REQUEST_SIZE;
use profile::{GpsValues, Layout, LinkStatus, LinkValues, Object, Rejection, ReportedValues};

/// The values that an object states.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// The values of Reported-Position.
    Reported(ReportedValues),
    /// The values of a GPS object.
    Gps(GpsValues),
}

/// The result of the check of an object's place in a frame or an image.
#[derive(Clone, Debug, PartialEq)]
pub enum State {
    /// The bytes are an intact object, and it is the object that belongs there.
    Valid {
        /// The object's timestamp, ms since HORUS's start.
        timestamp: u32,
        /// The object's values.
        values: Values,
    },
    /// The object's place holds 0x00 or 0xFF throughout, so there is no object.
    Vacant,
    /// The bytes are neither an intact object nor empty. The text says why.
    Unsound(Rejection),
}

/// An object as it was found in a frame or an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// The object's number in the profile: 0 is Reported-Position, 1 to n are GPS1 to GPSn.
    pub index: usize,
    /// The object's timestamp and values, or why the bytes are not an object.
    pub state: State,
    /// The object's bytes.
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

    /// Returns the object's timestamp, ms, if the object is valid.
    #[must_use]
    pub fn timestamp(&self) -> Option<u32> {
        match self.state {
            State::Valid { timestamp, .. } => Some(timestamp),
            _ => None,
        }
    }
}

/// Returns whether all bytes are 0x00 or all are 0xFF, as a scrub leaves them.
#[must_use]
pub fn is_vacant(bytes: &[u8]) -> bool {
    bytes.iter().all(|byte| *byte == 0) || bytes.iter().all(|byte| *byte == 0xFF)
}

/// A frame on the air.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The payload between LEN and CRC-16.
    pub payload: Vec<u8>,
    /// The frame's number in its cycle, from 0; `None` if no frame of the profile has this length.
    pub number: Option<usize>,
    /// The frame's objects; empty if no frame of the profile has this length.
    pub objects: Vec<Placed>,
}

impl Frame {
    /// Decodes the frame in `bytes` (LEN, payload, CRC-16). `whole` is false for a frame that broke off.
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

    /// Returns the timestamp of the frame's first valid object, ms.
    #[must_use]
    pub fn timestamp(&self) -> Option<u32> {
        self.objects.iter().find_map(Placed::timestamp)
    }
}

/// A transaction on the SSI.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// The instant, ns, at which chip select fell.
    pub selected: u64,
    /// The instant, ns, at which chip select rose.
    pub deselected: u64,
    /// The offset in the map of the first byte that the transaction read.
    pub offset: usize,
    /// Whether every byte was read as 0xFF. This happens if the DPR was busy or no image was readable.
    pub silent: bool,
    /// The values of Link-Status, or why it was rejected; `None` if the transaction did not read Link-Status
    /// completely.
    pub link: Option<Result<LinkValues, Rejection>>,
    /// The objects of which the transaction read every byte.
    pub objects: Vec<Placed>,
    /// The bytes that were read.
    pub miso: Vec<u8>,
}

impl Reading {
    /// Decodes a transaction that read `miso` from the map, from byte `offset` on.
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

    /// Returns whether Link-Status and all objects that were read completely are intact or empty.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let unsound = |placed: &Placed| matches!(placed.state, State::Unsound(_));
        !self.objects.iter().any(unsound) && !matches!(self.link, Some(Err(_)))
    }

    /// Returns the timestamp of the first valid object that was read, ms.
    #[must_use]
    pub fn timestamp(&self) -> Option<u32> {
        self.objects.iter().find_map(Placed::timestamp)
    }
}

/// The window: the range of the map that the next transaction reads. Each transaction may request the window of the
/// next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Window {
    offset: usize,
}

impl Window {
    /// Returns the offset in the map of the window's first byte.
    #[must_use]
    pub fn offset(self) -> usize {
        self.offset
    }

    /// Updates the window after a transaction in which the flight controller sent `mosi`. A busy DPR (`silent`) does
    /// not receive the request (`dpr_fw::ssi`).
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

/// The request in the first bytes of a transaction (docs/design.md#ssi).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// The flight controller sends idle bytes, which request nothing.
    Nothing,
    /// The request is for a window that lies in the map.
    Window {
        /// The offset of the window's first byte.
        offset: usize,
    },
    /// The request is for a window that is empty, or does not lie in the map.
    Outside,
    /// The request has a wrong CRC.
    Damaged,
    /// The transaction ended within the request.
    Short,
}

impl Asked {
    /// Returns the request that `mosi` makes to a DPR whose map has `map_len` bytes.
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

/// Returns whether the last bytes of `bytes` are the CRC of all bytes before them, big-endian (docs/design.md#crc).
#[must_use]
pub fn is_intact(bytes: &[u8]) -> bool {
    bytes.split_last_chunk().is_some_and(|(bytes, crc)| profile::crc::frame(bytes).to_be_bytes() == *crc)
}
