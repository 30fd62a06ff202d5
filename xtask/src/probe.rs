//! Handles real boards through the probe-rs library: writes and verifies a program, shows its log, runs a test suite.
//!
//! The board determines the chip. `--probe` names the probe, unless only one is connected. Otherwise the command fails,
//! so that it does not write to the wrong board.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use defmt_decoder::{DecodeError, StreamDecoder, Table};
use indicatif::{ProgressBar, ProgressStyle};
use object::{Object, ObjectSymbol};
use probe_rs::architecture::arm::dp::DpAddress;
use probe_rs::architecture::arm::sequences::DefaultArmSequence;
use probe_rs::architecture::arm::{ArmError, FullyQualifiedApAddress};
use probe_rs::flashing::{
    DownloadOptions, FileDownloadError, FlashError, FlashProgress, ProgressEvent, ProgressOperation,
    download_file_with_options, image_format,
};
use probe_rs::probe::cmsisdap::CmsisDapFactory;
use probe_rs::probe::jlink::JLinkFactory;
use probe_rs::probe::list::Lister;
use probe_rs::probe::{DebugProbeInfo, DebugProbeSelector, Probe, ProbeFactory, WireProtocol};
use probe_rs::rtt::Rtt;
use probe_rs::semihosting::SemihostingCommand;
use probe_rs::{
    BreakpointCause, Core, CoreStatus, HaltReason, MemoryInterface, Permissions, RegisterId, Session,
    VectorCatchCondition,
};

use crate::access::{
    Approtect, HW_DISABLED, Refusal, Seen, UICR_APPROTECT, VARIANT, chip, connection, explain, wrong_chip,
};
use crate::bench_flash;
use crate::bench_probe::BenchBoard;
use crate::{Board, FlashArgs, Image, ProbeArgs, firmware};

use watchdog::Feeding;

const CORE_TIMEOUT: Duration = Duration::from_secs(1);

/// The number by which DCRSR selects LR (ARMv7-M ARM C1.6.3).
const LR: RegisterId = RegisterId(14);
/// The number of xPSR in DCRSR.
const XPSR: RegisterId = RegisterId(16);
/// The number of MSP in DCRSR.
const MSP: RegisterId = RegisterId(17);
/// The number of PSP in DCRSR.
const PSP: RegisterId = RegisterId(18);

/// The interval at which the log is read. A firmware needs far longer to fill the buffer of 1 KiB.
const LOG_POLL: Duration = Duration::from_millis(10);

const LOG_START: Duration = Duration::from_secs(3);

const BENCH_LOG: f64 = 1.0;

#[derive(Debug)]
enum Found {
    Usb(DebugProbeInfo),
    Bench(BenchBoard),
}

impl std::fmt::Display for Found {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Usb(info) => info.fmt(f),
            Self::Bench(_) => f.write_str("the bench's probe"),
        }
    }
}

#[derive(Debug)]
enum Span<'a> {
    Endless,
    Wall(Instant, Duration),
    Virtual(&'a BenchBoard, u64),
}

impl<'a> Span<'a> {
    fn of(found: &'a Found, seconds: Option<f64>) -> Self {
        match (found, seconds) {
            (Found::Usb(_), None) => Self::Endless,
            (Found::Usb(_), Some(seconds)) => Self::Wall(Instant::now(), Duration::from_secs_f64(seconds)),
            (Found::Bench(board), seconds) => {
                Self::Virtual(board, board.now() + (seconds.unwrap_or(BENCH_LOG) * 1e9) as u64)
            }
        }
    }

    fn is_over(&self) -> bool {
        match self {
            Self::Endless => false,
            Self::Wall(since, length) => since.elapsed() >= *length,
            Self::Virtual(board, end) => board.now() >= *end,
        }
    }
}

pub(crate) fn flash(args: &FlashArgs) -> Result<ExitCode> {
    if args.hold && args.image != Image::Dpr {
        bail!("--hold is an option of the DPR's image: `cargo xtask flash dpr --hold`");
    }
    // Without a probe a build would be useless, so the probe is chosen first.
    let probe = choose(args.image.board(), &args.probe)?;
    if args.image == Image::Hold && matches!(probe, Found::Bench(_)) {
        bail!("the bench's probe has the boards dpr and horus; `cargo xtask sim --hold` runs the hold");
    }
    let elf = match args.image {
        Image::Hold => firmware::build_hold()?,
        Image::Dpr if args.hold => firmware::build_dpr_with_hold(args.gps)?,
        image => firmware::build(image.board(), args.gps)?,
    };
    flash_elf(args, &probe, &elf)
}

