//! Records what the boards' cores execute, for the object-code coverage of the flight images.

use std::sync::Arc;

use bench_judge::Verdict;
use cortex_m4::coverage::Record;
use cortex_m4::{Cost, Fast};

use super::{Bench, Error, Setup};

/// Records of the code that boards execute, one for each firmware image. Several runs may share them.
#[derive(Clone, Debug)]
pub struct Records {
    /// The record of HORUS's image.
    pub horus: Arc<Record>,
    /// The record of the DPR's image.
    pub dpr: Arc<Record>,
    /// The record of the hold's image, if there is a hold.
    pub hold: Option<Arc<Record>>,
}

impl<C: Cost> Bench<C> {
    /// Notes all that the boards execute from now on. Clones of the bench share the records.
    pub fn set_records(&mut self, records: &Records) {
        self.relay.a.set_record(records.horus.clone());
        self.relay.b.set_record(records.dpr.clone());
        if let Some(record) = &records.hold {
            self.relay.downstream.set_hold_record(record);
        }
    }
}

/// Runs the link on the fast clock to its end, notes in `records` what the boards execute, and returns the judge's
/// verdict.
///
/// # Errors
///
/// The errors are those of [`Bench::new`].
pub fn run(setup: &Setup, records: &Records) -> Result<Verdict, Error> {
    let mut bench: Bench<Fast> = Bench::new(setup)?;
    bench.set_records(records);
    bench.run_to(setup.duration_ns, setup.threads);
    Ok(bench.finish(setup.duration_ns).verdict)
}
