//! Tests of SAADC, COMP, PWM, QDEC, ECB, TWIM, the stalling of the core by NVMC, and the cost of accesses.
use crate::rig::*;
use cortex_m4::{Access, Bound, Purpose, Signals, Width};
use emulator_part::{FindingKind, I2cEvent, Part, Pin};

fn halves(rig: &Rig, address: u32, n: usize) -> Vec<i16> {
    rig.memory(address, 2 * n).chunks(2).map(|half| i16::from_le_bytes([half[0], half[1]])).collect()
}

#[test]
fn the_converter_reads_its_inputs_by_gain_reference_and_resolution() {
    let mut rig = Rig::new();
    rig.world.microvolts.insert(Pin::new(0, 2), 900_000);
    rig.world.microvolts.insert(Pin::new(0, 3), 1_200_000);
    rig.write_all(&[
        (SAADC + 0x5F0, 2),                  // 12 bits
        (SAADC + 0x510, 1),                  // AIN0, 1/6 of 0.6 V: 3.6 V full scale
        (SAADC + 0x520, 1),                  // AIN0 - AIN1, differential
        (SAADC + 0x524, 2),                  //
        (SAADC + 0x528, 0x2_0000 | 1 << 20), //
        (SAADC + 0x530, 9),                  // VDD against a quarter of it, gain 1/4: full scale
        (SAADC + 0x538, 0x2_0000 | 1 << 12 | 2 << 8),
        (SAADC + 0x51C, 1_000 << 16 | 0x8000), // limit of channel 0
        (SAADC + 0x500, 1),
        (SAADC + 0x62C, RX),
        (SAADC + 0x630, 3),
        (SAADC, 1),
        (SAADC + 0x04, 1),
    ]);
    assert_eq!(rig.run_until_set(SAADC + 0x104, MS), 36 * US, "three channels of 10 us + 2 us");
    assert_eq!(halves(&rig, RX, 3), [1_024, -171, 4_095]);
    assert_eq!(rig.read(SAADC + 0x634), 3);
    assert_eq!((rig.read(SAADC + 0x118), rig.read(SAADC + 0x11C)), (1, 0), "above its limit");
    rig.assert_clean();
}

#[test]
fn a_sample_without_start_is_reported() {
    let mut rig = Rig::new();
    rig.write_all(&[(SAADC + 0x500, 1), (SAADC + 0x510, 1), (SAADC + 0x04, 1)]);
    rig.run_to(MS);
    assert_eq!(rig.read(SAADC + 0x10C), 0);
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 1);
}

#[test]
fn a_comparator_says_when_its_input_crosses_its_threshold() {
    let mut rig = Rig::new();
    rig.write_all(&[(COMP + 0x500, 1), (COMP + 0x504, 2), (COMP + 0x508, 3), (COMP, 1)]); // half of 3 V
    rig.run_until_set(COMP + 0x100, MS);
    rig.world.microvolts.insert(Pin::new(0, 4), 1_600_000);
    rig.run_for(20 * US);
    rig.write(COMP + 0x08, 1);
    assert_eq!((rig.read(COMP + 0x108), rig.read(COMP + 0x104), rig.read(COMP + 0x400)), (1, 0, 1));
    rig.world.microvolts.insert(Pin::new(0, 4), 1_400_000);
    rig.run_for(20 * US);
    assert_eq!(rig.read(COMP + 0x104), 1);
    rig.assert_clean();
}

#[test]
fn a_pwm_plays_a_sequence_from_ram_on_its_pin() {
    let mut rig = Rig::new();
    rig.fill(TX, &[4, 0, 6, 0x80]); // rising at 4, then falling at 6
    rig.write_all(&[
        (p0_cnf(13), OUTPUT),
        (PWM0 + 0x560, psel(0, 13)),
        (PWM0 + 0x508, 16),
        (PWM0 + 0x520, TX),
        (PWM0 + 0x524, 2),
        (PWM0 + 0x528, 0),
        (PWM0 + 0x200, 1), // SEQEND0_STOP
        (PWM0 + 0x500, 1),
    ]);
    rig.world.pins.clear();
    rig.write(PWM0 + 0x08, 1);
    rig.run_to(10 * US);
    let edges: Vec<_> = rig.world.pins.iter().map(|&(at, _, pad)| (at, pad.level())).collect();
    // A period has 16 counts of 4 cycles. The pin is high from cycle 16 to 64, and in the next period from 64 to 64 +
    // 24.
    assert_eq!(edges, [(16, true), (88, false)]);
    assert_eq!((rig.read(PWM0 + 0x110), rig.read(PWM0 + 0x104)), (1, 1), "SEQEND, STOPPED");
    assert_eq!(rig.deadline(), u64::MAX);
    rig.assert_clean();
}

