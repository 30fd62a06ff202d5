//! Why a node cannot be made or asked.

/// What a node cannot do, as opposed to what a firmware does wrong.
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
        /// The image.
        firmware: String,
        /// The part.
        part: &'static str,
        /// The segment's first address.
        address: u64,
        /// Its length in bytes.
        length: usize,
    },
    /// What a part is said to have kept is not of its size.
    #[error("{length} bytes are not what the {part} keeps")]
    OtherFlash {
        /// The part.
        part: &'static str,
        /// How many bytes.
        length: usize,
    },
    /// The part's memory does not hold this image.
    #[error("the {part} does not hold {firmware}: its memory differs at {address:#010x}")]
    Differs {
        /// The image.
        firmware: String,
        /// The part.
        part: &'static str,
        /// Where the first byte differs.
        address: u64,
    },
    /// The image has no such symbol.
    #[error("{firmware} has no symbol {symbol}: is it the right image, and is the symbol `#[no_mangle]` and used?")]
    NoSymbol {
        /// The image.
        firmware: String,
        /// The name asked for.
        symbol: String,
    },
    /// A function does not hold certain bytes at exactly one place.
    #[error("{function} holds {bytes:02x?} at {found}: is it another build of the firmware?")]
    NoPlace {
        /// The function.
        function: String,
        /// What was looked for.
        bytes: Vec<u8>,
        /// Where it was found.
        found: &'static str,
    },
    /// An address or symbol asked for is not in memory.
    #[error("{length} bytes at {address:#010x} are not memory of the target")]
    NotMemory {
        /// The first address.
        address: u64,
        /// How many bytes were asked for.
        length: usize,
    },
    /// Where the part's core looks for its vectors at reset, the image has none.
    #[error(
        "{firmware} has no vector table at {address:#010x}, where the {part} starts from, and begins at \
         {begins:#010x}: is it an image for this part, without a bootloader?"
    )]
    NoVectors {
        /// The image.
        firmware: String,
        /// The part.
        part: &'static str,
        /// Where the table should be.
        address: u64,
        /// The lowest address that the image fills.
        begins: u64,
    },
}
