//! Flash, UICR, FICR and RAM (PS 4.2, 4.3, 4.4, 4.5).
//!
//! | covered | PS |
//! |---|---|
//! | flash and RAM at their addresses; the same RAM also as code RAM | 4.2 |
//! | FICR: CODEPAGESIZE, CODESIZE, INFO.PART, PACKAGE, RAM, FLASH of an nRF52840-QIAA | 4.4 |
//! | FICR: INFO.VARIANT, DEVICEID, DEVICEADDR, DEVICEADDRTYPE, from the settings; ER, IR, PRODTEST, TEMP | 4.4 |
//! | the words at 0x1000_0130 and 0x1000_0134: part and revision | – |
//! | the component identification at 0xF000_0FD0 to 0xF000_0FFF | – |
//!
//! No specification names the words at 0x1000_0130, 0x1000_0134 and 0xF000_0FE0. Nordic's start-up code reads them to
//! find the revision (nrfx, `mdk/nrf52_erratas.h`). Older versions of `system_nrf52840.c` check the low byte of
//! 0xF000_0FE0, the low nibble of 0xF000_0FE4, and the high nibbles of 0xF000_0FE8 and 0xF000_0FEC. The other nibbles
//! are assumed to be CoreSight's encoding of Nordic's JEP106 number 0x244.
//!
//! UICR holds what the image or the firmware wrote. PSELRESET, NFCPINS and REGOUT0 have no effect here, since reset
//! pin, NFC antenna and voltage regulators are not modelled. For APPROTECT see [`crate::Nrf52840::debug_port_open`].
use crate::Settings;
use cortex_m4::Width;
use emulator_part::{Flash, Ram};

/// The size of flash: 1 MiB in 256 pages of 4 KiB (PS 4.3).
pub(crate) const FLASH_BYTES: u32 = 1 << 20;
/// The size of data RAM: 256 KiB, which is all that EasyDMA reaches (PS 4.6).
pub(crate) const RAM_BYTES: u32 = 256 << 10;
/// The first address of data RAM.
pub(crate) const RAM_BASE: u32 = 0x2000_0000;
/// The first address at which the same RAM is accessed as code RAM (PS 4.2).
pub(crate) const CODE_RAM_BASE: u32 = 0x0080_0000;
/// The first addresses of FICR and UICR, and the size of each.
pub(crate) const FICR_BASE: u32 = 0x1000_0000;
pub(crate) const UICR_BASE: u32 = 0x1000_1000;
pub(crate) const PAGE: u32 = 4096;

#[derive(Clone, Debug)]
pub(crate) struct Memory {
    pub(crate) flash: Flash,
    pub(crate) uicr: Flash,
    pub(crate) ficr: Flash,
    pub(crate) ram: Ram,
    /// Whether flash was programmed or erased, and the core has yet to be told.
    pub(crate) code_changed: bool,
    /// The AHB slaves of RAM that EasyDMA has accessed, one bit each (see [`slave`]).
    dma_slaves: u16,
}

