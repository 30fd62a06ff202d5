//! What the receivers have sent and what is to be sent to them: between their sources and the parser's task
//!
//! `unsafe` here: none.
#![forbid(unsafe_code)]

use core::ops::Range;

use firmware_common::memory;
use horus_tx_fw::{
    source::{Outbox, Ring},
    RECEIVERS,
};

static RINGS: [Ring; RECEIVERS] = [const { Ring::new() }; RECEIVERS];
static OUTBOXES: [Outbox; RECEIVERS] = [const { Outbox::new() }; RECEIVERS];

/// What DMA writes and reads.
pub(super) fn memory() -> [Range<u32>; 2] {
    [memory::span(&RINGS), memory::span(&OUTBOXES)]
}

/// What receiver `index` has sent.
pub fn ring(index: usize) -> &'static Ring {
    &RINGS[index]
}

/// What is to be sent to receiver `index`.
pub fn outbox(index: usize) -> &'static Outbox {
    &OUTBOXES[index]
}
