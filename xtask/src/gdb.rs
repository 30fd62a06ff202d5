//! gdb at a board of the running link: the socket; `bench::gdb` is the rest.

use std::net::{Ipv4Addr, TcpListener};
use std::process::ExitCode;

use anyhow::{Context, Result};
use bench::faults::Board as Side;
use bench::gdb::{Ended, serve};
use bench::sim::Outcome;
use clap::Args;

use crate::sim::{self, Screen, SimArgs};
use crate::{Board, workspace};

/// The port that OpenOCD takes, which editors offer by default.
const PORT: u16 = 3333;

/// Runs the link as `sim` does, with the same options, and waits with it for a debugger.
#[derive(Args)]
pub(crate) struct GdbArgs {
    /// The board that the debugger is at; the other goes on in virtual time.
    #[arg(value_enum)]
    board: Board,
    /// The port on 127.0.0.1 to wait at; 0 takes a free one.
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
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, args.port))
            .with_context(|| format!("--port {}: cannot wait there for a debugger", args.port))?;
        let address = listener.local_addr().context("the port that was taken is not known")?;
        let name = args.board.name();
        let image = image.strip_prefix(workspace::root()).unwrap_or(image);
        screen.say(&format!(
            "{name} is halted at power-on and waits at {address}:\n  gdb-multiarch {} -ex 'target remote {address}'",
            image.display()
        ));
        let (connection, _) = listener.accept().context("no debugger came")?;
        // One debugger for one run.
        drop(listener);
        attached(args.board, setup, connection, screen)
    })
}

fn attached(
    board: Board,
    setup: &bench::sim::Setup,
    connection: std::net::TcpStream,
    screen: &mut Screen,
) -> Result<Option<Outcome>> {
    let side = match board {
        Board::Dpr => Side::Dpr,
        Board::Horus => Side::Horus,
    };
    let mut lost = |error| eprintln!("the debugger is gone ({error}); the run goes on without it");
    Ok(match serve(setup, side, connection, screen, &mut lost)? {
        Ended::Finished(outcome) => Some(*outcome),
        Ended::Killed(at) => {
            eprintln!("the debugger ended the run after {:.3} ms", at as f64 / 1e6);
            None
        }
    })
}
