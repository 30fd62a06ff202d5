//! Encodes and decodes TUNNEL, the message that carries objects, with a payload type of the private range.
//!
//! The `mavlink` crate's own TUNNEL refuses all payload types that are not registered, so this module defines the
//! message again; framing, CRC and signature are that crate's. The layout, the identifier 385 and CRC_EXTRA 147 are
//! those of `common.xml`. A test compares them with that file.

use mavlink::dialects::common::MavMessage;
use mavlink::error::ParserError;
use mavlink::{MavlinkVersion, MessageData};
use profile::Identifier;

use crate::{Bundle, Place};

/// The bit of payload types for private use: 32768 and above (`common.xml`, TUNNEL).
pub const PRIVATE: u16 = 0x8000;

/// The greatest number of payload bytes in one message.
pub const MAX_PAYLOAD: usize = 128;

/// Returns the payload type of a message that begins with this object: the object's identifier with [`PRIVATE`] set.
#[must_use]
pub fn payload_type(first: Place) -> Option<u16> {
    first.identifier().map(|identifier| PRIVATE | identifier.0)
}

/// A TUNNEL message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tunnel {
    /// The type of the payload.
    pub payload_type: u16,
    /// The MAVLink system for which the message is; 0 means all systems.
    pub target_system: u8,
    /// The MAVLink component for which the message is; 0 means all components.
    pub target_component: u8,
    /// The number of bytes of `payload` that are used.
    pub length: u8,
    /// The payload, followed by zeros.
    pub payload: [u8; MAX_PAYLOAD],
}

impl Tunnel {
    /// Returns the message to all systems that carries these objects; `None` if they exceed [`MAX_PAYLOAD`] bytes.
    #[must_use]
    pub fn of(bundle: &Bundle<'_>) -> Option<Self> {
        let (first, _) = bundle.objects().next()?;
        let bytes = bundle.bytes();
        let mut payload = [0; MAX_PAYLOAD];
        payload.get_mut(..bytes.len())?.copy_from_slice(bytes);
        let length = u8::try_from(bytes.len()).ok()?;
        let payload_type = payload_type(first)?;
        Some(Self { payload_type, target_system: 0, target_component: 0, length, payload })
    }

    /// Returns the objects that the message carries, intact or not; `None` if its payload type or length fits no
    /// objects.
    #[must_use]
    pub fn bundle(&self) -> Option<Bundle<'_>> {
        let identifier = Identifier(self.payload_type & !PRIVATE);
        let first = Place::of(identifier).filter(|_| self.payload_type & PRIVATE != 0)?;
        Bundle::from_first(first, self.payload.get(..usize::from(self.length))?)
    }
}

impl MessageData for Tunnel {
    type Message = MavMessage;
    const ID: u32 = 385;
    const NAME: &'static str = "TUNNEL";
    const EXTRA_CRC: u8 = 147;
    const ENCODED_LEN: usize = 5 + MAX_PAYLOAD;

    fn ser(&self, _version: MavlinkVersion, payload: &mut [u8]) -> usize {
        let [low, high] = self.payload_type.to_le_bytes();
        let head = [low, high, self.target_system, self.target_component, self.length];
        let (to_head, to_payload) = payload[..Self::ENCODED_LEN].split_at_mut(head.len());
        to_head.copy_from_slice(&head);
        to_payload.copy_from_slice(&self.payload);
        // MAVLink 2 omits the trailing zeros of a payload, but never the payload's first byte.
        let used = payload[..Self::ENCODED_LEN].iter().rposition(|byte| *byte != 0);
        used.map_or(1, |last| last + 1)
    }

    fn deser(_version: MavlinkVersion, input: &[u8]) -> Result<Self, ParserError> {
        let mut whole = [0; Self::ENCODED_LEN];
        // A later version may append fields, which are ignored.
        let given = input.len().min(whole.len());
        whole[..given].copy_from_slice(&input[..given]);
        let [low, high, target_system, target_component, length, payload @ ..] = whole;
        let payload_type = u16::from_le_bytes([low, high]);
        Ok(Self { payload_type, target_system, target_component, length, payload })
    }
}

#[cfg(test)]
mod tests {
    use mavlink::Message;
    use mavlink::dialects::common::{MavTunnelPayloadType, TUNNEL_DATA};
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_layout_is_that_of_the_dialect() {
        assert_eq!((Tunnel::ID, Tunnel::EXTRA_CRC), (TUNNEL_DATA::ID, TUNNEL_DATA::EXTRA_CRC));
        assert_eq!((Tunnel::NAME, Tunnel::ENCODED_LEN), (TUNNEL_DATA::NAME, TUNNEL_DATA::ENCODED_LEN));
        assert_eq!(MavMessage::extra_crc(Tunnel::ID), Tunnel::EXTRA_CRC);
        let mut payload = [0; 128];
        payload[..3].copy_from_slice(&[7, 8, 9]);
        let theirs = TUNNEL_DATA {
            payload_type: MavTunnelPayloadType::MAV_TUNNEL_PAYLOAD_TYPE_STORM32_RESERVED1,
            target_system: 3,
            target_component: 4,
            payload_length: 3,
            payload,
        };
        let ours = Tunnel { payload_type: 201, target_system: 3, target_component: 4, length: 3, payload };
        let (mut a, mut b) = ([0xAA; 255], [0xAA; 255]);
        let lengths = (theirs.ser(MavlinkVersion::V2, &mut a), ours.ser(MavlinkVersion::V2, &mut b));
        assert_eq!((lengths, &a[..8]), ((8, 8), &b[..8]));
        assert_eq!(Tunnel::deser(MavlinkVersion::V2, &a[..8]).unwrap(), ours);
    }

    #[test]
    fn payload_types_are_private_and_tell_the_first_object() {
        let types: Vec<_> = Place::ALL.iter().filter_map(|place| payload_type(*place)).collect();
        assert_eq!(types, [0xC400, 0xC800, 0xC801, 0xC802, 0xC803, 0xC804, 0xC805, 0xC401, 0xC200, 0xC100]);
        assert!(types.iter().all(|code| *code >= 32_768));
    }

    #[test]
    fn a_registered_payload_type_is_not_ours() {
        let mut tunnel = Tunnel::of(&Bundle::from_first(Place::Reported, &[1; 124]).unwrap()).unwrap();
        assert_eq!(tunnel.bundle().unwrap().objects().count(), 2);
        tunnel.payload_type &= !PRIVATE;
        assert!(tunnel.bundle().is_none());
        assert!(Tunnel::of(&Bundle::from_first(Place::LinkStatus, &[1; 156]).unwrap()).is_none(), "too long");
    }

    proptest! {
        #[test]
        fn any_payload_is_read(input in prop::collection::vec(any::<u8>(), 0..255)) {
            let tunnel = Tunnel::deser(MavlinkVersion::V2, &input).unwrap();
            if let Some(bundle) = tunnel.bundle() {
                prop_assert_eq!(Tunnel::of(&bundle).map(|again| again.payload_type), Some(tunnel.payload_type));
            }
            let mut bytes = [0; 255];
            let length = tunnel.ser(MavlinkVersion::V2, &mut bytes);
            prop_assert_eq!(Tunnel::deser(MavlinkVersion::V2, &bytes[..length]).unwrap(), tunnel);
        }
    }
}
