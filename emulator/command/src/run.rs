//! Runs a firmware as the options say.

use std::cell::RefCell;
use std::io::stdout;
use std::path::Path;
use std::time::Instant;

use anyhow::{Result, bail, ensure};
use emulator_gdb::{Ended, World, say_killed, say_lost, serve, wait};
use emulator_node::{Event, Firmware, Limits, Target};

use crate::options::{Leads, Options, leads};
use crate::output::{Output, milliseconds, pad_text};
use crate::script::Script;
use crate::session::Session;
use crate::trace::PartTrace;
use crate::verdict::{linked_elsewhere, said_nothing, summary, verdict};

/// The interval, virtual ns, at which a run with a trace reads which interrupt handlers the core has executed.
const TRACE_STEP: u64 = 1_000_000;

/// Runs the ELF file `elf` on a microcontroller. `board` is what the user calls it. The firmware's output and the
/// answers of a script go to standard output, and everything else to standard error.
///
/// Returns the run's status, 0 if the run has passed. With a script the status is 0 or 1. Without a script it is that
/// of [`emulator_node::Outcome::status`], except that a run with findings never has status 0.
///
/// # Errors
///
/// Fails if a file cannot be read or written, if the file is no firmware for this microcontroller, or if an option or a
/// line of the script is wrong.
pub fn run(target: Target, board: &str, elf: &Path, options: &Options) -> Result<u32> {
    let firmware = Firmware::read(elf)?;
    if let Some(error) = linked_elsewhere(target, &firmware) {
        bail!(error);
    }
    let is_input = |path: &str| path.ends_with("=-");
    ensure!(
        options.script.as_ref().is_none_or(|path| path.as_os_str() != "-")
            || !options.uart_in.iter().any(|lead| is_input(lead)),
        "--script and --uart-in cannot both read standard input"
    );
    let Leads { mut connected, files, shown, printed } = leads(options, target)?;
    let seconds = options.seconds.unwrap_or(options.limit);
    let mut limits = Limits { virtual_time: (seconds * 1e9) as u64, ..Limits::default() };
    if options.script.is_some() {
        limits.virtual_time = u64::MAX;
        connected.listened.extend(target.pins().all());
    }
    if options.trace.is_some() {
        limits.step = TRACE_STEP;
        connected.watched.extend(target.pins().all());
    }
    let output = RefCell::new(Output::new(stdout()));
    let files = RefCell::new(files);
    let mut event = |event: Event<'_>| match event {
        Event::Line(line) => output.borrow_mut().line(line),
        Event::Finding(finding) => eprintln!("{finding}"),
        Event::Reset(reset) => eprintln!("{:>14.6} ms  the part restarted {}", milliseconds(reset.at), reset.why()),
        Event::Pin(edge) if shown.contains(&edge.pin) => {
            let (name, does) = (target.pins().name(edge.pin), pad_text(edge.pad));
            output.borrow_mut().text(format_args!("{:>14.6} ms  {name} {does}", milliseconds(edge.at)));
        }
        Event::Pin(_) | Event::Driven(_) => {}
        Event::Byte(sent) => {
            if !files.borrow_mut().take(sent.pin, sent.byte) && printed.contains(&sent.pin) {
                output.borrow_mut().byte(sent);
            }
        }
    };
    let mut say = |text: &str| output.borrow_mut().text(format_args!("{text}"));
    let began = Instant::now();
    let mut run = target.start(options.clock, &firmware, connected, limits)?;
    let script = options.script.as_deref().map(|path| Script::open(path, target, run.as_mut())).transpose()?;
    let trace = options.trace.as_deref().map(|path| PartTrace::create(path, run.node())).transpose()?;
    let mut session = Session::new(run, options.seconds.is_some(), &mut event, &mut say);
    (session.script, session.trace) = (script, trace);
    if options.gdb {
        session.node().halt_at_end(true);
        let connection = wait(options.port, board, elf, &mut |text| eprintln!("{text}"))?;
        session = match serve(session, connection, &mut |error| say_lost(&error))? {
            Ended::Finished(session) => *session,
            Ended::Killed(at) => {
                say_killed(at);
                return Ok(1);
            }
        };
    } else {
        while !session.is_over() {
            session.go()?;
        }
    }
    let (outcome, scripted) = session.finish()?;
    output.borrow_mut().finish();
    files.into_inner().finish()?;
    eprintln!("{}", summary(&outcome, options.clock));
    // With a debugger the run waits for the user, so its duration does not show the speed of this machine.
    if !options.gdb {
        let seconds = began.elapsed().as_secs_f64();
        eprintln!("{:.0} million instructions a second of this machine", outcome.instructions as f64 / 1e6 / seconds);
    }
    if options.script.is_none()
        && options.uart.is_empty()
        && let Some(hint) = said_nothing(&firmware, &outcome)
    {
        eprintln!("{hint}");
    }
    let (says, status) = match scripted {
        Some(Ok(())) => (None, 0),
        Some(Err(failed)) => (Some(format!("error: {failed}")), 1),
        None => verdict(options.seconds, options.limit, &outcome),
    };
    if let Some(says) = says {
        eprintln!("{says}");
    }
    Ok(status)
}
