//! Judges the heater of the active hold. Nothing excuses it: the limits hold whatever is commanded, disturbed or
//! broken, because the hold's firmware keeps them by itself.
//!
//! | limit | derived from |
//! |---|---|
//! | the heater is on for at most [`MOST`] of the time | the greatest output of the control, 0.8, and its PWM |
//! | it is off in a box that has been above [`HOT`] for [`HOT_FOR`] | heating ends at a measured 45 °C |
//! | it is off if the climate sensor has sent no measurement for [`BLIND`] | a temperature is valid for 3 s |
//! | it is off from the hold's start or power-on until the climate sensor has sent a measurement | as above |

use super::{Rule, ms};
use crate::{Context, Event, Findings, Header, HoldEvent, Violation, What};

const MS: u64 = 1_000_000;

/// The greatest share of 100 ms in which the heater may be on, in ten thousandths: 0.8, and 0.0032 because the interval
/// cuts a PWM period of 1 ms at either end.
pub const MOST: u16 = 8_000 + 32;
/// The temperature of the box, m°C, above which it may not be heated for longer than [`HOT_FOR`].
///
/// The hold heats until it measures 45 °C, and for at most [`BLIND`] after that measurement. A heater of 12 W heats 60
/// J/K by at most 0.2 K/s. The sensor's error is at most 0.3 K.
pub const HOT: i32 = 46_500;
/// The time for which a box that is too hot may be heated, ns: two records of its temperature.
pub const HOT_FOR: u64 = 200 * MS;
/// The longest time for which the heater may be on after the climate sensor's last measurement, ns. It is the sum of 3
/// s in the firmware, a cycle of the hold, 104 ms of the watchdog (because a hung hold leaves its PWM on), and a
/// margin.
pub const BLIND: u64 = 3_300 * MS;

/// The rule; see the [module](self).
#[derive(Clone, Debug)]
pub struct Heater {
    has_hold: bool,
    /// The hold's last start, ns.
    started: u64,
    /// The instant, ns, of the first of the successive records with a hot box.
    hot: Option<u64>,
}

impl Rule for Heater {
    fn new(header: &Header) -> Self {
        Self { has_hold: header.hold, started: 0, hot: None }
    }

    fn take(&mut self, event: &Event, _context: &Context, findings: &mut Findings) {
        let at = event.at;
        match &event.what {
            What::Hold(HoldEvent::Power { on: true } | HoldEvent::Reset { .. }) => self.started = at,
            What::Hold(HoldEvent::Payload { heater, temperature, heated, measured, .. }) if self.has_hold => {
                self.hot = if *temperature > HOT { self.hot.or(Some(at)) } else { None };
                let mut wrong = |words: String| findings.add(Violation::HoldHeats, at, || words);
                if *heater > MOST {
                    wrong(format!("on for {heater} of 10000"));
                }
                if *heater > 0 && self.hot.is_some_and(|since| since + HOT_FOR <= at) {
                    wrong(format!("in a box of {temperature} m°C"));
                }
                let measured = measured.filter(|measured| *measured >= self.started);
                let until = measured.map_or(self.started, |measured| measured + BLIND);
                if let Some(heated) = heated.filter(|heated| *heated > until) {
                    let last = measured.map_or("none".to_owned(), ms);
                    wrong(format!("at {}, and the last measurement since the start is {last}", ms(heated)));
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cause;
    use crate::testing::{self, Events};

    fn record(heater: u16, temperature: i32, heated: Option<u64>, measured: Option<u64>) -> What {
        What::Hold(HoldEvent::Payload { heater, cooler: 0, temperature, humidity: 40_000, heated, measured })
    }

    fn wrong(records: &[What]) -> Option<u64> {
        let mut events = Events::new(1);
        events.hold = true;
        events.add(50 * MS, What::Hold(HoldEvent::Reset { cause: Cause::Watchdog, asked: false }));
        for (number, what) in (1..).zip(records) {
            events.add(number * 100 * MS, what.clone());
        }
        let found = testing::found(Heater::new(&events.log().header), &events.log()).0;
        assert!(found.len() <= 1 && found.iter().all(|(violation, ..)| *violation == Violation::HoldHeats));
        found.first().map(|(.., at)| at / MS)
    }

    #[test]
    fn the_share_may_exceed_the_limit_by_two_cut_periods() {
        let share = |share| wrong(&[record(share, 20_000, Some(99 * MS), Some(60 * MS))]);
        assert_eq!((share(8_032), share(8_033)), (None, Some(100)));
    }

    #[test]
    fn a_box_that_stays_hot_is_not_heated() {
        let heats = |temperature, heater| record(heater, temperature, Some(60 * MS), Some(60 * MS));
        assert_eq!(wrong(&[heats(46_500, 8_000), heats(46_500, 8_000), heats(46_500, 8_000)]), None);
        assert_eq!(wrong(&[heats(46_501, 8_000), heats(46_501, 8_000), heats(46_501, 1)]), Some(300));
        assert_eq!(wrong(&[heats(46_501, 8_000), heats(46_501, 8_000), heats(46_501, 0)]), None);
        assert_eq!(wrong(&[heats(46_501, 1), heats(46_500, 1), heats(46_501, 1), heats(46_501, 1)]), None);
    }

    #[test]
    fn without_a_recent_measurement_nothing_is_heated() {
        let (measured, heats) = (60 * MS, |heated| [record(10, 20_000, Some(heated), Some(60 * MS))]);
        assert_eq!(wrong(&heats(measured + BLIND)), None);
        assert_eq!(wrong(&heats(measured + BLIND + 1)), Some(100));
    }

    #[test]
    fn nothing_is_heated_from_a_start_until_the_first_measurement() {
        let heats = |heated, measured| [record(10, 20_000, heated, measured)];
        assert_eq!(wrong(&heats(Some(50 * MS), Some(40 * MS))), None, "before the start");
        assert_eq!(wrong(&heats(Some(51 * MS), Some(40 * MS))), Some(100));
        assert_eq!(wrong(&heats(Some(51 * MS), None)), Some(100));
        assert_eq!(wrong(&heats(Some(61 * MS), Some(60 * MS))), None);
        assert_eq!(wrong(&heats(None, None)), None);
    }

    #[test]
    fn the_heater_may_be_on_until_the_supply_goes_off() {
        let power = |on| {
            let mut events = Events::new(1);
            events.hold = true;
            events.add(70 * MS, What::Hold(HoldEvent::Power { on }));
            // The pin of the heater falls a few ns after the supply is switched off.
            events.add(100 * MS, record(10, 20_000, Some(70 * MS + 31), Some(60 * MS)));
            testing::found(Heater::new(&events.log().header), &events.log()).0.len()
        };
        assert_eq!((power(false), power(true)), (0, 1));
    }

    #[test]
    fn without_a_hold_there_is_no_heater() {
        let mut events = Events::new(1);
        events.add(100 * MS, record(9_000, 60_000, Some(99 * MS), None));
        assert_eq!(testing::found(Heater::new(&events.log().header), &events.log()).0, []);
    }
}
