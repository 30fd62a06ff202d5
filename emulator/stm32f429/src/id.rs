//! Numbers for everything in the part that has registers, and the address map of RM0090 table 1.

use crate::rcc::Gate;

/// The first number of each kind of peripheral that schedules events.
pub(crate) const SPI: u8 = 0;
pub(crate) const USART: u8 = 6;
pub(crate) const I2C: u8 = 14;
pub(crate) const TIM: u8 = 17;
pub(crate) const RTC: u8 = 31;
pub(crate) const RNG: u8 = 32;
pub(crate) const ADC: u8 = 33;
pub(crate) const CRC: u8 = 34;
pub(crate) const CAN1: u8 = 35;
/// The number of [`crate::cx::Peripheral`]s. They have the numbers below this one.
pub(crate) const INSTANCES: u8 = 36;
pub(crate) const IWDG: u8 = 36;
pub(crate) const WWDG: u8 = 37;
pub(crate) const RCC: u8 = 38;
pub(crate) const FLASH: u8 = 39;
pub(crate) const DMA1: u8 = 40;
pub(crate) const DMA2: u8 = 41;
/// The number of entries in the event queue. They have the numbers below this one.
pub(crate) const SCHEDULED: usize = 42;
pub(crate) const PWR: u8 = 42;
pub(crate) const SYSCFG: u8 = 43;
pub(crate) const EXTI: u8 = 44;
pub(crate) const GPIO: u8 = 45;
pub(crate) const BKPSRAM: u8 = 56;
/// The first number of the peripherals without a model.
pub(crate) const STUBS: u8 = 57;
/// The number of the DAC, which schedules no event.
pub(crate) const DAC: u8 = STUBS + 3;
pub(crate) const COUNT: usize = 70;
/// The number that stands for an address at which the part has nothing.
pub(crate) const NOTHING: u8 = 255;

#[rustfmt::skip]
pub(crate) static NAMES: [&str; COUNT] = [
    "SPI1", "SPI2", "SPI3", "SPI4", "SPI5", "SPI6",
    "USART1", "USART2", "USART3", "UART4", "UART5", "USART6", "UART7", "UART8",
    "I2C1", "I2C2", "I2C3",
    "TIM1", "TIM2", "TIM3", "TIM4", "TIM5", "TIM6", "TIM7", "TIM8", "TIM9", "TIM10", "TIM11", "TIM12", "TIM13", "TIM14",
    "RTC", "RNG", "ADC", "CRC", "CAN1", "IWDG", "WWDG", "RCC", "FLASH", "DMA1", "DMA2", "PWR", "SYSCFG", "EXTI",
    "GPIOA", "GPIOB", "GPIOC", "GPIOD", "GPIOE", "GPIOF", "GPIOG", "GPIOH", "GPIOI", "GPIOJ", "GPIOK",
    "BKPSRAM",
    "I2S2ext", "I2S3ext", "CAN2", "DAC", "SDIO", "SAI1", "LTDC", "ETH", "DMA2D", "OTG_HS", "OTG_FS", "DCMI",
    "FMC",
];

/// The clock gates in RCC, by number. Bus 255 means no gate.
#[rustfmt::skip]
pub(crate) static GATES: [Gate; COUNT] = {
    const fn a1(bit: u8) -> Gate { Gate { bus: 0, bit } }
    const fn a2(bit: u8) -> Gate { Gate { bus: 1, bit } }
    const fn p1(bit: u8) -> Gate { Gate { bus: 3, bit } }
    const fn p2(bit: u8) -> Gate { Gate { bus: 4, bit } }
    const ALWAYS: Gate = Gate { bus: 255, bit: 0 };
    [
        p2(12), p1(14), p1(15), p2(13), p2(20), p2(21),
        p2(4), p1(17), p1(18), p1(19), p1(20), p2(5), p1(30), p1(31),
        p1(21), p1(22), p1(23),
        p2(0), p1(0), p1(1), p1(2), p1(3), p1(4), p1(5), p2(1), p2(16), p2(17), p2(18), p1(6), p1(7), p1(8),
        ALWAYS, a2(6), p2(8), a1(12), p1(25), ALWAYS, p1(11), ALWAYS, ALWAYS, a1(21), a1(22), p1(28), p2(14), ALWAYS,
        a1(0), a1(1), a1(2), a1(3), a1(4), a1(5), a1(6), a1(7), a1(8), a1(9), a1(10),
        a1(18),
        p1(14), p1(15), p1(26), p1(29), p2(11), p2(22), p2(26), a1(25), a1(23), a1(29), a2(7), a2(0),
        Gate { bus: 2, bit: 0 },
    ]
};

