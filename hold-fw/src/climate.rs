//! Controls the temperature of the box with a heater and a cooler. At most one of them works at a time.
//!
//! # Design
//!
//! The control is a proportional and integral controller with a fixed step of [one cycle](STEP_S). Its output goes from
//! -1 (cooling) to 1 (heating). Neither a command nor a sensor can break these limits:
//!
//! | what is limited | limit |
//! |---|---|
//! | set-point | within [`SET_POINTS`]; the hold refuses any other value, also NaN |
//! | output | within [`OUTPUTS`] |
//! | change of the output in a cycle | at most [`SLEW`]; after a fault the output is 0 at once |
//! | heating | none above the range [`WORKING`] |
//! | cooling | none below the range [`WORKING`] |
//! | output without a valid temperature or with faulty memory | 0: [`Climate::is_safe`] |
//!
//! *No windup*: while the output is at a limit, the integral changes only in the direction that leads away from that
//! limit. A new set-point does not change the integral. While the output is held at 0 for safety, the integral is 0.
//!
//! *Dead band*: while the error is less than [`DEAD_BAND`], the proportional part is 0, so that the noise of the sensor
//! does not switch heater and cooler.

use core::ops::RangeInclusive;

/// The set-points that the hold accepts, °C.
pub const SET_POINTS: RangeInclusive<f32> = 2.0..=40.0;
/// The set-point after power-on, °C.
pub const DEFAULT_SET_POINT: f32 = 20.0;
/// The range of the output. Full heating is not allowed, because it could heat the box faster than its contents bear.
pub const OUTPUTS: RangeInclusive<f32> = -1.0..=0.8;
/// The greatest change of the controller's output from one cycle to the next.
pub const SLEW: f32 = 0.05;
/// The working temperatures of the box, °C. Above this range the box is not heated, below it the box is not cooled.
pub const WORKING: RangeInclusive<f32> = 0.0..=45.0;
/// The error of the temperature, K, below which the proportional part is 0.
pub const DEAD_BAND: f32 = 0.1;

/// The time between two steps of the control, s.
pub const STEP_S: f32 = profile::hold::PERIOD_MS as f32 / 1_000.0;
/// The proportional part of the output for each kelvin of error.
const PROPORTIONAL: f32 = 0.2;
/// The change of the integral for each kelvin of error and each second.
const INTEGRAL: f32 = 0.002;

/// The state of the temperature control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Climate {
    set_point: f32,
    integral: f32,
    output: f32,
    safe: bool,
}

impl Climate {
    /// Returns the control at its start, with the output off. [`DEFAULT_SET_POINT`] replaces a set-point out of range.
    #[must_use]
    pub fn new(set_point: f32) -> Self {
        // Not covered: a set-point out of range: the record of the last set-point has a CRC, and `set` takes none.
        let set_point = if SET_POINTS.contains(&set_point) { set_point } else { DEFAULT_SET_POINT };
        Self { set_point, integral: 0.0, output: 0.0, safe: true }
    }

    /// Changes the set-point, °C, and returns true if it is in [`SET_POINTS`]; otherwise nothing changes.
    pub fn set(&mut self, set_point: f32) -> bool {
        let accepted = SET_POINTS.contains(&set_point);
        if accepted {
            self.set_point = set_point;
        }
        accepted
    }

    /// Returns the set-point, °C.
    #[must_use]
    pub const fn set_point(&self) -> f32 {
        self.set_point
    }

    /// Returns the output: 1 is the full power of the heater, -1 that of the cooler.
    #[must_use]
    pub const fn output(&self) -> f32 {
        self.output
    }

    /// Whether the control holds the output at 0 for safety.
    #[must_use]
    pub const fn is_safe(&self) -> bool {
        self.safe
    }

