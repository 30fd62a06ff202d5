//! The DPR's rule for the frames of the hold: which frames it accepts, and how long it shows the last object.
use super::{EXPIRY_MS, HoldObject};
use crate::{PortStatusBits, Rejection};

/// What the DPR keeps about the frames of the hold.
///
/// A frame is accepted if it is an intact [object of a hold](HoldObject::verify) and its timestamp differs from that of
/// the last accepted object. So a hold that hangs and repeats its object does not seem alive. The last object is shown
/// for [`EXPIRY_MS`]. After that its bytes in the [map](crate::map) are 0x00, as at the DPR's start.
#[derive(Clone, Debug, Default)]
pub struct Intake {
    /// The timestamp of the last accepted object of the hold, and the instant at which its frame ended, µs.
    accepted: Option<(u32, u64)>,
    /// The instant at which the hold's last frame ended, µs, whether it was accepted or not.
    heard_us: Option<u64>,
    is_last_accepted: bool,
    accepted_count: u32,
    rejected_count: u32,
}

impl Intake {
    /// The state at the DPR's start: no frame has come.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Judges the payload of a frame that ended at `now_us`, µs on a clock that does not wrap.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`], [`Rejection::Crc`] or [`Rejection::Identifier`] as for [`HoldObject::verify`],
    /// [`Rejection::Repeated`] if the object's timestamp is that of the last accepted object.
    pub fn receive<'a>(&mut self, payload: &'a [u8], now_us: u64) -> Result<&'a HoldObject, Rejection> {
        let last = self.accepted.map(|(timestamp, _)| timestamp);
        let judged = HoldObject::verify(payload)
            .and_then(|object| if last == Some(object.timestamp()) { Err(Rejection::Repeated) } else { Ok(object) });
        self.heard_us = Some(now_us);
        self.is_last_accepted = judged.is_ok();
        match judged {
            Ok(object) => {
                self.accepted = Some((object.timestamp(), now_us));
                self.accepted_count = self.accepted_count.wrapping_add(1);
            }
            Err(_) => self.rejected_count = self.rejected_count.wrapping_add(1),
        }
        judged
    }

    /// Whether the last accepted object is shown at `now_us`.
    #[must_use]
    pub fn is_shown(&self, now_us: u64) -> bool {
        self.accepted.is_some_and(|(_, since_us)| is_within_expiry(since_us, now_us))
    }

    /// Sets the bits of Port-Status that describe the hold to the state at `now_us`.
    #[must_use]
    pub fn port_status(&self, status: PortStatusBits, now_us: u64) -> PortStatusBits {
        status
            .with_hold_heard(self.heard_us.is_some_and(|since_us| is_within_expiry(since_us, now_us)))
            .with_hold_accepted(self.is_last_accepted)
            .with_hold_counts(self.accepted_count, self.rejected_count)
    }
}

fn is_within_expiry(since_us: u64, now_us: u64) -> bool {
    // Not covered: only this line, the limit of the subtraction at 0: the frame was heard before now, on the same
    // clock.
    now_us.saturating_sub(since_us) < 1_000 * u64::from(EXPIRY_MS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::criticality::{ActiveLoad, Writer};
    use crate::{HoldStatus, HoldValues};

    fn object(timestamp: u32) -> HoldStatus {
        HoldStatus::seal(Writer::<ActiveLoad>::claim(), &HoldValues::absent(timestamp))
    }

    fn bits(intake: &Intake, now_us: u64) -> (bool, bool, u8, u8) {
        let status = intake.port_status(PortStatusBits::new(), now_us);
        (status.hold_heard(), status.hold_accepted(), status.hold_objects_accepted(), status.hold_objects_rejected())
    }

    #[test]
    fn without_a_hold_port_status_keeps_its_bits() {
        let intake = Intake::new();
        for bits in [0x0000, 0x007F, 0x0015] {
            let status = PortStatusBits::from_bits(bits);
            assert_eq!(intake.port_status(status, u64::MAX), status);
        }
        assert!(!intake.is_shown(0));
    }

    // Shows HOLD-2.
    #[test]
    fn an_object_is_shown_for_less_than_300_ms() {
        let mut intake = Intake::new();
        assert_eq!(intake.receive(object(0).as_bytes(), 5_000), Ok(object(0).as_object()));
        assert!(intake.is_shown(5_000) && intake.is_shown(304_999) && !intake.is_shown(305_000));
        assert_eq!(bits(&intake, 304_999), (true, true, 1, 0));
        assert_eq!(bits(&intake, 305_000), (false, true, 1, 0));
    }

    // Shows HOLD-3.
    #[test]
    fn a_repeated_object_is_rejected_and_does_not_prolong_the_first() {
        let mut intake = Intake::new();
        intake.receive(object(100).as_bytes(), 0).unwrap();
        for now_us in [100_000, 200_000, 299_999] {
            assert_eq!(intake.receive(object(100).as_bytes(), now_us), Err(Rejection::Repeated));
        }
        assert!(!intake.is_shown(300_000));
        assert_eq!(bits(&intake, 300_000), (true, false, 1, 3));
        // An earlier timestamp than the last one is accepted, because a hold that has restarted counts from 0 again.
        assert!(intake.receive(object(0).as_bytes(), 400_000).is_ok());
        assert!(intake.is_shown(400_000));
        assert_eq!(bits(&intake, 400_000), (true, true, 2, 3));
    }

    #[test]
    fn what_is_no_object_of_a_hold_is_rejected_and_counted() {
        let mut intake = Intake::new();
        let mut damaged = *object(100).as_bytes();
        damaged[9] ^= 0x10;
        let horus = *crate::ReportedPosition::seal(&crate::ReportedValues::absent(100)).as_bytes();
        for (payload, rejection) in [
            (&damaged[..], Rejection::Crc),
            (&horus, Rejection::Identifier),
            (&[0; 64], Rejection::Crc),
            (&[0; 244], Rejection::Length),
            (&[], Rejection::Length),
        ] {
            assert_eq!(intake.receive(payload, 7), Err(rejection));
        }
        assert_eq!(bits(&intake, 7), (true, false, 0, 5));
        assert!(!intake.is_shown(7));
        assert!(intake.receive(object(100).as_bytes(), 8).is_ok(), "what was rejected leaves no timestamp");
    }

    #[test]
    fn the_counts_of_port_status_wrap() {
        let mut intake = Intake::new();
        for n in 0..=16 {
            assert_eq!(bits(&intake, 0).2, u8::try_from(n % 16).unwrap());
            assert!(intake.receive(object(n).as_bytes(), 0).is_ok());
        }
        for n in 0..=8 {
            assert_eq!(bits(&intake, 0).3, n % 8);
            assert!(intake.receive(&[], 0).is_err());
        }
        assert_eq!(bits(&intake, 0), (true, false, 1, 1));
    }
}
