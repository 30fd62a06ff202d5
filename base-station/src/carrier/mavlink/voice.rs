//! Sends the base station's own messages: HEARTBEAT, uplink objects for drones, and [commands](super::commander) to
//! their holds. All are off by default.
//!
//! **HEARTBEAT** is sent once a second over every serial line, to every UDP peer from which a message came within
//! [`HEARD_US`], and to configured addresses. Some autopilots send nothing, or not MAVLink 2, before they receive it.
//! The station must not look like a ground station that can fly: while PX4 or ArduPilot receives one, it holds back its
//! failsafe for a lost ground station. PX4 recognises a ground station by the type MAV_TYPE_GCS, ArduPilot by the
//! system id, 255 by default. So the station's type is MAV_TYPE_ONBOARD_CONTROLLER, and its system id [`SYSTEM`].
//!
//! **An uplink** is one object, sealed once with the station's time, ms since 1970. The DPR stores it only if that time
//! is newer than the last uplink's. The object is sent to its drone, signed, every [`AGAIN_US`], until the drone
//! answers or [`GIVES_UP_US`] have passed. The answer is Port-Status and the uplink that the DPR shows:
//!
//! | answer | the uplink is |
//! |---|---|
//! | the object that was sent | [written](State::Written): the DPR has stored it |
//! | Port-Status without it, over [`ANSWERS_US`] after it was first sent | [refused](State::Refused), with reason |
//! | nothing | [sent](State::Sent), and finally [unanswered](State::Unanswered) |
//!
//! Until [`ANSWERS_US`] after the uplink was first sent, Port-Status may be the answer to an earlier uplink.
//!
//! **A command to a hold** begins the payload of uplinks, each with a later timestamp. A station that sends commands
//! sends no uplinks of users, because the hold could take their payload for a command.

use std::collections::BTreeMap;
use std::net::SocketAddr;

use mavlink::consts::v2::IFLAG_SIGNED;
use mavlink::dialects::common::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType};
use mavlink::{MAVLinkV2MessageRaw, MavHeader};
use profile::criticality::{BaseStation, Writer};
use profile::hold::HoldCommand;
use profile::port_status::Violation;
use profile::{PortValues, Uplink, UplinkStatus, UplinkValues};

use super::commander::{CommandRecord, Commander};
pub use super::not_sent::NotSent;
use super::signing::{self, Signer};
use super::tunnel::Tunnel;
use crate::{Bundle, DroneId, Fleet, Place, Source, Who};

/// The station's default system id. It is not 255, by which ArduPilot recognises its ground station.
pub const SYSTEM: u8 = 254;

/// The station's component id, MAV_COMP_ID_ONBOARD_COMPUTER.
pub const COMPONENT: u8 = 191;

/// The time from one HEARTBEAT to the next, µs.
pub const HEARTBEAT_US: u64 = 1_000_000;

/// How long HEARTBEAT is still sent to a UDP peer after the last message from that peer, µs.
pub const HEARD_US: u64 = 10_000_000;

/// The greatest number of UDP peers to which HEARTBEAT is sent.
pub const MAX_HEARERS: usize = 64;

/// The interval at which an uplink is sent again, µs.
pub const AGAIN_US: u64 = 250_000;

/// How long an uplink is repeated without an answer, µs.
pub const GIVES_UP_US: u64 = 5_000_000;

/// The time after an uplink was first sent during which an answer may still belong to an earlier uplink, µs.
pub const ANSWERS_US: u64 = 1_000_000;

/// The greatest number of drones for which the last uplink is kept.
pub const MAX_SENDINGS: usize = 64;

/// The state of an uplink.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// The uplink was sent; its outcome is not known yet.
    Sent,
    /// The DPR has stored the uplink and shows it.
    Written,
    /// The DPR has not stored the uplink. The text is the reason, if Port-Status gives one.
    Refused(String),
    /// The time within which an answer must come is over.
    Unanswered,
}

impl State {
    /// Returns the name of the state for programs.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Sent => "sent",
            Self::Written => "written",
            Self::Refused(_) => "refused",
            Self::Unanswered => "unanswered",
        }
    }

    /// Returns the reason for which the uplink was refused; `None` if it was not refused.
    #[must_use]
    pub fn why(&self) -> Option<&str> {
        match self {
            Self::Refused(why) => Some(why),
            Self::Sent | Self::Written | Self::Unanswered => None,
        }
    }
}

