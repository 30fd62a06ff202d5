//! The record of the instructions that a board's core executed.

use std::sync::Arc;

use cortex_m4::Cost;
use cortex_m4::coverage::Record;

use super::{Board, Node};

impl<B: Board, C: Cost> Node<B, C> {
    /// Notes each instruction that the core completes in `record` from now on, see
    /// [`cortex_m4::coverage`]. A clone of the node shares the record.
    pub fn set_record(&mut self, record: Arc<Record>) {
        self.core.set_record(Some(record));
    }
}