fn flash_elf(args: &FlashArgs, probe: &Found, elf: &Path) -> Result<ExitCode> {
    let (mut session, feeding) = attach(args.image.board(), probe, &args.probe)?;
    write(&mut session, elf)?;
    if args.image == Image::Horus {
        set_brown_out_level(&mut session).context("could not set the brown-out level")?;
    }
    let how_long = match (probe, args.seconds) {
        (Found::Usb(_), None) => "its log follows (Ctrl-C ends it)".to_owned(),
        (_, seconds) => format!("{} s of its log follow", seconds.unwrap_or(BENCH_LOG)),
    };
    eprintln!("{} written and verified; {how_long}", elf.display());
    if let Found::Bench(board) = probe {
        board.save()?;
    }
    let code = follow((&mut session, &feeding), elf, &Span::of(probe, args.seconds), Follow::Firmware)?;
    drop(session);
    Ok(if say_findings(probe) { ExitCode::FAILURE } else { code })
}

/// Prints the errors that the bench has found on its board. Returns whether there were any.
fn say_findings(probe: &Found) -> bool {
    let Found::Bench(board) = probe else { return false };
    let found = board.take_findings();
    found.iter().for_each(|finding| eprintln!("{finding}"));
    !found.is_empty()
}

pub(crate) fn run(board: Board, elf: &Path, args: &ProbeArgs) -> Result<ExitCode> {
    let probe = choose(board, args)?;
    let (mut session, feeding) = attach(board, &probe, args)?;
    write(&mut session, elf)?;
    let code = follow((&mut session, &feeding), elf, &Span::Endless, Follow::Suite)?;
    drop(session);
    Ok(if say_findings(&probe) { ExitCode::FAILURE } else { code })
}

fn choose(board: Board, args: &ProbeArgs) -> Result<Found> {
    let on_bench = match args.probe.as_deref() {
        Some("bench") => Some(board),
        Some("bench:dpr") => Some(Board::Dpr),
        Some("bench:horus") => Some(Board::Horus),
        _ => None,
    };
    match on_bench {
        Some(board) => Ok(Found::Bench(BenchBoard::switch_on(board, bench_flash::file(board))?)),
        None => choose_usb(board, args, &Lister::new()).map(Found::Usb),
    }
}

fn choose_usb(board: Board, args: &ProbeArgs, lister: &Lister) -> Result<DebugProbeInfo> {
    let (mut found, wanted) = match &args.probe {
        None => (lister.list_all(), None),
        Some(text) => {
            let selector: DebugProbeSelector = text
                .parse()
                .with_context(|| format!("--probe {text}: expected VID:PID or VID:PID:SERIAL, in hex, or bench"))?;
            (lister.list(Some(&selector)), Some(text))
        }
    };
    match (found.len(), wanted) {
        (1, _) => Ok(found.remove(0)),
        (0, None) => bail!("no debug probe found: {}", connection(board)),
        (0, Some(text)) => bail!("no debug probe matches {text}: {}{}", connection(board), listing(&lister.list_all())),
        (_, _) => bail!("more than one debug probe matches: name one with --probe VID:PID:SERIAL{}", listing(&found)),
    }
}

fn listing(probes: &[DebugProbeInfo]) -> String {
    probes.iter().map(|probe| format!("\n  {probe}")).collect()
}

fn attach(board: Board, probe: &Found, args: &ProbeArgs) -> Result<(Session, Feeding)> {
    // The probe library does not check the part: it would take an STM32 without access port 1 for a locked nRF52840.
    if let Some(wrong) = look(probe, args)?.and_then(|seen| wrong_chip(board, seen, &probe.to_string())) {
        bail!(wrong);
    }
    let (opened, khz, feeding) = open(probe, args)?;
    if board == Board::Horus {
        feeding.end();
    }
    if let Some(khz) = khz {
        eprintln!("SWD at {khz} kHz");
    }
    eprintln!("{} through {probe}", chip(board));
    let permissions = if args.erase_all { Permissions::new().allow_erase_all() } else { Permissions::new() };
    let mut session = opened.attach(watchdog::target(board)?, permissions).map_err(|error| {
        let explanation = explain(refusal(&error, args.erase_all), board, &probe.to_string());
        anyhow::Error::new(error).context(explanation)
    })?;
    if board == Board::Dpr {
        keep_debug_port_open(&mut session).context("could not see to UICR.APPROTECT")?;
    }
    Ok((session, feeding))
}

