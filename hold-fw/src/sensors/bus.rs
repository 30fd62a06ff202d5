//! Recovers an I2C bus whose SDA a sensor holds low.
//!
//! A sensor holds SDA low when its transfer was cut off, until it has received the missing clocks. Nine clocks end any
//! byte, and the stop condition after them makes every sensor wait for a start (UM10204, 3.1.16 "Bus clear").

/// The number of clocks after which any byte has ended.
const CLOCKS: u32 = 9;

/// Both lines of the I2C bus as open drains. `true` releases a line, which then rises unless a sensor holds it low.
pub trait Lines {
    /// Releases SCL or drives it low.
    fn set_scl(&mut self, high: bool);
    /// Releases SDA or drives it low.
    fn set_sda(&mut self, high: bool);
    /// Whether SCL is high.
    fn scl(&mut self) -> bool;
    /// Whether SDA is high.
    fn sda(&mut self) -> bool;
    /// Waits for half a clock period, 5 µs.
    fn pause(&mut self);
}

/// Frees the bus, in 0.12 ms at most. Returns whether SDA and SCL are high afterwards.
pub fn recover(lines: &mut impl Lines) -> bool {
    lines.set_sda(true);
    lines.set_scl(true);
    lines.pause();
    for _ in 0..CLOCKS {
        lines.set_scl(false);
        lines.pause();
        lines.set_scl(true);
        lines.pause();
    }
    // The stop condition is a rise of SDA while SCL is high.
    lines.set_scl(false);
    lines.pause();
    lines.set_sda(false);
    lines.pause();
    lines.set_scl(true);
    lines.pause();
    lines.set_sda(true);
    lines.pause();
    lines.scl() && lines.sda()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sensor that holds SDA low for a number of clocks, on lines that may be shorted.
    #[derive(Default)]
    struct Bus {
        scl: bool,
        sda: bool,
        holds_for: u32,
        scl_shorted: bool,
        stops: u32,
        pauses: u32,
    }

    impl Lines for Bus {
        fn set_scl(&mut self, high: bool) {
            if high && !self.scl {
                self.holds_for = self.holds_for.saturating_sub(1);
            }
            self.scl = high;
        }
        fn set_sda(&mut self, high: bool) {
            self.stops += u32::from(high && !self.sda && self.scl && self.holds_for == 0);
            self.sda = high;
        }
        fn scl(&mut self) -> bool {
            self.scl && !self.scl_shorted
        }
        fn sda(&mut self) -> bool {
            self.sda && self.holds_for == 0
        }
        fn pause(&mut self) {
            self.pauses += 1;
        }
    }

    #[test]
    fn a_sensor_within_any_bit_of_a_byte_is_freed() {
        for holds_for in 0..=9 {
            let mut bus = Bus { holds_for, ..Bus::default() };
            assert!(recover(&mut bus), "{holds_for}");
            assert!(bus.stops >= 1 && bus.pauses <= 24);
        }
    }

    #[test]
    fn lines_that_stay_low_are_reported_in_bounded_time() {
        let mut held = Bus { holds_for: 100, ..Bus::default() };
        assert!(!recover(&mut held));
        let mut shorted = Bus { scl_shorted: true, ..Bus::default() };
        assert!(!recover(&mut shorted));
        assert!(held.pauses <= 24 && shorted.pauses <= 24);
    }
}
