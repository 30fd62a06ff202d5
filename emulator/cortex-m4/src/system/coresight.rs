//! ITM, TPIU, ETM and ROM table, as far as start-up code uses them: identification, locks, and registers that read
//! back. The model has no trace output: stimulus ports are always ready, and data written to them is lost.

/// The unlock key of CoreSight components, ARM ARM appendix D2.
const UNLOCK: u32 = 0xC5AC_CE55;

#[derive(Clone, Debug, Default)]
pub(crate) struct CoreSight {
    itm_unlocked: bool,
    etm_unlocked: bool,
    itm_enable: u32,
    pub(crate) itm_privilege: u32,
    itm_control: u32,
    /// The TPIU registers CSPSR, ACPR, SPPR and FFCR.
    port_size: u32,
    prescaler: u32,
    protocol: u32,
    formatter: u32,
    /// The ETM registers CR and TRACEIDR.
    etm_control: u32,
    etm_identifier: u32,
}

/// The peripheral and component identification at 0xFD0 to 0xFFC: PIDR4 to 7, PIDR0 to 3, CIDR0 to 3, with Arm's code
/// (JEP106 0x3B, continuation 4).
fn identification(offset: u32, part: u32, revision: u32, class: u32) -> Option<u32> {
    Some(match offset {
        0xFD0 => 0x04,
        0xFD4 | 0xFD8 | 0xFDC | 0xFEC => 0,
        0xFE0 => part & 0xFF,
        0xFE4 => 0xB0 | part >> 8,
        0xFE8 => revision << 4 | 0x0B,
        0xFF0 => 0x0D,
        0xFF4 => class << 4,
        0xFF8 => 0x05,
        0xFFC => 0xB1,
        _ => return None,
    })
}

impl CoreSight {
    pub(crate) fn new() -> Self {
        Self { port_size: 1, protocol: 1, formatter: 0x102, etm_control: 0x411, ..Self::default() }
    }

    /// Reads an address of this space that belongs to none of DWT, FPB and SCS. Returns `None` where there is no
    /// register.
    pub(crate) fn read(&self, address: u32) -> Option<u32> {
        let offset = address & 0xFFF;
        match address >> 12 & 0xFF {
            0x00 => match offset {
                0x000..=0x07C => Some(1),
                0xE00 => Some(self.itm_enable),
                0xE40 => Some(self.itm_privilege),
                0xE80 => Some(self.itm_control),
                0xEF8 | 0xFB0 => Some(0),
                // LSR: bit 0 shows that there is a lock, bit 1 that it is locked.
                0xFB4 => Some(1 | u32::from(!self.itm_unlocked) << 1),
                _ => identification(offset, 0x001, 3, 0xE),
            },
            0x01 => identification(offset, 0x002, 3, 0xE),
            0x02 => identification(offset, 0x003, 2, 0xE),
            0x0E => identification(offset, 0x00C, 0, 0xE),
            0x40 => match offset {
                0x000 => Some(0xB),
                0x004 => Some(self.port_size),
                0x010 => Some(self.prescaler),
                0x0F0 => Some(self.protocol),
                0x300 => Some(8),
                0x304 => Some(self.formatter),
                0x308 | 0xFA0 | 0xFA4 => Some(0),
                0xFC8 => Some(0xCA1),
                0xFCC => Some(0x11),
                _ => identification(offset, 0x9A1, 0, 0x9),
            },
            0x41 => match offset {
                0x000 => Some(self.etm_control),
                0x004 => Some(0x8C80_2000),
                0x010 | 0xFB0 => Some(0),
                0x014 => Some(0x0002_0D09),
                0x1E4 => Some(0x4114_F250),
                0x200 => Some(self.etm_identifier),
                0xFB4 => Some(1 | u32::from(!self.etm_unlocked) << 1),
                _ => identification(offset, 0x925, 0, 0x9),
            },
            0xFF => match offset {
                0x000 => Some(0xFFF0_F003),
                0x004 => Some(0xFFF0_2003),
                0x008 => Some(0xFFF0_3003),
                0x00C => Some(0xFFF0_1003),
                0x010 => Some(0xFFF4_1003),
                0x014 => Some(0xFFF4_2003),
                0x018 => Some(0),
                0xFCC => Some(1),
                _ => identification(offset, 0x4C4, 0, 0x1),
            },
            _ => None,
        }
    }

    /// Writes an address that DWT, FPB and SCS do not have. Returns `false` where there is no register.
    pub(crate) fn write(&mut self, address: u32, value: u32) -> bool {
        let offset = address & 0xFFF;
        match (address >> 12 & 0xFF, offset) {
            (0x00, 0x000..=0x07C) => {}
            (0x00, 0xE00) if self.itm_unlocked => self.itm_enable = value,
            (0x00, 0xE40) if self.itm_unlocked => self.itm_privilege = value & 0xF,
            (0x00, 0xE80) if self.itm_unlocked => self.itm_control = value & 0x007F_0F1F,
            (0x00, 0xE00 | 0xE40 | 0xE80) => {}
            (0x00, 0xFB0) => self.itm_unlocked = value == UNLOCK,
            (0x40, 0x004) => self.port_size = value,
            (0x40, 0x010) => self.prescaler = value & 0x1FFF,
            (0x40, 0x0F0) => self.protocol = value & 3,
            (0x40, 0x304) => self.formatter = value & 2 | 0x100,
            (0x41, 0x000) if self.etm_unlocked => self.etm_control = value,
            (0x41, 0x200) if self.etm_unlocked => self.etm_identifier = value & 0x7F,
            (0x41, 0x000 | 0x200) => {}
            (0x41, 0xFB0) => self.etm_unlocked = value == UNLOCK,
            _ => return false,
        }
        true
    }
}
