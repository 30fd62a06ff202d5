//! The differences between two boards that carry the chip, and choices that the documents leave open.

/// The chip's variant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// ST25R3916 (DS12484): identity 0x2A, capacitive sensor, no RC calibration.
    St25r3916,
    /// ST25R3916B (DS13541): identity 0x31, active wave shaping with RC calibration (EA).
    St25r3916b,
}

/// The effect of a received frame that breaks off, because its length byte announces too many bytes or because the
/// field is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BrokenFrame {
    /// I_rxe comes with I_err1 (and I_crc unless no_crc_rx is set), because the framing logic detects the missing bits.
    EndsWithError,
    /// I_rxe never comes, and the receiver hangs until D1, as several drivers report of real chips.
    NeverEnds,
}

/// The configuration of a chip and its surroundings. The default is an ST25R3916B on a 5 V supply with a perfect
/// crystal.
///
/// There are three sorts of values. Some describe the chip and its board, some choose between documents that contradict
/// each other, and some are latencies or converter results that no document gives. Defaults of the last sort were
/// measured on one ST25R3916 at 5.2 V, unless the field says "assumed".
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The variant of the part.
    pub variant: Variant,
    /// Supply voltage, mV, in the chip's range of 2400 to 5500. Another value is a finding when the chip is used. The
    /// voltage determines the result of Measure power supply (DF) and the suitable setting of sup3V.
    pub vdd_mv: u16,
    /// Error of the 27.12 MHz crystal, parts per billion, clamped to ±1 000 000; positive values are fast.
    pub crystal_ppb: i64,
    /// Time from `en` to a stable oscillator, ns (data sheet: typically 0.7 ms).
    pub oscillator_startup_ns: u64,

    /// Whether DB (clear FIFO) also clears the interrupt registers. The data sheet contradicts itself about this.
    pub db_clears_irqs: bool,
    /// Whether C2 (stop) clears the interrupt registers, as a recording of silicon suggests.
    pub stop_clears_irqs: bool,
    /// Whether the end of a transmission raises I_txe while the receiver is off. The data sheet implies that it does.
    pub txe_with_rx_off: bool,
    /// Whether a target must be unmasked (D1) before each frame. This is the cautious choice.
    pub target_rearms_by_command: bool,
    /// The effect of a received frame that breaks off.
    pub broken_frame: BrokenFrame,
    /// Whether a frame is received although the receive chain (registers 0B to 0E, B0C, B0D) is unsuitable for its
    /// technology. The unsuitable setting is a finding in either case.
    pub unsuited_chain_receives: bool,

    /// Whether a frame reaches the other chip although the sender's settings cannot modulate NFC-F or its antenna is
    /// out of tune. The unsuitable setting is a finding in any case. If this field is false, only the carrier leaves
    /// the antenna, and an antenna out of tune receives nothing either.
    pub unsuited_modulation_reaches: bool,
    /// The antenna tuning (registers 26, 27) that suits the board's matching network: first of a poller, then of a
    /// listener.
    pub tuning: [[u8; 2]; 2],
    /// The largest deviation, in steps, from the suitable tuning at which the antenna still counts as tuned. Assumed.
    pub tuning_tolerance: u8,
    /// The voltage of another chip's field at the field detector's input, mV. Assumed for a few centimetres.
    pub field_mv: u16,

    /// Whether the chip is permitted to answer. If false, each answer is a finding.
    pub answers: bool,
    /// Whether the end of a poller's transmission unmasks a receiver that D0 has masked. No document says so. ST's
    /// library always stops the chip (C2) between D0 and a transmission, so it does not depend on this.
    pub transmit_unmasks: bool,
    /// Whether D1 also clears the FIFO, as ST's library says (stm32duino/ST25R3916 `src/rfal_rfst25r3916.cpp`).
    pub unmask_clears_fifo: bool,

    /// Seed of the random scatter of the start of transmission.
    pub seed: u64,
    /// Mean time from the end of the command byte to the start of the frame on the air, ns. Measured on one chip: seven
    /// NFC-A frames start 2.71 to 4.59 µs after the last clock edge of C4 to C7. The default is the middle of this
    /// range. It is also used for NFC-F and for answers.
    pub transmit_latency_ns: u64,
    /// Scatter of the start of transmission around its mean, peak to peak, uniform, ns; limited to twice the mean.
    /// Measured on one chip: after the same command, frames start up to 2.1 µs apart (NFC-A 1.9 µs in seven frames,
    /// NFC-V 2.1 µs in two, NFC-B 0.4 µs in two). The default of 2.3 µs is a bit at 424 kbit/s and covers these.
    pub transmit_scatter_ns: u64,
    /// Time from the first rising clock edge of an interrupt register's byte to the fall of the IRQ pin, ns. Measured
    /// on one chip: 30 to 32 ns.
    pub irq_fall_ns: u64,
    /// Time from the field's switch-on to I_apon, ns. Measured on one chip: 2.70 to 2.71 µs in three recordings.
    pub field_on_latency_ns: u64,
    /// Time by which I_cat comes later than the field-on guard time, ns. Measured on one chip.
    pub guard_extra_ns: u64,
    /// Time by which the no-response timer takes longer than its setting, ns. Measured on one chip.
    pub no_response_extra_ns: u64,
    /// Time from the end of an NFC-A answer's start of communication to I_rxs, ns. Measured on one chip.
    pub nfc_a_start_latency_ns: u64,
    /// Latency of an NFC-A answer's byte until it is in the FIFO, and of its end until I_rxe, ns. Measured on one chip.
    pub nfc_a_latency_ns: u64,
    /// Latency of an NFC-F frame's sync until I_rxs, of a byte until it is in the FIFO, and of the end until I_rxe, ns.
    /// Assumed: two bits at 424 kbit/s.
    pub nfc_f_latency_ns: u64,
    /// Time from a change of the external field to the change of the field detector's output, ns. Assumed.
    pub field_detect_ns: u64,

    /// Duration of Adjust regulators (D6), ns. Assumed: 3 ms (data sheet: at most 5 ms).
    pub adjust_regulators_ns: u64,
    /// Duration of the RC calibration (EA), ns. Assumed: 1 ms.
    pub rc_calibration_ns: u64,
    /// Duration of the measurement commands D3, D8, D9 and DF, ns (data sheet: 25 µs).
    pub measurement_ns: u64,
    /// Value of the regulator display (register B2C) after Adjust regulators (D6). Measured on one chip.
    pub regulator_display: u8,
    /// Value of the TX driver timing display (register B2B). Measured on one chip.
    pub driver_timing_display: u8,
    /// Value of the RC calibration display (register B39) after an RC calibration (EA). Measured on one chip.
    pub rc_calibration_display: u8,
    /// Constant result of Measure amplitude (D3), A/D steps. Measured on one chip. A use of the command is a finding.
    pub amplitude: u8,
    /// Constant result of Measure phase (D9), A/D steps. Measured on one chip. A use of the command is a finding.
    pub phase: u8,
    /// Results of Measure power supply (DF) for VDD_A, VDD_D, VDD_RF and VDD_AM, mV. Measured on one chip.
    pub regulated_mv: [u16; 4],
}

