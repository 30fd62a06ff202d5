//! All tests that need neither a process nor a clock of their own, in one binary.

mod common;
mod hostile;
mod hostile_hour;
mod parsers;
mod recording;
mod ten_minutes;