#[test]
fn a_pwm_whose_pin_is_no_output_drives_nothing() {
    let mut rig = Rig::new();
    rig.write_all(&[(PWM0 + 0x560, psel(0, 13)), (PWM0 + 0x520, TX), (PWM0 + 0x524, 1), (PWM0 + 0x500, 1)]);
    rig.world.pins.clear();
    rig.write(PWM0 + 0x08, 1);
    rig.run_to(MS);
    assert_eq!(rig.world.pins, []);
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 1);
}

#[test]
fn a_quadrature_decoder_counts_both_ways_and_double_steps() {
    let mut rig = Rig::new();
    let (a, b) = (Pin::new(0, 20), Pin::new(0, 21));
    rig.write_all(&[
        (p0_cnf(20), INPUT),
        (p0_cnf(21), INPUT),
        (QDEC + 0x520, 20),
        (QDEC + 0x524, 21),
        (QDEC + 0x500, 1),
        (QDEC, 1),
    ]);
    for (level_a, level_b, acc) in [(true, false, 1), (true, true, 2), (false, true, 3), (true, true, 2)] {
        rig.drive(a, level_a);
        rig.drive(b, level_b);
        rig.run_for(128 * US);
        assert_eq!(rig.read(QDEC + 0x514), acc);
    }
    rig.drive(a, false);
    rig.drive(b, false);
    rig.run_for(128 * US);
    assert_eq!(rig.read(QDEC + 0x544), 1, "both at once is a double transition");
    rig.run_for(5 * 128 * US);
    assert_eq!((rig.read(QDEC + 0x104), rig.read(QDEC + 0x10C)), (1, 1), "REPORTRDY, DBLRDY after ten samples");
    rig.assert_clean();
}

#[test]
fn a_block_is_encrypted_in_ram() {
    let mut rig = Rig::new();
    let key: Vec<u8> = (0..16).collect();
    let clear: Vec<u8> = (0..16).map(|n| n * 0x11).collect();
    rig.fill(TX, &[key, clear].concat());
    rig.write_all(&[(ECB + 0x504, TX), (ECB, 1)]);
    rig.run_until_set(ECB + 0x100, MS);
    assert_eq!(rig.memory(TX + 32, 4), [0x69, 0xC4, 0xE0, 0xD8]);
    rig.assert_clean();
}

/// A part with TWIM0 at 400 kbit/s on P0.26 and P0.27.
fn with_twim() -> Rig {
    let mut rig = Rig::new();
    rig.write_all(&[
        (p0_cnf(26), 6 << 8),
        (p0_cnf(27), 6 << 8),
        (SPIM0 + 0x508, 27),
        (SPIM0 + 0x50C, 26),
        (SPIM0 + 0x524, 0x0640_0000),
        (SPIM0 + 0x588, 0x42),
        (SPIM0 + 0x500, 6),
        (SPIM0 + 0x544, TX),
        (SPIM0 + 0x548, 2),
        (SPIM0 + 0x534, RX),
        (SPIM0 + 0x538, 2),
    ]);
    rig
}

#[test]
fn a_two_wire_controller_writes_then_reads_then_stops() {
    let mut rig = with_twim();
    rig.world.address = Some(0x42);
    rig.fill(TX, &[0x10, 0x20]);
    rig.write_all(&[(SPIM0 + 0x200, 1 << 7 | 1 << 12), (SPIM0 + 0x08, 1)]);
    rig.run_until_set(SPIM0 + 0x104, MS);
    let bus: Vec<_> = rig.world.bus.iter().map(|&(_, event)| event).collect();
    let wanted = [
        I2cEvent::Start(0x84),
        I2cEvent::Write(0x10),
        I2cEvent::Write(0x20),
        I2cEvent::Start(0x85),
        I2cEvent::Read(true),
        I2cEvent::Read(false),
        I2cEvent::Stop,
    ];
    assert_eq!(bus, wanted);
    assert_eq!(rig.memory(RX, 2), [5, 6]);
    assert_eq!((rig.read(SPIM0 + 0x54C), rig.read(SPIM0 + 0x53C)), (2, 2));
    assert_eq!(rig.read(SPIM0 + 0x124), 0);
    rig.assert_clean();
}

