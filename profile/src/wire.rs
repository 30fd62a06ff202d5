//! Numbers on the wire as arrays of bytes with alignment 1, independent of the host's byte order.
use bytemuck::{Pod, Zeroable};

macro_rules! little_endian {
    ($($(#[$doc:meta])* $name:ident, $number:ty, $size:literal;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
        #[repr(transparent)]
        pub(crate) struct $name([u8; $size]);

        impl $name {
            #[inline]
            pub(crate) const fn new(value: $number) -> Self {
                Self(value.to_le_bytes())
            }

            #[inline]
            pub(crate) const fn get(self) -> $number {
                <$number>::from_le_bytes(self.0)
            }
        }
    )*};
}

little_endian! {
    /// `u16`, least significant byte first.
    U16Le, u16, 2;
    /// `u32`, least significant byte first.
    U32Le, u32, 4;
    /// IEEE 754 binary32, least significant byte first. Every bit pattern is kept, also a NaN's payload.
    F32Le, f32, 4;
    /// IEEE 754 binary64, least significant byte first. Every bit pattern is kept, also a NaN's payload.
    F64Le, f64, 8;
}

/// A CRC-32 in the order in which it is sent, most significant byte first. Data and CRC are then the coefficients of
/// one polynomial.
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub(crate) struct CrcBe([u8; 4]);

impl CrcBe {
    /// The content of a CRC field before its CRC is computed.
    pub(crate) const UNSEALED: Self = Self([0; 4]);

    #[inline]
    pub(crate) const fn new(crc: u32) -> Self {
        Self(crc.to_be_bytes())
    }

    #[inline]
    pub(crate) const fn get(self) -> u32 {
        u32::from_be_bytes(self.0)
    }
}
