//! The climate in the hold's payload box. The box has one heat capacity, and loses heat to its surroundings.
//!
//! `C dT/dt = P - G (T - Ta)`: C is the heat capacity of box and load, G what the walls pass, Ta the temperature of the
//! surroundings, P the power of heater or cooler. Between two changes of P the solution is exact. The box is closed, so
//! the vapour in it stays, and the relative humidity follows the temperature (Magnus formula over water).

use crate::faults::Rng;

/// The heating power of the heater, and the cooling power of the cooler, W.
const HEATER: f64 = 12.0;
const COOLER: f64 = 8.0;

/// Temperature, °C, and relative humidity, %, of the air in the box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    /// The temperature, °C.
    pub temperature: f64,
    /// The relative humidity, %.
    pub humidity: f64,
}

/// The payload box, with its heater and cooler.
#[derive(Clone, Debug)]
pub struct Climate {
    /// The heat capacity of the box and its load, J/K.
    capacity: f64,
    /// The heat that the walls pass, W/K.
    loss: f64,
    /// The temperature of the surroundings, °C.
    surroundings: f64,
    /// The pressure of the vapour in the box, hPa.
    vapour: f64,
    temperature: f64,
    /// The instant, ns, to which the temperature and the vapour pressure belong.
    at: u64,
    heats: bool,
    cools: bool,
    /// The times, ns, for which heater and cooler have been on since the last call of [`Climate::take_on`].
    on: [u64; 2],
    /// The last instant at which the heater was on, ns.
    heated: Option<u64>,
}

impl Climate {
    /// Returns a box at 0 ns whose properties are drawn from `seed`.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        let mut within = |least: f64, most: f64| least + (most - least) * rng.below(1_000_001) as f64 / 1e6;
        let surroundings = within(-5.0, 35.0);
        let temperature = surroundings + within(-2.0, 6.0);
        Self {
            capacity: within(60.0, 120.0),
            loss: within(0.1, 0.3),
            surroundings,
            vapour: saturation(surroundings) * within(0.2, 0.7),
            temperature,
            at: 0,
            heats: false,
            cools: false,
            on: [0; 2],
            heated: None,
        }
    }

    /// Advances the box to `at` (ns).
    fn advance(&mut self, at: u64) {
        let took = at.saturating_sub(self.at);
        if took == 0 {
            return;
        }
        self.at = at;
        let power = f64::from(u8::from(self.heats)) * HEATER - f64::from(u8::from(self.cools)) * COOLER;
        let goal = self.surroundings + power / self.loss;
        self.temperature += (self.temperature - goal) * (-self.loss / self.capacity * took as f64 / 1e9).exp_m1();
        if self.heats {
            self.on[0] += took;
            self.heated = Some(at);
        }
        self.on[1] += if self.cools { took } else { 0 };
    }

    /// Switches heater and cooler on or off from `at` (ns) on.
    pub fn switch(&mut self, at: u64, heats: bool, cools: bool) {
        self.advance(at);
        (self.heats, self.cools) = (heats, cools);
    }

    /// Makes the air in the box have this temperature, °C, from `at` (ns) on.
    pub fn warm_to(&mut self, at: u64, celsius: f64) {
        self.advance(at);
        self.temperature = celsius;
    }

    /// Returns temperature and humidity in the box at `at` (ns).
    pub fn air(&mut self, at: u64) -> Air {
        self.advance(at);
        let humidity = (100.0 * self.vapour / saturation(self.temperature)).min(100.0);
        Air { temperature: self.temperature, humidity }
    }

    /// Returns the last instant, ns, at which the heater was on. The box must have been advanced to the present.
    #[must_use]
    pub fn heated(&self) -> Option<u64> {
        self.heated
    }

    /// Returns the times, ns, for which heater and cooler were on from the last call to `at` (ns).
    pub fn take_on(&mut self, at: u64) -> [u64; 2] {
        self.advance(at);
        std::mem::take(&mut self.on)
    }
}

/// Returns the pressure of saturated vapour at `celsius`, hPa (Magnus formula; WMO-No. 8, annex 4.B).
fn saturation(celsius: f64) -> f64 {
    6.112 * (17.62 * celsius / (243.12 + celsius)).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    #[test]
    fn the_result_does_not_depend_on_the_steps() {
        let (mut whole, mut steps) = (Climate::new(3), Climate::new(3));
        whole.switch(0, true, false);
        steps.switch(0, true, false);
        for ms in 1..60_000 {
            steps.switch(ms * S / 1000, true, false);
        }
        let difference = whole.air(60 * S).temperature - steps.air(60 * S).temperature;
        assert!(difference.abs() < 1e-9, "{difference}");
    }

    #[test]
    fn the_heater_warms_and_dries_and_the_cooler_does_the_opposite() {
        for seed in 0..20 {
            let mut climate = Climate::new(seed);
            let rest = climate.clone().air(30 * S);
            let mut cooled = climate.clone();
            climate.switch(0, true, false);
            cooled.switch(0, false, true);
            let (warm, cold) = (climate.air(30 * S), cooled.air(30 * S));
            assert!(warm.temperature > rest.temperature + 1.0 && rest.temperature > cold.temperature + 1.0);
            assert!(warm.humidity < rest.humidity && rest.humidity < cold.humidity);
            assert_eq!((climate.take_on(30 * S), cooled.take_on(31 * S)), ([30 * S, 0], [0, 31 * S]));
            climate.switch(32 * S, false, false);
            climate.air(33 * S);
            assert_eq!((climate.heated(), cooled.heated()), (Some(32 * S), None));
        }
    }

    #[test]
    fn air_is_saturated_at_the_pressure_of_the_tables() {
        // WMO-No. 8: 23.37 hPa at 20 °C.
        assert!((saturation(20.0) - 23.37).abs() < 0.05, "{}", saturation(20.0));
    }
}
