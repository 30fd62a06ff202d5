//! Tests which bytes of a receiver on a bus HORUS must use, which it may use, and which it must not use.

use super::super::Line;
use crate::bounds::{NEWS, READ_AT_ONCE, READ_SETTLED, TOO_OLD};
use crate::testing::MS;

const MUST: Option<bool> = Some(true);
const MAY: Option<bool> = Some(false);

fn read_before() -> Line {
    let mut line = Line::new();
    assert_eq!(line.read((0, MS), 100, 0, true), MAY, "the first that it reads");
    assert_eq!(line.read((10 * MS, 11 * MS), 100, 10 * MS, true), MUST);
    line
}

/// Returns whether HORUS must or may use the bytes that it reads from a receiver on a bus within 1 ms from `at` on. The
/// last of these bytes has waited for `waited` ns.
fn read(line: &mut Line, at: u64, waited: u64) -> Option<bool> {
    line.read((at, at + MS), 100, at + MS - waited, true)
}

#[test]
fn a_message_that_has_waited_too_long_must_be_dropped() {
    let once = |waited| read(&mut read_before(), 100 * MS, waited);
    assert_eq!((once(NEWS), once(NEWS + 1)), (MUST, MAY));
    // The age of bytes counts at the start of their transfer, 1 ms before its end.
    assert_eq!((once(TOO_OLD + MS), once(TOO_OLD + MS + 1)), (MAY, None));
}

#[test]
fn a_message_after_an_old_or_damaged_one_may_be_dropped() {
    let spoils: [fn(&mut Line, u64); 3] = [
        |line, at| _ = read(line, at, NEWS + 1),
        |line, at| _ = line.read((at, at + MS), 100, at, false),
        |line, at| _ = read(line, at, TOO_OLD + 9 * MS),
    ];
    for spoil in spoils {
        let mut line = read_before();
        let at = 100 * MS;
        spoil(&mut line, at);
        let over = at + MS + READ_SETTLED;
        assert_eq!(read(&mut line, over - 1, MS), MAY);
        assert_eq!(read(&mut line, over, MS), MAY, "the first after that");
        assert_eq!(read(&mut line, over + 10 * MS, MS), MUST);
    }
}

#[test]
fn what_waits_beyond_one_reading_may_be_dropped() {
    let mut line = read_before();
    line.offered(100 * MS, &vec![0; READ_AT_ONCE as usize]);
    assert_eq!(line.read((100 * MS, 101 * MS), READ_AT_ONCE, 100 * MS, true), MUST);
    line.offered(200 * MS, &vec![0; READ_AT_ONCE as usize]);
    line.offered(200 * MS, &[0]);
    assert_eq!(read(&mut line, 200 * MS, MS), MAY);
    let mut line = read_before();
    line.forget(100 * MS);
    assert_eq!((read(&mut line, 200 * MS, MS), read(&mut line, 210 * MS, MS)), (MAY, MUST));
}