/// Opens the probe. Returns the probe, the requested SWD clock in kHz, and the handle that ends the feeding of an
/// nRF52840's watchdog.
fn open(probe: &Found, args: &ProbeArgs) -> Result<(Probe, Option<u32>, Feeding)> {
    let opened = match probe {
        Found::Usb(info) => {
            // With these probes the library makes single transfers, between which the watchdog can be fed.
            let drivers: [&dyn ProbeFactory; 2] = [&JLinkFactory, &CmsisDapFactory];
            let selector = DebugProbeSelector::from(info);
            drivers.into_iter().find_map(|driver| driver.open(&selector).ok())
        }
        Found::Bench(board) => Some(board.probe()),
    };
    let (mut opened, feeding) = match (opened, probe) {
        (Some(opened), _) => {
            let (opened, feeding) = watchdog::fed(opened);
            (Probe::from_specific_probe(opened), feeding)
        }
        (None, Found::Usb(info)) => {
            let opened =
                info.open().with_context(|| format!("could not open {probe}: is another debugger using it?"))?;
            (opened, Feeding::default())
        }
        (None, Found::Bench(_)) => unreachable!("the bench's probe is always there"),
    };
    opened.select_protocol(WireProtocol::Swd).context("the probe does not speak SWD")?;
    let khz = args.speed.map(|khz| opened.set_speed(khz).with_context(|| format!("the probe does not do {khz} kHz")));
    Ok((opened, khz.transpose()?, feeding))
}

/// Identifies the part at the probe by its identification registers, without disturbing it. Returns `None` if no debug
/// port answers; the library reports that when it attaches.
fn look(probe: &Found, args: &ProbeArgs) -> Result<Option<Seen>> {
    /// The address of IDR of an access port, in its bank 2 (ADIv5.2, C1.3).
    const IDR: u64 = 0xFC;
    /// The bits of IDR that hold the JEP106 number of the access port's designer.
    const DESIGNER: u32 = 0x0FFE_0000;
    /// The value of [`DESIGNER`] in Nordic's access ports: the JEP106 number 0x44 (PS v1.7, 4.8.1).
    const NORDIC: u32 = 0x0288_0000;
    const DBGMCU_IDCODE: u64 = 0xE004_2000;
    const INFO_PART: u64 = 0x1000_0100;

    let (mut opened, _, feeding) = open(probe, args)?;
    feeding.end();
    if opened.attach_to_unspecified().is_err() {
        return Ok(None);
    }
    let Ok(mut port) = opened.try_into_arm_debug_interface(DefaultArmSequence::create()) else { return Ok(None) };
    if port.select_debug_port(DpAddress::Default).is_err() {
        return Ok(None);
    }
    let ap = FullyQualifiedApAddress::v1_with_default_dp;
    let control = port.read_raw_ap_register(&ap(1), IDR).unwrap_or(0);
    let mut word = |address| port.memory_interface(&ap(0)).and_then(|mut memory| memory.read_word_32(address)).ok();
    Ok(Some(if control & DESIGNER == NORDIC {
        Seen::Nordic(word(INFO_PART))
    } else {
        word(DBGMCU_IDCODE).map_or(Seen::Other, |code| Seen::St(code & 0xFFF))
    }))
}

/// Returns the meaning of an error of the library's `attach`. `erase_all` states whether the library was permitted to
/// erase everything.
fn refusal(error: &probe_rs::Error, erase_all: bool) -> Refusal {
    match error {
        probe_rs::Error::MissingPermissions(_) | probe_rs::Error::Arm(ArmError::MissingPermissions(_)) => {
            Refusal::Locked
        }
        // `attach` ends with this error only if it could not unlock an nRF52840.
        probe_rs::Error::Arm(ArmError::DebugSequence(_)) if erase_all => Refusal::StaysLocked,
        _ => Refusal::NoAnswer,
    }
}

