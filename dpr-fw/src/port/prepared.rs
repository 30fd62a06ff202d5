//! What the port task hands to the commit task.

use core::borrow::Borrow;

use profile::map::PortArea;

/// The newest Port-Status and uplinks that are ready.
///
/// The port task fills an area of its own and [exchanges](Prepared::exchange) it for this one, which moves two
/// references. The commit task, of higher priority, [looks at it](Prepared::newest). So it always finds a whole one,
/// and never waits for longer than the exchange.
#[derive(Clone, Copy, Debug)]
pub struct Prepared<A>(A);

impl<A: Borrow<PortArea>> Prepared<A> {
    /// With an area to begin with.
    pub const fn new(area: A) -> Self {
        Self(area)
    }

    /// What the next image shows.
    pub fn newest(&self) -> &PortArea {
        self.0.borrow()
    }

    /// `area` is the newest from now on; it becomes what was the newest before.
    pub fn exchange(&mut self, area: &mut A) {
        core::mem::swap(&mut self.0, area);
    }
}
