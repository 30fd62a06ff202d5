//! Register addresses and bits: what this driver touches, and nothing else.
//!
//! Source: DS13541 (ST25R3916B), "Registers" chapter; where the ST25R3916 differs, this says so. Bits
//! marked *seen* were also observed on a real ST25R3916 (public SPI captures). Addresses are of
//! space A unless the name starts with `B_`.

/// IO configuration 1: MCU clock output, I²C thresholds.
pub const IO_CONFIGURATION_1: u8 = 0x00;
/// IO configuration 2: supply range, MISO pull-downs, IO driver strength.
pub const IO_CONFIGURATION_2: u8 = 0x01;
/// Operation control.
pub const OPERATION_CONTROL: u8 = 0x02;
/// Mode definition; writable once the oscillator is stable.
pub const MODE: u8 = 0x03;
/// Bit rate definition.
pub const BIT_RATE: u8 = 0x04;
/// ISO14443B settings 2 and NFC-F: preamble length.
pub const NFC_F_PREAMBLE: u8 = 0x07;
/// Passive target definition.
pub const PASSIVE_TARGET: u8 = 0x08;
/// Auxiliary definition.
pub const AUXILIARY: u8 = 0x0A;
/// Mask-receive timer.
pub const MASK_RECEIVE_TIMER: u8 = 0x0F;
/// No-response timer, most significant byte; the least significant follows at 0x11. 0 is off.
pub const NO_RESPONSE_TIMER: u8 = 0x10;
/// First of four interrupt mask registers, 0x16..=0x19; 1 masks. A masked bit still sets.
pub const IRQ_MASK_MAIN: u8 = 0x16;
/// Last interrupt mask register. Everything it masks concerns card emulation in NFC-A and wake-up;
/// this driver keeps it at [`IRQ_MASK_TARGET_ALL`], which a reset chip does not (it reads 0). Bit 2 is reserved and
/// reads 0 whatever is written (*seen*: 0xFF written, 0xFB read).
pub const IRQ_MASK_TARGET: u8 = 0x19;
/// First of four interrupt registers, 0x1A..=0x1D; reading clears.
pub const IRQ_MAIN: u8 = 0x1A;
/// FIFO status 1: count, bits 7:0. Status 2 follows at 0x1F.
pub const FIFO_STATUS_1: u8 = 0x1E;
/// Transmit length in bytes, bits 12:5; bits 4:0 follow at 0x23, shifted left by 3.
pub const TRANSMIT_LENGTH: u8 = 0x22;
/// Antenna tuning A; B follows at 0x27.
pub const ANTENNA_TUNING: u8 = 0x26;
/// Transmit driver: AM depth (bits 7:4), output resistance (bits 3:0).
pub const TRANSMIT_DRIVER: u8 = 0x28;
/// Passive target modulation: driver resistance when modulated and when not.
pub const PASSIVE_TARGET_MODULATION: u8 = 0x29;
/// Auxiliary display (read only).
pub const AUXILIARY_DISPLAY: u8 = 0x31;
/// Identity (read only): type in bits 7:3, revision in bits 2:0.
pub const IDENTITY: u8 = 0x3F;
/// Space B: auxiliary modulation: which drivers do load modulation.
pub const B_AUXILIARY_MODULATION: u8 = 0x28;
/// Test space: with [`TEST_OVERHEAT_PROTECTION`], what ST's own driver writes on the ST25R3916.
pub const TEST_OVERHEAT: u8 = 0x04;

/// [`IO_CONFIGURATION_1`]: no clock on MCU_CLK (out_cl = 3, lf_clk_off).
pub const IO_1_NO_CLOCK: u8 = 0x07;
/// [`IO_CONFIGURATION_2`]: MISO pull-downs on (miso_pd2, miso_pd1), strong IO drivers (io_drv_lvl).
pub const IO_2_MISO: u8 = 0x1C;
/// [`IO_CONFIGURATION_2`]: sup3V, supply between 2.4 V and 3.6 V.
pub const IO_2_SUPPLY_3V: u8 = 0x80;

/// [`OPERATION_CONTROL`]: oscillator and regulator on.
pub const OP_EN: u8 = 0x80;
/// [`OPERATION_CONTROL`]: receiver on.
pub const OP_RX_EN: u8 = 0x40;
/// [`OPERATION_CONTROL`]: transmitter, that is the field, on.
pub const OP_TX_EN: u8 = 0x08;
/// [`OPERATION_CONTROL`]: external field detector, automatic (en_fd_c = 3).
pub const OP_FIELD_DETECTOR: u8 = 0x03;