/// Programs UICR.APPROTECT of an nRF52840 that would otherwise be locked after the next power-on.
///
/// The NVMC programs only this word (PS v1.7, NVMC). The library would first erase all of UICR, with the settings of
/// the reset pin and the regulator.
fn keep_debug_port_open(session: &mut Session) -> Result<()> {
    const NVMC_READY: u64 = 0x4001_E400;
    const NVMC_CONFIG: u64 = 0x4001_E504;
    const READ_ONLY: u32 = 0;
    const WRITE: u32 = 1;
    // Programming a word takes the NVMC 41 us (PS v1.7, NVMC, electrical specification). A single reading of the NVMC's
    // state through the probe takes longer.
    const LOOKS: usize = 1_000;

    let mut core = session.core(0).context("could not reach the core")?;
    // The core is halted, so that the firmware does not use the NVMC at the same time.
    core.halt(CORE_TIMEOUT).context("the core does not halt")?;
    match Approtect::of(core.read_word_32(VARIANT)?, core.read_word_32(UICR_APPROTECT)?) {
        Approtect::Leave => return Ok(()),
        Approtect::WillLock => {
            eprintln!(
                "warning: UICR.APPROTECT locks this board's debug port at the next power-on; only erasing undoes it"
            );
            return Ok(());
        }
        Approtect::Program => {}
    }
    core.write_word_32(NVMC_CONFIG, WRITE)?;
    let written = core.write_word_32(UICR_APPROTECT, HW_DISABLED);
    let ready = (0..LOOKS).any(|_| core.read_word_32(NVMC_READY).is_ok_and(|ready| ready & 1 == 1));
    core.write_word_32(NVMC_CONFIG, READ_ONLY)?;
    written?;
    if !ready || core.read_word_32(UICR_APPROTECT)? != HW_DISABLED {
        bail!("it does not take the value that keeps the debug port open");
    }
    eprintln!("UICR.APPROTECT programmed: the debug port will open after a power-on too");
    Ok(())
}

/// Programs brown-out level 3 into the option bytes of HORUS's STM32F429. Without that level the firmware stops at its
/// start. The other option bytes keep their values (RM0090, "Option bytes"). The level takes effect at the next reset.
fn set_brown_out_level(session: &mut Session) -> Result<()> {
    const OPTKEYR: u64 = 0x4002_3C08;
    const KEYS: [u32; 2] = [0x0819_2A3B, 0x4C5D_6E7F];
    const SR: u64 = 0x4002_3C0C;
    const BSY: u32 = 1 << 16;
    const OPTCR: u64 = 0x4002_3C14;
    const OPTLOCK: u32 = 1 << 0;
    const OPTSTRT: u32 = 1 << 1;
    const BOR_LEV: u32 = 3 << 2;
    // Erasing and programming the option bytes takes as long as for a sector: 0.8 s at most (DS9405, "Flash memory
    // characteristics"). Reading the register once through the probe takes at least 50 us.
    const LOOKS: usize = 50_000;

    let mut core = session.core(0).context("could not reach the core")?;
    // The core is halted before the new program begins, so that no program uses the flash interface at the same time.
    core.reset_and_halt(CORE_TIMEOUT).context("the core does not halt")?;
    let options = core.read_word_32(OPTCR)?;
    let level = options & BOR_LEV;
    if level == 0 {
        eprintln!("brown-out level 3 is set: the part resets below 2.7 V");
        return Ok(());
    }
    let now = ["3", "2", "1", "off"][(level >> 2) as usize];
    eprintln!(
        "the brown-out level in the option bytes is {now}: programming level 3, so that the part resets below 2.7 V"
    );
    for key in KEYS {
        core.write_word_32(OPTKEYR, key)?;
    }
    let wanted = options & !(BOR_LEV | OPTLOCK | OPTSTRT);
    core.write_word_32(OPTCR, wanted)?;
    core.write_word_32(OPTCR, wanted | OPTSTRT)?;
    let is_done = |core: &mut Core<'_>| core.read_word_32(SR).is_ok_and(|status| status & BSY == 0);
    let done = (0..LOOKS).any(|_| is_done(&mut core));
    core.write_word_32(OPTCR, wanted | OPTLOCK)?;
    // A reset loads the option bytes, which only then take effect. Before it the register may hold other values.
    core.reset_and_halt(CORE_TIMEOUT).context("the core does not halt")?;
    let loaded = core.read_word_32(OPTCR)?;
    if !done || loaded & BOR_LEV != 0 {
        bail!("the option bytes do not take it: OPTCR is {loaded:#010x} after a reset");
    }
    Ok(())
}

