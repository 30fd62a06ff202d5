//! Code shared by the tests and the fuzz targets: an independent reference, the invariants of every parser, and the
//! initial seeds of fuzzing.
#![allow(dead_code, reason = "each test and each fuzz target uses its part of this")]

pub(crate) mod invariants;
pub(crate) mod reference;
pub(crate) mod seeds;
pub(crate) mod tape;
