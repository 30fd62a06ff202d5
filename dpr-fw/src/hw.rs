//! The registers: the only module with `unsafe` in it.
//!
//! # Design
//!
//! Each peripheral is a type that owns what its DMA may touch. A receive buffer is inside [`RfPort`] for as long as SPIM0 may write it, and
//! the image and the receive area are inside [`SsiPort`] for as long as SPIS1 may read and write them; both are `&'static mut`, so nobody else
//! can look at them meanwhile, and they come out only when the peripheral has reported that it is done. All of it is in RAM, as EasyDMA requires (PS v1.7, 6.3).
//! Compiler fences stand before each start and after each end, so that no access to a buffer moves across; the Cortex-M4 has no data cache and completes its
//! stores in order, so the compiler is all there is to hold back.
//!
//! # Anomalies
//!
//! nRF52840 revisions 1 to 3, of the peripherals used here:
//!
//! | no. | what | what we do |
//! |---|---|---|
//! | 36 | CLOCK: some registers survive a reset | the event of the HFXO is cleared before it is awaited |
//! | 78 | TIMER: high current after STOP | our timers never stop |
//! | 87 | CPU: FPU exceptions wake the processor | the FPU computes nothing here; a wake-up too many does no harm |
//! | 136 | RESETREAS: bits set that should not be | with the pin's bit set, the others are not believed |
//! | 155 | GPIOTE: an edge may be reported twice | the interrupt asks the pin for its level ([`dpr_fw::rf`]) |
//! | 173, 210 | GPIO: LATCH is slow, and wrong | LATCH is not used |
//! | 176 | a flash erase through CTRL-AP fails with the watchdog running | a matter for the flashing tool: halt first |
//! | 195, 198 | SPIM3 draws current when disabled and can corrupt what it sends | SPIM0 and SPIS1 are used |
//! | 213 | WDT: configuration lost in System OFF | System OFF is not used |
//! | 246 | extra current in idle after EasyDMA | current only |
//!
//! 58 (SPIM, one byte too many) and 156 (GPIOTE CLR tasks) are of Engineering A only.

use core::sync::atomic::{compiler_fence, AtomicBool, Ordering};

use cortex_m_rt::{exception, ExceptionFrame};
use dpr_fw::{
    rf::{Failed, Port, LEAD},
    ssi::RECEIVE_BYTES,
    telemetry::Telemetry,
    triple::{Filling, Received},
    ImageMemory, ReceiveMemory,
};
use embedded_hal::digital::{InputPin, OutputPin};
use nrf52840_hal::{
    gpio::{p0, p1, Disconnected, Floating, Input, Level, Output, Pin, PullDown, PullUp, PushPull},
    gpiote::Gpiote,
    pac::{self, Interrupt},
    wdt::{count::One, handles::Hdl0, Watchdog, WatchdogHandle},
};
use st25r3916::{command, Short};

/// The counters, for a debugger to find.
#[no_mangle]
pub(crate) static DPR_TELEMETRY: Telemetry = Telemetry::new();

/// A receive buffer.
pub(crate) type ReceiveBuffer = &'static mut ReceiveMemory;
/// An image buffer.
pub(crate) type ImageBuffer = &'static mut ImageMemory;

/// The watchdog bites after 100 ms: eight deadlines without a sign of life, ten cycles of old data at most.
const WATCHDOG_TICKS: u32 = 32_768 / 10;
/// Microsecond timers: 16 MHz / 2^4.
const PRESCALER: u8 = 4;
/// A compare value nearer than this could be passed before it is set, µs.
const SHORTEST_US: u32 = 2;
/// Polls for SPIM0 to stop: it does within the byte it is at, 1 µs.
const STOP_POLLS: u32 = 1_000;
/// The FRESH pulse: 1 µs at 64 MHz, wide enough for a pin interrupt of the flight controller.
const FRESH_CYCLES: u32 = 64;

