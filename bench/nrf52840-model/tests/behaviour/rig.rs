//! The part in a rigless session with the core played by the test: it writes and reads registers as firmware would, and
//! lets time pass from one deadline of the models to the next.
use nrf52840_model::{Finding, FindingKind, Nrf52840, Pin, Settings};
use rigless::chip::Timeline;
use rigless::chip::spi::Peer;
use rigless::device::Level;
use rigless::emulator::{Access, AccessKind, CoreSpec, Error, Host, InterruptLine, Memory, Stop, StopReason};
use rigless::machine::{Board, Target};
use rigless::mcu::Mcu;
use rigless::session::Session;
use rigless::snapshot::Store;
use rigless::soc::Width;
use rigless::time::{NO_DEADLINE, VirtualNanos};
use std::collections::BTreeSet;
use std::num::NonZeroU64;

pub(crate) const POWER: u32 = 0x4000_0000;
pub(crate) const UARTE0: u32 = 0x4000_2000;
pub(crate) const SPIM0: u32 = 0x4000_3000;
pub(crate) const SPIS1: u32 = 0x4000_4000;
pub(crate) const GPIOTE: u32 = 0x4000_6000;
pub(crate) const TIMER0: u32 = 0x4000_8000;
pub(crate) const TIMER1: u32 = 0x4000_9000;
pub(crate) const RTC0: u32 = 0x4000_B000;
pub(crate) const RNG: u32 = 0x4000_D000;
pub(crate) const WDT: u32 = 0x4001_0000;
pub(crate) const EGU0: u32 = 0x4001_4000;
pub(crate) const TIMER3: u32 = 0x4001_A000;
pub(crate) const NVMC: u32 = 0x4001_E000;
pub(crate) const PPI: u32 = 0x4001_F000;
pub(crate) const SPIM3: u32 = 0x4002_F000;
pub(crate) const P0: u32 = 0x5000_0000;
pub(crate) const P1: u32 = 0x5000_0300;
pub(crate) const RAM: u32 = 0x2000_0000;

pub(crate) const US: u64 = 1_000;
pub(crate) const MS: u64 = 1_000_000;

#[derive(Debug)]
pub(crate) struct Bench {
    pub(crate) part: Nrf52840,
}

impl Store for Bench {}

impl Board for Bench {
    fn name(&self) -> &'static str {
        "bench"
    }
    fn target_names(&self) -> Vec<&'static str> {
        vec!["nrf52840"]
    }
    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.part)
    }
    fn targets(&mut self) -> Vec<Target<'_>> {
        let core: CoreSpec = self.part.core_spec(NonZeroU64::new(64_000_000).unwrap());
        vec![Target::new("nrf52840", &mut self.part, core)]
    }
}

/// Memory, and the interrupt lines that are high.
#[derive(Debug)]
struct World {
    flash: Vec<u8>,
    uicr: Vec<u8>,
    ram: Vec<u8>,
    lines: BTreeSet<u16>,
    restarts: u32,
}

impl World {
    fn bytes(&mut self, address: u64, width: Width) -> Result<&mut [u8], Error> {
        let (bytes, base) = match address {
            0..0x10_0000 => (&mut self.flash, 0),
            0x1000_1000..0x1000_2000 => (&mut self.uicr, 0x1000_1000),
            0x2000_0000..0x2004_0000 => (&mut self.ram, 0x2000_0000),
            _ => return Err(Error::Memory { address, width }),
        };
        let from = (address - base) as usize;
        Ok(&mut bytes[from..from + width.bytes() as usize])
    }
}

impl Memory for World {
    fn read(&mut self, address: u64, width: Width) -> Result<u64, Error> {
        let bytes = self.bytes(address, width)?;
        Ok(bytes.iter().rev().fold(0, |word, &byte| word << 8 | u64::from(byte)))
    }
    fn write(&mut self, address: u64, width: Width, value: u64) -> Result<(), Error> {
        let bytes = self.bytes(address, width)?;
        let n = bytes.len();
        bytes.copy_from_slice(&value.to_le_bytes()[..n]);
        Ok(())
    }
    fn program(&mut self, address: u64, width: Width, value: u64) -> Result<(), Error> {
        self.write(address, width, value)
    }
}

