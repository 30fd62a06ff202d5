//! Code that the tests and the fuzz targets share.
#![allow(dead_code, reason = "each test and each fuzz target uses its part of this")]

pub(crate) mod invariants;
pub(crate) mod reference;
pub(crate) mod seeds;
pub(crate) mod tape;
