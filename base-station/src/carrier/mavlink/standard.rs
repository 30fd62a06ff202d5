//! The standard messages with which any MAVLink tool shows HORUS's position without a plug-in.
//!
//! These messages have a component id of their own, so that they are not mistaken for the flight controller's. They
//! contain only positions that HORUS marks as valid. They have no CRC of HORUS: a user who must rely on a position
//! reads the objects.
//!
//! | message | contents from Reported-Position |
//! |---|---|
//! | HEARTBEAT | HORUS's state: active only while it monitors; emergency once it has acted; UNINIT without fresh data |
//! | GPS_RAW_INT | position and fix; accuracies unknown, satellites unknown |
//! | ATTITUDE | attitude, if it is valid; rates 0 |
//!
//! The objects' altitudes are above the ellipsoid, MAVLink's above mean sea level. The distance of these two surfaces
//! (up to 100 m) is not known here, so `alt` is 0: evidently wrong rather than wrong by 50 m.
//!
//! GLOBAL_POSITION_INT is not sent: ground stations take it from any component as the vehicle's own position, and would
//! move the map to an altitude of 0.

use mavlink::dialects::common::{
    ATTITUDE_DATA, GPS_RAW_INT_DATA, GpsFixType, HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState,
    MavType,
};
use profile::{HorusState, ReportedValues};

/// The component id of the standard messages: MAV_COMP_ID_PERIPHERAL, in `minimal.xml` for devices without parameters.
pub const COMPONENT: u8 = 158;

/// Returns HEARTBEAT with HORUS's state. `reported` is `None` if there are no fresh data.
#[must_use]
pub fn heartbeat(reported: Option<&ReportedValues>) -> MavMessage {
    let system_status = match reported.map(|values| values.status.state()) {
        Some(Some(HorusState::Monitoring)) => MavState::MAV_STATE_ACTIVE,
        Some(Some(
            HorusState::PositionLost
            | HorusState::OutsideRange
            | HorusState::SwitchedToRedundant
            | HorusState::InputsContradict,
        )) => MavState::MAV_STATE_CRITICAL,
        Some(Some(HorusState::MotorsCut | HorusState::EmergencyFired)) => MavState::MAV_STATE_EMERGENCY,
        Some(Some(HorusState::Starting)) => MavState::MAV_STATE_BOOT,
        Some(None) | None => MavState::MAV_STATE_UNINIT,
    };
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status,
        mavlink_version: 3,
    })
}

/// Returns the standard messages for position and attitude, as far as these are valid.
#[must_use]
pub fn position(reported: &ReportedValues) -> Vec<MavMessage> {
    let reported = reported.checked();
    let mut messages = vec![];
    let time_boot_ms = reported.timestamp;
    if reported.status.position_valid() {
        let (lat, lon) = (degrees_1e7(reported.latitude), degrees_1e7(reported.longitude));
        let is_3d = reported.altitude.is_finite();
        messages.push(MavMessage::GPS_RAW_INT(GPS_RAW_INT_DATA {
            time_usec: u64::from(time_boot_ms) * 1_000,
            fix_type: if is_3d { GpsFixType::GPS_FIX_TYPE_3D_FIX } else { GpsFixType::GPS_FIX_TYPE_2D_FIX },
            lat,
            lon,
            alt: 0,
            eph: u16::MAX,
            epv: u16::MAX,
            vel: u16::MAX,
            cog: u16::MAX,
            satellites_visible: u8::MAX,
        }));
    }
    let angles = [reported.roll, reported.pitch, reported.yaw];
    if reported.status.attitude_valid() {
        let [roll, pitch, yaw] = angles;
        messages.push(MavMessage::ATTITUDE(ATTITUDE_DATA {
            time_boot_ms,
            roll,
            pitch,
            yaw,
            ..ATTITUDE_DATA::default()
        }));
    }
    messages
}

fn degrees_1e7(degrees: f64) -> i32 {
    (degrees * 1e7).round() as i32
}

#[cfg(test)]
mod tests {
    use profile::ReportedStatus;

    use super::*;

    fn values() -> ReportedValues {
        ReportedValues {
            status: ReportedStatus::new().with_position_valid(true).with_attitude_valid(true),
            latitude: -47.497_9,
            longitude: 179.999_999_99,
            altitude: 500.0,
            pitch: 0.1,
            yaw: -0.5,
            roll: 0.2,
            ..ReportedValues::absent(1_230)
        }
    }

    #[test]
    fn a_valid_position_is_told_in_units_of_mavlink() {
        let messages = position(&values());
        let [MavMessage::GPS_RAW_INT(raw), MavMessage::ATTITUDE(attitude)] = &messages[..] else {
            panic!("{messages:?}")
        };
        assert_eq!((raw.lat, raw.lon, raw.time_usec), (-474_979_000, 1_800_000_000, 1_230_000));
        assert_eq!(raw.fix_type, GpsFixType::GPS_FIX_TYPE_3D_FIX);
        assert_eq!((attitude.roll, attitude.pitch, attitude.yaw), (0.2, 0.1, -0.5));
    }

    #[test]
    fn nothing_is_told_that_is_not_valid() {
        let told = |values: ReportedValues| position(&values).len();
        let none = ReportedStatus::new();
        assert_eq!(told(ReportedValues { status: none, ..values() }), 0);
        assert_eq!(told(ReportedValues { status: none.with_attitude_valid(true), ..values() }), 1);
        assert_eq!(told(ReportedValues { status: none.with_position_valid(true), ..values() }), 1);
        assert_eq!(told(ReportedValues { latitude: f64::NAN, ..values() }), 1);
        assert_eq!(told(ReportedValues { latitude: 90.1, ..values() }), 1);
        assert_eq!(told(ReportedValues { longitude: f64::INFINITY, roll: f32::NAN, ..values() }), 0);
    }

    #[test]
    fn the_heartbeat_tells_what_horus_has_done() {
        let told = |state| {
            let status = ReportedStatus::new().with_state(state);
            match heartbeat(Some(&ReportedValues { status, ..values() })) {
                MavMessage::HEARTBEAT(heartbeat) => heartbeat.system_status,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(told(HorusState::Monitoring), MavState::MAV_STATE_ACTIVE);
        assert_eq!(told(HorusState::Starting), MavState::MAV_STATE_BOOT);
        assert_eq!(told(HorusState::PositionLost), MavState::MAV_STATE_CRITICAL, "and not active");
        assert_eq!(told(HorusState::MotorsCut), MavState::MAV_STATE_EMERGENCY);
    }
}
