//! Firmware images without their ELF files, for programs that cannot carry megabytes of debug information.

use serde::{Deserialize, Serialize};

use crate::firmware::{Contents, Function};
use crate::{Error, Firmware, Symbol};

/// What a board needs of a firmware image: contents of memory, names of addresses, and the table of log messages.
#[derive(Serialize, Deserialize)]
struct Packed {
    name: String,
    segments: Vec<(u64, Vec<u8>)>,
    symbols: Vec<(String, Symbol)>,
    functions: Vec<(u64, u64, String)>,
    log: Option<defmt_decoder::Table>,
}

impl Firmware {
    /// Returns the image in a compact form for [`Firmware::unpack`]. It lacks the debug information, so the names of
    /// addresses have no source lines, and the sections, so the use of the stack is not known.
    ///
    /// # Errors
    ///
    /// Returns an error if the table of log messages has a form that cannot be written.
    pub fn pack(&self) -> Result<Vec<u8>, Error> {
        let Contents { name, segments, symbols, functions, log, .. } = self.contents();
        let packed = Packed {
            name: name.clone(),
            segments: segments.clone(),
            symbols: symbols.iter().map(|(name, symbol)| (name.clone(), *symbol)).collect(),
            functions: functions.iter().map(|of| (of.start, of.size, of.name.clone())).collect(),
            log: log.clone(),
        };
        postcard::to_allocvec(&packed).map_err(|error| Error::Firmware(format!("{name} cannot be packed: {error}")))
    }

    /// Returns the image that [`Firmware::pack`] has written.
    ///
    /// # Errors
    ///
    /// Returns an error for bytes that are no packed image.
    pub fn unpack(bytes: &[u8]) -> Result<Self, Error> {
        let packed: Packed = postcard::from_bytes(bytes)
            .map_err(|error| Error::Firmware(format!("these bytes are no packed firmware image: {error}")))?;
        Ok(Self::of(Contents {
            name: packed.name,
            segments: packed.segments,
            symbols: packed.symbols.into_iter().collect(),
            functions: packed.functions.into_iter().map(|(start, size, name)| Function { start, size, name }).collect(),
            log: packed.log,
            ..Contents::default()
        }))
    }
}
