//! Calculates the worst cases of two of the DPR's deadlines as sums: from the last bit to readable, and from the end of
//! a transaction to ready.
//!
//! A run seldom shows the worst case, because all delays of a path must coincide. Each part of the path is therefore
//! measured at its longest, on each clock, and the parts are added up. The sums must keep the bounds of
//! docs/design.md#timing, and no run may exceed the sums.
//!
//! | path or share | how it is measured |
//! |---|---|
//! | the frame's way | from the last bit to FRESH, cut where the running task changes; the longest time of each piece |
//! | the SSI task's way | from the end of a transaction that nothing masks to the release |
//! | the SSI's share | the longest runs of `ssi_end` and `ssi_pause`, with exception entry and return of both |
//! | sections that mask | the longest time for which BASEPRI or PRIMASK masks a priority while a task below it runs |
//!
//! The processor's state is examined after each of its clock cycles. `cargo test -p bench --test all sums:: --
//! --nocapture` prints the tables of docs/timing.md#sums.

use crate::boards;

use std::collections::BTreeMap;
use std::marker::PhantomData;

use bench::faults::{Conduct, Fault, Faults};
use bench::sim::{Bench, Images, Setup};
use bench_judge::{Log, SsiEvent, What, bounds};
use boards::image;
use cortex_m4::{Cost, Fast, Optimistic, Pessimistic, Register};
use emulator_node::Threads;

const MS: u64 = 1_000_000;
/// The instant, ns, from which the DPR's processor is examined.
const WARM: u64 = 300 * MS;
/// The time for which the DPR's processor is examined, ns: one cycle of HORUS.
const LOOKED_AT: u64 = 10 * MS;
/// The end of the run, ns. The times from a transaction to ready are observed until then.
const END: u64 = WARM + 500 * MS;
/// An upper limit of the DPR's clock period at 64 MHz, ns.
const CYCLE: u64 = 15;
/// The exception numbers of the tasks `ssi_end` (SPIS1) and `ssi_pause` (TIMER3).
const SSI: [u32; 2] = [16 + 4, 16 + 26];
/// The values of BASEPRI that mask priority 6 (the SSI) and priority 5 (the RFID side), in the three upper bits.
const MASKS: [u32; 2] = [0x40, 0x60];

/// The observations of the DPR's processor during the examination.
struct Watched<C: Cost> {
    /// The instant (ns) at which an exception began or continued to run, and its number; 0 stands for the idle loop and
    /// for sleep.
    runs: Vec<(u64, u32)>,
    /// For each priority in [`MASKS`], the longest time, ns, for which less urgent code masked it.
    masked: [u64; 2],
    log: Log,
    clock: PhantomData<C>,
}

/// Runs the link to [`WARM`] and then examines the DPR's processor. `conduct` is a misuse of the SSI in place of the
/// ordinary transactions.
fn watch<C: Cost>(gps: usize, conduct: Option<Conduct>) -> Option<Watched<C>> {
    let images = Images { horus: image(gps, "horus-tx-fw.elf")?, dpr: image(gps, "dpr-fw.elf")? };
    let mut setup = Setup { writes: true, ..Setup::new(images, gps, END) };
    if let Some(conduct) = conduct {
        setup.faults = Faults::none().with(WARM - 50 * MS, u64::MAX, Fault::FlightController(conduct));
    }
    let mut bench: Bench<C> = Bench::new(&setup).unwrap_or_else(|error| panic!("{error}"));
    bench.run_to(WARM, setup.threads);
    bench.keep_log();
    let (mut runs, mut masked, mut since) = (vec![], [0; 2], [None; 2]);
    let mut at = WARM;
    while at < WARM + LOOKED_AT {
        at += CYCLE;
        bench.run_to(at, Threads::One);
        let dpr = bench.dpr();
        let active = dpr.core_register(Register::Xpsr) & 0x1FF;
        if runs.last().is_none_or(|&(_, last)| last != active) {
            runs.push((at, active));
        }
        let (base, all) = (dpr.core_register(Register::Basepri), dpr.core_register(Register::Primask) != 0);
        for ((mask, since), longest) in MASKS.into_iter().zip(&mut since).zip(&mut masked) {
            // A priority is not masked while a task of the same priority, or of a more urgent one, runs.
            let runs = SSI.contains(&active) || mask == MASKS[1] && is_of_the_rfid_side(active);
            if (all || base != 0 && base <= mask) && !runs {
                let since = *since.get_or_insert(at - CYCLE);
                *longest = (at - since).max(*longest);
            } else {
                *since = None;
            }
        }
    }
    bench.run_to(END, setup.threads);
    Some(Watched { runs, masked, log: bench.finish(END).log, clock: PhantomData })
}

fn is_of_the_rfid_side(exception: u32) -> bool {
    [16 + 3, 16 + 6, 16 + 8].contains(&exception)
}

