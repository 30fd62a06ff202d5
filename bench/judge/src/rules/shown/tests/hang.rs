//! Tests which data may stay readable while a DPR hangs.

use super::super::synthetic::{Air, Image, MS, Run, US};
use super::{RECEIVERS, hide};
use crate::{Board, Event, Violation, What, bounds};

/// Returns a run in which the DPR hangs from `at` on, and its watchdog bites 80 ms later.
fn stopped(n: usize, at: u64) -> Run {
    Run {
        cycles: 80,
        dpr_start: Some((at + 80 * MS, crate::Cause::Watchdog, profile::ResetReason::Watchdog)),
        ..Run::new(n)
    }
}

fn silent(at: u64) -> impl Fn(&mut Vec<Image>) {
    move |images| images.retain(|image| image.at <= at || image.at >= at + 80 * MS)
}

fn told(mut run: Run, at: u64) -> Run {
    run.extra.push(Event { at, what: What::Hung { board: Board::Dpr } });
    run
}

#[test]
fn a_hang_of_the_dpr_excuses_what_it_no_longer_publishes() {
    for n in RECEIVERS {
        for after in [0, 50 * US, 99 * US, MS, 3 * MS, 7 * MS, 9 * MS] {
            let run = Run::new(n);
            let at = run.end(20) + after;
            assert_eq!(told(stopped(n, at), at).broken(silent(at)), [], "{n} receivers, {after}");
            let blamed = stopped(n, at).broken(silent(at));
            assert!(blamed.contains(&Violation::NotShown), "{n} receivers, {after}: {blamed:?}");
            // A hang of HORUS does not excuse the DPR.
            let mut other = stopped(n, at);
            other.extra.push(Event { at, what: What::Hung { board: Board::Horus } });
            assert_eq!(other.broken(silent(at)), blamed);
        }
    }
}

#[test]
fn a_cycle_due_when_the_dpr_hangs_must_be_shown() {
    for n in RECEIVERS {
        let run = Run::new(n);
        let from = run.end(20) + bounds::LAST_BIT_TO_READABLE;
        for (at, expected) in [(from, vec![Violation::NotShown]), (from - 1, vec![])] {
            let hidden = |images: &mut Vec<Image>| {
                silent(at)(images);
                hide(run.timestamp(20))(images);
            };
            assert_eq!(told(stopped(n, at), at).broken(hidden), expected, "{n} receivers");
        }
    }
}

#[test]
fn an_image_already_stale_when_the_dpr_hangs_is_a_violation() {
    for (clock, publication) in [("fast", bounds::PUBLICATION), ("pessimistic", bounds::PUBLICATION_PESSIMISTIC)] {
        let ended = Run::new(3).end(20);
        let deadline = ended + bounds::FRAME_DEADLINE + publication;
        let judged = |at: u64, hung: Option<u64>| {
            let mut run = stopped(3, at).hit_all(21..30, &Air::Lost);
            (run.clock, run.only) = (clock, Some(ended + 20 * MS));
            if let Some(hung) = hung {
                run = told(run, hung);
            }
            run.broken(silent(ended + 5 * MS))
        };
        assert_eq!(judged(deadline, Some(deadline)), [], "{clock}");
        assert_eq!(judged(deadline, Some(deadline + 1)), [Violation::ShownStale], "{clock}");
        assert_eq!(judged(deadline, None), [Violation::ShownStale], "{clock}");
    }
}

#[test]
fn a_dpr_that_hangs_shows_no_expired_image() {
    for n in RECEIVERS {
        let run = Run::new(n);
        let (at, last_bit) = (run.end(20) + 2 * MS, run.end(20));
        let read = |after: u64| {
            let run = Run { only: Some(last_bit + after), ..told(stopped(n, at), at) };
            run.broken(|images| {
                silent(at)(images);
                images.iter_mut().filter(|image| image.at <= at).for_each(|image| image.expires = at + 79 * MS);
            })
        };
        let expires = bounds::PUBLICATION + bounds::EXPIRY;
        assert_eq!(read(expires), [], "{n} receivers");
        assert_eq!(read(expires + 1), [Violation::ShownExpired], "{n} receivers");
        assert_eq!(read(70 * MS), [Violation::ShownExpired], "{n} receivers");
    }
}

#[test]
fn what_reaches_the_antenna_of_a_dpr_that_hangs_is_never_shown() {
    let run = Run::new(3);
    let at = run.end(21);
    let shows = |hangs: bool| {
        let run = if hangs { told(stopped(3, at), at) } else { stopped(3, at) };
        let run = Run { only: Some(at + MS), ..run };
        run.broken(silent(at + 100 * US))
    };
    assert_eq!(shows(true), [Violation::ShownOutOfSequence]);
    assert_eq!(shows(false), []);
}

#[test]
fn objects_may_outlast_a_repeated_frame_if_the_dpr_hangs_first() {
    let run = Run::new(1);
    let (cycle, after) = (20, 5_300 * US);
    let repeated = run.end(cycle) + after;
    let judged = |at: u64, hangs: bool| {
        let run = Run { only: Some(repeated + MS), ..stopped(1, at) }.hit(cycle, 0, Air::Repeated(after));
        let run = if hangs { told(run, at) } else { run };
        run.broken(silent(repeated))
    };
    let readable = repeated + bounds::PUBLICATION;
    assert_eq!(judged(readable - 1, true), []);
    assert_eq!(judged(readable, true), [Violation::ShownOutOfSequence]);
    assert_eq!(judged(readable - 1, false), [Violation::ShownOutOfSequence]);
}

#[test]
fn a_dpr_that_has_restarted_after_a_hang_must_show_again() {
    let at = Run::new(3).end(20) + 2 * MS;
    let run = told(stopped(3, at), at);
    let cycle = 60;
    assert!(run.tick(cycle) > at + 80 * MS + 250 * MS);
    let hidden = |images: &mut Vec<Image>| {
        silent(at)(images);
        hide(run.timestamp(cycle))(images);
    };
    assert_eq!(run.broken(hidden), [Violation::NotShown]);
}