/// Reads and clears an event, and waits until the write is through the bus bridge, so that the interrupt does not come again for it (PS v1.7, 6.1.8).
macro_rules! take_event {
    ($event:expr) => {{
        let event = &$event;
        let set = event.read().bits() != 0;
        if set {
            event.reset();
            let _ = event.read();
        }
        set
    }};
}
/// Everything the tasks own of the hardware.
pub(crate) struct Board {
    /// RFID front end.
    pub(crate) rf: RfPort,
    /// IRQ edge of the front end.
    pub(crate) rf_edge: RfEdge,
    /// SSI.
    pub(crate) ssi: SsiPort,
    /// FRESH.
    pub(crate) fresh: Fresh,
    /// The missed-frame deadline.
    pub(crate) deadline: Deadline,
    /// The watchdog; `None` if something else has configured it, then it is that one's.
    pub(crate) watchdog: Option<WatchdogHandle<Hdl0>>,
    /// Whether the last reset was the watchdog's.
    pub(crate) watchdog_reset: bool,
}

/// Static memory that DMA uses.
pub(crate) struct Memory {
    /// What is sent in a short transfer, or the command of a read.
    pub(crate) spi_tx: &'static mut [u8; Short::MAX],
    /// What is received in a short transfer.
    pub(crate) spi_rx: &'static mut [u8; Short::MAX],
    /// What comes in over SSI.
    pub(crate) ssi_rx: &'static mut [u8; RECEIVE_BYTES],
}

/// Configures everything. The watchdog first, since the crystal is waited for.
pub(crate) fn init(
    core: &mut cortex_m::Peripherals,
    p: pac::Peripherals,
    memory: Memory,
    receive: Filling<ReceiveBuffer>,
) -> Board {
    let reason = p.POWER.resetreas.read();
    let watchdog_reset = reason.dog().is_detected() && reason.resetpin().is_not_detected();
    // SAFETY: bits of RESETREAS are cleared by writing ones; these are the ones just read, so every bit is defined.
    p.POWER.resetreas.write(|w| unsafe { w.bits(reason.bits()) });

    let watchdog = match Watchdog::try_new(p.WDT) {
        Ok(mut watchdog) => {
            watchdog.set_lfosc_ticks(WATCHDOG_TICKS);
            watchdog.run_during_sleep(true);
            watchdog.run_during_debug_halt(false);
            Some(watchdog.activate::<One>().handles.0)
        }
        // It runs already: it outlives a soft reset.
        Err(wdt) => Watchdog::try_recover::<One>(wdt).ok().map(|parts| parts.handles.0),
    };

    p.CLOCK.events_hfclkstarted.reset();
    let _clocks = nrf52840_hal::Clocks::new(p.CLOCK).enable_ext_hfosc();
    p.NVMC.icachecnf.write(|w| w.cacheen().enabled());
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();

    let port0 = p0::Parts::new(p.P0);
    let port1 = p1::Parts::new(p.P1);

    time_base(&p.TIMER0);
    let gpiote = Gpiote::new(p.GPIOTE);
    let rf_irq = port0.p0_03.into_pulldown_input().degrade();
    gpiote.channel0().input_pin(&rf_irq).lo_to_hi().enable_interrupt();
    let pins = RfPins {
        select: port1.p1_12.into_push_pull_output(Level::High).degrade(),
        mosi: port1.p1_13.into_push_pull_output(Level::Low).degrade(),
        miso: port1.p1_14.into_floating_input().degrade(),
        clock: port1.p1_15.into_push_pull_output(Level::Low).degrade(),
        irq: rf_irq,
    };
    let rf = RfPort::new(p.SPIM0, p.TIMER0, pins, memory.spi_tx, memory.spi_rx, receive);

    let pins = SsiPins {
        clock: port1.p1_01.into_floating_input().degrade(),
        mosi: port1.p1_02.into_floating_input().degrade(),
        miso: port1.p1_03.into_disconnected().degrade(),
        select: port1.p1_04.into_pullup_input().degrade(),
    };
    let ssi = SsiPort::new(p.SPIS1, pins, memory.ssi_rx);
    port1.p1_05.into_push_pull_output(Level::Low);
    let deadline = Deadline::new(p.TIMER1);
    Board { rf, rf_edge: RfEdge(gpiote), ssi, fresh: Fresh(()), deadline, watchdog, watchdog_reset }
}

