//! Names the pins and peripherals of the DPR's board: an nRF52840-DK with an ST25R3916 expansion board.
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
//! | SSI SCK | P1.01 | D0 | in |
//! | SSI MOSI | P1.02 | D1 | in |
//! | SSI MISO | P1.03 | D2 | out while selected |
//! | SSI CSN | P1.04 | D3 | in, pulled up |
//! | FRESH | P1.05 | D4 | out |
//! | second front end MISO | P1.06 | D5 | in |
//! | second front end MOSI | P1.07 | D6 | out |
//! | second front end SCK | P1.08 | D7 | out |
//! | second front end chip select | P1.10 | D8 | out |
//! | second front end IRQ | P1.11 | D9 | in, pulled down |
//!
//! | peripheral | use | task |
//! |---|---|---|
//! | SPIM0 | front end | `rf_spi` |
//! | SPIS1 | SSI | `ssi_end` |
//! | GPIOTE channel 0 | rising edge of the front end's IRQ | `rf_irq` |
//! | GPIOTE channel 1 | FRESH | – |
//! | TIMER0 | µs counter; compare 0: end of a delay of the driver; capture 1: IRQ edge, 3: present time | `rf_timer` |
//! | TIMER1 | the deadline of the next frame | `deadline` |
//! | TIMER2 | time since FRESH, µs. Compare 0 and 1: expiry of the image. Compare 2: end of the FRESH pulse | – |
//! | TIMER3 | time since a transaction was served, µs. Compare 0: end of the pause | `ssi_pause` |
//! | SWI0, SWI1, SWI2 | calls from other tasks | `commit`, `scrub`, `port` |
//! | SPIM2 | second front end | `hold_spi` |
//! | GPIOTE channel 3 | chip select of the second front end | – |
//! | GPIOTE channel 2 | rising edge of the second front end's IRQ; raises no interrupt | – |
//! | EGU3 channel 0 | triggered by that edge; raises the interrupt | `hold_irq` |
//! | TIMER4 | for the second front end, as TIMER0; compare 2: start of the answer | `hold_timer` |
//! | WDT | watchdog | – |
//!
//! | PPI channel | event | what the event triggers |
//! |---|---|---|
//! | 0 | GPIOTE IN\[0\] | TIMER0 CAPTURE\[1\] |
//! | 1 | TIMER2 COMPARE\[0\] | SPIS1 ACQUIRE |
//! | 2 | TIMER2 COMPARE\[1\] | SPIS1 ACQUIRE |
//! | 3 | TIMER2 COMPARE\[2\] | GPIOTE CLR\[1\] |
//! | 4 | GPIOTE IN\[2\] | EGU3 TRIGGER\[0\] |
//! | 5 | GPIOTE IN\[2\] | TIMER4 CAPTURE\[1\] |
//! | 6 | TIMER4 COMPARE\[2\] | SPIM2 START |
//! | 7 | SPIM2 END | GPIOTE SET\[3\] |
//!
//! The second front end and its peripherals (SPIM2, EGU3, TIMER4) are used only with the feature `hold`.

use dpr_fw::task::{Task, TASKS};
use firmware_common::calls::Calls;
use nrf52840_hal::{
    gpio::{p0, p1, Disconnected, Floating, Input, Level, Output, Pin, PullDown, PullUp, PushPull},
    gpiote::{Gpiote, TaskOutPolarity},
    pac::{self, Interrupt},
    ppi::{self, ConfigurablePpi, Ppi},
};

dpr_fw::each_task!(firmware_common::task_vectors);

static CALLS: Calls<Task> = Calls::new();

/// Calls `task` as [`call`] does, and marks the call for [`was_called`].
#[inline(always)]
pub(crate) fn call_step(task: Task) {
    CALLS.make(task);
    call(task);
}

/// Whether `task`, which begins to run, was called by [`call_step`].
#[inline(always)]
pub(crate) fn was_called(task: Task) -> bool {
    CALLS.take(task, || is_pending(task))
}

pub(crate) const SSI_SELECT_PIN: u8 = 4;
pub(crate) const FRESH_CHANNEL: usize = 1;
/// The compare register of TIMER0 and of TIMER4 that ends the delays of the front end's driver.
pub(crate) const WAIT_COMPARE: usize = 0;
/// The capture register of TIMER0 and of TIMER4 that takes the time of the IRQ's edge.
pub(crate) const EDGE_CAPTURE: usize = 1;
/// The capture register of TIMER4 by which the present time is read.
#[cfg(feature = "hold")]
pub(crate) use firmware_common::nrf52840::NOW_CAPTURE;
/// The GPIOTE channel of the second front end's chip select.
#[cfg(feature = "hold")]
pub(crate) const HOLD_SELECT_CHANNEL: usize = 3;
/// The compare register of TIMER4 that starts the answer to the hold.
#[cfg(feature = "hold")]
pub(crate) const HOLD_ANSWER_COMPARE: usize = 2;
pub(crate) const EXPIRY_COMPARES: [usize; 2] = [0, 1];
/// The compare register of TIMER2 that ends the FRESH pulse.
pub(crate) const PULSE_COMPARE: usize = 2;
/// The compare register of TIMER3 that ends the pause after a transaction.
pub(crate) const PAUSE_COMPARE: usize = 0;

pub(crate) struct RfPins<S = Pin<Output<PushPull>>> {
    pub(crate) select: S,
    pub(crate) mosi: Pin<Output<PushPull>>,
    pub(crate) miso: Pin<Input<Floating>>,
    pub(crate) clock: Pin<Output<PushPull>>,
    pub(crate) irq: Pin<Input<PullDown>>,
}

