//! Names the pins and peripherals of the hold's board: an nRF52840-DK with an ST25R3916 expansion board on its Arduino
//! header, two sensors and three outputs.
//!
//! Only this file names pins and peripherals.
//!
//! | signal | pin | Arduino header | direction |
//! |---|---|---|---|
//! | front end chip select | P1.12 | D10 | out |
//! | front end MOSI | P1.13 | D11 | out |
//! | front end MISO | P1.14 | D12 | in |
//! | front end SCK | P1.15 | D13 | out |
//! | front end IRQ | P0.03 | A0 | in, pulled down |
//! | sensors SDA | P0.26 | SDA | open drain, pulled up |
//! | sensors SCL | P0.27 | SCL | open drain, pulled up |
//! | heater | P1.05 | D4 | out, PWM; high: on |
//! | cooler | P1.06 | D5 | out, PWM; high: on |
//! | lock | P1.07 | D6 | out; high: locked |
//!
//! | peripheral | use | task |
//! |---|---|---|
//! | SPIM0 | front end | `rf_spi` |
//! | TWIM1 | sensors | – |
//! | GPIOTE channel 0 | rising edge of the front end's IRQ | `rf_irq` |
//! | TIMER0 | µs counter; compare 0: end of a delay of the front end's driver; capture 3: present time | `rf_timer` |
//! | TIMER1 | compare 0: a beat, every 25 ms; compare 1: the slot | `slot` |
//! | PWM0 | channel 0: heater, channel 1: cooler | – |
//! | SAADC | channel 0: supply voltage | – |
//! | SWI0, SWI1, SWI2 | calls from other tasks | `cycle`, `answer`, `sensors` |
//! | WDT | watchdog | – |

use hold_fw::task::{Task, TASKS};
use nrf52840_hal::{
    gpio::{p0, p1, Floating, Input, Level, Output, Pin, PullDown, PushPull},
    gpiote::Gpiote,
    pac::{self, Interrupt},
};

hold_fw::each_task!(firmware_common::task_vectors);

/// The compare register of TIMER0 that ends the delays of the front end's driver.
pub(crate) const WAIT_COMPARE: usize = 0;
/// The compare register of TIMER1 for the beats ([`hold_fw::timing`]). A match also clears the timer.
pub(crate) const BEAT_COMPARE: usize = 0;
/// The compare register of TIMER1 for the slot, the instant in a cycle at which the frame is sent.
pub(crate) const SLOT_COMPARE: usize = 1;

pub(crate) struct RfPins {
    pub(crate) select: Pin<Output<PushPull>>,
    pub(crate) mosi: Pin<Output<PushPull>>,
    pub(crate) miso: Pin<Input<Floating>>,
    pub(crate) clock: Pin<Output<PushPull>>,
    pub(crate) irq: Pin<Input<PullDown>>,
}

pub(crate) struct BusPins {
    pub(crate) sda: Pin<Input<Floating>>,
    pub(crate) scl: Pin<Input<Floating>>,
}

pub(crate) struct OutputPins {
    pub(crate) heater: Pin<Output<PushPull>>,
    pub(crate) cooler: Pin<Output<PushPull>>,
    pub(crate) lock: Pin<Output<PushPull>>,
}

pub(crate) struct Pins {
    pub(crate) rf: RfPins,
    pub(crate) bus: BusPins,
    pub(crate) outputs: OutputPins,
}

impl Pins {
    /// Configures the pins as in the table above. Each output has its level before it becomes an output: chip select is
    /// high, heater and cooler are off, and the lock is as before the reset (`locked`).
    pub(crate) fn new(port0: pac::P0, port1: pac::P1, locked: bool) -> Self {
        let port0 = p0::Parts::new(port0);
        let port1 = p1::Parts::new(port1);
        let lock = if locked { Level::High } else { Level::Low };
        Self {
            rf: RfPins {
                select: port1.p1_12.into_push_pull_output(Level::High).degrade(),
                mosi: port1.p1_13.into_push_pull_output(Level::Low).degrade(),
                miso: port1.p1_14.into_floating_input().degrade(),
                clock: port1.p1_15.into_push_pull_output(Level::Low).degrade(),
                irq: port0.p0_03.into_pulldown_input().degrade(),
            },
            bus: BusPins {
                sda: port0.p0_26.into_floating_input().degrade(),
                scl: port0.p0_27.into_floating_input().degrade(),
            },
            outputs: OutputPins {
                heater: port1.p1_05.into_push_pull_output(Level::Low).degrade(),
                cooler: port1.p1_06.into_push_pull_output(Level::Low).degrade(),
                lock: port1.p1_07.into_push_pull_output(lock).degrade(),
            },
        }
    }
}

/// Configures GPIOTE channel 0 as in the table above.
pub(crate) fn connect(gpiote: pac::GPIOTE, irq: &Pin<Input<PullDown>>) -> Gpiote {
    let gpiote = Gpiote::new(gpiote);
    gpiote.channel0().input_pin(irq).lo_to_hi().enable_interrupt();
    gpiote
}
