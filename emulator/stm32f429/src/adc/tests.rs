//! Tests of conversions, sequences and triggers.

use super::*;
use crate::rig::Rig;

const CR1: u32 = 0x04;
const CR2: u32 = 0x08;
const DR: u32 = 0x4C;

#[test]
fn a_conversion_takes_its_sampling_time_and_a_cycle_for_each_bit() {
    let mut rig = Rig::new(Adc::new());
    rig.lines.microvolts = 1_650_000;
    rig.write(0x10, 1);
    rig.write(CR2, ADON);
    rig.write(CR2, ADON | SWSTART);
    // The conversion takes 15 + 12 cycles of PCLK2 / 2.
    rig.run(53);
    assert_eq!(rig.read(0), STRT);
    rig.run(54);
    assert_eq!(rig.read(0), STRT | EOC);
    assert_eq!(rig.read(DR), 2048);
    assert_eq!(rig.read(0), STRT);
}

#[test]
fn a_pin_that_the_dac_drives_reads_what_it_drives() {
    let mut rig = Rig::new(Adc::new());
    rig.pads.dac[0] = Some(825_000);
    rig.write(0x34, 4);
    rig.write(CR2, ADON);
    rig.write(CR2, ADON | SWSTART);
    rig.run(100);
    assert_eq!(rig.read(DR), 1024);
}

#[test]
fn a_scan_requests_dma_for_each_channel_and_overruns_without_it() {
    let mut rig = Rig::new(Adc::new());
    rig.write(CR1, SCAN);
    rig.write(0x2C, 1 << 20);
    rig.write(0x34, 1 << 5);
    rig.write(CR2, ADON | DMA);
    rig.write(CR2, ADON | DMA | SWSTART);
    rig.run(30);
    assert_eq!((rig.instance.dma(), rig.read(0) & EOC), (1, 0));
    rig.call(|adc, cx| adc.dma_served(0, 7, cx));
    rig.run(60);
    assert_eq!((rig.instance.dma(), rig.read(0) & EOC), (1, EOC));
    rig.write(CR2, ADON | DMA | SWSTART);
    rig.run(100);
    assert_eq!(rig.read(0) & OVR, OVR);
    assert_eq!(rig.instance.dma(), 0);
}

#[test]
fn a_converter_that_is_off_converts_nothing() {
    let mut rig = Rig::new(Adc::new());
    rig.write(CR2, SWSTART);
    rig.run(1000);
    assert_eq!(rig.read(0), 0);
    assert!(rig.found("off"));
}

#[test]
fn the_internal_reference_reads_what_the_factory_measured() {
    let mut rig = Rig::new(Adc::new());
    rig.write(0x34, 17);
    rig.write(CR2, ADON | SWSTART);
    rig.run(1000);
    assert_eq!(rig.read(DR), 0, "the channel is off without TSVREFE");
    rig.write(0x304, TSVREFE);
    rig.write(CR2, ADON | SWSTART);
    rig.run(2000);
    assert_eq!(rig.read(DR), u32::from(CALIBRATION[0]));
}

#[test]
fn a_timer_starts_a_conversion_where_it_is_selected() {
    let mut rig = Rig::new(Adc::new());
    // EXTSEL 8 selects a rising edge of TIM3_TRGO.
    rig.write(CR2, ADON | 8 << 24 | 1 << 28);
    rig.call(|adc, cx| adc.trigger(Trigger::Trgo(2), cx));
    rig.run(100);
    assert_eq!(rig.read(0), 0);
    rig.call(|adc, cx| adc.trigger(Trigger::Trgo(3), cx));
    rig.run(200);
    assert_eq!(rig.read(0), STRT | EOC);
}
