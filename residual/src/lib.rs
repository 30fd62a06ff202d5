//! The exact error detection of the profile's two CRCs.
//!
//! **No estimates.** The probability that damage goes undetected follows from the number of codewords of each weight.
//! These numbers are exact integers: the 2^32 words of the dual code are counted one by one ([`DualWeights`]), and
//! MacWilliams' identity gives the weights of the code ([`Weights`]). Probabilities are sums over all of them
//! ([`undetected_exactly`], [`ErrorCurve`]).
//!
//! **Every number is calculated in two ways.** An independent method finds codewords of low weight one by one
//! ([`Words`]). Its results must agree with the others and with Koopman's published ones. The theory is tested on
//! objects that `profile` sealed ([`wire`]): detectable error patterns must be rejected, and undetectable ones
//! accepted, so that the weights are those of the code in use.
//!
//! **One command.** `cargo xtask residual` makes all of these calculations, and writes `docs/safety/residual-error.md`
//! with its plot. The counting takes a minute or two, so its result is committed ([`codes`]). Tests start from the
//! committed result; the command counts again and compares.

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