pub(crate) struct SsiPins {
    pub(crate) clock: Pin<Input<Floating>>,
    pub(crate) mosi: Pin<Input<Floating>>,
    pub(crate) miso: Pin<Disconnected>,
    pub(crate) select: Pin<Input<PullUp>>,
}

pub(crate) struct Pins {
    pub(crate) rf: RfPins,
    pub(crate) ssi: SsiPins,
    pub(crate) fresh: Pin<Output<PushPull>>,
    #[cfg(feature = "hold")]
    pub(crate) hold: RfPins,
}

impl Pins {
    /// Configures the pins. Chip select of the front end is high and FRESH low before these pins become outputs.
    pub(crate) fn new(port0: pac::P0, port1: pac::P1) -> Self {
        let port0 = p0::Parts::new(port0);
        let port1 = p1::Parts::new(port1);
        Self {
            rf: RfPins {
                select: port1.p1_12.into_push_pull_output(Level::High).degrade(),
                mosi: port1.p1_13.into_push_pull_output(Level::Low).degrade(),
                miso: port1.p1_14.into_floating_input().degrade(),
                clock: port1.p1_15.into_push_pull_output(Level::Low).degrade(),
                irq: port0.p0_03.into_pulldown_input().degrade(),
            },
            ssi: SsiPins {
                clock: port1.p1_01.into_floating_input().degrade(),
                mosi: port1.p1_02.into_floating_input().degrade(),
                miso: port1.p1_03.into_disconnected().degrade(),
                select: port1.p1_04.into_pullup_input().degrade(),
            },
            fresh: port1.p1_05.into_push_pull_output(Level::Low).degrade(),
            #[cfg(feature = "hold")]
            hold: RfPins {
                select: port1.p1_10.into_push_pull_output(Level::High).degrade(),
                mosi: port1.p1_07.into_push_pull_output(Level::Low).degrade(),
                miso: port1.p1_06.into_floating_input().degrade(),
                clock: port1.p1_08.into_push_pull_output(Level::Low).degrade(),
                irq: port1.p1_11.into_pulldown_input().degrade(),
            },
        }
    }
}

/// Configures GPIOTE and PPI. The timers and SPIS1 may be configured later, since they produce no event before.
pub(crate) fn connect(
    gpiote: pac::GPIOTE,
    ppi: pac::PPI,
    irq: &Pin<Input<PullDown>>,
    fresh: Pin<Output<PushPull>>,
    timer0: &pac::TIMER0,
    timer2: &pac::TIMER2,
    spis: &pac::SPIS1,
) -> (Gpiote, ppi::Parts) {
    let gpiote = Gpiote::new(gpiote);
    gpiote.channel0().input_pin(irq).lo_to_hi().enable_interrupt();
    gpiote.channel1().output_pin(fresh).task_out_polarity(TaskOutPolarity::Set).init_low();

    let mut ppi = ppi::Parts::new(ppi);
    ppi.ppi0.set_event_endpoint(gpiote.channel0().event());
    ppi.ppi0.set_task_endpoint(&timer0.tasks_capture[EDGE_CAPTURE]);
    ppi.ppi0.enable();
    ppi.ppi1.set_event_endpoint(&timer2.events_compare[EXPIRY_COMPARES[0]]);
    ppi.ppi1.set_task_endpoint(&spis.tasks_acquire);
    ppi.ppi1.enable();
    ppi.ppi2.set_event_endpoint(&timer2.events_compare[EXPIRY_COMPARES[1]]);
    ppi.ppi2.set_task_endpoint(&spis.tasks_acquire);
    ppi.ppi2.enable();
    ppi.ppi3.set_event_endpoint(&timer2.events_compare[PULSE_COMPARE]);
    ppi.ppi3.set_task_endpoint(gpiote.channel1().task_clr());
    ppi.ppi3.enable();
    (gpiote, ppi)
}

/// Configures GPIOTE and PPI channels of the second front end as in the tables above. Returns the front end's pins, of
/// which `select` drives chip select by GPIOTE.
#[cfg(feature = "hold")]
pub(crate) fn connect_hold<S>(
    select: S,
    gpiote: &Gpiote,
    mut ppi: ppi::Parts,
    pins: RfPins,
    timer: &pac::TIMER4,
    spim: &pac::SPIM2,
    egu: &pac::EGU3,
) -> RfPins<S> {
    use nrf52840_hal::timer::Instance as _;

    let RfPins { select: pin, mosi, miso, clock, irq } = pins;
    gpiote.channel2().input_pin(&irq).lo_to_hi();
    gpiote.channel3().output_pin(pin).task_out_polarity(TaskOutPolarity::Set).init_high();
    ppi.ppi4.set_event_endpoint(gpiote.channel2().event());
    ppi.ppi4.set_task_endpoint(&egu.tasks_trigger[0]);
    ppi.ppi4.enable();
    ppi.ppi5.set_event_endpoint(gpiote.channel2().event());
    ppi.ppi5.set_task_endpoint(&timer.as_timer0().tasks_capture[EDGE_CAPTURE]);
    ppi.ppi5.enable();
    ppi.ppi6.set_event_endpoint(&timer.as_timer0().events_compare[HOLD_ANSWER_COMPARE]);
    ppi.ppi6.set_task_endpoint(&spim.tasks_start);
    ppi.ppi6.enable();
    ppi.ppi7.set_event_endpoint(&spim.events_end);
    ppi.ppi7.set_task_endpoint(gpiote.channel3().task_set());
    ppi.ppi7.enable();
    RfPins { select, mosi, miso, clock, irq }
}
