//! Response times of all tasks of the three firmwares: measured in a search, and bounded by analysis.
//!
//! [`search`] runs the release images in many setups. An observer of each processor ([`observe`]) records each instant
//! at which an exception becomes pending, enters, is preempted or returns, and each change of BASEPRI and PRIMASK. The
//! search finds the longest execution of each task, the longest masked sections, and the greatest demand of a group of
//! tasks in windows of any length. [`tasks`] states deadlines and arrivals with their sources, and [`bounds`] applies
//! the fixed-point analysis of [`analysis`] to both.
//!
//! # What the bound is, and is not
//!
//! An observed execution time is the longest of the search, and no proven worst case. With these times the bound holds
//! for every coincidence of independent tasks, even for one that was not observed. Tasks that follow from one cause,
//! such as a frame, have fixed phases and delay each other only as observed (offsets: K. Tindell, *Adding time-offsets
//! to schedulability analysis*, 1994; measured demands: A. Maxiaguine, S. Künzli, L. Thiele, *Workload characterization
//! model for tasks with variable execution demand*, DATE 2004).

pub mod analysis;
pub mod bounds;
pub mod chart;
pub mod observe;
pub mod search;
pub mod tasks;
