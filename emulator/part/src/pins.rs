//! The pins of a part by name.

use crate::Pin;

/// The pins of a part, named as the part's maker names them: P0.13 on the nRF52840, PB7 on the STM32F429.
///
/// ```
/// use emulator_part::{Pin, Pins};
///
/// let pins = Pins { ports: &[("P0.", 32), ("P1.", 16)], digits: 2 };
/// assert_eq!(pins.find("p1.05"), Some(Pin::new(1, 5)));
/// assert_eq!(pins.find("P1.16"), None);
/// assert_eq!(pins.name(Pin::new(1, 5)), "P1.05");
/// assert_eq!(pins.to_string(), "P0.00 to P0.31, P1.00 to P1.15");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pins {
    /// The ports in the order of their numbers: what a pin's name begins with, and the number of pins.
    pub ports: &'static [(&'static str, u8)],
    /// The least number of digits in a pin's name.
    pub digits: usize,
}

impl Pins {
    /// The pin called `name`, in capital or small letters; `None` if the part has no such pin.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<Pin> {
        self.all().find(|&pin| {
            let rest = name.get(..self.port(pin).len()).filter(|port| port.eq_ignore_ascii_case(self.port(pin)));
            rest.map(|port| &name[port.len()..]).is_some_and(|digits| {
                digits.bytes().all(|digit| digit.is_ascii_digit()) && digits.parse() == Ok(pin.number)
            })
        })
    }

    /// The name of `pin`, which is one of [`Pins::all`].
    #[must_use]
    pub fn name(&self, pin: Pin) -> String {
        format!("{}{:0digits$}", self.port(pin), pin.number, digits = self.digits)
    }

    /// All pins, by port and number.
    pub fn all(&self) -> impl Iterator<Item = Pin> {
        (0..).zip(self.ports).flat_map(|(port, &(_, pins))| (0..pins).map(move |number| Pin::new(port, number)))
    }

    fn port(&self, pin: Pin) -> &'static str {
        self.ports.get(usize::from(pin.port)).map_or("P?", |(name, _)| name)
    }
}

/// The first and the last pin of each port.
impl std::fmt::Display for Pins {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (port, &(_, pins)) in (0_u8..).zip(self.ports) {
            let [first, last] = [0, pins.saturating_sub(1)].map(|number| self.name(Pin::new(port, number)));
            write!(f, "{}{first} to {last}", if port == 0 { "" } else { ", " })?;
        }
        Ok(())
    }
}