/// Starts TIMER0: 32 bits of µs, from zero, for ever.
fn time_base(timer: &pac::TIMER0) {
    timer.bitmode.write(|w| w.bitmode()._32bit());
    // SAFETY: the field has four bits and takes 0..=9 (PS v1.7, 6.30).
    timer.prescaler.write(|w| unsafe { w.prescaler().bits(PRESCALER) });
    // SAFETY: task registers take 1; the reset of the counter comes before its start.
    timer.tasks_clear.write(|w| unsafe { w.bits(1) });
    // SAFETY: as above.
    timer.tasks_start.write(|w| unsafe { w.bits(1) });
}

/// The µs counter now, from any task.
pub(crate) fn now_us() -> u32 {
    // SAFETY: the pointer is the peripheral's, valid for ever. Capture register 3 is used here only. If another task preempts between the two
    // accesses and captures too, what is read is a later value than the own capture, but still one of the time of this call.
    let timer = unsafe { &*pac::TIMER0::ptr() };
    // SAFETY: task registers take 1.
    timer.tasks_capture[3].write(|w| unsafe { w.bits(1) });
    timer.cc[3].read().bits()
}

/// Asks for the SSI's buffer, so that a newer image may be put in; the SSI interrupt follows when it is there. Tells whether a transaction is under
/// way, whose end has to come first.
pub(crate) fn request_ssi() -> bool {
    // SAFETY: the pointer is the peripheral's, valid for ever; a task register and a read-only one are accessed, which races with nothing.
    let spis = unsafe { &*pac::SPIS1::ptr() };
    // SAFETY: task registers take 1.
    spis.tasks_acquire.write(|w| unsafe { w.bits(1) });
    let holder = spis.semstat.read().semstat();
    holder.is_spis() || holder.is_cpupending()
}

/// The FRESH pin. Both of its edges are single writes to a set or clear register, so two tasks may have it.
#[derive(Clone, Copy)]
pub(crate) struct Fresh(());

impl Fresh {
    /// Pulses.
    pub(crate) fn pulse(self) {
        // SAFETY: the pointer is the peripheral's, valid for ever; OUTSET and OUTCLR change the pins whose bits are set and no others.
        let port = unsafe { &*pac::P1::ptr() };
        port.outset.write(|w| w.pin5().set());
        cortex_m::asm::delay(FRESH_CYCLES);
        port.outclr.write(|w| w.pin5().clear());
    }
}

/// The missed-frame deadline: TIMER1 in µs.
pub(crate) struct Deadline(pac::TIMER1);

impl Deadline {
    fn new(timer: pac::TIMER1) -> Self {
        timer.bitmode.write(|w| w.bitmode()._32bit());
        // SAFETY: the field has four bits and takes 0..=9 (PS v1.7, 6.30).
        timer.prescaler.write(|w| unsafe { w.prescaler().bits(PRESCALER) });
        timer.shorts.write(|w| w.compare0_clear().enabled());
        timer.intenset.write(|w| w.compare0().set());
        let mut deadline = Self(timer);
        deadline.restart(dpr_fw::link::FRAME_DEADLINE_US);
        // SAFETY: task registers take 1.
        deadline.0.tasks_start.write(|w| unsafe { w.bits(1) });
        deadline
    }

    /// The deadline is `us` µs from now.
    pub(crate) fn restart(&mut self, us: u32) {
        // SAFETY: task registers take 1.
        self.0.tasks_clear.write(|w| unsafe { w.bits(1) });
        self.follow(us.max(SHORTEST_US));
        self.0.events_compare[0].reset();
    }

