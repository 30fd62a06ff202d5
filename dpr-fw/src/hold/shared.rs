//! What the tasks of the second port and the task `port` share: the hold's object, and the uplinks for the hold.

use bytemuck::{Pod, Zeroable};
use profile::{
    criticality::{ActiveLoad, BaseStation, FlightController, Writer, WritesUplink},
    hold::{Answer, Intake, COMMAND_AGE_MS},
    map::{self, PortArea},
    HoldObject, PortStatusBits, Rejection, Uplink,
};

use crate::link::Clock;

/// The number of bytes of the hold's object in the image, which is none without the feature `hold`.
pub const SHOWN: usize = if cfg!(feature = "hold") { HoldObject::SIZE } else { 0 };

/// What the port task prepares for the next image: Port-Status and both uplinks, then the hold's object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Area {
    /// Port-Status and both uplinks.
    pub port: PortArea,
    /// The hold's object, or zeros.
    pub hold: [u8; SHOWN],
}

impl Area {
    /// Zeros, in which no object verifies.
    pub const EMPTY: Self = Self { port: PortArea::EMPTY, hold: [0; SHOWN] };

    /// Copies the area to its place in `map`, which is one for `N` receivers.
    pub fn place<const N: usize>(&self, writer: Writer<profile::criticality::Dpr>, map: &mut [u8]) {
        if let Some(place) = map::port_area_mut::<_, N>(writer, map) {
            *place = *self.port.as_bytes();
        }
        if let (Some(place), Some(hold)) =
            (map::hold_mut::<_, N>(Writer::<ActiveLoad>::claim(), map), self.hold.first_chunk())
        {
            *place = *hold;
        }
    }
}

/// An uplink that the hold gets, with the instant at which it was stored, µs since start.
#[derive(Clone, Copy, Debug)]
struct Kept {
    uplink: Uplink,
    stored_us: Option<u64>,
}

/// The state that the tasks of the second port share with the task `port`.
#[derive(Clone, Debug)]
pub struct Shared {
    clock: Clock,
    intake: Intake,
    object: HoldObject,
    /// The uplinks of the base station and of the flight controller.
    kept: [Kept; 2],
}

impl Default for Shared {
    fn default() -> Self {
        Self::new()
    }
}

impl Shared {
    /// Returns the state before anything has come in.
    #[must_use]
    pub fn new() -> Self {
        Self {
            clock: Clock::new(),
            intake: Intake::new(),
            object: bytemuck::zeroed(),
            kept: [Kept { uplink: Uplink::EMPTY, stored_us: None }; 2],
        }
    }

    /// Judges the payload of a frame that ended when the µs counter was at `ended_us`; it is at `now_us`.
    ///
    /// # Errors
    ///
    /// The errors are those of [`Intake::receive`].
    pub fn receive(&mut self, payload: &[u8], ended_us: u32, now_us: u32) -> Result<(), Rejection> {
        self.clock.advance(now_us);
        self.object = *self.intake.receive(payload, self.clock.instant_us(ended_us))?;
        Ok(())
    }

    /// Puts the hold's object into `place` as the image shows it at `now_us`, or zeros. Returns the hold's bits of
    /// Port-Status.
    pub fn show(&mut self, now_us: u32, place: &mut [u8; SHOWN]) -> PortStatusBits {
        self.clock.advance(now_us);
        let shown = if self.intake.is_shown(self.clock.us()) { self.object } else { bytemuck::zeroed() };
        for (place, byte) in place.iter_mut().zip(shown.as_bytes()) {
            *place = *byte;
        }
        self.intake.port_status(PortStatusBits::new(), self.clock.us())
    }

    /// Keeps an uplink of role `W`, which was stored `stored_us` µs after the DPR's start, for the hold.
    pub fn keep<W: WritesUplink>(&mut self, uplink: &Uplink, stored_us: Option<u64>) {
        let [base_station, flight_controller] = &mut self.kept;
        let kept = if W::INDEX == 0 { base_station } else { flight_controller };
        if kept.stored_us != stored_us {
            *kept = Kept { uplink: *uplink, stored_us };
        }
    }

    /// Returns the answer at `now_us`: each uplink as it was stored, or zeros if it was stored too long ago. It does
    /// not show whether they are intact.
    #[must_use]
    pub fn answer(&mut self, now_us: u32) -> Answer {
        self.clock.advance(now_us);
        let now_us = self.clock.us();
        let [base_station, flight_controller] = self.kept.map(|kept| {
            let is_fresh = |stored: u64| now_us.wrapping_sub(stored) <= 1_000 * u64::from(COMMAND_AGE_MS);
            if kept.stored_us.is_some_and(is_fresh) {
                kept.uplink
            } else {
                Uplink::EMPTY
            }
        });
        let mut answer = Answer::EMPTY;
        answer.set_uplink(Writer::<BaseStation>::claim(), base_station);
        answer.set_uplink(Writer::<FlightController>::claim(), flight_controller);
        answer
    }
}

/// Returns `answer` with zeros in place of an uplink that is not intact.
pub(super) fn intact(mut answer: Answer) -> Answer {
    if answer.uplink::<BaseStation>().is_err() {
        answer.set_uplink(Writer::<BaseStation>::claim(), Uplink::EMPTY);
    }
    if answer.uplink::<FlightController>().is_err() {
        answer.set_uplink(Writer::<FlightController>::claim(), Uplink::EMPTY);
    }
    answer
}
