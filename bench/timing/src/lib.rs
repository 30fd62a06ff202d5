//! Response times of all tasks of the three firmwares: measured in a search, and bounded by analysis.
//!
//! [`search`] runs the release images on many setups. An observer at each processor ([`observe`]) notes each
//! exception's pending, entry, preemption and return, and each change of BASEPRI and PRIMASK, to the cycle. From these
//! it has the longest execution of each task, the longest masked sections, and the most execution time that a group of
//! tasks demands in windows of any length. [`tasks`] states deadlines and arrivals with their sources, and [`bounds`]
//! puts both into the fixed-point analysis of [`analysis`].
//!
//! # What the bound is, and is not
//!
//! An execution time that was seen is no proven worst case; it is the longest of a stated search. With it, the bound
//! holds for every coincidence of tasks that do not follow from one cause: it need not have been seen. Tasks that one
//! chain of causes releases (a frame, for instance) come in fixed phases, and so they delay each other as was seen
//! (offsets: K. Tindell, *Adding time-offsets to schedulability analysis*, 1994; measured demands: A. Maxiaguine, S.
//! Künzli, L. Thiele, *Workload characterization model for tasks with variable execution demand*, DATE 2004).

pub mod analysis;
pub mod bounds;
pub mod chart;
pub mod observe;
pub mod search;
pub mod tasks;
