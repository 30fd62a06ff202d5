//! The register addresses and bits that this driver uses.
//!
//! The source is DS13541 (ST25R3916B), "Registers" chapter; differences of the ST25R3916 are noted. Values marked
//! *seen* were also observed on a real ST25R3916 (public SPI captures). Addresses are of space A unless the name starts
//! with `B_`.
//!
//! For some values of the receive chain, of the antenna tuning and of the supply measurement the data sheet does not
//! help. They follow public drivers, which have these short names here:
//!
//! | short | repository, file |
//! |---|---|
//! | *RFAL* | stm32duino/ST25R3916, `src/rfal_rfst25r3916_analogConfigTbl.h`, `src/st25r3916.cpp` (ST's own library) |
//! | *Flipper* | flipperdevices/flipperzero-firmware, `targets/f7/furi_hal/furi_hal_nfc_felica.c`, `furi_hal_nfc.c` |
//! | *Guyot* | pguyot/st25r391x, `st25r391x_nfcf.c` (from the ST25R3916's data sheet DS12484) |
//! | *Delpy* | BdF-LabSec/kst25r3916, `Core/program/st25r` |
//! | *rnfc* | embassy-rs/rnfc, `rnfc-st25r39/src/lib.rs` |
//! | *Highboy* | HighCodeh/TentacleOS, its FeliCa emulation (`felica_emu.c`, ST25R3916) |
//! | *TM* | techmccat/st25r39, `src/registers.rs` (paraphrases the ST25R3916B's data sheet) |
//!
//! Where the drivers disagree, `docs/decisions/0008-receive-chain.md` gives the choice and the reason.

/// The offset that marks an address as one of space B, where a single number names a register of either space.
pub const SPACE_B: u8 = 0x40;

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
/// Receiver configuration 1: channel, low-pass and high-pass filter. After a reset 0x08 (*seen*), `hz_600_400khz`, the
/// filter for the 848 kHz subcarrier of NFC-A.
pub const RECEIVER_1: u8 = 0x0B;
/// Receiver configuration 2: demodulator, squelch, gain control. 0x2D after a reset (*seen*).
pub const RECEIVER_2: u8 = 0x0C;
/// Receiver configuration 3: first stage's gain reduction. 0xD8 after a reset (*seen*).
pub const RECEIVER_3: u8 = 0x0D;
/// Receiver configuration 4: second stage's gain reduction. 0x00 after a reset (*seen*).
pub const RECEIVER_4: u8 = 0x0E;
/// Mask-receive timer.
pub const MASK_RECEIVE_TIMER: u8 = 0x0F;
/// No-response timer, high byte. The low byte is at 0x11, the timers' control at 0x12. The value 0 switches it off.
pub const NO_RESPONSE_TIMER: u8 = 0x10;
/// First of four interrupt mask registers, 0x16..=0x19. A bit of 1 masks; a masked interrupt still sets its bit.
pub const IRQ_MASK_MAIN: u8 = 0x16;
/// Last interrupt mask register, for card emulation in NFC-A and wake-up. This driver keeps it at
/// [`IRQ_MASK_TARGET_ALL`], while a reset chip has 0. Bit 2 is reserved and reads 0 (*seen*: 0xFF written, 0xFB read).
pub const IRQ_MASK_TARGET: u8 = 0x19;
/// First of four interrupt registers, 0x1A..=0x1D; a read clears them.
pub const IRQ_MAIN: u8 = 0x1A;
/// FIFO status 1: bits 7:0 of the number of bytes. FIFO status 2 follows at 0x1F.
pub const FIFO_STATUS_1: u8 = 0x1E;
/// Transmit length in bytes, bits 12:5; bits 4:0 follow at 0x23, shifted left by 3.
pub const TRANSMIT_LENGTH: u8 = 0x22;
/// Result of the chip's A/D converter (read only): the measured supply voltage in steps of 23.4 mV.
pub const AD_RESULT: u8 = 0x25;
/// Antenna tuning A; B follows at 0x27. Both drive the tuning pins only while [`IO_2_ANTENNA_TUNING`] is set.
pub const ANTENNA_TUNING: u8 = 0x26;
/// Transmit driver: AM depth (bits 7:4), output resistance (bits 3:0).
pub const TRANSMIT_DRIVER: u8 = 0x28;
/// Passive target modulation: the driver's resistance while an answer modulates the field (`ptm_res`, bits 7:4) and
/// while it does not (`pt_res`, bits 3:0).
pub const PASSIVE_TARGET_MODULATION: u8 = 0x29;
/// External field detector: the upper threshold, at which a field appears. The lower one, above which the field stays,
/// follows at 0x2B. Bits 6:4 of each are for peer detection (trg), bits 3:0 for collision avoidance (rfe).
pub const FIELD_THRESHOLDS: u8 = 0x2A;
/// Regulator control: whether the regulated voltage is set by hand or as adjusted (`reg_s`), and the source of a supply
/// measurement (`mpsv`, bits 2:0).
pub const REGULATOR_CONTROL: u8 = 0x2C;
/// Auxiliary display (read only).
pub const AUXILIARY_DISPLAY: u8 = 0x31;
/// Identity (read only): type in bits 7:3, revision in bits 2:0.
pub const IDENTITY: u8 = 0x3F;
/// Space B: correlator configuration 1; configuration 2 follows at 0x0D. After a reset 0x93 and 0x00 (*seen*).
pub const B_CORRELATOR: u8 = 0x0C;
/// Space B: auxiliary modulation: the drivers for load modulation, and the method of a poller's amplitude modulation.
pub const B_AUXILIARY_MODULATION: u8 = 0x28;
/// Space B: resistive AM modulation (bits 6:0), and the non-overlap of the drivers (`fa3_f`, bit 7).
pub const B_DRIVER_NON_OVERLAP: u8 = 0x2A;
/// Space B, ST25R3916B only: active wave shaping, configuration 1; configuration 2 follows at 0x2F.
pub const B_WAVE_SHAPING: u8 = 0x2E;
/// Space B, ST25R3916B only: the first four of six times of the active wave shaping, in carrier periods.
pub const B_WAVE_SHAPING_TIMES: u8 = 0x34;
/// Test space, ST25R3916 only: the threshold of the internal overheat protection.
pub const TEST_OVERHEAT: u8 = 0x04;