/// A change of an uplink's state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UplinkChange {
    /// The drone to which the uplink was sent.
    pub drone: DroneId,
    /// The uplink object.
    pub uplink: Uplink,
    /// The new state of the uplink.
    pub state: State,
}

/// The last uplink that was sent to a drone.
#[derive(Clone, Debug)]
pub struct Sending {
    /// The uplink object.
    pub uplink: Uplink,
    /// The instant at which the uplink was first sent, µs.
    pub since_us: u64,
    /// The number of times that the uplink was sent.
    pub times: u32,
    /// The state of the uplink.
    pub state: State,
    /// The instant at which the outcome became known, µs; before that, the instant of the last sending.
    pub at_us: u64,
    first: Option<PortValues>,
}

/// The destination of a message: a line, and an address on that line if the line has addresses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct To {
    /// The number of the line; `None` stands for every line without addresses.
    pub line: Option<u16>,
    /// The address on the line.
    pub address: Option<SocketAddr>,
}

#[derive(Debug, Default)]
struct Heartbeat {
    to: Vec<SocketAddr>,
    heard: BTreeMap<(u16, SocketAddr), u64>,
    last_us: Option<u64>,
}

/// Makes the station's own messages. See the [module](self).
#[derive(Debug)]
pub struct Voice {
    system: u8,
    sequence: u8,
    signer: Option<Signer>,
    heartbeat: Option<Heartbeat>,
    uplinks: Option<BTreeMap<DroneId, Sending>>,
    commander: Option<Commander>,
    sealed: Option<u32>,
    told: Vec<UplinkChange>,
    commands: Vec<CommandRecord>,
}

impl Voice {
    /// Returns a sender of messages with this system id; `signer` signs the messages. The sender sends nothing yet.
    #[must_use]
    pub const fn new(system: u8, signer: Option<Signer>) -> Self {
        let (heartbeat, uplinks, commander, sealed) = (None, None, None, None);
        Self { system, sequence: 0, signer, heartbeat, uplinks, commander, sealed, told: vec![], commands: vec![] }
    }

    /// Enables HEARTBEAT, which is also sent to these addresses.
    #[must_use]
    pub fn with_heartbeat(mut self, to: Vec<SocketAddr>) -> Self {
        self.heartbeat = Some(Heartbeat { to, ..Heartbeat::default() });
        self
    }

    /// Enables uplinks, if there is a signer for them.
    #[must_use]
    pub fn with_uplinks(mut self) -> Self {
        self.uplinks = self.signer.is_some().then(BTreeMap::new);
        self
    }

    /// Enables commands to holds instead of users' uplinks, if there is a signer for them.
    #[must_use]
    pub fn with_commands(mut self) -> Self {
        self.uplinks = None;
        self.commander = self.signer.is_some().then(Commander::default);
        self
    }

    /// Returns whether commands to holds can be sent.
    #[must_use]
    pub const fn sends_commands(&self) -> bool {
        self.commander.is_some()
    }

    /// Begins to send a command to a drone's hold. Returns the command with its number.
    ///
    /// # Errors
    ///
    /// Returns why the command cannot be sent.
    pub fn command(
        &mut self,
        now_us: u64,
        fleet: &Fleet,
        drone: DroneId,
        command: HoldCommand,
    ) -> Result<CommandRecord, NotSent> {
        let commander = self.commander.as_mut().ok_or(NotSent::NoCommands)?;
        fleet.get(drone).ok_or(NotSent::UnknownDrone)?;
        system_of(drone).ok_or(NotSent::NoWay)?;
        let record = commander.send(now_us, fleet, drone, command)?;
        self.commands.push(record.clone());
        Ok(record)
    }

    /// Returns the changes of commands' states since the last call, in order.
    pub fn take_commands(&mut self) -> Vec<CommandRecord> {
        std::mem::take(&mut self.commands)
    }

    /// Returns whether uplinks can be sent.
    #[must_use]
    pub const fn sends_uplinks(&self) -> bool {
        self.uplinks.is_some()
    }

    /// Records that a message came from this address over this line of MAVLink datagrams.
    pub fn heard(&mut self, line: u16, from: SocketAddr, at_us: u64) {
        let Some(Heartbeat { heard, .. }) = &mut self.heartbeat else { return };
        if heard.len() >= MAX_HEARERS {
            heard.retain(|_, last_us| at_us.saturating_sub(*last_us) <= HEARD_US);
        }
        if heard.len() < MAX_HEARERS || heard.contains_key(&(line, from)) {
            heard.insert((line, from), at_us);
        }
    }

