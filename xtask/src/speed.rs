//! Measures the speed of the bench: that of the core alone, and how the time of a run of the link is divided.

use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use bench::sim::{Crystals, Images, Setup, speed::Speed};
use clap::Args;

use crate::{Receivers, firmware, workspace};

/// How long the link runs before the measurement begins, ns: the start of the firmwares is negligible in longer runs.
const WARM_UP_NS: u64 = 1_000_000_000;

/// The longest time that a virtual second of the link may take, in times of the yardstick of [`bench::sim::speed`], a
/// fixed piece of work. When the bound was set, it took 3.8 times the yardstick; seven measurements, three of them
/// beside other work, gave 3.78 to 3.85.
const MOST_YARDSTICKS: f64 = 4.2;

/// Reports instructions per second of the core alone, where the time of `sim` goes, the time of a copy of it, and the
/// time of a virtual second in times of a fixed piece of work (the yardstick).
///
/// Core: the loops of cortex-m4's example `speed` for half a second each: one computes, one polls a register of a
/// device. Memory and the device are a few lines; there are no part models.
///
/// Link: both images on one thread on the fast clock, after their first second, the least processor time of five runs.
/// The time of an instruction in the computing loop, times the instructions that each core executed, is the cores'
/// share. The rest is only measured as a whole: the cores' cost of accesses, interrupts and memory protection beyond
/// that loop, part models, front ends, air and the surroundings of the boards. A profiler shows the shares of single
/// functions: `valgrind --tool=callgrind target/debug/xtask sim --threads 1`.
#[derive(Args)]
pub(crate) struct SpeedArgs {
    /// Virtual time of the link to measure, in seconds.
    #[arg(long, default_value_t = 5.0, value_parser = crate::sim::positive_seconds)]
    seconds: f64,
}

pub(crate) fn speed(args: &SpeedArgs) -> Result<ExitCode> {
    println!("The core alone:");
    let per_instruction = core_alone()?;
    let measured = link(args.seconds)?;
    let whole = measured.seconds * 1e3;
    println!("\nThe link on one thread, for each virtual second:");
    println!("  {whole:6.2} ms in all, {:.0} x real time", 1e3 / whole);
    let mut rest = whole;
    for (board, count) in [("HORUS", measured.horus), ("DPR", measured.dpr)] {
        let millions = count / 1e6;
        let share = millions * per_instruction;
        rest -= share;
        let percent = 100.0 * share / whole;
        println!("  {share:6.2} ms ({percent:2.0} %) the {board} core: {millions:.2} million instructions");
    }
    println!(
        "  {rest:6.2} ms ({:2.0} %) the cores' accesses, part models, front ends, air, surroundings",
        100.0 * rest / whole
    );
    println!("\nA copy of the whole bench: {:.3} ms", measured.copy * 1e3);
    println!("A virtual second takes {:.2} times the yardstick, of {MOST_YARDSTICKS} allowed", measured.yardsticks());
    Ok(ExitCode::SUCCESS)
}

fn link(seconds: f64) -> Result<Speed> {
    let (horus, dpr) = firmware::build_pair(Receivers::DEFAULT)?;
    let duration_ns = WARM_UP_NS + (seconds * 1e9).round() as u64;
    let setup = Setup::new(Images { horus, dpr }, Receivers::DEFAULT.0, duration_ns);
    let setup = Setup { crystals: Crystals::default(), ..setup };
    Ok(bench::sim::speed::speed(&setup, WARM_UP_NS)?)
}

pub(crate) fn check() -> Result<()> {
    let yardsticks = link(2.0)?.yardsticks();
    println!("a virtual second of the link takes {yardsticks:.2} times the yardstick, of {MOST_YARDSTICKS} allowed");
    ensure!(yardsticks <= MOST_YARDSTICKS, "the bench has become slower: see `cargo xtask speed`");
    Ok(())
}

/// Runs the example `speed` of the core's crate. Returns the time of an instruction in its computing loop on the fast
/// clock, ns.
fn core_alone() -> Result<f64> {
    let mut cargo = workspace::cargo();
    cargo.args(["run", "--quiet", "--package", "cortex-m4", "--example", "speed"]);
    let output = cargo.stderr(std::process::Stdio::inherit()).output().context("cargo did not start")?;
    if !output.status.success() {
        bail!("the core's example failed ({})", output.status);
    }
    let text = String::from_utf8_lossy(&output.stdout);
    for line in text.lines() {
        println!("  {line}");
    }
    per_instruction(&text).context("the core's example did not say how fast it is")
}

fn per_instruction(text: &str) -> Option<f64> {
    text.lines().find_map(|line| {
        let mut words = line.split_whitespace();
        (words.next() == Some("compute") && words.next() == Some("fast")).then_some(())?;
        words.next()?.parse::<f64>().ok().map(|millions| 1e3 / millions)
    })
}

#[cfg(test)]
mod tests {
    use super::per_instruction;

    #[test]
    fn the_instruction_time_is_read_from_the_fast_clocks_line() {
        let text = "compute  optimistic   100 M/s, 1.2 cycles\ncompute  fast          250 M/s, 1.37 cycles\n";
        assert_eq!(per_instruction(text), Some(4.0));
        assert_eq!(per_instruction("polling  fast  250 M/s"), None);
    }
}