fn write(session: &mut Session, elf: &Path) -> Result<()> {
    let bar = ProgressBar::new(0).with_style(
        ProgressStyle::with_template("{msg:>9} [{bar:40}] {bytes}/{total_bytes}").expect("a constant template"),
    );
    let shown = bar.clone();
    // Before it writes, probe-rs announces each step with its size. Then it begins the steps one by one.
    let mut totals = BTreeMap::new();
    let progress = FlashProgress::new(move |event| match event {
        ProgressEvent::AddProgressBar { operation, total } => {
            totals.insert(verb(&operation), total.unwrap_or(0));
        }
        ProgressEvent::Started(operation) => {
            let verb = verb(&operation);
            shown.set_length(totals.get(verb).copied().unwrap_or(0));
            shown.set_position(0);
            shown.set_message(verb);
        }
        ProgressEvent::Progress { size, .. } => shown.inc(size),
        ProgressEvent::DiagnosticMessage { message } => shown.println(message),
        _ => {}
    });
    let mut options = DownloadOptions::default();
    options.progress = progress;
    options.verify = true;
    let loader = image_format("elf").context("the probe library reads no ELF")?.create_loader(None);
    let outcome = download_file_with_options(session, elf, loader, options);
    bar.finish_and_clear();
    outcome.map_err(|error| {
        let text = not_written(&error, elf);
        anyhow::Error::new(error).context(text)
    })
}

fn not_written(error: &FileDownloadError, elf: &Path) -> String {
    let elf = elf.display();
    match error {
        FileDownloadError::Flash(FlashError::Verify) => format!(
            "{elf} was written, but flash does not hold it: the board must not be used like this\n\
             If that happens again, the part's flash is damaged or worn."
        ),
        _ => format!(
            "{elf} was not written to its end: the board must not be used before the same command has succeeded\n\
             If the probe was unplugged or the board lost its supply, connect them and repeat it."
        ),
    }
}

