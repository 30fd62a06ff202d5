//! Waits for gdb at a socket, for a board of the running link or one that `run` runs alone. `bench::gdb` serves the
//! connection.

use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use bench::faults::Board as Side;
use bench::gdb::{Ended, serve};
use bench::sim::Outcome;
use clap::Args;

use crate::Board;
use crate::sim::{self, Screen, SimArgs};

/// The default port of OpenOCD and of editors.
pub(crate) const PORT: u16 = 3333;

/// Runs the link as `sim` does, with the same options, and waits with it for a debugger.
#[derive(Args)]
pub(crate) struct GdbArgs {
    /// The board with the debugger; the other continues in virtual time.
    #[arg(value_enum)]
    board: Board,
    /// The port on 127.0.0.1 to wait at; 0 selects a free one.
    #[arg(long, default_value_t = PORT)]
    port: u16,
    #[command(flatten)]
    sim: SimArgs,
}

pub(crate) fn gdb(args: &GdbArgs) -> Result<ExitCode> {
    sim::run(&args.sim, |setup, screen| {
        let image = match args.board {
            Board::Dpr => &setup.images.dpr,
            Board::Horus => &setup.images.horus,
        };
        let connection = wait(args.port, args.board, image, &mut |text| screen.say(text))?;
        attached(args.board, setup, connection, screen)
    })
}

pub(crate) fn wait(port: u16, board: Board, image: &Path, say: &mut dyn FnMut(&str)) -> Result<TcpStream> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))
        .with_context(|| format!("--port {port}: cannot wait there for a debugger"))?;
    let address = listener.local_addr().context("the port that was taken is not known")?;
    let here = std::env::current_dir().unwrap_or_default();
    let image = image.strip_prefix(here).unwrap_or(image);
    say(&format!(
        "{} is halted at power-on and waits at {address}:\n  gdb-multiarch {} -ex 'target remote {address}'",
        board.name(),
        image.display()
    ));
    let (connection, _) = listener.accept().context("no debugger came")?;
    // A run has only one debugger, so the listener is closed here.
    Ok(connection)
}

pub(crate) fn say_lost(error: &str) {
    eprintln!("the debugger is gone ({error}); the run goes on without it");
}

pub(crate) fn say_killed(at: u64) {
    eprintln!("the debugger ended the run after {:.3} ms", at as f64 / 1e6);
}

fn attached(
    board: Board,
    setup: &bench::sim::Setup,
    connection: TcpStream,
    screen: &mut Screen,
) -> Result<Option<Outcome>> {
    let side = match board {
        Board::Dpr => Side::Dpr,
        Board::Horus => Side::Horus,
    };
    Ok(match serve(setup, side, connection, screen, &mut |error| say_lost(&error))? {
        Ended::Finished(outcome) => Some(*outcome),
        Ended::Killed(at) => {
            say_killed(at);
            None
        }
    })
}