/// The AHB slave of the RAM at `offset`: RAM0 to RAM7 have two sections of 4 KiB each, RAM8 has the rest (PS 4.2,
/// memory layout).
#[inline]
const fn slave(offset: u32) -> u16 {
    if offset < 0x1_0000 { 1 << (offset >> 13) } else { 1 << 8 }
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Place {
    Flash(u32),
    Ram(u32),
    Ficr(u32),
    Uicr(u32),
}

#[inline]
pub(crate) fn place(address: u32) -> Option<Place> {
    let ram = address.wrapping_sub(RAM_BASE);
    if ram < RAM_BYTES {
        return Some(Place::Ram(ram));
    }
    if address < FLASH_BYTES {
        return Some(Place::Flash(address));
    }
    let code_ram = address.wrapping_sub(CODE_RAM_BASE);
    if code_ram < RAM_BYTES {
        return Some(Place::Ram(code_ram));
    }
    match address & !(PAGE - 1) {
        FICR_BASE => Some(Place::Ficr(address - FICR_BASE)),
        UICR_BASE => Some(Place::Uicr(address - UICR_BASE)),
        _ => None,
    }
}

impl Memory {
    pub(crate) fn new(settings: &Settings) -> Self {
        Self {
            flash: Flash::new(FLASH_BYTES as usize),
            uicr: Flash::new(PAGE as usize),
            ficr: ficr(settings),
            ram: Ram::new(RAM_BYTES as usize),
            code_changed: false,
            dma_slaves: 0,
        }
    }

    pub(crate) fn slice(&self, address: u32, size: usize) -> Option<&[u8]> {
        let (bytes, from) = match place(address)? {
            Place::Flash(offset) => (self.flash.bytes(), offset),
            Place::Ram(offset) => (self.ram.bytes(), offset),
            Place::Ficr(offset) => (self.ficr.bytes(), offset),
            Place::Uicr(offset) => (self.uicr.bytes(), offset),
        };
        bytes.get(from as usize..(from as usize).checked_add(size)?)
    }

    pub(crate) fn slice_mut(&mut self, address: u32, size: usize) -> Option<&mut [u8]> {
        let (bytes, from) = match place(address)? {
            Place::Flash(offset) => {
                self.code_changed = true;
                (self.flash.bytes_mut(), offset)
            }
            Place::Ram(offset) => return self.ram.slice_mut(offset, size),
            Place::Ficr(offset) => (self.ficr.bytes_mut(), offset),
            Place::Uicr(offset) => (self.uicr.bytes_mut(), offset),
        };
        bytes.get_mut(from as usize..(from as usize).checked_add(size)?)
    }

    /// Programs a word of flash or UICR: clears the bits that are clear in `value`.
    pub(crate) fn program(&mut self, address: u32, value: u32) {
        if let Some(word) = self.slice_mut(address, 4) {
            let had = u32::from_le_bytes([word[0], word[1], word[2], word[3]]);
            word.copy_from_slice(&(had & value).to_le_bytes());
        }
    }

    /// Erases a range of flash or UICR: sets all bits.
    pub(crate) fn erase(&mut self, address: u32, size: u32) {
        if let Some(bytes) = self.slice_mut(address, size as usize) {
            bytes.fill(0xFF);
        }
    }

    /// The offset in data RAM of `address`; `None` elsewhere, since EasyDMA reaches data RAM only (PS 4.6).
    #[inline]
    fn dma(address: u32) -> Option<usize> {
        let offset = address.wrapping_sub(RAM_BASE);
        (offset < RAM_BYTES).then_some(offset as usize)
    }

    #[inline]
    pub(crate) fn dma_read(&mut self, address: u32) -> Option<u8> {
        let offset = Self::dma(address)?;
        self.dma_slaves |= slave(offset as u32);
        Some(self.ram.bytes()[offset])
    }

    #[inline]
    pub(crate) fn dma_write(&mut self, address: u32, value: u8) -> bool {
        let Some(offset) = Self::dma(address) else { return false };
        self.dma_slaves |= slave(offset as u32);
        self.ram.write(offset as u32, Width::Byte, u32::from(value))
    }

    /// Whether EasyDMA has accessed the AHB slave of the RAM at `address`. The processor may then have to wait for
    /// EasyDMA.
    #[inline]
    pub(crate) fn may_meet_dma(&self, address: u32) -> bool {
        matches!(place(address), Some(Place::Ram(offset)) if self.dma_slaves & slave(offset) != 0)
    }
}

/// The part's revision as Nordic numbers it: 3 for build codes Fxx and later.
fn revision(settings: &Settings) -> u32 {
    if settings.build_code[2] >= b'F' { 3 } else { 2 }
}

fn ficr(settings: &Settings) -> Flash {
    let mut ficr = Flash::new(PAGE as usize);
    let (id, address) = (settings.device_id, settings.device_address);
    let words = [
        (0x010, 4096),                   // CODEPAGESIZE
        (0x014, 256),                    // CODESIZE
        (0x060, id as u32),              // DEVICEID
        (0x064, (id >> 32) as u32),      //
        (0x0A0, 0xFFFF_FFFF),            // DEVICEADDRTYPE: bit 0 set, random
        (0x0A4, address as u32),         // DEVICEADDR
        (0x0A8, (address >> 32) as u32), //
        (0x100, 0x0005_2840),            // INFO.PART
        (0x104, u32::from_be_bytes(settings.build_code)),
        (0x108, 0x2004), // INFO.PACKAGE: QIxx
        (0x10C, 256),    // INFO.RAM, KiB
        (0x110, 1024),   // INFO.FLASH, KiB
        (0x130, 8),      // nRF52840
        (0x134, revision(settings)),
        (0x350, 0xBB42_319F), // PRODTEST[0..3]: production tests done (PS 4.4.1.18)
        (0x354, 0xBB42_319F),
        (0x358, 0xBB42_319F),
        (0x404, 0x320), // TEMP.A0 to A5
        (0x408, 0x343),
        (0x40C, 0x35D),
        (0x410, 0x400),
        (0x414, 0x452),
        (0x418, 0x37B),
        (0x41C, 0x3FCC), // TEMP.B0 to B5
        (0x420, 0x3F98),
        (0x424, 0x3F98),
        (0x428, 0x12),
        (0x42C, 0x4D),
        (0x430, 0x3E10),
        (0x434, 0xE2), // TEMP.T0 to T4
        (0x438, 0x00),
        (0x43C, 0x14),
        (0x440, 0x19),
        (0x444, 0x50),
    ];
    let bytes = ficr.bytes_mut();
    let mut put = |at: usize, value: u32| bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
    for (at, value) in words {
        put(at, value);
    }
    // ER and IR: 128 random bits each.
    let mut state = id;
    for word in 0..8 {
        state = state.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(0x1405_7B7E_F767_814F);
        put(0x080 + 4 * word, (state >> 32) as u32);
    }
    ficr
}

pub(crate) fn identification(address: u32, settings: &Settings) -> Option<u32> {
    Some(match address {
        0xF000_0FD0 => 0x02,
        0xF000_0FD4..=0xF000_0FDF => 0,
        0xF000_0FE0 => 0x08,
        0xF000_0FE4 => 0x40,
        0xF000_0FE8 => revision(settings) << 4 | 0x0C,
        0xF000_0FEC => 0,
        0xF000_0FF0 => 0x0D,
        0xF000_0FF4 => 0x10,
        0xF000_0FF8 => 0x05,
        0xF000_0FFC => 0xB1,
        _ => return None,
    })
}