/// [`IO_CONFIGURATION_1`]: no clock on MCU_CLK (out_cl = 3, lf_clk_off).
pub const IO_1_NO_CLOCK: u8 = 0x07;
/// [`IO_CONFIGURATION_2`]: MISO pull-downs on (miso_pd2, miso_pd1), strong IO drivers (io_drv_lvl).
pub const IO_2_MISO: u8 = 0x1C;
/// [`IO_CONFIGURATION_2`]: `aat_en`, without which the antenna tuning registers have no effect (*RFAL* and *Delpy*,
/// both parts; *seen*: 0x3C on real boards).
pub const IO_2_ANTENNA_TUNING: u8 = 0x20;
/// [`IO_CONFIGURATION_2`]: `sup3V` for a supply between 2.4 V and 3.6 V; the bit is clear above 3.6 V.
pub const IO_2_SUPPLY_3V: u8 = 0x80;

/// [`REGULATOR_CONTROL`]: `reg_s`, set and cleared before the regulators are adjusted (*RFAL*, *Delpy*, *rnfc*).
pub const REGULATOR_MANUAL: u8 = 0x80;
/// [`REGULATOR_CONTROL`]: regulated voltage as adjusted (`reg_s` = 0), and VDD measured (`mpsv` = 0).
pub const REGULATOR_ADJUSTED_MEASURE_VDD: u8 = 0x00;

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
/// [`AUXILIARY`]: the correlator receives (`dis_corr` = 0), and the received CRC is checked (`no_crc_rx` = 0). (*RFAL*
/// for NFC-F without its coherent option; reset value, *seen*.)
pub const AUXILIARY_CORRELATOR: u8 = 0x00;
/// [`RECEIVER_1`] for NFC-F: AM channel, `lp_600khz`, `hz_12_80khz`. NFC-F has no subcarrier: at 424 kbit/s its
/// Manchester code has its energy at 424 kHz and below, which the reset value filters away. (*Flipper*'s NFC-F
/// listener; *RFAL*, both parts, and *Guyot* for receiving NFC-F, at 212 and 424 kbit/s alike.)
pub const RECEIVER_1_NFC_F: u8 = 0x13;
/// [`RECEIVER_2`] for NFC-F: AM demodulation by the peak detector, squelch after a transmission (`sqm_dyn`), gain
/// control for the whole reception (`agc_en`, `agc_m`) with ratio 3 (`agc6_3`). (*Flipper*'s NFC-F listener; reset
/// value, *seen*.)
pub const RECEIVER_2_NFC_F: u8 = 0x2D;
/// [`RECEIVER_3`] for NFC-F: full gain in the first stage, AM and PM. (*Flipper*, *RFAL*, *Guyot*.)
pub const RECEIVER_3_NFC_F: u8 = 0x00;
/// [`RECEIVER_4`] for NFC-F: no gain reduction in the second stage, AM and PM. (*Flipper*, *RFAL*, *Guyot*.)
pub const RECEIVER_4_NFC_F: u8 = 0x00;
/// [`B_CORRELATOR`], two registers, for NFC-F: `corr_s6`, `corr_s4`, `corr_s2` in the first; the second is 0.
/// (*Flipper*'s NFC-F listener, *RFAL*, *Guyot*.)
pub const CORRELATOR_NFC_F: [u8; 2] = [0x54, 0x00];
/// [`MASK_RECEIVE_TIMER`]: two steps. (*Flipper*'s listeners, *Delpy*'s targets.)
pub const MASK_RECEIVE_SHORT: u8 = 0x02;
/// [`RECEIVER_2`] of a poller with an ST25R3916 that receives answers in NFC-F: [`RECEIVER_2_NFC_F`] and `pulz_61`.
/// (*RFAL*, *Guyot*; *TM* recommends `pulz_61` = 0 for FeliCa.)
pub const RECEIVER_2_ANSWER_A: u8 = 0x3D;
/// [`RECEIVER_2`] of a poller with an ST25R3916B that receives answers: its I/Q demodulator (`demod_mode`) and the
/// mixer (`amd_sel`), which compare the answer with the poller's own carrier. (*RFAL* alone.)
pub const RECEIVER_2_ANSWER_B: u8 = 0xFD;
/// [`MASK_RECEIVE_TIMER`] of a poller that receives answers: 40 steps of 64/fc = 189 µs after its own frame. This is
/// [`GUARD_FC`] less the one step of jitter that ST allows for. (*RFAL*: 2672/fc - 64/fc.)
pub const MASK_RECEIVE_GUARD: u8 = ((GUARD_FC - 64) / 64) as u8;
/// The time after a poller's frame in which a listener must not answer in NFC-F, in carrier periods: 197 µs. (NFC
/// Forum, Digital Protocol 1.1, A.4, TR0F,LISTEN,MIN, as given by *RFAL* and by Proxmark3, `armsrc/felica.c`.)
pub const GUARD_FC: u32 = 2_672;
/// Timers' control, after [`NO_RESPONSE_TIMER`]: steps of 64/fc, no EMV mode, start at the end of transmission. (*RFAL*
/// for every exchange; *TM*.)
pub const TIMERS_64_FC: u8 = 0x00;
/// [`ANTENNA_TUNING`], two registers, of a poller with an ST25R3916 (*RFAL*, *Flipper*).
pub const ANTENNA_TUNING_POLLER_A: [u8; 2] = [0x82, 0x82];
/// [`ANTENNA_TUNING`], two registers, of a poller with an ST25R3916B. (*RFAL*. The value depends on the board's
/// matching network, and this is ST's value for its expansion board.)
pub const ANTENNA_TUNING_POLLER_B: [u8; 2] = [0xC5, 0xE3];
/// [`ANTENNA_TUNING`], two registers, of a listener with an ST25R3916 (*RFAL*, *Delpy*).
pub const ANTENNA_TUNING_LISTENER_A: [u8; 2] = [0x00, 0xFF];
/// [`ANTENNA_TUNING`], two registers, of a listener with an ST25R3916B (*RFAL*).
pub const ANTENNA_TUNING_LISTENER_B: [u8; 2] = [0x00, 0x00];
/// A value of [`PASSIVE_TARGET_MODULATION`]: with high impedance the driver cannot modulate the poller's field.
pub const PASSIVE_TARGET_HIGH_Z: u8 = 0xFF;
/// [`B_AUXILIARY_MODULATION`]: no load modulation by the internal (lm_dri) or by an external (lm_ext) driver.
pub const NO_LOAD_MODULATION: u8 = 0x00;
/// [`PASSIVE_TARGET_MODULATION`] of an ST25R3916 that answers: high impedance while it does not modulate, step 5 while
/// it does. (*RFAL*; *Flipper* and older versions of *RFAL* use step 0, the lowest resistance, instead of step 5: 0F.)
pub const PASSIVE_TARGET_ANSWERS_A: u8 = 0x5F;
/// [`PASSIVE_TARGET_MODULATION`] of an ST25R3916B that answers: step 14, next to high impedance, while it does not
/// modulate, and step 2 while it does. (*RFAL*; *Delpy* has high impedance instead of step 14: 2F.)
pub const PASSIVE_TARGET_ANSWERS_B: u8 = 0x2E;
/// [`B_AUXILIARY_MODULATION`] of an ST25R3916 that answers: its own driver modulates (`lm_dri`), no external one
/// (`lm_ext`). (*RFAL*; *Flipper* sets `lm_ext` as well, which drives a pin that ST's boards do not use.)
pub const LOAD_MODULATION_BY_DRIVER_A: u8 = 0x10;
/// [`B_AUXILIARY_MODULATION`] of an ST25R3916B that answers: `lm_dri`, and `dis_reg_am` as for a poller, because that
/// bit depends on the board. `rgs_am` is clear. (*RFAL* clears it for listening; *TM*: clear in card mode.)
pub const LOAD_MODULATION_BY_DRIVER_B: u8 = 0x90;
/// [`FIELD_THRESHOLDS`], two registers. Peer detection, which a listener uses: upper threshold 105 mV, lower threshold
/// 75 mV (*RFAL*, *Flipper*, *Delpy*). Collision avoidance, which is not used: 205 mV and 150 mV (*RFAL*, from the data
/// sheet; the others have 105 mV and 75 mV). No source states the values after a reset; 00 00 is 75 mV for all.
pub const FIELD_THRESHOLDS_WITH_HYSTERESIS: [u8; 2] = [0x13, 0x02];
/// [`B_AUXILIARY_MODULATION`] of a poller with an ST25R3916: amplitude modulation by the regulator (`dis_reg_am` = 0,
/// `res_am` = 0), no load modulation. (*RFAL*, *Flipper*.)
pub const AM_BY_REGULATOR_A: u8 = 0x00;
/// [`B_AUXILIARY_MODULATION`] of a poller with an ST25R3916B: `rgs_am` for modulation by active wave shaping, and
/// `dis_reg_am` = 1, which belongs to `act_amsink` = 0 in [`IO_CONFIGURATION_2`] and a small capacitor at VDD_AM
/// (*TM*). (*RFAL*; *Delpy* has 94, with the driver's load modulation, `lm_dri`, which a poller does not need.)
pub const AM_BY_WAVE_SHAPING_B: u8 = 0x84;
/// [`B_WAVE_SHAPING`], two registers, for NFC-F. First: `vddrf_cont`, which must be 1 (*TM*), and `rgs_txonoff`.
/// Second: symmetric shape (`am_sym`, for ASK), weak sink, filter constant 8. (*RFAL*; *Delpy* has these for NFC-A, but
/// 18, for OOK, in the second.)
pub const WAVE_SHAPING_NFC_F: [u8; 2] = [WAVE_SHAPING_SUPPLY, 0x28];
/// The first register of [`B_WAVE_SHAPING`] alone: `vddrf_cont` and `rgs_txonoff`, which *RFAL* sets for every role.
pub const WAVE_SHAPING_SUPPLY: u8 = 0x09;
/// [`B_WAVE_SHAPING_TIMES`], four registers: `tmodsw1` = 1; 0; `tentx1` = 7, `tmods2` = 9; `tmodsw2` = 7. (*RFAL*
/// leaves the second register at its reset value; *Delpy* sets it to 0.)
pub const WAVE_SHAPING_TIMES_NFC_F: [u8; 4] = [0x01, 0x00, 0x79, 0x07];
/// [`B_DRIVER_NON_OVERLAP`]: the smallest non-overlap (`fa3_f`), which affects the efficiency. (*RFAL*, *Flipper*.)
pub const DRIVER_NON_OVERLAP_LEAST: u8 = 0x80;
/// [`TRANSMIT_DRIVER`] on the ST25R3916B: 12 % AM (am_mod = 4), lowest output resistance.
pub const TRANSMIT_DRIVER_12_PERCENT_B: u8 = 0x40;
/// [`TRANSMIT_DRIVER`] on the ST25R3916: 12 % AM (am_mod = 7, its reset value, *seen*). The ST25R3916B codes the depth
/// differently: its value 4 would be 9 % here.
pub const TRANSMIT_DRIVER_12_PERCENT_A: u8 = 0x70;
/// [`TEST_OVERHEAT`]: keeps the internal overheat protection of the ST25R3916 from switching off below the permitted
/// junction temperature. The power-on sequence requires it after each set default (*RFAL*, *Flipper*, *Guyot*,
/// *Delpy*).
pub const TEST_OVERHEAT_PROTECTION: u8 = 0x10;