impl Host for World {
    fn set_interrupt(&mut self, line: InterruptLine, level: Level) {
        if level == Level::High {
            self.lines.insert(line.index());
        } else {
            self.lines.remove(&line.index());
        }
    }
    fn request_reset(&mut self) {
        self.restarts += 1;
    }
}

pub(crate) struct Rig {
    pub(crate) session: Session<Bench>,
    world: World,
    pub(crate) now: u64,
}

impl Rig {
    pub(crate) fn new() -> Self {
        Self::with(Settings { hfint_ppb: 0, ..Settings::default() })
    }

    pub(crate) fn with(settings: Settings) -> Self {
        Self::of(Nrf52840::new(settings))
    }

    pub(crate) fn of(part: Nrf52840) -> Self {
        let session = Session::new(Box::new(Bench { part }), 0, NO_DEADLINE).expect("the description holds");
        let world = World {
            flash: vec![0xFF; 1 << 20],
            uicr: vec![0xFF; 0x1000],
            ram: vec![0; 256 << 10],
            lines: BTreeSet::new(),
            restarts: 0,
        };
        Self { session, world, now: 0 }
    }

    pub(crate) fn part(&mut self) -> &mut Nrf52840 {
        &mut self.session.board_mut().part
    }

    fn access(&mut self, kind: AccessKind, address: u32, width: Width, value: u32) -> u32 {
        let mut access = Access::new(kind, u64::from(address), width, u64::from(value));
        access.virtual_time = VirtualNanos(self.now);
        access.program_counter = Some(0x1000);
        self.session.access(access, &mut self.world).0 as u32
    }

    pub(crate) fn write(&mut self, address: u32, value: u32) {
        self.access(AccessKind::Write, address, Width::W32, value);
    }

    /// A write, and whether the bus failed it.
    pub(crate) fn try_write(&mut self, address: u32, width: Width, value: u32) -> bool {
        self.access(AccessKind::Write, address, width, value);
        !self.session.take_failure()
    }

    pub(crate) fn read(&mut self, address: u32) -> u32 {
        self.access(AccessKind::Read, address, Width::W32, 0)
    }

    pub(crate) fn write_all(&mut self, writes: &[(u32, u32)]) {
        for &(address, value) in writes {
            self.write(address, value);
        }
    }

    /// The next instant at which the models want control.
    pub(crate) fn deadline(&mut self) -> u64 {
        self.session.next_deadline().0
    }

    /// Lets time pass until `at`, stopping wherever the models ask to.
    pub(crate) fn run_to(&mut self, at: u64) {
        assert!(at >= self.now, "time goes forward");
        loop {
            let deadline = self.deadline();
            if deadline > at {
                break;
            }
            self.now = self.now.max(deadline);
            let stop = Stop { at: VirtualNanos(self.now), instruction_count: 0, reason: StopReason::Deadline };
            self.session.stop(stop, &mut self.world);
        }
        self.now = at;
    }

    pub(crate) fn run_for(&mut self, ns: u64) {
        self.run_to(self.now + ns);
    }

    /// Lets time pass until `address` reads something else than 0, and answers when that was.
    pub(crate) fn run_until_set(&mut self, address: u32, limit: u64) -> u64 {
        while self.read(address) == 0 {
            let deadline = self.deadline();
            assert!(deadline <= limit, "{address:#x} is still 0 at {limit} ns");
            self.run_to(deadline);
        }
        self.now
    }

    /// Something outside the part happens now.
    pub(crate) fn input<T>(&mut self, input: impl FnOnce(&mut Nrf52840, VirtualNanos) -> T) -> T {
        self.input_with_memory(|part, _, at| input(part, at))
    }