    /// The deadline is `us` µs after the one that has passed: its compare has cleared the counter.
    pub(crate) fn follow(&mut self, us: u32) {
        // SAFETY: any value may be compared with.
        self.0.cc[0].write(|w| unsafe { w.bits(us) });
    }

    /// Whether it has passed, once.
    pub(crate) fn passed(&mut self) -> bool {
        take_event!(self.0.events_compare[0])
    }
}

/// The IRQ edge's interrupt.
pub(crate) struct RfEdge(Gpiote);

impl RfEdge {
    /// The edge is taken notice of.
    pub(crate) fn clear(&mut self) {
        let channel = self.0.channel0();
        take_event!(*channel.event());
    }
}

struct RfPins {
    select: Pin<Output<PushPull>>,
    mosi: Pin<Output<PushPull>>,
    miso: Pin<Input<Floating>>,
    clock: Pin<Output<PushPull>>,
    irq: Pin<Input<PullDown>>,
}

/// The transfer that runs or has ended.
#[derive(Clone, Copy)]
enum Transfer {
    None,
    Short {
        len: usize,
    },
    /// `kept` is the byte that the byte under the command overwrites.
    Read {
        offset: usize,
        len: usize,
        kept: u8,
    },
}

/// SPIM0, chip select, IRQ pin and timer compare 0 of the RFID side, with the receive buffer that is being written.
pub(crate) struct RfPort {
    spim: pac::SPIM0,
    timer: pac::TIMER0,
    pins: RfPins,
    tx: &'static mut [u8; Short::MAX],
    rx: &'static mut [u8; Short::MAX],
    receive: Option<Filling<ReceiveBuffer>>,
    transfer: Transfer,
    running: bool,
    timer_from: u32,
    timer_us: u32,
}

impl RfPort {
    fn new(
        spim: pac::SPIM0,
        timer: pac::TIMER0,
        pins: RfPins,
        tx: &'static mut [u8; Short::MAX],
        rx: &'static mut [u8; Short::MAX],
        receive: Filling<ReceiveBuffer>,
    ) -> Self {
        // SAFETY: (all four) the pins' own selectors; the pins are owned by `pins` and configured as PS v1.7, 6.25.2 wants them.
        spim.psel.sck.write(|w| unsafe { w.bits(pins.clock.psel_bits()) });
        // SAFETY: as above.
        spim.psel.mosi.write(|w| unsafe { w.bits(pins.mosi.psel_bits()) });
        // SAFETY: as above.
        spim.psel.miso.write(|w| unsafe { w.bits(pins.miso.psel_bits()) });
        spim.frequency.write(|w| w.frequency().m8());
        // Mode 1: clock low when idle, data taken at the trailing edge.
        spim.config.write(|w| w.order().msb_first().cpha().trailing().cpol().active_high());
        // SAFETY: any byte may be sent beyond the end of the transmit buffer.
        spim.orc.write(|w| unsafe { w.orc().bits(0) });
        spim.intenset.write(|w| w.end().set());
        spim.enable.write(|w| w.enable().enabled());
        timer.intenset.write(|w| w.compare0().set());
        Self {
            spim,
            timer,
            pins,
            tx,
            rx,
            receive: Some(receive),
            transfer: Transfer::None,
            running: false,
            timer_from: 0,
            timer_us: u32::MAX,
        }
    }

    /// Exchanges the receive buffer; to be called while no transfer runs.
    pub(crate) fn exchange(&mut self, with: impl FnOnce(Filling<ReceiveBuffer>) -> Filling<ReceiveBuffer>) {
        assert!(!self.running, "the receive buffer is being written");
        self.receive = self.receive.take().map(with);
    }