/// Main interrupt: oscillator stable.
pub const IRQ_OSCILLATOR: u8 = 0x80;
/// Main interrupt: start of receive (the sync was detected).
pub const IRQ_RXS: u8 = 0x20;
/// Main interrupt: end of receive.
pub const IRQ_RXE: u8 = 0x10;
/// Main interrupt: end of transmission.
pub const IRQ_TXE: u8 = 0x08;
/// Timer and NFC interrupt: direct command ended.
pub const IRQ_DCT: u8 = 0x80;
/// Timer and NFC interrupt: the no-response timer has run out.
pub const IRQ_NRE: u8 = 0x40;
/// Timer and NFC interrupt: external field on.
pub const IRQ_EON: u8 = 0x10;
/// Timer and NFC interrupt: external field off.
pub const IRQ_EOF: u8 = 0x08;
/// Error interrupt: CRC.
pub const IRQ_CRC: u8 = 0x80;
/// Error interrupts: parity (0x40), soft framing (0x20), hard framing (0x10).
pub const IRQ_FRAMING: u8 = 0x70;

/// Interrupt masks of a poller, 0x16..=0x19: all but I_osc and I_txe (main), all but I_dct (timer), every error, every
/// target interrupt. They also mask the FIFO water level (I_wl), which a frame of more than 200 bytes raises.
pub const POLLER_MASKS: [u8; 4] = [0x77, 0x7F, 0xFF, IRQ_MASK_TARGET_ALL];
/// Interrupt masks of a poller that receives answers: all but I_osc, I_rxs, I_rxe and I_txe (main), all but I_dct and
/// I_nre (timer), every error, every target interrupt.
pub const EXCHANGE_MASKS: [u8; 4] = [0x47, 0x3F, 0xFF, IRQ_MASK_TARGET_ALL];
/// Interrupt masks of a listener that answers: [`LISTENER_MASKS`], but I_txe is not masked.
pub const ANSWERER_MASKS: [u8; 4] = [0xC7, 0xE7, 0x0F, IRQ_MASK_TARGET_ALL];
/// Interrupt masks of a listener: all but I_rxs and I_rxe (main), all but I_eon and I_eof (timer), no receive error,
/// every target interrupt.
pub const LISTENER_MASKS: [u8; 4] = [0xCF, 0xE7, 0x0F, IRQ_MASK_TARGET_ALL];
/// [`IRQ_MASK_TARGET`] as this driver sets it: every existing interrupt. The reserved bit 2 is 0, so that the register
/// reads back as written.
pub const IRQ_MASK_TARGET_ALL: u8 = 0xFB;

/// FIFO status 2: underflow.
pub const FIFO_UNDERFLOW: u8 = 0x20;
/// FIFO status 2: overflow.
pub const FIFO_OVERFLOW: u8 = 0x10;
/// FIFO status 2: the number of bits in an incomplete last byte, or its missing parity bit.
pub const FIFO_LAST_BITS: u8 = 0x0F;
/// The FIFO's size in bytes.
pub const FIFO_SIZE: u16 = 512;

/// Auxiliary display: the external field detector detects a field (`efd_o`).
pub const DISPLAY_FIELD: u8 = 0x40;
/// Auxiliary display: transmitter on.
pub const DISPLAY_TX_ON: u8 = 0x20;
/// Auxiliary display: oscillator stable (*seen*).
pub const DISPLAY_OSC_OK: u8 = 0x10;

/// The bits of the identity register without the revision.
pub const IDENTITY_TYPE: u8 = 0xF8;
/// The type of the ST25R3916 in the identity register (0x2A with its revision, *seen*).
pub const IDENTITY_A: u8 = 0x28;
/// The type of the ST25R3916B in the identity register (0x31 with its revision).
pub const IDENTITY_B: u8 = 0x30;
