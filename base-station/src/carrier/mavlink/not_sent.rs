//! The reasons why the station does not send what a user of the page asked for.

/// The reason why an uplink, or a command to a hold, is not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotSent {
    /// This station sends no uplinks.
    NotAllowed,
    /// There is no drone with this id.
    UnknownDrone,
    /// The drone cannot be reached, because its messages do not come over MAVLink.
    NoWay,
    /// Uplinks to as many other drones as the station allows are under way already.
    TooMany,
    /// This station sends no commands to holds.
    NoCommands,
    /// The drone has no present Hold-Status, so the command cannot be numbered.
    NoHold,
    /// Hold-Status has come for less than 2 s, so an earlier command may be under way.
    HoldIsNew,
    /// Another command to this hold waits for its acknowledgement.
    CommandWaits,
}

impl std::fmt::Display for NotSent {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::NotAllowed => "this station sends no uplinks: it was started without --uplink",
            Self::UnknownDrone => "this drone is not known here",
            Self::NoWay => "this drone is not heard over MAVLink, so no uplink can be sent to it",
            Self::TooMany => "too many uplinks are under way",
            Self::NoCommands => "this station sends no commands to holds: it was started without --hold-commands",
            Self::NoHold => "there is no present Hold-Status of this drone",
            Self::HoldIsNew => "the hold has been heard for less than 2 s: an earlier command may be under way",
            Self::CommandWaits => "the command before this one is pending",
        })
    }
}