pub(crate) const fn spi(n: u8) -> u8 {
    SPI + n - 1
}
/// Returns the index of the serial port with this number in the name, 1 to 8: USART1 to UART8.
pub(crate) const fn usart(n: u8) -> u8 {
    USART + n - 1
}
pub(crate) const fn i2c(n: u8) -> u8 {
    I2C + n - 1
}
pub(crate) const fn tim(n: u8) -> u8 {
    TIM + n - 1
}

/// For each KiB from 0x4000_0000 to 0x4007_FFFF, the number of the instance there.
static BLOCKS: [u8; 512] = {
    let mut table = [NOTHING; 512];
    let list: &[(u32, u32, u8)] = &[
        (0x0000, 1, tim(2)),
        (0x0400, 1, tim(3)),
        (0x0800, 1, tim(4)),
        (0x0C00, 1, tim(5)),
        (0x1000, 1, tim(6)),
        (0x1400, 1, tim(7)),
        (0x1800, 1, tim(12)),
        (0x1C00, 1, tim(13)),
        (0x2000, 1, tim(14)),
        (0x2800, 1, RTC),
        (0x2C00, 1, WWDG),
        (0x3000, 1, IWDG),
        (0x3400, 1, STUBS),
        (0x3800, 1, spi(2)),
        (0x3C00, 1, spi(3)),
        (0x4000, 1, STUBS + 1),
        (0x4400, 1, usart(2)),
        (0x4800, 1, usart(3)),
        (0x4C00, 1, usart(4)),
        (0x5000, 1, usart(5)),
        (0x5400, 1, i2c(1)),
        (0x5800, 1, i2c(2)),
        (0x5C00, 1, i2c(3)),
        (0x6400, 1, CAN1),
        (0x6800, 1, STUBS + 2),
        (0x7000, 1, PWR),
        (0x7400, 1, DAC),
        (0x7800, 1, usart(7)),
        (0x7C00, 1, usart(8)),
        (0x1_0000, 1, tim(1)),
        (0x1_0400, 1, tim(8)),
        (0x1_1000, 1, usart(1)),
        (0x1_1400, 1, usart(6)),
        (0x1_2000, 1, ADC),
        (0x1_2C00, 1, STUBS + 4),
        (0x1_3000, 1, spi(1)),
        (0x1_3400, 1, spi(4)),
        (0x1_3800, 1, SYSCFG),
        (0x1_3C00, 1, EXTI),
        (0x1_4000, 1, tim(9)),
        (0x1_4400, 1, tim(10)),
        (0x1_4800, 1, tim(11)),
        (0x1_5000, 1, spi(5)),
        (0x1_5400, 1, spi(6)),
        (0x1_5800, 1, STUBS + 5),
        (0x1_6800, 1, STUBS + 6),
        (0x2_0000, 1, GPIO),
        (0x2_0400, 1, GPIO + 1),
        (0x2_0800, 1, GPIO + 2),
        (0x2_0C00, 1, GPIO + 3),
        (0x2_1000, 1, GPIO + 4),
        (0x2_1400, 1, GPIO + 5),
        (0x2_1800, 1, GPIO + 6),
        (0x2_1C00, 1, GPIO + 7),
        (0x2_2000, 1, GPIO + 8),
        (0x2_2400, 1, GPIO + 9),
        (0x2_2800, 1, GPIO + 10),
        (0x2_3000, 1, CRC),
        (0x2_3800, 1, RCC),
        (0x2_3C00, 1, FLASH),
        (0x2_4000, 4, BKPSRAM),
        (0x2_6000, 1, DMA1),
        (0x2_6400, 1, DMA2),
        (0x2_8000, 5, STUBS + 7),
        (0x2_B000, 3, STUBS + 8),
        (0x4_0000, 256, STUBS + 9),
    ];
    let mut row = 0;
    while row < list.len() {
        let (offset, size, number) = list[row];
        let mut nth = 0;
        while nth < size {
            table[(offset / 1024 + nth) as usize] = number;
            nth += 1;
        }
        row += 1;
    }
    table
};

#[inline]
pub(crate) fn at(address: u32) -> (u8, u32) {
    if address & 0xFFF8_0000 == 0x4000_0000 {
        let number = BLOCKS[(address >> 10 & 0x1FF) as usize];
        let mask = if number == BKPSRAM { 0xFFF } else { 0x3FF };
        return (number, address & mask);
    }
    match address {
        0x5000_0000..0x5004_0000 => (STUBS + 10, address & 0x3_FFFF),
        0x5005_0000..0x5005_0400 => (STUBS + 11, address & 0x3FF),
        0x5006_0800..0x5006_0C00 => (RNG, address & 0x3FF),
        0xA000_0000..0xA000_1000 => (STUBS + 12, address & 0xFFF),
        _ => (NOTHING, 0),
    }
}
