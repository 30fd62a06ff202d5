//! The macro `object!`, which defines the methods that all objects share: header, frame CRC, bytes.

/// Defines the common methods of an object: a `repr(C)` type of wire fields that include `timestamp`, `identifier`,
/// `status` and `crc`.
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
            /// The size of the object in bytes.
            pub const SIZE: usize = $size;

            /// The object as zeros, the contents of memory before the first write. Zeros do not verify.
            pub const EMPTY: Self = bytemuck::zeroed();

            #[doc = $timestamp]
            #[must_use]
            pub const fn timestamp(&self) -> u32 {
                self.timestamp.get()
            }

            /// The identifier in the object's header.
            #[must_use]
            pub const fn identifier(&self) -> $crate::Identifier {
                $crate::Identifier(self.identifier.get())
            }

            /// The status in the object's header; undefined bits are ignored.
            #[must_use]
            pub const fn status(&self) -> $status {
                <$status>::from_bits(self.status.get())
            }

            /// The frame CRC in the object; it may be wrong.
            #[must_use]
            pub const fn crc(&self) -> u32 {
                self.crc.get()
            }

            /// The bytes of the object in their order on the wire.
            #[must_use]
            pub const fn as_bytes(&self) -> &[u8; Self::SIZE] {
                bytemuck::must_cast_ref(self)
            }

            fn sealed(mut self) -> Self {
                let [covered @ .., _, _, _, _] = self.as_bytes();
                self.crc = $crate::wire::CrcBe::new($crate::crc::frame(covered));
                self
            }

            fn look(bytes: &[u8]) -> Result<(&Self, $crate::rejection::Findings), $crate::Rejection> {
                let bytes: &[u8; Self::SIZE] = bytes.try_into().map_err(|_| $crate::Rejection::Length)?;
                Ok(Self::found(bytes, $crate::crc::frame_intact(bytes)))
            }

            /// Reads `bytes` as an object. The argument `intact` says whether their frame CRC is right.
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
