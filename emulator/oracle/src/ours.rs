//! Runs an image on the bench's own core, with only memory around the core.

use cortex_m4::{Access, Bound, Bus, BusError, Config, Core, Cost, Exit, Fast, Signals};

use crate::image::{RESULT_WORDS, RESULTS};

const CODE_BYTES: usize = 4 << 20;
const RAM: u32 = 0x2000_0000;
const RAM_BYTES: usize = 64 << 10;
const RESULT_BYTES: usize = 4 << 20;

/// A bus with three memories: code at 0, RAM, and the results.
#[derive(Clone, Debug)]
pub struct Memory {
    code: Vec<u8>,
    ram: Vec<u8>,
    results: Vec<u8>,
    signals: Signals,
    constant: bool,
}

impl Memory {
    /// Makes memory with `image` at address 0.
    #[must_use]
    pub fn new(image: &[u8], constant: bool) -> Self {
        let mut code = image.to_vec();
        code.resize(CODE_BYTES, 0);
        let signals = Signals::default();
        Self { code, ram: vec![0; RAM_BYTES], results: vec![0; RESULT_BYTES], signals, constant }
    }

    fn at(&mut self, address: u32, bytes: u32) -> Result<&mut [u8], BusError> {
        let (memory, base) = match address {
            0..RAM => (&mut self.code, 0),
            RAM..RESULTS => (&mut self.ram, RAM),
            _ => (&mut self.results, RESULTS),
        };
        let from = (address - base) as usize;
        memory.get_mut(from..from + bytes as usize).ok_or(BusError)
    }
}

impl Bus for Memory {
    fn read(&mut self, access: &Access) -> Result<u32, BusError> {
        let bytes = self.at(access.address, access.width.bytes())?;
        Ok(bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte)))
    }

    fn write(&mut self, access: &Access, value: u32) -> Result<(), BusError> {
        let width = access.width.bytes();
        self.at(access.address, width)?.copy_from_slice(&value.to_le_bytes()[..width as usize]);
        Ok(())
    }

    fn fetch(&mut self, address: u32) -> Result<u16, BusError> {
        let bytes = self.at(address, 2)?;
        Ok(u16::from_le_bytes([bytes[0], bytes[1]]))
    }

    fn is_constant(&self, address: u32) -> bool {
        self.constant && address < CODE_BYTES as u32
    }

    fn due(&self) -> u64 {
        u64::MAX
    }

    fn advance(&mut self, _: u64) {}

    fn signals(&mut self) -> &mut Signals {
        &mut self.signals
    }

    fn wait_states(&mut self, _: &Access, _: Bound) -> u32 {
        0
    }

    fn bit_banding(&self) -> bool {
        true
    }
}

/// Makes a core with the configuration of QEMU's `mps2-an386`.
#[must_use]
pub fn core<C: Cost>() -> Core<C> {
    Core::new(Config {
        lines: 32,
        priority_bits: 8,
        vector_table: 0,
        systick_calibration: 0,
        systick_reference: 0,
        mpu_regions: 8,
    })
}

/// Runs `image` to its first semihosting call, and returns `words` words of results.
///
/// # Errors
///
/// Returns an error if the image did not reach a semihosting call.
pub fn run_words<C: Cost>(image: &[u8], words: usize, constant: bool) -> anyhow::Result<Vec<u32>> {
    let mut memory = Memory::new(image, constant);
    let mut core = core::<C>();
    core.reset(&mut memory);
    // The limit is generous: a case takes about 300 instructions.
    let exit = core.run(&mut memory, 2_000_000_000);
    anyhow::ensure!(exit == Exit::HostCall, "{exit:?} at {:#010x}", core.pc());
    let words = memory.results.as_chunks::<4>().0.iter().take(words);
    Ok(words.map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]])).collect())
}

/// Returns the results of these cases, in the form of [`crate::reference`].
///
/// # Errors
///
/// Returns an error if the image did not run to its end.
pub fn results(cases: &[crate::image::Case]) -> anyhow::Result<Vec<u32>> {
    run_words::<Fast>(&crate::image::build(cases), cases.len() * RESULT_WORDS, true)
}