/// The antenna tuning (registers 26, 27) for the matching networks on ST's expansion boards: first of a poller, then of
/// a listener (stm32duino/ST25R3916 `src/rfal_rfst25r3916_analogConfigTbl.h`). `TUNING_B` is for the board with the
/// ST25R3916B, `TUNING_A` for the board with the ST25R3916.
const TUNING_B: [[u8; 2]; 2] = [[0xC5, 0xE3], [0x00, 0x00]];
const TUNING_A: [[u8; 2]; 2] = [[0x82, 0x82], [0x00, 0xFF]];

impl Config {
    /// Returns the configuration of an ST25R3916 on its own expansion board.
    #[must_use]
    pub fn st25r3916() -> Self {
        Self { variant: Variant::St25r3916, tuning: TUNING_A, ..Self::default() }
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            variant: Variant::St25r3916b,
            vdd_mv: 5000,
            crystal_ppb: 0,
            oscillator_startup_ns: 700_000,
            db_clears_irqs: true,
            stop_clears_irqs: true,
            txe_with_rx_off: true,
            target_rearms_by_command: true,
            broken_frame: BrokenFrame::EndsWithError,
            unsuited_chain_receives: true,
            unsuited_modulation_reaches: true,
            tuning: TUNING_B,
            tuning_tolerance: 0x20,
            field_mv: 350,
            answers: false,
            transmit_unmasks: false,
            unmask_clears_fifo: false,
            seed: 0,
            transmit_latency_ns: 3_650,
            transmit_scatter_ns: 2_300,
            irq_fall_ns: 31,
            field_on_latency_ns: 2_710,
            guard_extra_ns: 420,
            no_response_extra_ns: 2_300,
            nfc_a_start_latency_ns: 48_900,
            nfc_a_latency_ns: 17_630,
            nfc_f_latency_ns: 4_720,
            field_detect_ns: 10_000,
            adjust_regulators_ns: 3_000_000,
            rc_calibration_ns: 1_000_000,
            measurement_ns: 25_000,
            regulator_display: 0xE0,
            driver_timing_display: 0x04,
            rc_calibration_display: 0x80,
            amplitude: 0x80,
            phase: 0x80,
            regulated_mv: [3_000, 3_000, 3_000, 2_700],
        }
    }
}