/// [`MODE`]: FeliCa initiator (om = 3), AM modulation (tr_am).
pub const MODE_POLLER_NFC_F: u8 = 0x1C;
/// [`MODE`]: target (targ), NFC-F passive (om = 4).
pub const MODE_LISTENER_NFC_F: u8 = 0xA0;
/// [`BIT_RATE`]: 424 kbit/s in both directions.
pub const BIT_RATE_424: u8 = 0x22;
/// [`NFC_F_PREAMBLE`]: 48 bits (f_p = 0).
pub const PREAMBLE_48: u8 = 0x00;
/// [`PASSIVE_TARGET`]: no automatic answer of any kind (d_ac_ap2p, d_212_424_1r, d_106_ac_a).
pub const PASSIVE_TARGET_SILENT: u8 = 0x5D;
/// [`MASK_RECEIVE_TIMER`]: two steps.
pub const MASK_RECEIVE_SHORT: u8 = 0x02;
/// [`PASSIVE_TARGET_MODULATION`]: both resistances at high impedance: the driver cannot
/// modulate the poller's field.
pub const PASSIVE_TARGET_HIGH_Z: u8 = 0xFF;
/// [`B_AUXILIARY_MODULATION`]: no load modulation by the internal (lm_dri) nor by an external
/// (lm_ext) driver.
pub const NO_LOAD_MODULATION: u8 = 0x00;
/// [`TRANSMIT_DRIVER`] on the ST25R3916B: 12 % AM (am_mod = 4), lowest output resistance.
pub const TRANSMIT_DRIVER_12_PERCENT_B: u8 = 0x40;
/// [`TRANSMIT_DRIVER`] on the ST25R3916: 12 % AM (am_mod = 7, its reset value, *seen*). The two
/// parts code the depth differently: 4 would be 9 % here.
pub const TRANSMIT_DRIVER_12_PERCENT_A: u8 = 0x70;
/// [`TEST_OVERHEAT`]: overheat protection on.
pub const TEST_OVERHEAT_PROTECTION: u8 = 0x10;

/// Main interrupt: oscillator stable.
pub const IRQ_OSCILLATOR: u8 = 0x80;
/// Main interrupt: start of receive (the sync was seen).
pub const IRQ_RXS: u8 = 0x20;
/// Main interrupt: end of receive.
pub const IRQ_RXE: u8 = 0x10;
/// Main interrupt: end of transmission.
pub const IRQ_TXE: u8 = 0x08;
/// Timer and NFC interrupt: direct command ended.
pub const IRQ_DCT: u8 = 0x80;
/// Timer and NFC interrupt: external field on.
pub const IRQ_EON: u8 = 0x10;
/// Timer and NFC interrupt: external field off.
pub const IRQ_EOF: u8 = 0x08;
/// Error interrupt: CRC.
pub const IRQ_CRC: u8 = 0x80;
/// Error interrupts: parity (0x40), soft framing (0x20), hard framing (0x10).
pub const IRQ_FRAMING: u8 = 0x70;

/// Poller masks, 0x16..=0x19: all but I_osc and I_txe (main), all but I_dct (timer), every error,
/// every target interrupt. The FIFO water level (I_wl), raised on the way by a frame of more than
/// 200 bytes, is among the masked.
pub const POLLER_MASKS: [u8; 4] = [0x77, 0x7F, 0xFF, IRQ_MASK_TARGET_ALL];
/// Listener masks: all but I_rxs and I_rxe, all but I_eon and I_eof, errors not masked, every
/// target interrupt masked.
pub const LISTENER_MASKS: [u8; 4] = [0xCF, 0xE7, 0x0F, IRQ_MASK_TARGET_ALL];
/// [`IRQ_MASK_TARGET`] as this driver sets it: every interrupt that exists, the reserved bit 2 left 0, so that it reads back
/// as written; 0x00 after a reset.
pub const IRQ_MASK_TARGET_ALL: u8 = 0xFB;

/// FIFO status 2: underflow.
pub const FIFO_UNDERFLOW: u8 = 0x20;
/// FIFO status 2: overflow.
pub const FIFO_OVERFLOW: u8 = 0x10;
/// FIFO status 2: bits in an incomplete last byte, or its parity missing.
pub const FIFO_LAST_BITS: u8 = 0x0F;
/// The FIFO's size in bytes.
pub const FIFO_SIZE: u16 = 512;

/// Auxiliary display: transmitter on.
pub const DISPLAY_TX_ON: u8 = 0x20;
/// Auxiliary display: oscillator stable (*seen*).
pub const DISPLAY_OSC_OK: u8 = 0x10;

/// Identity without its revision.
pub const IDENTITY_TYPE: u8 = 0xF8;
/// Type of the ST25R3916 (0x2A with its revision, *seen*).
pub const IDENTITY_A: u8 = 0x28;
/// Type of the ST25R3916B (0x31 with its revision).
pub const IDENTITY_B: u8 = 0x30;