    /// What has arrived of a frame, `len` bytes beginning with LEN; to be called while no read runs, which would put its own bytes in.
    pub(crate) fn arrived(&self, len: usize) -> &[u8] {
        match &self.receive {
            Some(receive) if !self.running || !matches!(self.transfer, Transfer::Read { .. }) => {
                let bytes: &[u8] = bytemuck::cast_slice(receive.peek().as_slice());
                bytes.get(LEAD..LEAD + len).unwrap_or(&[])
            }
            _ => &[],
        }
    }

    /// Starts SPIM0 on `tx[..send]` and `receive` bytes at `into`.
    ///
    /// # Safety
    ///
    /// `into` must be valid for `receive` bytes of RAM that are owned by `self` until the transfer has ended or was stopped.
    unsafe fn start(&mut self, send: usize, into: *mut u8, receive: usize) {
        // SAFETY: (pointers and counts) `tx` is ours and at least `send` long, which the callers see to; `into` is the caller's promise. Counts fit 16 bits.
        self.spim.txd.ptr.write(|w| unsafe { w.ptr().bits(self.tx.as_ptr() as u32) });
        // SAFETY: as above.
        self.spim.txd.maxcnt.write(|w| unsafe { w.maxcnt().bits(send as u16) });
        // SAFETY: as above.
        self.spim.rxd.ptr.write(|w| unsafe { w.ptr().bits(into as u32) });
        // SAFETY: as above.
        self.spim.rxd.maxcnt.write(|w| unsafe { w.maxcnt().bits(receive as u16) });
        self.spim.events_end.reset();
        self.running = true;
        // What was written to the buffers is in memory before the DMA reads or overwrites it.
        compiler_fence(Ordering::SeqCst);
        let Ok(()) = self.pins.select.set_low();
        // SAFETY: task registers take 1.
        self.spim.tasks_start.write(|w| unsafe { w.bits(1) });
    }

    /// The transfer is over or stopped: the buffers are ours again.
    fn finish(&mut self) {
        let Ok(()) = self.pins.select.set_high();
        compiler_fence(Ordering::SeqCst);
        self.running = false;
        if let (Transfer::Read { offset, kept, .. }, Some(receive)) = (self.transfer, &mut self.receive) {
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(receive.memory().as_mut_slice());
            bytes[LEAD + offset - 1] = kept;
        }
    }
}

impl Port for RfPort {
    fn start_short(&mut self, bytes: &[u8]) {
        let len = bytes.len().min(Short::MAX);
        self.tx[..len].copy_from_slice(&bytes[..len]);
        self.transfer = Transfer::Short { len };
        let into = self.rx.as_mut_ptr();
        // SAFETY: `rx` is ours for ever and at least `len` bytes long; nobody reads it before `ended`.
        unsafe { self.start(len, into, len) };
    }

    fn start_read(&mut self, offset: usize, len: usize) {
        let Some(receive) = &mut self.receive else { return };
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(receive.memory().as_mut_slice());
        let place = LEAD + offset - 1;
        // One byte more: the one under the command.
        let into = &mut bytes[place..place + 1 + len];
        self.transfer = Transfer::Read { offset, len, kept: into[0] };
        self.tx[0] = command::FIFO_READ;
        let into = into.as_mut_ptr();
        // SAFETY: the slice was just checked to lie in the receive buffer, which is in `self` until the transfer has ended: `exchange` refuses meanwhile.
        unsafe { self.start(1, into, len + 1) };
    }

    fn ended(&mut self) -> bool {
        if !self.running || !take_event!(self.spim.events_end) {
            return false;
        }
        self.finish();
        true
    }

    fn response(&self) -> Result<&[u8], Failed> {
        let received = usize::from(self.spim.rxd.amount.read().amount().bits());
        match (self.transfer, &self.receive) {
            (Transfer::Short { len }, _) if received == len => Ok(&self.rx[..len]),
            (Transfer::Read { offset, len, .. }, Some(receive)) if received == len + 1 => {
                let bytes: &[u8] = bytemuck::cast_slice(receive.peek().as_slice());
                Ok(&bytes[LEAD + offset..LEAD + offset + len])
            }
            _ => Err(Failed),
        }
    }

