//! The macro `object!`, which gives every object the methods that all of them have: header, frame CRC, bytes.
//!
//! The objects themselves are in `reported`, `gps` and `link_status`.

/// The methods every object has, for a `repr(C)` type of wire fields with `timestamp`, `identifier`, `status` and `crc`
/// among them.
macro_rules! object {
    (
        $object:ident, $size:literal bytes, status: $status:ty, timestamp: $timestamp:literal,
        also shown: [$($shown:ident),*]
    ) => {
        const _: () = {
            assert!(core::mem::size_of::<$object>() == $object::SIZE);
            assert!(core::mem::align_of::<$object>() == 1);
            assert!(core::mem::offset_of!($object, timestamp) == 0);
            assert!(core::mem::offset_of!($object, identifier) == 4);
            assert!(core::mem::offset_of!($object, status) == 6);
            assert!(core::mem::offset_of!($object, crc) == $object::SIZE - 4);
        };

        impl $object {
            /// Bytes.
            pub const SIZE: usize = $size;

            /// All zero, as a slot is before anything has been put there. Does not verify.
            pub const EMPTY: Self = bytemuck::zeroed();

            #[doc = $timestamp]
            #[must_use]
            pub const fn timestamp(&self) -> u32 {
                self.timestamp.get()
            }

            /// Which object it says it is.
            #[must_use]
            pub const fn identifier(&self) -> $crate::Identifier {
                $crate::Identifier(self.identifier.get())
            }

            /// Its status; bits without a meaning are ignored.
            #[must_use]
            pub const fn status(&self) -> $status {
                <$status>::from_bits(self.status.get())
            }

            /// The frame CRC it carries, right or wrong.
            #[must_use]
            pub const fn crc(&self) -> u32 {
                self.crc.get()
            }

            /// As on the wire.
            #[must_use]
            pub const fn as_bytes(&self) -> &[u8; Self::SIZE] {
                bytemuck::must_cast_ref(self)
            }

            /// With the frame CRC of what it carries.
            fn sealed(mut self) -> Self {
                let [covered @ .., _, _, _, _] = self.as_bytes();
                self.crc = $crate::wire::CrcBe::new($crate::crc::frame(covered));
                self
            }

            /// `bytes` as an object, and whether its frame CRC is right; nothing else of it is known yet.
            fn look(bytes: &[u8]) -> Result<(&Self, $crate::rejection::Findings), $crate::Rejection> {
                let bytes: &[u8; Self::SIZE] = bytes.try_into().map_err(|_| $crate::Rejection::Length)?;
                Ok(Self::found(bytes, $crate::crc::frame_intact(bytes)))
            }

            /// `bytes` as an object, given whether its frame CRC is right.
            fn found(bytes: &[u8; Self::SIZE], intact: bool) -> (&Self, $crate::rejection::Findings) {
                let findings = $crate::rejection::Findings::new().check(intact, $crate::Rejection::Crc);
                (bytemuck::must_cast_ref(bytes), findings)
            }
        }

        impl core::fmt::Debug for $object {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                f.debug_struct(stringify!($object))
                    .field("identifier", &self.identifier())
                    .field("values", &self.values())
                    $(.field(stringify!($shown), &format_args!("{:#010X}", self.$shown())))*
                    .field("crc", &format_args!("{:#010X}", self.crc()))
                    .finish()
            }
        }
    };
}

pub(crate) use object;
