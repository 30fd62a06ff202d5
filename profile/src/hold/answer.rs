//! The answer to a hold's frame: an object with the uplinks of the base station and of the flight controller.
use core::fmt;

use bytemuck::{Pod, Zeroable};

use crate::{
    Rejection, Uplink,
    criticality::{Writer, WritesUplink},
};

/// The payload of the answer: the base station's uplink and the flight controller's, each as it was written. Zeros
/// replace an uplink that is missing, damaged or older than [`COMMAND_AGE_MS`](super::COMMAND_AGE_MS).
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Answer {
    uplinks: [Uplink; 2],
}

impl Answer {
    /// The size of the answer in bytes.
    pub const SIZE: usize = 2 * Uplink::SIZE;

    /// The answer without an uplink: zeros.
    pub const EMPTY: Self = bytemuck::zeroed();

    /// Reads `bytes` as an answer, without checking the uplinks.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not 128.
    pub fn read(bytes: &[u8]) -> Result<&Self, Rejection> {
        bytemuck::try_from_bytes(bytes).map_err(|_| Rejection::Length)
    }

    /// The uplink of role `W` in the answer, if that uplink is intact.
    ///
    /// # Errors
    ///
    /// [`Rejection::Crc`] if the uplink is damaged or absent, [`Rejection::Identifier`] if it is another object.
    pub fn uplink<W: WritesUplink>(&self) -> Result<&Uplink, Rejection> {
        let [base_station, flight_controller] = &self.uplinks;
        Uplink::verify::<W>(if W::INDEX == 0 { base_station.as_bytes() } else { flight_controller.as_bytes() })
    }

    /// Sets the uplink of role `W`. [`Uplink::EMPTY`] means that there is none for the hold.
    pub fn set_uplink<W: WritesUplink>(&mut self, _writer: Writer<W>, uplink: Uplink) {
        let [base_station, flight_controller] = &mut self.uplinks;
        *(if W::INDEX == 0 { base_station } else { flight_controller }) = uplink;
    }

    /// The bytes of the answer in their order on the wire.
    #[must_use]
    pub const fn as_bytes(&self) -> &[u8; Self::SIZE] {
        bytemuck::must_cast_ref(self)
    }
}

impl fmt::Debug for Answer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Answer").field("uplinks", &self.uplinks).finish()
    }
}