#[test]
fn a_two_wire_controller_that_nobody_acknowledges_says_so() {
    let mut rig = with_twim();
    rig.write_all(&[(SPIM0 + 0x08, 1)]);
    rig.run_until_set(SPIM0 + 0x124, MS);
    assert_eq!(rig.read(SPIM0 + 0x4C4), 1 << 1, "ANACK");
    rig.write(SPIM0 + 0x14, 1);
    rig.run_until_set(SPIM0 + 0x104, MS);
    rig.assert_clean();
}

#[test]
fn flash_that_works_holds_a_core_that_executes_from_it() {
    let mut rig = Rig::new();
    *rig.part.signals() = Signals::default();
    rig.write_all(&[(NVMC + 0x504, 2), (NVMC + 0x508, 0x8000)]);
    assert_eq!(rig.part.signals().stalled_until(), 85 * MS);
    assert!(rig.part.signals().forgets_code());
    let mut rig = Rig::new();
    rig.write(NVMC + 0x504, 2);
    let from_ram = Access {
        address: NVMC + 0x508,
        width: Width::Word,
        purpose: Purpose::Data,
        privileged: true,
        cycle: 0,
        pc: RAM,
    };
    assert!(rig.part.write(&from_ram, 0x8000, &mut rig.world).is_ok());
    assert_eq!(rig.part.signals().stalled_until(), 0, "code in RAM runs on");
}

#[test]
fn code_can_be_fetched_from_flash_and_from_the_ram_alias() {
    let mut rig = Rig::new();
    rig.fill(0x100, &[0x34, 0x12]);
    rig.write(RAM + 8, 0xBF00_BF00);
    assert_eq!(rig.part.fetch(0x100), Ok(0x1234));
    assert_eq!(rig.part.fetch(0x0080_0008), Ok(0xBF00));
    assert_eq!(rig.read(0x0080_0008), 0xBF00_BF00);
    assert!(rig.part.fetch(POWER).is_err());
    assert!(rig.part.is_constant(0x100) && !rig.part.is_constant(RAM));
}

#[test]
fn wait_states_depend_on_the_cache_and_on_who_else_moves_data() {
    let mut rig = Rig::new();
    let access =
        |address| Access { address, width: Width::Word, purpose: Purpose::Data, privileged: true, cycle: 0, pc: 0 };
    let waits = |rig: &mut Rig, address, bound| rig.part.wait_states(&access(address), bound);
    assert_eq!(waits(&mut rig, 0, Bound::Worst), 2);
    assert_eq!((waits(&mut rig, 0, Bound::Best), waits(&mut rig, RAM, Bound::Worst)), (0, 0));
    rig.write_all(&[(NVMC + 0x540, 1), (SPIM0 + 0x500, 7), (SPIM0 + 0x548, 4), (SPIM0 + 0x10, 1)]);
    assert_eq!((waits(&mut rig, 0, Bound::Worst), waits(&mut rig, RAM, Bound::Worst)), (3, 0));
    assert_eq!(waits(&mut rig, RAM, Bound::Best), 0);
}

#[test]
fn the_short_way_to_wait_states_tells_what_the_long_way_tells() {
    let mut rig = Rig::new();
    let settings = [(NVMC + 0x540, 1), (SPIM0 + 0x500, 7), (SPIM0 + 0x544, RAM), (SPIM0 + 0x548, 100)];
    rig.write_all(&settings);
    rig.write(SPIM0 + 0x10, 1);
    rig.run_to(10 * US);
    let (mut long, mut short, mut contended) = (rig.part.clone(), rig.part, 0);
    for cycle in 0..200 {
        for (address, bound) in [0x400, RAM, RAM + 0x2_0000, 0x0080_0000]
            .into_iter()
            .flat_map(|address| [(address, Bound::Best), (address, Bound::Worst)])
        {
            let (width, purpose) = (Width::Word, Purpose::Data);
            let waits = long.wait_states(&Access { address, width, purpose, privileged: true, cycle, pc: 0 }, bound);
            assert_eq!(short.memory_waits(address, false, cycle, bound), Some(waits), "{address:#x}, cycle {cycle}");
            contended += u32::from(address == RAM && waits == 1);
        }
    }
    assert!(contended > 3, "{contended}");
    assert_eq!(short.memory_waits(SPIM0, false, 0, Bound::Worst), None);
}

