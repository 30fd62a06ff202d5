//! Failures of requests to a node.

/// A failure of a request to a node, as opposed to a fault of its firmware.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The firmware image cannot be read.
    #[error("cannot read the firmware image: {0}")]
    Firmware(String),
    /// A segment of the image lies where the part has no memory.
    #[error(
        "{firmware} places {length} bytes at {address:#010x}, where the {part} has no memory: is it \
         linked for this part?"
    )]
    Placement {
        /// The name of the image.
        firmware: String,
        /// The name of the part.
        part: &'static str,
        /// The segment's first address.
        address: u64,
        /// The segment's length in bytes.
        length: usize,
    },
    /// The flash contents that a part should keep have another size than the part's flash.
    #[error("{length} bytes are not what the {part} keeps")]
    OtherFlash {
        /// The name of the part.
        part: &'static str,
        /// The number of bytes in the contents.
        length: usize,
    },
    /// The part's memory holds other bytes than this image.
    #[error("the {part} does not hold {firmware}: its memory differs at {address:#010x}")]
    Differs {
        /// The name of the image.
        firmware: String,
        /// The name of the part.
        part: &'static str,
        /// The address of the first byte that differs.
        address: u64,
    },
    /// The image has no such symbol.
    #[error("{firmware} has no symbol {symbol}: is it the right image, and is the symbol `#[no_mangle]` and used?")]
    NoSymbol {
        /// The name of the image.
        firmware: String,
        /// The requested name.
        symbol: String,
    },
    /// The bytes that were looked for are not in a function of the image, or are there more than once.
    #[error("{function} holds {bytes:02x?} at {found}: is it another build of the firmware?")]
    NoPlace {
        /// The name of the function.
        function: String,
        /// The bytes that were looked for.
        bytes: Vec<u8>,
        /// The number of times that the bytes were found, in words.
        found: &'static str,
    },
    /// A requested address or symbol is not in memory.
    #[error("{length} bytes at {address:#010x} are not memory of the target")]
    NotMemory {
        /// The first address.
        address: u64,
        /// The number of requested bytes.
        length: usize,
    },
    /// The image has no vector table at the address from which the core reads the table at reset.
    #[error(
        "{firmware} has no vector table at {address:#010x}, where the {part} starts from, and begins at \
         {begins:#010x}: is it an image for this part, without a bootloader?"
    )]
    NoVectors {
        /// The name of the image.
        firmware: String,
        /// The name of the part.
        part: &'static str,
        /// The address at which the table should be.
        address: u64,
        /// The lowest address that the image fills.
        begins: u64,
    },
}