    /// Does one step of the control, and returns the output. `temperature` is in °C, `None` without a valid
    /// measurement. If `allowed` is false, the output is 0.
    pub fn step(&mut self, temperature: Option<f32>, allowed: bool) -> f32 {
        // Not covered: a temperature that is not finite: it comes from an integer.
        let Some(temperature) = temperature.filter(|celsius| allowed && celsius.is_finite()) else {
            *self = Self::new(self.set_point);
            return self.output;
        };
        self.safe = false;
        let error = self.set_point - temperature;
        let proportional = if error.abs() < DEAD_BAND { 0.0 } else { PROPORTIONAL * error };
        let may = |output: f32| {
            let hottest = if temperature > *WORKING.end() { 0.0 } else { *OUTPUTS.end() };
            let coldest = if temperature < *WORKING.start() { 0.0 } else { *OUTPUTS.start() };
            bound(output, coldest, hottest)
        };
        let integral = self.integral + INTEGRAL * error * STEP_S;
        let wanted = proportional + integral;
        // While the output is at a limit, the integral may only change towards the other side.
        if may(wanted) == wanted || (wanted > 0.0) == (integral < self.integral) {
            self.integral = integral;
        }
        let slewed = bound(may(proportional + self.integral), self.output - SLEW, self.output + SLEW);
        // The slew limit does not delay the end of heating or cooling that is no longer allowed.
        self.output = may(slewed);
        self.output
    }
}

/// Limits `value` to `low..=high`. `f32::clamp` is not used: its panic message prints numbers, and the code for that
/// would be a third of the firmware.
fn bound(value: f32, low: f32, high: f32) -> f32 {
    // Not covered: the results of `max` and `min` for a NaN, which no caller passes.
    value.max(low).min(high)
}

/// The fractions of the time, each 0 to 1, for which heater and cooler are on. At most one of them is not 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Duty {
    heater: f32,
    cooler: f32,
}

impl Duty {
    /// Returns the duties for an output of the control, -1 to 1.
    #[must_use]
    pub fn of(output: f32) -> Self {
        Self { heater: bound(output, 0.0, 1.0), cooler: bound(-output, 0.0, 1.0) }
    }