#[test]
fn a_clone_runs_on_as_the_original_does() {
    let mut rig = with_twim();
    rig.write_all(&[(SPIM0 + 0x08, 1), (RNG, 1)]);
    rig.run_to(20 * US);
    let mut copy = rig.clone();
    rig.run_to(MS);
    copy.run_to(MS);
    assert_eq!((rig.world.bus.clone(), rig.read(RNG + 0x508)), (copy.world.bus.clone(), copy.read(RNG + 0x508)));
}

#[test]
fn a_watchdog_that_pauses_in_sleep_counts_only_while_awake() {
    for (config, resets) in [(0, 0), (1, 1)] {
        let mut rig = Rig::new();
        rig.write_all(&[(WDT + 0x504, 32_767), (WDT + 0x50C, config), (WDT, 1)]);
        rig.run_to(100 * MS);
        rig.part.sleeps(rig.now, true, false, &mut rig.world);
        rig.run_to(1_500 * MS);
        assert_eq!(rig.restarts(), resets, "CONFIG {config}");
        rig.part.sleeps(rig.now, false, false, &mut rig.world);
        rig.run_to(2_399 * MS);
        assert_eq!(rig.part.watchdog_resets().len(), resets as usize);
        rig.run_to(2_401 * MS);
        assert_eq!(rig.part.watchdog_resets().len(), 1, "CONFIG {config}");
    }
}

#[test]
fn a_comparators_hysteresis_is_half_above_and_half_below_its_threshold() {
    // Each row has ENABLE, MODE, REFSEL and half the hysteresis, around 1.5 V. LPCOMP compares with half of 3 V, and
    // COMP with AIN3.
    for (enable, mode, select, half) in [(1, 0, 3, 25_000), (2, 1 << 8, 5, 15_000)] {
        let mut rig = Rig::new();
        let (input, reference) = (Pin::new(0, 4), Pin::new(0, 5));
        rig.world.microvolts.insert(reference, 1_500_000);
        rig.write_all(&[(COMP + 0x500, enable), (COMP + 0x504, 2), (COMP + 0x508, select), (COMP + 0x50C, 3)]);
        rig.write_all(&[(COMP + 0x534, mode), (COMP + 0x538, 1), (COMP, 1)]);
        rig.run_until_set(COMP + 0x100, MS);
        for (around, above) in [(half - 1_000, 0), (half + 1_000, 1), (1_000 - half, 1), (-half - 1_000, 0)] {
            rig.world.microvolts.insert(input, 1_500_000 + around);
            rig.run_for(20 * US);
            rig.write(COMP + 0x08, 1);
            assert_eq!(rig.read(COMP + 0x400), above, "{enable} {around}");
        }
        rig.assert_clean();
    }
}

/// The first packet of an encrypted connection in the sample data (Bluetooth Core Specification, volume 6, part C,
/// 1.2).
#[test]
fn the_sample_packet_of_the_bluetooth_specification_is_encrypted_and_decrypted() {
    const CCM: u32 = 0x4000_F000;
    const CONFIG: u32 = RAM + 0x300;
    const CLEAR: [u8; 4] = [0x0F, 1, 0, 0x06];
    const SENT: [u8; 8] = [0x0F, 5, 0, 0x9F, 0xCD, 0xA7, 0xF4, 0x48];
    let mut rig = Rig::new();
    rig.fill(CONFIG, &0x99AD_1B52_26A3_7E3E_058E_3B8E_27C2_C666_u128.to_be_bytes());
    rig.fill(CONFIG + 24, &[1, 0x24, 0xAB, 0xDC, 0xBA, 0xBE, 0xBA, 0xAF, 0xDE]);
    rig.write_all(&[(CCM + 0x500, 2), (CCM + 0x508, CONFIG), (CCM + 0x50C, TX), (CCM + 0x510, RX), (CCM + 0x200, 1)]);
    for (mode, input, output, status) in [(0, &CLEAR[..], &SENT[..], 0), (1, &SENT[..], &CLEAR[..], 1)] {
        rig.fill(TX, input);
        rig.write_all(&[(CCM + 0x504, mode), (CCM + 0x104, 0), (CCM, 1)]);
        assert!(rig.run_until_set(CCM + 0x104, MS) >= 50 * US);
        assert_eq!(rig.memory(RX, output.len()), output);
        assert_eq!(rig.read(CCM + 0x400), status);
    }
    rig.fill(TX + 4, &[0xCC]);
    rig.write_all(&[(CCM + 0x104, 0), (CCM, 1)]);
    rig.run_until_set(CCM + 0x104, MS);
    assert_eq!(rig.read(CCM + 0x400), 0, "a MIC that does not fit");
    rig.assert_clean();
}
