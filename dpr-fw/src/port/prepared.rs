//! Hands Port-Status and the uplinks over from the port task to the commit task.

use core::borrow::Borrow;

use crate::hold::Area;

/// The newest Port-Status and uplinks that are ready.
///
/// The port task fills another area and then [exchanges](Prepared::exchange) two references. The commit task, of higher
/// priority, [reads](Prepared::newest) the newest area. So the commit task always finds a whole area, and waits no
/// longer than the exchange takes.
#[derive(Clone, Copy, Debug)]
pub struct Prepared<A>(A);

impl<A: Borrow<Area>> Prepared<A> {
    /// Returns a holder whose newest area is `area`.
    pub const fn new(area: A) -> Self {
        Self(area)
    }

    /// Returns the area that the next published image will show.
    pub fn newest(&self) -> &Area {
        self.0.borrow()
    }

    /// Makes `area` the newest one, and puts the previous one into `area`.
    pub fn exchange(&mut self, area: &mut A) {
        core::mem::swap(&mut self.0, area);
    }
}
