//! The pairs of pins from which HORUS derives its state
//!
//! Each pin has a pull-up, so that a pair that is not connected reads as a contradiction (decision 18).

use horus_tx_fw::state_inputs::{Levels, INPUTS};

use super::gpio::{self, Pull};
use crate::board::STATE_INPUTS;

pub fn set_up() {
    gpio::enable_ports();
    for pair in &STATE_INPUTS {
        gpio::input(pair.active, Pull::Up);
        gpio::input(pair.inactive, Pull::Up);
    }
}

pub fn levels() -> [Levels; INPUTS] {
    core::array::from_fn(|index| {
        let pair = &STATE_INPUTS[index];
        Levels { active: gpio::is_high(pair.active), inactive: gpio::is_high(pair.inactive) }
    })
}
