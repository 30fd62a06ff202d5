//! The state that the second port's tasks share with the task `port`: the hold's object, and the uplinks for the hold.

use bytemuck::{Pod, Zeroable};
use profile::{
    criticality::{ActiveLoad, BaseStation, FlightController, Writer, WritesUplink},
    hold::{Answer, Intake, COMMAND_AGE_MS},
    map::{self, PortArea},
    HoldObject, PortStatusBits, Rejection, Uplink,
};

use crate::link::Clock;

/// The number of bytes of the hold's object in the image; 0 without the feature `hold`.
pub const SHOWN: usize = if cfg!(feature = "hold") { HoldObject::SIZE } else { 0 };

/// What the task `port` prepares for the next image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Area {
    /// Port-Status and both uplinks.
    pub port: PortArea,
    /// The bytes of the hold's object, or zeros if the object is not valid.
    pub hold: [u8; SHOWN],
}

impl Area {
    /// An area of zeros, in which no object has a right CRC.
    pub const EMPTY: Self = Self { port: PortArea::EMPTY, hold: [0; SHOWN] };

    /// Copies the area into `map`, which has the objects of `N` receivers.
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

/// An uplink for the hold, and the instant at which the DPR stored it, µs since the start.
#[derive(Clone, Copy, Debug)]
struct Kept {
    uplink: Uplink,
    stored_us: Option<u64>,
}

/// The hold's object and the uplinks for the hold.
#[derive(Clone, Debug)]
pub struct Shared {
    clock: Clock,
    intake: Intake,
    object: HoldObject,
    kept: [Kept; 2],
}

impl Default for Shared {
    fn default() -> Self {
        Self::new()
    }
}

impl Shared {
    /// Returns the state at the start, without an object or an uplink.
    #[must_use]
    pub fn new() -> Self {
        Self {
            clock: Clock::new(),
            intake: Intake::new(),
            object: bytemuck::zeroed(),
            kept: [Kept { uplink: Uplink::EMPTY, stored_us: None }; 2],
        }
    }

    /// Checks the payload of a frame that ended at `ended_us` of the µs counter, and keeps its object if it is
    /// accepted. `now_us` is the present value of that counter.
    ///
    /// # Errors
    ///
    /// The errors are those of [`Intake::receive`].
    pub fn receive(&mut self, payload: &[u8], ended_us: u32, now_us: u32) -> Result<(), Rejection> {
        self.clock.advance(now_us);
        self.object = *self.intake.receive(payload, self.clock.instant_us(ended_us))?;
        Ok(())
    }

    /// Copies the hold's object into `place` if it is valid at `now_us`, otherwise zeros. Returns the hold's bits of
    /// Port-Status.
    pub fn show(&mut self, now_us: u32, place: &mut [u8; SHOWN]) -> PortStatusBits {
        self.clock.advance(now_us);
        let shown = if self.intake.is_shown(self.clock.us()) { self.object } else { bytemuck::zeroed() };
        for (place, byte) in place.iter_mut().zip(shown.as_bytes()) {
            *place = *byte;
        }
        self.intake.port_status(PortStatusBits::new(), self.clock.us())
    }

    /// Keeps an uplink of role `W` for the hold. It was stored `stored_us` µs after the DPR's start.
    pub fn keep<W: WritesUplink>(&mut self, uplink: &Uplink, stored_us: Option<u64>) {
        let [base_station, flight_controller] = &mut self.kept;
        let kept = if W::INDEX == 0 { base_station } else { flight_controller };
        if kept.stored_us != stored_us {
            *kept = Kept { uplink: *uplink, stored_us };
        }
    }

    /// Returns the answer at `now_us`: each uplink, or zeros if it was stored too long ago. The uplinks' CRCs are not
    /// checked here.
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

/// Replaces each uplink in `answer` by zeros, unless it is intact.
pub(super) fn intact(mut answer: Answer) -> Answer {
    if answer.uplink::<BaseStation>().is_err() {
        answer.set_uplink(Writer::<BaseStation>::claim(), Uplink::EMPTY);
    }
    if answer.uplink::<FlightController>().is_err() {
        answer.set_uplink(Writer::<FlightController>::claim(), Uplink::EMPTY);
    }
    answer
}