    /// Begins to send an uplink to a drone, in place of an earlier one. Returns the uplink's timestamp, ms.
    ///
    /// # Errors
    ///
    /// Returns why the uplink cannot be sent.
    pub fn send(
        &mut self,
        now_us: u64,
        fleet: &Fleet,
        drone: DroneId,
        status: UplinkStatus,
        payload: [u8; Uplink::PAYLOAD],
    ) -> Result<u32, NotSent> {
        let uplinks = self.uplinks.as_mut().ok_or(NotSent::NotAllowed)?;
        fleet.get(drone).ok_or(NotSent::UnknownDrone)?;
        system_of(drone).ok_or(NotSent::NoWay)?;
        if !uplinks.contains_key(&drone) && uplinks.len() >= MAX_SENDINGS {
            let settled = uplinks.iter().filter(|(_, sending)| sending.state != State::Sent);
            let oldest = settled.min_by_key(|(_, sending)| sending.at_us).map(|(drone, _)| *drone);
            uplinks.remove(&oldest.ok_or(NotSent::TooMany)?);
        }
        let uplink = seal(&mut self.sealed, now_us, status, payload);
        let timestamp = uplink.timestamp();
        let (since_us, at_us) = (now_us, now_us);
        self.told.push(UplinkChange { drone, uplink, state: State::Sent });
        uplinks.insert(drone, Sending { uplink, since_us, times: 0, state: State::Sent, at_us, first: None });
        Ok(timestamp)
    }

    /// Returns the last uplink to a drone.
    #[must_use]
    pub fn sending(&self, drone: DroneId) -> Option<&Sending> {
        self.uplinks.as_ref()?.get(&drone)
    }

    /// Returns the changes of uplinks' states since the last call, in order.
    pub fn take_told(&mut self) -> Vec<UplinkChange> {
        std::mem::take(&mut self.told)
    }

    /// Evaluates the answers to uplinks and returns the messages to send at `now_us`, µs since 1970, with their
    /// destinations.
    pub fn tick(&mut self, now_us: u64, fleet: &Fleet) -> Vec<(To, Vec<u8>)> {
        let mut out = vec![];
        for to in self.heartbeat_due(now_us) {
            let bytes = self.heartbeat(now_us);
            out.push((to, bytes));
        }
        let mut due = vec![];
        for (drone, sending) in self.uplinks.iter_mut().flatten() {
            let before = sending.state.clone();
            let is_due = sending.look(now_us, fleet, *drone);
            if sending.state != before {
                self.told.push(UplinkChange { drone: *drone, uplink: sending.uplink, state: sending.state.clone() });
            }
            if is_due && let Some((source, system)) = fleet.source(*drone).zip(system_of(*drone)) {
                due.push((source, system, sending.uplink));
            }
        }
        let Self { commander, commands, sealed, .. } = self;
        let waiting = commander.as_mut().map(|commander| commander.tick(now_us, fleet, |told| commands.push(told)));
        for (drone, payload) in waiting.into_iter().flatten() {
            if let Some((source, system)) = fleet.source(drone).zip(system_of(drone)) {
                due.push((source, system, seal(sealed, now_us, UplinkStatus::default(), payload)));
            }
        }
        for (Source { line, from, .. }, system, uplink) in due {
            let Some(bytes) = self.uplink(now_us, system, uplink.as_bytes()) else { continue };
            out.push((To { line: Some(line), address: from }, bytes));
        }
        out
    }

    fn heartbeat_due(&mut self, now_us: u64) -> Vec<To> {
        let Some(Heartbeat { to, heard, last_us }) = &mut self.heartbeat else { return vec![] };
        if last_us.is_some_and(|last_us| now_us.saturating_sub(last_us) < HEARTBEAT_US) {
            return vec![];
        }
        *last_us = Some(now_us);
        heard.retain(|_, last_us| now_us.saturating_sub(*last_us) <= HEARD_US);
        let told = to.iter().filter(|to| !heard.keys().any(|(_, address)| address == *to));
        let told = told.map(|to| To { line: None, address: Some(*to) });
        let heard = heard.keys().map(|(line, address)| To { line: Some(*line), address: Some(*address) });
        [To { line: None, address: None }].into_iter().chain(told).chain(heard).collect()
    }