    /// Returns for how many of the `top` counts of a PWM period the heater and the cooler are on.
    #[must_use]
    pub fn counts(self, top: u16) -> [u16; 2] {
        // Not covered: the saturation of the conversion: a duty is at most 1, so no product exceeds `top`.
        [self.heater, self.cooler].map(|duty| (duty * f32::from(top)) as u16)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn any_celsius() -> impl Strategy<Value = Option<f32>> {
        prop_oneof![
            (-60.0_f32..130.0).prop_map(Some),
            prop::num::f32::ANY.prop_map(Some),
            Just(Some(f32::NAN)),
            Just(None)
        ]
    }

    proptest! {
        // Shows HOLD-9.
        #[test]
        fn no_sequence_of_inputs_breaks_a_limit(
            // Each input of the test lasts for up to 4 s, because the output needs 3.6 s from one limit to the other.
            steps in prop::collection::vec((any_celsius(), any::<bool>(), prop::num::f32::ANY, 1_usize..40), 1..60)
        ) {
            let mut climate = Climate::new(f32::NAN);
            let steps = steps.into_iter().flat_map(|(celsius, allowed, point, cycles)| {
                std::iter::repeat_n((celsius, allowed, point), cycles)
            });
            for (temperature, allowed, commanded) in steps {
                let (before, point) = (climate.output(), climate.set_point());
                let accepted = climate.set(commanded);
                prop_assert_eq!(accepted, (2.0..=40.0).contains(&commanded));
                prop_assert!(accepted || climate.set_point() == point);
                let output = climate.step(temperature, allowed);
                prop_assert!((-1.0..=0.8).contains(&output));
                let known = temperature.filter(|celsius| celsius.is_finite() && allowed);
                prop_assert_eq!(climate.is_safe(), known.is_none());
                match known {
                    None => prop_assert_eq!(output, 0.0),
                    Some(celsius) if celsius > 45.0 => prop_assert!(output <= 0.0),
                    Some(celsius) if celsius < 0.0 => prop_assert!(output >= 0.0),
                    Some(_) => prop_assert!((output - before).abs() <= 0.050_001),
                }
                let [heater, cooler] = Duty::of(output).counts(1_000);
                prop_assert!(heater == 0 || cooler == 0);
                prop_assert!(heater <= 800 && cooler <= 1_000);
            }
        }
    }

    /// Returns the temperatures, °C, of a simulated box that begins at `celsius` in air of `outside` °C. The box has
    /// 2 kJ/K, 5 W/K through its walls, a heater of 100 W and a cooler of 60 W.
    fn flown(climate: &mut Climate, mut celsius: f32, outside: f32, seconds: u32) -> Vec<f32> {
        let mut record = vec![];
        for _ in 0..seconds * 10 {
            let output = climate.step(Some(celsius), true);
            let power = if output > 0.0 { 100.0 * output } else { 60.0 * output };
            celsius += (power - 5.0 * (celsius - outside)) / 2_000.0 * STEP_S;
            record.push(celsius);
        }
        record
    }

    #[test]
    fn the_box_comes_to_its_set_point_from_both_sides_and_stays() {
        for (set_point, begins, outside) in [(20.0, 5.0, 8.0), (5.0, 15.0, 12.0), (30.0, 30.0, 18.0)] {
            let mut climate = Climate::new(set_point);
            let record = flown(&mut climate, begins, outside, 3_600);
            for celsius in &record[30_000..] {
                assert!((celsius - set_point).abs() < 0.3, "{set_point} from {begins}: {celsius}");
            }
        }
    }

    #[test]
    fn a_set_point_that_was_out_of_reach_leaves_no_windup() {
        let mut climate = Climate::new(40.0);
        // At the limit of 80 W the heater can bring the box to -4 °C at most, in air of -20 °C.
        let record = flown(&mut climate, -10.0, -20.0, 7_200);
        assert_eq!(climate.output(), 0.8);
        let end = record[record.len() - 1];
        assert!(climate.set(2.0));
        // In warmer air the output must leave its limit within a minute, although the integral was at its own limit for
        // a long time.
        let _ = flown(&mut climate, end.max(8.0), 20.0, 60);
        assert!(climate.output() < 0.0, "{}", climate.output());
    }

    #[test]
    fn after_a_lost_temperature_the_control_begins_anew() {
        let mut climate = Climate::new(30.0);
        let _ = flown(&mut climate, 20.0, 0.0, 600);
        assert!(climate.output() > 0.5);
        assert_eq!((climate.step(None, true), climate.is_safe()), (0.0, true));
        assert!(climate.step(Some(29.0), true) <= SLEW);
        assert_eq!((climate.step(Some(29.0), false), climate.is_safe()), (0.0, true));
    }

    #[test]
    fn the_output_follows_the_error_and_its_integral_outside_the_dead_band() {
        let after_10_steps = |celsius| {
            let mut climate = Climate::new(20.0);
            (0..10).for_each(|_| _ = climate.step(Some(celsius), true));
            climate.output()
        };
        // An error of 1 K for 1 s gives a proportional part of 0.2 and an integral of 0.002. An error of 0.09 K is in
        // the dead band, so it only changes the integral.
        for (celsius, expected) in [(19.0, 0.202), (21.0, -0.202), (19.91, 0.000_18), (20.09, -0.000_18)] {
            let output = after_10_steps(celsius);
            assert!((output - expected).abs() < 1e-6, "{output} at {celsius}");
        }
    }

    #[test]
    fn the_integral_stands_still_while_the_output_is_at_a_limit() {
        for (far, limit) in [(10.0, 0.8), (35.0, -1.0)] {
            let mut climate = Climate::new(20.0);
            (0..100).for_each(|_| _ = climate.step(Some(far), true));
            assert_eq!(climate.output(), limit);
            (0..30).for_each(|_| _ = climate.step(Some(20.0), true));
            assert_eq!(climate.output(), 0.0, "after {far}");
        }
    }

    #[test]
    fn at_the_ends_of_the_working_range_both_sides_may_work() {
        let after = |first, last: f32| {
            let mut climate = Climate::new(20.0);
            (0..20).for_each(|_| _ = climate.step(Some(first), true));
            climate.step(Some(last), true)
        };
        assert!(after(5.0, 45.0) > 0.0 && after(35.0, 0.0) < 0.0);
        assert!(after(5.0, 45.1) <= 0.0 && after(35.0, -0.1) >= 0.0);
    }

    #[test]
    fn duties_are_parts_of_the_period_and_of_one_side() {
        for (output, expected) in [(0.0, [0, 0]), (0.5, [500, 0]), (-0.25, [0, 250]), (-1.0, [0, 1_000])] {
            assert_eq!(Duty::of(output).counts(1_000), expected);
        }
        assert_eq!(Duty::of(f32::NAN).counts(1_000), [0, 0]);
    }
}
