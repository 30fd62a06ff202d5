//! Hands Port-Status and the uplinks over from the port task to the commit task.

use core::borrow::Borrow;

use crate::hold::Area;

/// The newest Port-Status and uplinks that are ready.
///
/// The port task fills an area of its own and [exchanges](Prepared::exchange) it for this one, which moves two
/// references. The commit task, of higher priority, [reads](Prepared::newest) this one. So the commit task always finds
/// a whole area, and never waits for longer than the exchange takes.
#[derive(Clone, Copy, Debug)]
pub struct Prepared<A>(A);

impl<A: Borrow<Area>> Prepared<A> {
    /// Returns a holder whose newest area is `area`.
    pub const fn new(area: A) -> Self {
        Self(area)
    }

    /// Returns the area that the next image shows.
    pub fn newest(&self) -> &Area {
        self.0.borrow()
    }

    /// Makes `area` the newest one. The area that was the newest before is then in `area`.
    pub fn exchange(&mut self, area: &mut A) {
        core::mem::swap(&mut self.0, area);
    }
}
