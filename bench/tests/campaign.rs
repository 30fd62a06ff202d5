//! Campaigns of faults on copies of the running link.

use bench::campaign::{self, Class, Counts, Options, Reading, Scope, Shard};
use bench::faults::{Board, Fault, Faults, Kind, RECEIVED, Upset};
use bench::sim::{Bench, Images, Setup};
use bench_judge::{Violation, What};
use emulator_node::{Clock, Firmware, Threads};

use crate::boards::image;

/// The instant of a flip, ns, at which the link is up.
const FLIP_AT: u64 = 603_000_000;

fn campaign(kinds: &[Kind], cycles: u64) -> Option<(Setup, Options)> {
    let images = Images { horus: image(3, "horus-tx-fw.elf")?, dpr: image(3, "dpr-fw.elf")? };
    let setup = Setup { writes: true, ..Setup::new(images, 3, 0) };
    let scope = Scope { kinds: kinds.to_vec(), seed: 1, gps: 3, clock: Clock::Fast, bit_error: 1e-4, seconds: 1 };
    Some((setup, Options { scope, cycles, jobs: 2, shard: Shard::WHOLE }))
}

#[test]
fn each_variable_into_which_a_board_receives_is_in_its_image() {
    let Some((horus, dpr)) = image(3, "horus-tx-fw.elf").zip(image(3, "dpr-fw.elf")) else { return };
    let images = [horus, dpr].map(|path| Firmware::read(&path).unwrap());
    for name in RECEIVED {
        let sizes = images.iter().filter_map(|image| image.variable_called(name)).map(|variable| variable.size);
        assert!(sizes.sum::<u64>() >= 200, "{name}");
    }
}

#[test]
fn one_thread_two_threads_and_two_parts_find_the_same() {
    let Some((setup, options)) = campaign(&[Kind::Bits, Kind::Ram, Kind::Peripherals], 400) else { return };
    let run = |options: &Options| campaign::run(&setup, options, None, &|_| ()).unwrap();
    let whole = run(&options);
    assert_eq!(whole.flaws(), [""; 0]);
    assert!(whole.sum().cycles >= 400);
    assert_eq!(run(&Options { jobs: 1, ..options.clone() }), whole);
    let part = |part| run(&Options { shard: Shard { part, of: 2 }, ..options.clone() });
    let mut merged = part(2);
    merged.merge(part(1)).unwrap();
    assert_eq!(merged, whole);
}

#[test]
fn each_trial_repeated_alone_has_the_class_that_it_had_among_others() {
    let Some((setup, options)) = campaign(&[Kind::Bits, Kind::Registers], 250) else { return };
    let sum = campaign::run(&setup, &options, None, &|_| ()).unwrap().sum();
    let mut alone = Counts::default();
    for number in 1..=sum.injected() {
        let trial = campaign::repeat(&setup, &options, number).unwrap();
        assert!(trial.injected, "{trial}");
        *match trial.class {
            Class::Masked => &mut alone.masked,
            Class::Recovered => &mut alone.recovered,
            Class::Stopped => &mut alone.stopped,
            Class::Dangerous => &mut alone.dangerous,
        } += 1;
        alone.cycles += trial.cycles;
        alone.readings += trial.readings;
    }
    assert_eq!(alone, sum);
}

#[test]
fn bit_errors_glitches_and_drift_mislead_nobody_and_break_no_rule() {
    let Some((setup, options)) = campaign(&[Kind::Bits, Kind::Spi, Kind::Drift], 500) else { return };
    let tally = campaign::run(&setup, &options, None, &|_| ()).unwrap();
    assert!(tally.is_clean(), "{tally}");
    for row in ["bits", "spi", "drift"] {
        assert!(tally.rows[row].recovered > 0, "{row} never reached a reader: {tally}");
    }
}

#[test]
fn flips_that_stop_the_pin_tick_change_no_command_and_no_reading() {
    let Some((setup, _)) = campaign(&[], 0) else { return };
    let setup = Setup { duration_ns: 900_000_000, ..setup };
    let outcome = |flip: Option<(u32, u8)>| {
        let mut bench: Bench = Bench::new(&setup).unwrap();
        bench.keep_log();
        if let Some((address, bit)) = flip {
            let upset = Fault::Upset(Board::Horus, Upset::Peripheral { address, bit });
            bench.add_faults(&Faults::none().with(FLIP_AT, FLIP_AT, upset));
        }
        bench.run_to(setup.duration_ns, Threads::Two);
        let finished = bench.finish(setup.duration_ns);
        let ticks_again = finished.verdict.kinds().all(|kind| kind != Violation::NoTick);
        let readings: Vec<Reading> = Reading::of(&finished.log.events).collect();
        let commands = finished.log.events.iter().filter(|event| event.what == What::Command);
        (ticks_again, readings, commands.map(|event| event.at).collect::<Vec<_>>())
    };
    let (ticks, readings, commands) = outcome(None);
    assert!(ticks && readings.len() > 80 && commands.len() > 80);
    // TIM2 CCR3, which forms the pulse on the pin, and GPIOB AFRH, which connects the pin to the timer. Trials 4935,
    // 11385 and 14895 of a campaign of 10^6 cycles with seed 1 flipped these bits.
    for flip in [(0x4000_003C, 27), (0x4000_003C, 28), (0x4002_0424, 11)] {
        assert_eq!(outcome(Some(flip)), (false, readings.clone(), commands.clone()), "{flip:x?}");
    }
}