    fn abort(&mut self) {
        self.spim.events_stopped.reset();
        // SAFETY: task registers take 1.
        self.spim.tasks_stop.write(|w| unsafe { w.bits(1) });
        for _ in 0..STOP_POLLS {
            if self.spim.events_stopped.read().bits() != 0 {
                break;
            }
        }
        // A peripheral that did not even stop is switched off, which ends its DMA.
        self.spim.enable.write(|w| w.enable().disabled());
        self.spim.enable.write(|w| w.enable().enabled());
        self.spim.events_end.reset();
        self.finish();
        self.transfer = Transfer::None;
    }

    fn irq(&mut self) -> bool {
        let Ok(high) = self.pins.irq.is_high();
        high
    }

    fn start_timer(&mut self, micros: u32) {
        let micros = micros.max(SHORTEST_US);
        self.timer_from = now_us();
        self.timer_us = micros;
        // SAFETY: any value may be compared with.
        self.timer.cc[0].write(|w| unsafe { w.bits(self.timer_from.wrapping_add(micros)) });
        self.timer.events_compare[0].reset();
        if now_us().wrapping_sub(self.timer_from) >= micros {
            // Preempted for so long that the compare was missed: come back at once.
            rtic::pend(Interrupt::TIMER0);
        }
    }

    fn elapsed(&mut self) -> bool {
        take_event!(self.timer.events_compare[0]);
        now_us().wrapping_sub(self.timer_from) >= self.timer_us
    }

    fn now_us(&mut self) -> u32 {
        now_us()
    }
}

struct SsiPins {
    clock: Pin<Input<Floating>>,
    mosi: Pin<Input<Floating>>,
    miso: Pin<Disconnected>,
    select: Pin<Input<PullUp>>,
}

/// SPIS1, with the image that is streamed and the area that is written from outside.
pub(crate) struct SsiPort {
    spis: pac::SPIS1,
    /// Held so that nobody reconfigures them.
    _pins: SsiPins,
    receive: &'static mut [u8; RECEIVE_BYTES],
    image: Option<Received<ImageBuffer, ()>>,
    granted: bool,
}

impl SsiPort {
    /// Enabled, but with the buffers in the processor's hands: whoever selects it reads 0xFF.
    fn new(spis: pac::SPIS1, pins: SsiPins, receive: &'static mut [u8; RECEIVE_BYTES]) -> Self {
        // SAFETY: (all four) the pins' own selectors; the pins are owned by `pins` and configured as inputs (PS v1.7, 6.26.4), MISO by the peripheral.
        spis.psel.sck.write(|w| unsafe { w.bits(pins.clock.psel_bits()) });
        // SAFETY: as above.
        spis.psel.mosi.write(|w| unsafe { w.bits(pins.mosi.psel_bits()) });
        // SAFETY: as above.
        spis.psel.miso.write(|w| unsafe { w.bits(pins.miso.psel_bits()) });
        // SAFETY: as above.
        spis.psel.csn.write(|w| unsafe { w.bits(pins.select.psel_bits()) });
        // Mode 0.
        spis.config.write(|w| w.order().msb_first().cpha().leading().cpol().active_high());
        // SAFETY: any byte may be the default and the over-read character; no CRC accepts 0xFF throughout.
        spis.def.write(|w| unsafe { w.def().bits(0xFF) });
        // SAFETY: as above.
        spis.orc.write(|w| unsafe { w.orc().bits(0xFF) });
        spis.shorts.write(|w| w.end_acquire().enabled());
        spis.intenset.write(|w| w.end().set().acquired().set());
        spis.enable.write(|w| w.enable().enabled());
        Self { spis, _pins: pins, receive, image: None, granted: false }
    }

