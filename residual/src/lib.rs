//! What the profile's two CRCs are worth, exactly.
//!
//! # Design
//!
//! **Nothing estimated.** The probability that damage goes undetected follows from one set of numbers: how many
//! codewords have each weight. They are computed in full, in exact integers: the 2^32 words of the dual code are
//! counted one by one ([`DualWeights`]), MacWilliams' identity gives the weights of the code itself ([`Weights`]), and
//! probabilities are sums over all of them ([`undetected_exactly`], [`ErrorCurve`]).
//!
//! **Every number in two ways.** Codewords of little weight are also searched for one by one, by a method that knows
//! nothing of the dual ([`Words`]); the two must agree, and with what Koopman published. And what the theory says of a
//! pattern of errors is tried on objects that `profile` sealed ([`wire`]): what must be detected is rejected, and what
//! must not be is accepted, without which the weights might be those of some other code.
//!
//! **One command.** `cargo xtask residual` does all of it and writes the tables and the plot of
//! `docs/safety/residual-error.md`. The counting takes a minute or two, so its result is committed ([`codes`]): tests
//! start from it, the command counts again and compares.
//!
//! | module | says |
//! |---|---|
//! | [`codes`] | which polynomials, at which lengths |
//! | [`rate`] | residual errors per hour, SIL bounds, the error interval limit |
//! | [`burst`] | bursts |
//! | [`joint`] | both CRCs over latitude and longitude |
//! | [`wire`] | what `profile` makes of injected errors |
//! | [`report`], [`plot`] | all of it, for people and programs |

pub mod burst;
pub mod codes;
mod dual;
pub mod joint;
pub mod plot;
mod polynomial;
mod probability;
pub mod rate;
pub mod report;
mod search;
mod weights;
pub mod wire;

pub use codes::Code;
pub use dual::{DualWeights, MAX_LENGTH};
pub use polynomial::Polynomial;
pub use probability::{BitErrorRate, ErrorCurve, Maximum, logarithmic, undetected_exactly};
pub use search::{MAX_LENGTH as MAX_SEARCHED, MAX_WEIGHT, Words};
pub use weights::{NotADual, Weights};
