//! The exact error detection of the profile's two CRCs.
//!
//! # Design
//!
//! **No estimates.** The probability that damage goes undetected follows from the number of codewords of each weight.
//! These numbers are calculated in full, in exact integers: the 2^32 words of the dual code are counted one by one
//! ([`DualWeights`]), MacWilliams' identity gives the weights of the code itself ([`Weights`]), and probabilities are
//! sums over all of them ([`undetected_exactly`], [`ErrorCurve`]).
//!
//! **Every number is calculated in two ways.** A second method, independent of the dual, also finds codewords of low
//! weight one by one ([`Words`]); its results must agree with those of the first and with Koopman's published ones. The
//! theory's statements about error patterns are tested on objects that `profile` sealed ([`wire`]): detectable patterns
//! must be rejected, and undetectable ones accepted, because otherwise the weights might be those of some other code.
//!
//! **One command.** `cargo xtask residual` carries out both methods and the tests, and writes the tables and the plot
//! of `docs/safety/residual-error.md`. The counting takes a minute or two, so its result is committed ([`codes`]).
//! Tests start from the committed result, while the command counts again and compares.
//!
//! | module | contents |
//! |---|---|
//! | [`codes`] | the polynomials and lengths |
//! | [`rate`] | residual errors per hour, SIL bounds, the error interval limit |
//! | [`burst`] | bursts |
//! | [`joint`] | both CRCs over latitude and longitude |
//! | [`wire`] | injected errors, judged by `profile` |
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