    pub(crate) fn input_with_memory<T>(
        &mut self,
        input: impl FnOnce(&mut Nrf52840, &mut dyn Memory, VirtualNanos) -> T,
    ) -> T {
        let at = VirtualNanos(self.now);
        let out = input(&mut self.session.board_mut().part, &mut self.world, at);
        self.session.resume(NO_DEADLINE, at, 0, &mut self.world);
        out
    }

    /// The core asks for a system reset (AIRCR.SYSRESETREQ).
    pub(crate) fn core_reset(&mut self) {
        let stop = Stop { at: VirtualNanos(self.now), instruction_count: 0, reason: StopReason::Reset };
        self.session.stop(stop, &mut self.world);
    }

    /// The reset pin is pulled low for a moment.
    pub(crate) fn pin_reset(&mut self) {
        let at = VirtualNanos(self.now);
        self.session.reset_by_pin(at, 0, &mut self.world);
        self.session.resume(NO_DEADLINE, at, 0, &mut self.world);
    }

    /// How often the models restarted the core.
    pub(crate) fn restarts(&self) -> u32 {
        self.world.restarts
    }

    pub(crate) fn line(&self, number: u16) -> bool {
        self.world.lines.contains(&number)
    }

    pub(crate) fn lines(&self) -> usize {
        self.world.lines.len()
    }

    pub(crate) fn ram(&self, address: u32, len: usize) -> &[u8] {
        let from = (address - RAM) as usize;
        &self.world.ram[from..from + len]
    }

    pub(crate) fn fill(&mut self, address: u32, bytes: &[u8]) {
        let from = (address - RAM) as usize;
        self.world.ram[from..from + bytes.len()].copy_from_slice(bytes);
    }

    pub(crate) fn flash(&self, address: usize, len: usize) -> &[u8] {
        &self.world.flash[address..address + len]
    }

    pub(crate) fn findings(&mut self, kind: FindingKind) -> Vec<Finding> {
        self.part().findings().iter().filter(|found| found.kind == kind).copied().collect()
    }

    /// Nothing was reported, by the part or by the session.
    pub(crate) fn assert_clean(&mut self) {
        let findings = self.part().findings();
        assert!(findings.is_empty(), "{findings:?}");
        assert!(self.session.unmapped().is_empty(), "{:?}", self.session.unmapped());
        assert!(self.session.refused().is_empty(), "{:?}", self.session.refused());
        assert!(self.session.unimplemented().is_empty(), "{:?}", self.session.unimplemented());
        assert!(self.session.undefined().is_empty(), "{:?}", self.session.undefined());
    }
}

/// What a chip saw of its bus, each with its instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Seen {
    Select(u64),
    Byte(u64, u8),
    Deselect(u64),
}

/// A chip that answers each byte with the complement of the one before, 0xA5 first.
#[derive(Debug)]
pub(crate) struct Recorder {
    pub(crate) seen: Vec<Seen>,
    last: u8,
}

impl Recorder {
    pub(crate) fn new() -> Box<Self> {
        Box::new(Self { seen: Vec::new(), last: !0xA5 })
    }
}

impl Store for Recorder {}

impl Peer for Recorder {
    fn transfer(&mut self, mosi: u32, bits: u8, context: &mut Timeline<'_, '_>) -> u32 {
        assert_eq!(bits, 8, "EasyDMA moves bytes");
        let answer = !self.last;
        self.last = mosi as u8;
        self.seen.push(Seen::Byte(context.now().0, mosi as u8));
        u32::from(answer)
    }
    fn select(&mut self, context: &mut Timeline<'_, '_>) {
        self.last = !0xA5;
        self.seen.push(Seen::Select(context.now().0));
    }
    fn deselect(&mut self, context: &mut Timeline<'_, '_>) {
        self.seen.push(Seen::Deselect(context.now().0));
    }
}

/// PSEL's number of a pin.
pub(crate) fn psel(port: u32, n: u32) -> u32 {
    port << 5 | n
}

pub(crate) const SCK: Pin = Pin::p1(15);
pub(crate) const MOSI: Pin = Pin::p1(13);
pub(crate) const MISO: Pin = Pin::p1(14);
pub(crate) const CS: Pin = Pin::p1(12);