impl<C: Cost> Watched<C> {
    /// Returns the longest uninterrupted run of an exception, ns. A run in which FRESH rises is left out, because it
    /// belongs to the handling of a frame.
    fn longest(&self, exception: u32) -> u64 {
        let rises: Vec<u64> = self.frames().into_iter().map(|(_, rose)| rose).collect();
        let runs = self.runs.windows(2).filter(|pair| pair[0].1 == exception).map(|pair| pair[0].0..pair[1].0);
        let served = runs.filter(|run| !rises.iter().any(|rose| run.contains(rose)));
        served.map(|run| run.end - run.start).max().unwrap_or(0)
    }

    fn share(&self) -> u64 {
        let around = (C::EXCEPTION_ENTRY + C::EXCEPTION_RETURN) * 1_000 / 64;
        SSI.iter().map(|&exception| self.longest(exception) + around).sum()
    }

    fn frames(&self) -> Vec<(u64, u64)> {
        let mut heard = None;
        let frames = self.log.events.iter().filter_map(|event| match event.what {
            What::Heard { .. } => {
                heard = Some(event.at);
                None
            }
            What::Fresh { high: true, .. } => heard.take().map(|heard| (heard, event.at)),
            _ => None,
        });
        frames.collect()
    }

    /// Returns the exceptions that ran between a frame's last bit and the rise of FRESH, each with its longest time,
    /// ns.
    fn pieces(&self) -> Vec<(u32, u64)> {
        let mut pieces: BTreeMap<usize, (u32, u64)> = BTreeMap::new();
        let frames = self.frames();
        for (last_bit, rose) in frames.into_iter().filter(|(_, rose)| *rose < WARM + LOOKED_AT) {
            let before = self.runs.iter().rev().find(|(at, _)| *at <= last_bit).map_or(0, |(_, running)| *running);
            let within = self.runs.iter().filter(|(at, _)| (last_bit + 1..rose).contains(at)).copied();
            let starts: Vec<(u64, u32)> = std::iter::once((last_bit, before)).chain(within).collect();
            for (number, (at, running)) in starts.iter().enumerate() {
                let took = starts.get(number + 1).map_or(rose, |(next, _)| *next) - at;
                let piece = pieces.entry(number).or_insert((*running, 0));
                assert_eq!(piece.0, *running, "every frame takes the same way");
                piece.1 = piece.1.max(took);
            }
        }
        assert!(!pieces.is_empty(), "a frame was announced");
        pieces.into_values().collect()
    }

    fn served(&self) -> u64 {
        let mut ended = None;
        let served = self.log.events.iter().filter_map(|event| match event.what {
            What::Transaction { .. } => {
                ended = Some(event.at);
                None
            }
            What::Ssi(SsiEvent::Released) => ended.take().map(|ended| event.at - ended),
            _ => None,
        });
        served.max().expect("a transaction was served")
    }
}

/// Calculates both sums for `gps` receivers, and compares them with the bounds and the observed times.
fn add_up<C: Cost>(gps: usize) {
    let Some(quiet) = watch::<C>(gps, Some(Conduct::Silent)) else { return };
    let Some(usual) = watch::<C>(gps, None) else { return };
    let Some(hostile) = watch::<C>(gps, Some(Conduct::Edges(1_000))) else { return };
    println!("{} receivers, {} clock, ns", gps, C::NAME);
    let pieces = quiet.pieces();
    for (running, longest) in &pieces {
        println!("  exception {running:2}: {longest}");
    }
    let way: u64 = pieces.iter().map(|(_, longest)| longest).sum();
    let share = usual.share().max(hostile.share());
    let masked = [0, 1].map(|which| [&quiet, &usual, &hostile].map(|watched| watched.masked[which]).into_iter().max());
    let [of_ssi, of_rfid] = masked.map(|longest| longest.expect("three runs"));
    let readable = way + share + of_rfid;
    println!("  last bit to readable: way {way} + SSI's share {share} + RFID masked {of_rfid} = {readable}");
    let ready = usual.served() + of_ssi;
    println!("  SSI ready: way {} + SSI masked {of_ssi} = {ready}", usual.served());
    assert!(readable <= bounds::LAST_BIT_TO_READABLE, "{readable}");
    assert!(ready <= bounds::SSI_READY, "{ready}");
    assert!(of_ssi > 0 && of_rfid >= of_ssi, "the commit task masks both when it publishes");
    for seen in [&quiet, &usual, &hostile] {
        let worst = seen.frames().into_iter().map(|(last_bit, rose)| rose - last_bit).max().expect("a frame");
        assert!(worst <= readable, "{worst}");
    }
    // The tasks of the SSI must have interrupted the handling of a frame, as the sum assumes.
    assert!(hostile.longest(SSI[0]) > 0 && hostile.longest(SSI[1]) > 0, "both tasks ran");
}

#[test]
fn with_three_receivers_both_deadlines_hold_as_sums_on_three_clocks() {
    add_up::<Fast>(3);
    add_up::<Optimistic>(3);
    add_up::<Pessimistic>(3);
}

#[test]
fn both_sums_hold_with_one_and_five_receivers_on_the_pessimistic_clock() {
    add_up::<Pessimistic>(1);
    add_up::<Pessimistic>(5);
}
