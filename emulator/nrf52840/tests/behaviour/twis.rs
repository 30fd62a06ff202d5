//! Tests of TWIS with a controller.
use crate::rig::*;
use emulator_part::{I2cEvent, Pin};

/// A part with TWIS0 at 0x1A and 0x1B on P0.14 and P0.16, with 2 bytes of buffer in each direction.
fn with_target() -> Rig {
    let mut rig = Rig::new();
    rig.write_all(&[(p0_cnf(14), INPUT), (p0_cnf(16), INPUT), (SPIM0 + 0x508, 14), (SPIM0 + 0x50C, 16)]);
    rig.write_all(&[(SPIM0 + 0x588, 0x1A), (SPIM0 + 0x58C, 0x1B), (SPIM0 + 0x594, 3), (SPIM0 + 0x5C0, 0x5A)]);
    rig.write_all(&[(SPIM0 + 0x534, RX), (SPIM0 + 0x538, 2), (SPIM0 + 0x544, TX), (SPIM0 + 0x548, 2)]);
    rig.fill(TX, &[7, 8]);
    rig.write(SPIM0 + 0x500, 9);
    rig
}

fn bus(rig: &mut Rig, event: I2cEvent) -> Option<(bool, u8)> {
    rig.run_for(90 * US);
    let answer = rig.part.two_wire(rig.now, Pin::new(0, 14), Pin::new(0, 16), event, &mut rig.world);
    answer.map(|answer| (answer.acknowledged, answer.data))
}

#[test]
fn an_addressed_target_holds_scl_until_it_has_a_buffer() {
    use I2cEvent::{Read, Start, Stop, Write};
    const NOBODY: Option<(bool, u8)> = Some((false, 0xFF));
    const YES: Option<(bool, u8)> = Some((true, 0xFF));
    let mut rig = with_target();
    assert_eq!(bus(&mut rig, Start(0x19 << 1)), NOBODY);
    assert_eq!(bus(&mut rig, Start(0x1B << 1)), YES);
    assert_eq!((rig.read(SPIM0 + 0x4D4), rig.read(SPIM0 + 0x164), rig.read(SPIM0 + 0x14C)), (1, 1, 0));
    assert_eq!(bus(&mut rig, Write(0x11)), None, "no buffer");
    rig.write(SPIM0 + 0x30, 1);
    assert_eq!(rig.read(SPIM0 + 0x14C), 1, "RXSTARTED");
    assert_eq!([0x11, 0x22].map(|byte| bus(&mut rig, Write(byte))), [YES, YES]);
    assert_eq!(rig.read(SPIM0 + 0x124), 0);
    assert_eq!(bus(&mut rig, Write(0x33)), NOBODY, "RXD is full");
    assert_eq!((rig.read(SPIM0 + 0x124), rig.read(SPIM0 + 0x4D0)), (1, 0b101), "ERROR: OVERFLOW, DNACK");
    // The transfer has a repeated start, and SHORTS has READ_SUSPEND.
    rig.write(SPIM0 + 0x4D0, 0b101);
    rig.write_all(&[(SPIM0 + 0x200, 1 << 14), (SPIM0 + 0x34, 1)]);
    assert_eq!(bus(&mut rig, Start(0x1A << 1 | 1)), YES);
    assert_eq!(rig.memory(RX, 3), [0x11, 0x22, 0]);
    assert_eq!(rig.read(SPIM0 + 0x53C), 2, "RXD.AMOUNT");
    assert_eq!((rig.read(SPIM0 + 0x168), rig.read(SPIM0 + 0x150), rig.read(SPIM0 + 0x104)), (1, 0, 0));
    assert_eq!(bus(&mut rig, Read(true)), None, "suspended");
    rig.write(SPIM0 + 0x20, 1);
    assert_eq!(rig.read(SPIM0 + 0x150), 1, "TXSTARTED");
    assert_eq!([7, 8, 0x5A].map(|_| bus(&mut rig, Read(true))), [7, 8, 0x5A].map(|byte| Some((true, byte))));
    assert_eq!(rig.read(SPIM0 + 0x4D0), 0b1000, "OVERREAD");
    assert_eq!(bus(&mut rig, Stop), NOBODY);
    assert_eq!((rig.read(SPIM0 + 0x54C), rig.read(SPIM0 + 0x104)), (2, 1), "TXD.AMOUNT, STOPPED");
    rig.assert_clean();
}
