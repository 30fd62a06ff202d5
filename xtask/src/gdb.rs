//! A debugger at a board of the running link.

use std::net::TcpStream;
use std::process::ExitCode;

use anyhow::Result;
use bench::faults::Board as Side;
use bench::gdb::serve;
use bench::sim::Outcome;
use clap::Args;
use emulator_gdb::{Ended, PORT, say_killed, say_lost, wait};

use crate::Board;
use crate::sim::{self, Screen, SimArgs};

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
        let connection = wait(args.port, args.board.name(), image, &mut |text| screen.say(text))?;
        attached(args.board, setup, connection, screen)
    })
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
    Ok(match serve(setup, side, Box::new(connection), screen, &mut |error| say_lost(&error))? {
        Ended::Finished(outcome) => Some(*outcome),
        Ended::Killed(at) => {
            say_killed(at);
            None
        }
    })
}
