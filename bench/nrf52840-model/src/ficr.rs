//! FICR: what the factory wrote (PS 4.4).
//!
//! | covered | value |
//! |---|---|
//! | CODEPAGESIZE, CODESIZE, INFO.PART, PACKAGE, RAM, FLASH | an nRF52840-QIAA |
//! | INFO.VARIANT, DEVICEID, DEVICEADDR, DEVICEADDRTYPE | from the settings |
//! | the words at 0x130 and 0x134: part and revision | 8; 3 with build code Fxx or later, else 2; see below |
//! | TEMP.A0–A5, B0–B5, T0–T4 | the typical calibration |
//! | every other word | erased, 0xFFFF_FFFF |
//!
//! No specification names the words at 0x130 and 0x134. Nordic's start-up code reads them to know a part with hardened
//! access port protection, revision 3 on (public repository littlekernel/lk,
//! `external/platform/nrfx/mdk/nrf52_erratas.h`).
//!
//! UICR is memory that the NVMC programs, erased to 0xFF: see `nvmc`. PSELRESET, NFCPINS, APPROTECT and REGOUT0 read
//! what the image or the firmware put there and change nothing here: the reset pin, the NFC antenna and the supply are
//! outside the model, and what APPROTECT means to a debugger is [`crate::Nrf52840::debug_port_open`].
use crate::Settings;
use crate::clocks::Clocks;
use crate::instance::{Block, Cx, Instance};

/// The registers.
#[derive(Debug)]
pub(crate) struct Ficr {
    block: Block,
    words: [(u32, u32); 33],
}

impl Ficr {
    pub(crate) fn new(settings: &Settings) -> Self {
        let (id, address) = (settings.device_id, settings.device_address);
        let variant = u32::from_be_bytes(settings.build_code);
        let revision = if settings.build_code[2] >= b'F' { 3 } else { 2 };
        Self {
            block: Block::default(),
            words: [
                (0x010, 4096),                   // CODEPAGESIZE
                (0x014, 256),                    // CODESIZE
                (0x060, id as u32),              // DEVICEID
                (0x064, (id >> 32) as u32),      //
                (0x0A0, 1),                      // DEVICEADDRTYPE: random
                (0x0A4, address as u32),         // DEVICEADDR
                (0x0A8, (address >> 32) as u32), //
                (0x100, 0x0005_2840),            // INFO.PART
                (0x104, variant),                // INFO.VARIANT
                (0x108, 0x2004),                 // INFO.PACKAGE: QIxx
                (0x10C, 256),                    // INFO.RAM, KiB
                (0x110, 1024),                   // INFO.FLASH, KiB
                (0x130, 8),                      // nRF52840
                (0x134, revision),
                (0x350, 0xFFFF_FFFF), // PRODTEST[0..3]
                (0x354, 0xFFFF_FFFF),
                (0x358, 0xFFFF_FFFF),
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
            ],
        }
    }
}

impl Instance for Ficr {
    crate::instance::block!();

    fn read(&self, offset: u32, _: u64, _: &Clocks) -> Option<u32> {
        let word = self.words.iter().find(|(at, _)| *at == offset);
        Some(word.map_or(u32::MAX, |(_, value)| *value))
    }

    fn write(&mut self, offset: u32, _: u32, cx: &mut Cx<'_>) -> bool {
        cx.misuse("a write to read-only memory, at offset", offset);
        true
    }
}
