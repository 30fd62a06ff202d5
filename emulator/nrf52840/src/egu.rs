//! EGU: 16 tasks, each of which raises an event, for interrupts and PPI chains that software triggers (PS 6.8).
//!
//! Covered: TRIGGER[0..16], TRIGGERED[0..16], INTEN. Nothing is left out.
use crate::instance::{Block, Cx, Instance, index};

#[derive(Clone, Debug, Default)]
pub(crate) struct Egu {
    block: Block,
}

impl Instance for Egu {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        let Some(n) = index(offset, 0, 4, 16) else {
            return false;
        };
        self.block.raise(n as u32, cx);
        true
    }
}
