//! Everything that a run of the link must not show.

macro_rules! violations {
    ($($(#[$doc:meta])* $name:ident = $words:literal,)*) => {
        /// Something that a run of the link must not show. The rule that finds it is in [`crate::rules`].
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Violation {
            $($(#[$doc])* $name,)*
        }

        impl Violation {
            /// All of them.
            pub const ALL: &'static [Self] = &[$(Self::$name,)*];

            /// In words.
            #[must_use]
            pub const fn words(self) -> &'static str {
                match self {
                    $(Self::$name => $words,)*
                }
            }
        }
    };
}

violations! {
    // ---- Sending side

    /// HORUS does not tick. From a start-up time after power-on or reset, or one and a half cycles after a tick,
    /// there is no tick.
    NoTick = "HORUS does not tick",
    /// The tick is not constant. Two ticks are not 10 ms apart, give or take what a clock without its crystal is
    /// off, or not equally far.
    TickIrregular = "the tick is not constant",
    /// A cycle without its frames. A tick was not followed by the frames of its cycle.
    NoFrame = "a cycle without its frames",
    /// More frames than the cycle has. HORUS sent a frame that its cycle does not have.
    ExtraFrame = "more frames than the cycle has",
    /// A transmit command without a frame. A transmit command was not followed by a frame.
    CommandWithoutFrame = "a transmit command without a frame",
    /// A frame without a transmit command. A frame that no transmit command began.
    FrameWithoutCommand = "a frame without a transmit command",
    /// HORUS broke a frame off. The poller ended a frame before all of it was sent.
    BrokenOff = "HORUS broke a frame off",
    /// HORUS sent something that is not whole objects. The payload has no frame's length.
    SentNotWhole = "HORUS sent something that is not whole objects",
    /// HORUS sent an object that is not valid. CRC or identifier of an object on the air is wrong.
    SentInvalid = "HORUS sent an object that is not valid",
    /// HORUS's timestamp is not its tick's. The timestamp is not 10 ms for each tick since the start; also one from
    /// the future.
    TimestampWrong = "HORUS's timestamp is not its tick's",
    /// The time from tick to command is not constant. Peak to peak.
    CommandJitter = "the time from tick to command is not constant",
    /// The time from tick to air is not constant. Peak to peak.
    AirJitter = "the time from tick to air is not constant",
    /// The field dropped. HORUS's carrier went off while it ran.
    FieldDropped = "the field dropped",
    /// A GPS object differs from what its receiver said. A value is not that of the message the receiver sent last.
    ContentWrong = "a GPS object differs from what its receiver said",
    /// A GPS object's status differs from what its receiver sent. A bit of the status: fix, valid, heard, stale.
    StatusWrong = "a GPS object's status differs from what its receiver sent",
    /// Reported-Position is not what the receivers that agree say. Its position, attitude or acceleration is not their
    /// median, it claims more or fewer of them, or its status is not what follows.
    ReportedWrong = "Reported-Position is not what the receivers that agree say",
    /// A voted position without a majority, or one that jumps. Too few receivers, or no more than are against them, or
    /// receivers that do not agree; or a place or an altitude that the last one does not lead to and that has not held
    /// for a second.
    VoteWrong = "a voted position without a majority, or one that jumps",
    /// No voted position although a majority agrees, and it does not jump or has held for a second.
    VoteMissing = "no voted position although a majority agrees",
    /// A receiver is excluded without a cause, or is not excluded although it agrees with no member. Or it returns
    /// before it has agreed for a second, or not after that.
    ExclusionWrong = "a receiver is wrongly excluded, or wrongly not",
    /// A position of a receiver that does not navigate as airborne. HORUS shows it as valid, long after it should have
    /// told the receiver its dynamic model.
    NotAirborne = "a position of a receiver that does not navigate as airborne",
    /// HORUS's state is not what its inputs say. The relay, the motor cut or the emergency measure is active or
    /// contradicts itself for longer than the debounce time, and the state shows something else, or the other way
    /// round.
    StateWrong = "HORUS's state is not what its inputs say",
    /// HORUS does not read what a receiver offers. What a receiver on a bus has to say waits until HORUS reads it; a
    /// receiver on a UART does not wait.
    NotRead = "HORUS does not read what a receiver offers",
    /// A receiver is not set as HORUS needs it. It puts no positions out, long after HORUS should have told it to.
    NotConfigured = "a receiver is not set as HORUS needs it",
    /// HORUS has no position in a sound run. Enough receivers are well, and nothing else that is found explains it.
    NoPosition = "HORUS has no position in a sound run",
    /// A position far from where the aircraft is. Reported-Position shows it as valid, and the aircraft was at no such
    /// place for as long as a solution may be valid.
    PositionOff = "a position far from where the aircraft is",
    /// HORUS tells wrongly whether it runs without its crystal.
    CrystalWrong = "HORUS tells wrongly whether it runs without its crystal",
    /// A fault has no consequence. A bit of a board's program memory was changed, a bit of a buffer is stuck, or a
    /// supply falls, and the board neither says so nor stops within the required time.
    FaultUnnoticed = "a fault has no consequence",
    // ---- DPR and SSI

    /// The listener answered. The DPR's front end sent something.
    Answered = "the listener answered",
    /// The flight controller reads nothing. There was no transaction for longer than its cycle allows.
    NoTransaction = "the flight controller reads nothing",
    /// The DPR never got ready for a transaction. From a start-up time after power-on or reset on, nothing could be
    /// read.
    NeverReady = "the DPR never got ready for a transaction",
    /// The SSI was not ready in time. After the end of a transaction the DPR could not serve the next within its
    /// bound.
    NotReady = "the SSI was not ready in time",
    /// A transaction reads nothing although an image is readable. It reads 0xFF throughout, and no image was being put
    /// in, nor had a transaction just ended.
    Unserved = "a transaction reads nothing although an image is readable",
    /// FRESH is too short. The flight controller's pin interrupt may miss the pulse.
    FreshShort = "FRESH is too short",
    /// The SSI was held back too long. The processor kept the SSI's buffers longer than its bound.
    HeldBack = "the SSI was held back too long",
    /// Two transactions in a row met the DPR busy. One may, while a new image is put in.
    BusyTwice = "two transactions in a row met the DPR busy",
    /// Nothing can be read. Nothing is readable although the DPR runs: its images expire instead of being replaced.
    Silent = "nothing can be read",
    /// A vacant object although it was delivered whole. The image shows the cycle, and lacks an object of it that
    /// reached the antenna whole.
    Vacant = "a vacant object although it was delivered whole",
    /// A cycle not shown although it was delivered. A cycle in sequence reached the antenna whole and was never
    /// shown.
    NotShown = "a cycle not shown although it was delivered",
    /// An invalid object shown as valid. It was never sent by HORUS so, whatever its CRC says.
    ShownNeverSent = "an invalid object shown as valid",
    /// An object out of sequence shown as valid. Repeated, delayed, inserted or before the sequence was found.
    ShownOutOfSequence = "an object out of sequence shown as valid",
    /// Stale data shown past its deadline. An object is shown although the next frame was missed and the deadline
    /// has passed.
    ShownStale = "stale data shown past its deadline",
    /// An expired image can be read. An object is shown although its image was not replaced within its 25 ms.
    ShownExpired = "an expired image can be read",
    /// Old data shown after new. An object older than one of its kind that was shown before.
    Regression = "old data shown after new",
    /// A torn read. What one transaction read is of several images, down to the byte.
    Torn = "a torn read",
    /// Damaged data in the image. A place is neither an intact object nor vacant nor torn.
    Damaged = "damaged data in the image",
    /// A valid object in another's place. An intact object in a place that is not its own.
    Misplaced = "a valid object in another's place",
    /// FRESH without a readable image. FRESH rose, and a transaction at that instant would have met the DPR busy,
    /// or an unsound image.
    FreshUnreadable = "FRESH without a readable image",
    /// FRESH without a fresh image. FRESH rose, and what was readable at that instant was the image of before.
    FreshNotNew = "FRESH without a fresh image",
    /// An image readable without FRESH. A transaction brought an image that FRESH had not announced.
    FreshMissing = "an image readable without FRESH",
    /// A frame was readable too late after its last bit.
    LateReadable = "a frame was readable too late after its last bit",
    /// A sample was readable too late.
    LateSample = "a sample was readable too late",
    /// The link recovers too late. After a cause has gone away, no valid object that HORUS sent after it was read
    /// within the cycles that a recovery may take.
    RecoversLate = "the link recovers too late",
    /// Link-Status tells a wrong age. Against the instant of the sample as it was on the wires.
    LinkAge = "Link-Status tells a wrong age",
    /// Link-Status tells wrong counters. Against the frames that reached the antenna.
    LinkCounters = "Link-Status tells wrong counters",
    /// Link-Status tells wrong flags. Against what reached the antenna and what happened to the board.
    LinkFlags = "Link-Status tells wrong flags",
    /// Link-Status tells a wrong time. Its timestamp against the time since the DPR's start.
    LinkTime = "Link-Status tells a wrong time",
    /// Port-Status tells what is not so. Uplinks, commands and violations of each kind against what was written.
    PortStatusWrong = "Port-Status tells what is not so",
    /// An uplink is read otherwise than it was written. Its bytes, its age, whether it is fresh.
    UplinkWrong = "an uplink is read otherwise than it was written",
    // ---- Flight controller and base station

    /// The client flies by a position that it must not. It is too old, or none that HORUS sent.
    ClientWrong = "the client flies by a position that it must not",
    /// The client tells a wrong age. Against the instant of the sample, as far as the wires tell it.
    ClientAge = "the client tells a wrong age",
    /// The client has no position although it reads valid ones in sequence.
    ClientHides = "the client has no position although it reads them",
    /// A profile is not forwarded. The flight controller read a new one, whole and sound.
    NotForwarded = "a profile is not forwarded",
    /// The base station tells a wrong age. Against the instant of the sample that it shows.
    StationAge = "the base station tells a wrong age",
    /// The base station alarms wrongly. An alarm holds that must not, or one that must does not.
    StationAlarm = "the base station alarms wrongly",

    /// The base station missed a profile. It was forwarded and did not arrive.
    BaseMissed = "the base station missed a profile",
    /// The base station got another profile than was forwarded. Bytes were changed, added or invented on the way.
    BaseChanged = "the base station got another profile than was forwarded",
    /// The base station shows an object that is not valid. By CRC, identifier or place.
    BaseInvalid = "the base station shows an object that is not valid",
    /// The base station shows objects of several cycles as one.
    BaseMixed = "the base station shows objects of several cycles as one",
    /// The base station does not show an object that is valid.
    BaseHidden = "the base station does not show an object that is valid",
    // ---- Boards

    /// HORUS restarted unasked.
    HorusRestarted = "HORUS restarted unasked",
    /// The DPR restarted unasked.
    DprRestarted = "the DPR restarted unasked",
    /// HORUS hangs, and its watchdog does not restart it. The bench had its core stop, and the longest time that the
    /// watchdog may take has passed.
    HorusStaysHung = "HORUS hangs, and its watchdog does not restart it",
    /// The DPR hangs, and its watchdog does not restart it. As with HORUS.
    DprStaysHung = "the DPR hangs, and its watchdog does not restart it",
    /// HORUS did what its part does not allow.
    HorusFinding = "HORUS did what its part does not allow",
    /// The DPR did what its part does not allow.
    DprFinding = "the DPR did what its part does not allow",
    /// A front end was used against its data sheet. By either firmware; the words say which.
    FrontEndMisuse = "a front end was used against its data sheet",
    /// HORUS's processor is loaded too much.
    HorusOverloaded = "HORUS's processor is loaded too much",
    /// The DPR's processor is loaded too much.
    DprOverloaded = "the DPR's processor is loaded too much",
    /// HORUS counts faults that have no cause. A counter of the firmware's own, beside what is seen from outside.
    HorusComplains = "HORUS counts faults that have no cause",
    /// The DPR counts faults that have no cause. A counter of the firmware's own, beside what is seen from outside.
    DprComplains = "the DPR counts faults that have no cause",
    /// An image without telemetry. A counter that is evidence is missing.
    NoTelemetry = "an image without telemetry",
    /// The bench acted late. So the run is not exact in time.
    Late = "the bench acted late",
}

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.words())
    }
}