const fn verb(operation: &ProgressOperation) -> &'static str {
    match operation {
        ProgressOperation::Fill => "reading",
        ProgressOperation::Erase => "erasing",
        ProgressOperation::Program => "writing",
        ProgressOperation::Verify => "verifying",
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Follow {
    /// A firmware that runs for ever, and that handles a HardFault or a restart by itself.
    Firmware,
    /// A test suite, which ends with a semihosting exit. A failure ends with a HardFault (panic-probe). The core halts
    /// there.
    Suite,
}

/// The number of restarts after which a test suite counts as failed, because it would not end.
const MOST_RESTARTS: usize = 10;

/// The address of DHCSR, whose bit S_RESET_ST is set by a reset of the core and cleared by a read (ARMv7-M ARM C1.6.2).
const DHCSR: u64 = 0xE000_EDF0;
const S_RESET_ST: u32 = 1 << 25;

/// The address of CPUID, which is never zero (ARMv7-M ARM B3.2.3).
const CPUID: u64 = 0xE000_ED00;

/// Resets the core and shows its defmt log until the program exits through semihosting, the time is over, or the user
/// interrupts. Returns the exit code. A restart of the part does not end the log.
fn follow(
    (session, feeding): (&mut Session, &Feeding),
    elf: &Path,
    span: &Span<'_>,
    follow: Follow,
) -> Result<ExitCode> {
    let data = std::fs::read(elf).with_context(|| format!("could not read {}", elf.display()))?;
    let table = Table::parse(&data)?.with_context(|| format!("{} carries no defmt log", elf.display()))?;
    let block = rtt_block(&data).with_context(|| format!("{} has no RTT control block", elf.display()))?;
    let mut decoder = table.new_stream_decoder();
    let mut core = session.core(0).context("could not reach the core")?;
    core.reset_and_halt(CORE_TIMEOUT).context("the core does not reset")?;
    // The RAM may have the log's control block of an earlier run.
    core.write_8(block, &[0; 16]).context("could not clear the old log")?;
    // A vector catch of an earlier run may still be set, because not every reset clears it.
    core.disable_vector_catch(VectorCatchCondition::HardFault).context("could not set the vector catch")?;
    if follow == Follow::Suite {
        core.enable_vector_catch(VectorCatchCondition::HardFault).context("could not set the vector catch")?;
    }
    // The reset above must not count as a restart, so its flag is cleared by a read.
    was_reset(&mut core)?;
    core.run().context("the core does not run")?;
    // From now on the program must feed the watchdog.
    feeding.end();
    let mut rtt = attach_log(&mut core, block)?;
    let mut restarts = 0;
    loop {
        let mut restarted = was_reset(&mut core)?;
        let status = core.status().context("lost the core")?;
        // The status is read before the log, so that the log has all lines up to a halt.
        if !restarted {
            match drain(&mut rtt, &mut core, decoder.as_mut()) {
                Ok(()) => {}
                Err(probe_rs::rtt::Error::ReadPointerChanged | probe_rs::rtt::Error::ControlBlockCorrupted(_)) => {
                    restarted = true;
                }
                Err(error) => return Err(error).context("could not read the log"),
            }
        }
        if restarted {
            restarts += 1;
            eprintln!(
                "warning: the part restarted; its log goes on from its new start\n\
                 If the image does not do that itself: a watchdog that the one before it started outlives the reset."
            );
            if follow == Follow::Suite && restarts == MOST_RESTARTS {
                bail!("the part restarted {restarts} times: the suite does not come to its end");
            }
            decoder = table.new_stream_decoder();
            if follow == Follow::Suite && catch_again(&mut core)? {
                // The HardFault came before the vector catch was set again, so that its log is still in the buffer.
                rtt = attach_log(&mut core, block)?;
                drain(&mut rtt, &mut core, decoder.as_mut()).context("could not read the log")?;
                eprintln!("error: the image ended in a HardFault");
                return Ok(ExitCode::FAILURE);
            }
            // The pause is far longer than the start-up code takes to initialise the log's control block.
            std::thread::sleep(LOG_POLL);
            rtt = attach_log(&mut core, block)?;
            continue;
        }
        match status {
            CoreStatus::Halted(HaltReason::Breakpoint(BreakpointCause::Semihosting(command))) => match command {
                SemihostingCommand::ExitSuccess => return Ok(ExitCode::SUCCESS),
                SemihostingCommand::ExitError(details) => {
                    eprintln!("error: the image ended with {details}");
                    return Ok(ExitCode::FAILURE);
                }
                _ => core.run().context("the core does not go on")?,
            },
            // The reason of the halt is ignored, because the library cannot clear those of earlier halts.
            CoreStatus::Halted(_) if follow == Follow::Suite && in_hard_fault(&mut core)? => {
                eprintln!("error: the image ended in a HardFault{}", faulted(&mut core, elf)?);
                return Ok(ExitCode::FAILURE);
            }
            CoreStatus::Halted(reason) => bail!("the core stopped: {reason:?}"),
            CoreStatus::LockedUp => bail!("the core locked up"),
            _ if span.is_over() => return Ok(ExitCode::SUCCESS),
            // The virtual time of the bench's board advances with each access, so that no pause is needed.
            _ if matches!(span, Span::Virtual(..)) => {}
            _ => std::thread::sleep(LOG_POLL),
        }
    }
}

fn was_reset(core: &mut Core<'_>) -> Result<bool> {
    Ok(core.read_word_32(DHCSR).context("lost the core")? & S_RESET_ST != 0)
}

/// Makes the core halt again at a HardFault and at semihosting calls. On an nRF52840 only a soft reset keeps that
/// setting (PS v1.7, 5.3.7.8). Returns whether a HardFault occurred before the setting was made.
fn catch_again(core: &mut Core<'_>) -> Result<bool> {
    // After any reset but a soft one, an nRF52840's debug port is closed until the program opens it. Meanwhile a
    // request to halt is lost, and every read returns zero. CPUID is never zero, so reading it shows when the port is
    // open.
    let since = Instant::now();
    while core.read_word_32(CPUID).context("lost the core")? == 0 {
        if since.elapsed() >= CORE_TIMEOUT {
            bail!("the debug port does not open after the restart");
        }
    }
    core.halt(CORE_TIMEOUT).context("the core does not halt")?;
    core.enable_vector_catch(VectorCatchCondition::HardFault).context("could not set the vector catch")?;
    if in_hard_fault(core)? {
        return Ok(true);
    }
    was_reset(core)?;
    core.run().context("the core does not go on")?;
    Ok(false)
}

/// Whether the halted core is in its HardFault handler (ARMv7-M ARM table B1-4).
fn in_hard_fault(core: &mut Core<'_>) -> Result<bool> {
    const EXCEPTION: u32 = 0x1FF;
    const HARD_FAULT: u32 = 3;
    let status: u32 = core.read_core_reg(XPSR)?;
    Ok(status & EXCEPTION == HARD_FAULT)
}

/// Returns the address of the instruction that the HardFault interrupted, as text. The core must have halted at the
/// first instruction of its HardFault handler.
fn faulted(core: &mut Core<'_>, elf: &Path) -> Result<String> {
    /// Bit 2 of EXC_RETURN, set if the exception's frame is on the process stack (ARMv7-M ARM table B1-8).
    const PROCESS_STACK: u32 = 1 << 2;
    const RETURN_ADDRESS: u64 = 24;
    let returns: u32 = core.read_core_reg(LR)?;
    let stack: u32 = core.read_core_reg(if returns & PROCESS_STACK != 0 { PSP } else { MSP })?;
    // A wrong stack pointer may have caused the fault, so that the read fails.
    let Ok(pc) = core.read_word_32(u64::from(stack) + RETURN_ADDRESS) else { return Ok(String::new()) };
    let place = emulator_node::Firmware::read(elf)?.place_of(u64::from(pc));
    Ok(place.map_or_else(|| format!(" at {pc:#010x}"), |place| format!(" in {place}")))
}

fn rtt_block(elf: &[u8]) -> Option<u64> {
    let file = object::File::parse(elf).ok()?;
    file.symbols().find(|symbol| symbol.name() == Ok("_SEGGER_RTT")).map(|symbol| symbol.address())
}

fn attach_log(core: &mut Core<'_>, block: u64) -> Result<Rtt> {
    let mut left = LOG_START;
    loop {
        match Rtt::attach_at(core, block) {
            Ok(rtt) => return Ok(rtt),
            Err(error) if left.is_zero() => return Err(error).context("the image set up no log within 3 s"),
            Err(_) => {
                std::thread::sleep(LOG_POLL);
                left = left.saturating_sub(LOG_POLL);
            }
        }
    }
}

fn drain(
    rtt: &mut Rtt,
    core: &mut Core<'_>,
    decoder: &mut (dyn StreamDecoder + Send + Sync + '_),
) -> Result<(), probe_rs::rtt::Error> {
    let channel = rtt.up_channel(0).ok_or(probe_rs::rtt::Error::MissingChannel(0))?;
    let mut buffer = [0; 1024];
    loop {
        let count = channel.read(core, &mut buffer)?;
        if count == 0 {
            return Ok(());
        }
        decoder.received(&buffer[..count]);
        loop {
            match decoder.decode() {
                Ok(frame) => println!("{}", frame.display(true)),
                Err(DecodeError::UnexpectedEof) => break,
                Err(DecodeError::Malformed) => eprintln!("(a damaged log frame: the buffer overran)"),
            }
        }
    }
}

mod watchdog;

#[cfg(test)]
mod on_bench;

#[cfg(test)]
mod tests {
    use super::*;
    use probe_rs::architecture::arm::sequences::ArmDebugSequenceError;

    #[test]
    fn a_locked_part_is_distinguished_from_one_that_does_not_answer() {
        for error in [
            probe_rs::Error::Arm(ArmError::MissingPermissions("erase_all".into())),
            probe_rs::Error::MissingPermissions("erase_all".into()),
        ] {
            assert_eq!(refusal(&error, false), Refusal::Locked);
        }
        for error in [probe_rs::Error::Arm(ArmError::Timeout), probe_rs::Error::Timeout] {
            assert_eq!(refusal(&error, false), Refusal::NoAnswer);
            assert_eq!(refusal(&error, true), Refusal::NoAnswer);
        }
    }

    #[test]
    fn a_failed_unlock_is_reported_as_a_part_that_stays_locked() {
        let failed = ArmDebugSequenceError::SequenceSpecific("Could not unlock core".into());
        let error = probe_rs::Error::Arm(failed.into());
        assert_eq!(refusal(&error, true), Refusal::StaysLocked);
        assert_eq!(refusal(&error, false), Refusal::NoAnswer);
    }
}
