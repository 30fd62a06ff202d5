//! Campaigns of faults on copies of the running link.

use bench::campaign::{self, Class, Counts, Options, Scope, Shard};
use bench::faults::{Kind, RECEIVED};
use bench::sim::{Images, Setup};
use emulator_node::{Clock, Firmware};

use crate::boards::image;

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
