//! The buffers between each receiver's source and the parser's task, one for each direction
#![forbid(unsafe_code)]

use core::ops::Range;

use firmware_common::memory;
use horus_tx_fw::{
    source::{Outbox, Ring},
    RECEIVERS,
};

static RINGS: [Ring; RECEIVERS] = [const { Ring::new() }; RECEIVERS];
static OUTBOXES: [Outbox; RECEIVERS] = [const { Outbox::new() }; RECEIVERS];

pub(super) fn memory() -> [Range<u32>; 2] {
    [memory::span(&RINGS), memory::span(&OUTBOXES)]
}

/// Returns the ring of the bytes that receiver `index` has sent.
pub fn ring(index: usize) -> &'static Ring {
    // Not covered: an index beyond the receivers: each source has the index of its own receiver.
    &RINGS[index]
}

/// Returns the outbox of the messages to receiver `index`.
pub fn outbox(index: usize) -> &'static Outbox {
    &OUTBOXES[index]
}