    fn heartbeat(&mut self, now_us: u64) -> Vec<u8> {
        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            base_mode: MavModeFlag::empty(),
            system_status: MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
        });
        let header = self.header();
        let mut raw = MAVLinkV2MessageRaw::new();
        match &self.signer {
            Some(_) => raw.serialize_message_for_signing(header, &message),
            None => raw.serialize_message(header, &message),
        }
        if let Some(signer) = &mut self.signer {
            signer.sign(signing::timestamp(now_us), &mut raw);
        }
        raw.raw_bytes().to_vec()
    }

    fn uplink(&mut self, now_us: u64, system: u8, object: &[u8]) -> Option<Vec<u8>> {
        let bundle = Bundle::new(Place::Uplink, 1, object)?;
        let tunnel = Tunnel { target_system: system, ..Tunnel::of(&bundle)? };
        let header = self.header();
        let mut raw = MAVLinkV2MessageRaw::new();
        *raw.incompatibility_flags_mut() |= IFLAG_SIGNED;
        raw.serialize_message_data(header, &tunnel);
        self.signer.as_mut()?.sign(signing::timestamp(now_us), &mut raw);
        Some(raw.raw_bytes().to_vec())
    }

    fn header(&mut self) -> MavHeader {
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        MavHeader { system_id: u32::from(self.system), component_id: COMPONENT, sequence }
    }
}

/// Seals an uplink. Its timestamp is later than the last one, `sealed`.
fn seal(sealed: &mut Option<u32>, now_us: u64, status: UplinkStatus, payload: [u8; Uplink::PAYLOAD]) -> Uplink {
    // Every 50 days the low 32 bits of the time wrap. The DPR accepts a timestamp after a wrap.
    let now_ms = (now_us / 1_000) as u32;
    let timestamp = match *sealed {
        Some(before) if now_ms.wrapping_sub(before).cast_signed() <= 0 => before.wrapping_add(1),
        _ => now_ms,
    };
    *sealed = Some(timestamp);
    Uplink::seal(Writer::<BaseStation>::claim(), &UplinkValues { timestamp, status, payload })
}

impl Sending {
    /// Evaluates the answers to a drone's uplink until `now_us`. Returns whether to send the uplink, perhaps again.
    fn look(&mut self, now_us: u64, fleet: &Fleet, drone: DroneId) -> bool {
        let Some(heard) = fleet.get(drone) else { return false };
        let came_back = heard.uplink() == Some(&self.uplink);
        if came_back && self.state != State::Written {
            (self.state, self.at_us) = (State::Written, now_us);
        }
        if self.state != State::Sent {
            return false;
        }
        if let Some(held) = heard.port_status().filter(|held| held.arrived_us > self.since_us) {
            let first = *self.first.get_or_insert(held.values);
            if held.arrived_us > self.since_us.saturating_add(ANSWERS_US) {
                (self.state, self.at_us) = (State::Refused(why(&first, &held.values)), now_us);
                return false;
            }
        }
        if now_us.saturating_sub(self.since_us) > GIVES_UP_US {
            (self.state, self.at_us) = (State::Unanswered, now_us);
            return false;
        }
        let again = self.times == 0 || now_us.saturating_sub(self.at_us) >= AGAIN_US;
        if again {
            self.times += 1;
            self.at_us = now_us;
        }
        again
    }
}

fn why(first: &PortValues, now: &PortValues) -> String {
    let grown = |kind: &Violation| now.violations.of(*kind) > first.violations.of(*kind);
    let words = |kind: &Violation| match kind {
        Violation::UplinkNotNewer => Some("it is not newer than the one that the DPR had"),
        Violation::UplinkDamaged => Some("it was damaged on the way to the DPR"),
        Violation::UplinkIdentifier => Some("it is no object that may be written"),
        Violation::TooShort => Some("the transaction that wrote it was too short"),
        Violation::TooMany => Some("the DPR had too many transactions"),
        _ => None,
    };
    match Violation::ALL.iter().filter(|kind| grown(kind)).find_map(words) {
        Some(words) => words.to_owned(),
        None if now.status.last_refused() => "the DPR says that it refused the last that came in".to_owned(),
        None => "the DPR shows another one, or none".to_owned(),
    }
}

fn system_of(drone: DroneId) -> Option<u8> {
    match drone.who {
        Who::System(system) => u8::try_from(system).ok(),
        Who::Address(_) | Who::Line(_) | Who::Named(_) => None,
    }
}

#[cfg(test)]
mod tests;
