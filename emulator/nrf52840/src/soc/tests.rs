//! Compares every register with its table.

use super::*;
use emulator_part::Open;

#[test]
fn every_register_modelled_reads_its_reset_value_first() {
    // These registers are not compared. Some belong to instances without a model. The reset values of the others cannot
    // be read by any core, since HFCLK and flash are ready while a core runs.
    const OTHERS: [&str; 9] = ["HFCLKSTAT", "READYNEXT", "SPI.", "TWI.", "TWIS.", "ACL.", "IHIT", "IMISS", "UNUSED"];
    let mut soc = Soc::new(Settings::default());
    let (mut checked, mut others) = (0, vec![]);
    for block in BLOCKS.iter().filter(|block| block.modelled) {
        for register in block.registers {
            if OTHERS.iter().any(|other| register.name.contains(other)) {
                continue;
            }
            let address = address_of(block.id) + register.offset;
            let (width, purpose) = (Width::Word, Purpose::Data);
            let access = Access { address, width, purpose, privileged: true, cycle: 0, pc: 0 };
            let reads = soc.read(&access, &mut Open).expect("a register");
            if reads != register.reset {
                let (block, name, reset) = (block.name, register.name, register.reset);
                others.push(format!("{block}.{name} reads {reads:#x}, not {reset:#x}"));
            }
            checked += 1;
        }
    }
    assert!(others.is_empty(), "{others:#?}");
    assert!(checked > 800, "{checked} registers");
    // In the device description RTC0 has a fourth compare register. In the part only RTC1 and RTC2 have it.
    let unmodelled: Vec<_> = soc.out.findings.iter().map(|found| (found.place, &*found.text)).collect();
    assert_eq!(unmodelled, [("RTC0", "CC[3] 0x54c")]);
}