    /// Looks what has come: whether the buffers are in the processor's hands, and what the transaction that has ended brought in.
    ///
    /// The semaphore is looked at before the end of a transaction: if one ends in between, its end is seen now and its buffers next time, never the other
    /// way round. END and ACQUIRED come together by the short, and who handled ACQUIRED first would hand the buffers out again before the transaction was
    /// looked at (the fault of openthread#5703).
    pub(crate) fn look(&mut self) -> (bool, Option<&[u8]>) {
        take_event!(self.spis.events_acquired);
        let ours = self.spis.semstat.read().semstat().is_cpu();
        let ended = take_event!(self.spis.events_end);
        if ours {
            // The peripheral is done with both buffers.
            compiler_fence(Ordering::SeqCst);
            self.granted = false;
        }
        if !ended {
            return (ours, None);
        }
        let amount = usize::from(self.spis.rxd.amount.read().amount().bits());
        (ours, Some(&self.receive[..amount.min(RECEIVE_BYTES)]))
    }

    /// Exchanges the image; to be called only while the buffers are in the processor's hands.
    pub(crate) fn exchange<R>(
        &mut self,
        with: impl FnOnce(Option<Received<ImageBuffer, ()>>) -> (Option<Received<ImageBuffer, ()>>, R),
    ) -> R {
        assert!(!self.granted, "the image is being streamed");
        let (image, result) = with(self.image.take());
        self.image = image;
        result
    }

    /// Grants the buffers for the next transaction: `window` of the image goes out. Without an image nothing is granted. Tells whether it was.
    pub(crate) fn grant(&mut self, window: core::ops::Range<usize>) -> bool {
        let Some(image) = &self.image else { return false };
        let bytes: &[u8] = bytemuck::cast_slice(image.memory().as_slice());
        let window = &bytes[window];
        // SAFETY: (pointers and counts) both buffers are in RAM for ever and in `self` until the semaphore is ours again, which `exchange` and `look` see
        // to; both slices were checked for their length, which fits 16 bits. The peripheral reads the one and writes the other.
        self.spis.txd.ptr.write(|w| unsafe { w.ptr().bits(window.as_ptr() as u32) });
        // SAFETY: as above.
        self.spis.txd.maxcnt.write(|w| unsafe { w.maxcnt().bits(window.len() as u16) });
        // SAFETY: as above.
        self.spis.rxd.ptr.write(|w| unsafe { w.ptr().bits(self.receive.as_mut_ptr() as u32) });
        // SAFETY: as above.
        self.spis.rxd.maxcnt.write(|w| unsafe { w.maxcnt().bits(RECEIVE_BYTES as u16) });
        self.granted = true;
        compiler_fence(Ordering::SeqCst);
        // SAFETY: task registers take 1.
        self.spis.tasks_release.write(|w| unsafe { w.bits(1) });
        true
    }
}

/// The safe state: nothing is granted to the SSI any more, so that the flight controller reads 0xFF, nothing interrupts, and nobody feeds the watchdog, which
/// resets the part within 100 ms. A transaction that is under way ends with the image with which it began.
fn safe_state() {
    cortex_m::interrupt::disable();
    request_ssi();
}

/// Stays until the watchdog bites.
fn wait_for_watchdog() -> ! {
    loop {
        compiler_fence(Ordering::SeqCst);
    }
}

/// A panic within a panic, such as one of the logger, is not logged.
static PANICKED: AtomicBool = AtomicBool::new(false);

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    safe_state();
    if !PANICKED.swap(true, Ordering::Relaxed) {
        defmt::error!("{}", defmt::Display2Format(info));
    }
    wait_for_watchdog()
}

#[defmt::panic_handler]
fn defmt_panic() -> ! {
    safe_state();
    PANICKED.store(true, Ordering::Relaxed);
    wait_for_watchdog()
}

/// # Safety
///
/// Called by the processor only.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    safe_state();
    if !PANICKED.swap(true, Ordering::Relaxed) {
        defmt::error!("hard fault at {=u32:#010x}, called from {=u32:#010x}", frame.pc(), frame.lr());
    }
    wait_for_watchdog()
}

defmt::timestamp!("{=u32:us}", now_us());
