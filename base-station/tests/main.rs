//! The tests without a process or a clock of their own in one binary: each file is a module of it.

mod common;
mod hostile;
mod hostile_hour;
mod parsers;
mod recording;
mod ten_minutes;
