//! The violations that a run of the link must not show.

macro_rules! violations {
    ($($(#[$doc:meta])* $name:ident = $words:literal,)*) => {
        /// A fault that a run of the link must not show. A rule of [`crate::rules`] finds it.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Violation {
            $($(#[$doc])* $name,)*
        }

        impl Violation {
            /// All violations, in the order of their declaration.
            pub const ALL: &'static [Self] = &[$(Self::$name,)*];

            /// Returns a short description of the violation.
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

    /// No tick came within the start-up time after power-on or reset, or within one and a half cycles after the last
    /// tick.
    // Shows TIME-1.
    NoTick = "HORUS does not tick",
    /// The time between two ticks varies too much, or differs from 10 ms by more than a clock without its crystal may
    /// be off.
    // Shows TIME-1.
    TickIrregular = "the tick is not constant",
    /// A tick was not followed by the frames of its cycle.
    // Shows TIME-2.
    NoFrame = "a cycle without its frames",
    /// HORUS sent more frames in a cycle than the cycle has.
    // Shows TIME-2.
    ExtraFrame = "more frames than the cycle has",
    /// A transmit command was not followed by a frame.
    CommandWithoutFrame = "a transmit command without a frame",
    /// A frame began without a transmit command.
    FrameWithoutCommand = "a frame without a transmit command",
    /// HORUS broke a frame off: the poller ended the frame before all of it was sent.
    // Shows TIME-2.
    BrokenOff = "HORUS broke a frame off",
    /// The payload of a frame that HORUS sent has a length that no frame of the profile has.
    SentNotWhole = "HORUS sent something that is not whole objects",
    /// The CRC or the identifier of an object that HORUS sent is wrong.
    SentInvalid = "HORUS sent an object that is not valid",
    /// HORUS's timestamp does not count 10 ms for each tick since the start, or lies in the future.
    // Shows TIME-3.
    TimestampWrong = "HORUS's timestamp is not its tick's",
    /// The spread, peak to peak, of the time from a tick to the transmit command exceeds the bound.
    // Shows TIME-5.
    CommandJitter = "the time from tick to command is not constant",
    /// The spread, peak to peak, of the time from a tick to the first bit on the air exceeds the bound.
    // Shows TIME-5.
    AirJitter = "the time from tick to air is not constant",
    /// HORUS's carrier went off although HORUS was running.
    FieldDropped = "the field dropped",
    /// A value in a GPS object is not that of the receiver's last message.
    // Shows REC-5, REC-6.
    ContentWrong = "a GPS object differs from what its receiver said",
    /// A bit of a GPS object's status does not fit what the receiver sent.
    // Shows REC-1, REC-2, REC-3, REC-4.
    StatusWrong = "a GPS object's status differs from what its receiver sent",
    /// Reported-Position does not follow from the receivers that agree, or its status is wrong.
    // Shows VOTE-2, VOTE-3, STA-4, STA-5, STA-6.
    ReportedWrong = "Reported-Position is not what the receivers that agree say",
    /// HORUS shows a voted position that has no majority of receivers, or one that jumps. A position jumps if it is
    /// farther from the last one than an aircraft can have flown. HORUS may show such a position only after it has
    /// lasted for a second.
    // Shows VOTE-1, VOTE-4.
    VoteWrong = "a voted position without a majority, or one that jumps",
    /// HORUS shows no voted position although a majority agrees and the position need not be held back.
    // Shows VOTE-7.
    VoteMissing = "no voted position although a majority agrees",
    /// A receiver is excluded without a cause, or is not excluded although it agrees with no receiver of the voted
    /// position. The same violation covers a return before or well after the receiver has agreed for a second.
    // Shows VOTE-5, VOTE-6.
    ExclusionWrong = "a receiver is wrongly excluded, or wrongly not",
    /// HORUS shows as valid the position of a receiver whose dynamic model HORUS should have set long before.
    // Shows REC-7.
    NotAirborne = "a position of a receiver that does not navigate as airborne",
    /// HORUS's state does not fit its inputs (relay, motor cut, emergency measure). Either an input was active, or
    /// contradicted itself, for the debounce time and the state does not show it. Or the state shows what no input
    /// justifies.
    // Shows STA-1, STA-2.
    StateWrong = "HORUS's state is not what its inputs say",
    /// HORUS does not read the bytes that wait in a receiver on a bus.
    // Shows REC-9.
    NotRead = "HORUS does not read what a receiver offers",
    /// A receiver does not send positions, although HORUS should have set it to do so long before.
    // Shows REC-8.
    NotConfigured = "a receiver is not set as HORUS needs it",
    /// HORUS has no position although enough receivers work, and no other violation explains this.
    NoPosition = "HORUS has no position in a sound run",
    /// Reported-Position shows a valid position that is too far from the aircraft's true position.
    // Shows VOTE-8.
    PositionOff = "a position far from where the aircraft is",
    /// HORUS states wrongly whether it runs without its crystal.
    // Shows STA-3.
    CrystalWrong = "HORUS tells wrongly whether it runs without its crystal",
    /// A bit of program memory changed, a bit of a buffer is stuck, a supply falls, or a task of a cycle ran out of its
    /// turn. The board neither reports the fault nor stops within the required time.
    // Shows IMG-4, SAFE-3, SAFE-15, SAFE-16.
    FaultUnnoticed = "a fault has no consequence",
    // ---- DPR and SSI

    /// The DPR's front end sent something, although it must only receive.
    // Shows WAY-2.
    Answered = "the listener answered",
    /// The flight controller made no transaction for longer than its control cycle allows.
    NoTransaction = "the flight controller reads nothing",
    /// Nothing could be read although the DPR's start-up time after power-on or reset had passed.
    NeverReady = "the DPR never got ready for a transaction",
    /// After the end of a transaction the DPR could not serve the next one within the bound.
    // Shows SSI-5.
    NotReady = "the SSI was not ready in time",
    /// A transaction read 0xFF throughout although an image was readable.
    // Shows SSI-1.
    Unserved = "a transaction reads nothing although an image is readable",
    /// FRESH is high for too short a time, so the flight controller's pin interrupt may miss the pulse.
    // Shows IMG-3.
    FreshShort = "FRESH is too short",
    /// The processor kept the SSI's buffers longer than the bound, so no transaction could be served.
    HeldBack = "the SSI was held back too long",
    /// Two transactions in a row found the DPR busy. Only one may, while the DPR puts in a new image.
    // Shows SSI-1.
    BusyTwice = "two transactions in a row met the DPR busy",
    /// Nothing can be read although the DPR runs, because its images expire and no new one replaces them.
    // Shows SSI-1.
    Silent = "nothing can be read",
    /// The image shows objects of a cycle but lacks one that reached the antenna whole.
    // Shows IMG-2.
    Vacant = "a vacant object although it was delivered whole",
    /// A cycle was not shown although it reached the antenna whole and in sequence.
    // Shows IMG-2, TIME-9.
    NotShown = "a cycle not shown although it was delivered",
    /// An object is shown whose CRC is right, but HORUS never sent these bytes.
    // Shows OBJ-1.
    ShownNeverSent = "an invalid object shown as valid",
    /// An object is shown whose frame was repeated, delayed or inserted, or whose frame came before the sequence was
    /// found.
    // Shows SEQ-1, SEQ-2, SEQ-3, SEQ-4.
    ShownOutOfSequence = "an object out of sequence shown as valid",
    /// An object is shown although a later frame was missed and that frame's deadline has passed.
    // Shows IMG-1.
    ShownStale = "stale data shown past its deadline",
    /// An object is shown although its image was not replaced within 25 ms.
    // Shows IMG-5.
    ShownExpired = "an expired image can be read",
    /// An object is shown that is older than an object with the same identifier shown before.
    // Shows IMG-7.
    Regression = "old data shown after new",
    /// The bytes that a transaction read come from several images, even those of a single object.
    // Shows IMG-7.
    Torn = "a torn read",
    /// The bytes of an object are neither intact nor empty nor torn.
    // Shows OBJ-1.
    Damaged = "damaged data in the image",
    /// An object is intact, but stands at another object's offset.
    // Shows OBJ-6.
    Misplaced = "a valid object in another's place",
    /// A transaction at the rise of FRESH would have found the DPR busy, or would have read an unsound image.
    // Shows IMG-3.
    FreshUnreadable = "FRESH without a readable image",
    /// FRESH rose, but the image that could be read was still the one before.
    // Shows IMG-3.
    FreshNotNew = "FRESH without a fresh image",
    /// A transaction read an image that FRESH had not announced.
    // Shows IMG-3.
    FreshMissing = "an image readable without FRESH",
    /// A frame was readable too late after its last bit.
    // Shows TIME-6.
    LateReadable = "a frame was readable too late after its last bit",
    /// A sample was readable too late after its tick.
    LateSample = "a sample was readable too late",
    /// After a disturbance the flight controller does not read a new valid object within the allowed number of cycles.
    // Shows TIME-9.
    RecoversLate = "the link recovers too late",
    /// The age of the sample in Link-Status does not fit the tick at which the sample was taken.
    // Shows LNK-1.
    LinkAge = "Link-Status tells a wrong age",
    /// The age of the sample in Link-Status is greater than any that fits: the sample looks older than it is.
    // Shows LNK-1.
    LinkAgeOver = "Link-Status tells too great an age",
    /// The counters in Link-Status do not fit the frames that reached the antenna.
    // Shows LNK-2.
    LinkCounters = "Link-Status tells wrong counters",
    /// The flags in Link-Status do not fit the frames at the antenna, the DPR's starts or the injected faults.
    // Shows LNK-3, LNK-4, LNK-5, LNK-6, LNK-7, LNK-8.
    LinkFlags = "Link-Status tells wrong flags",
    /// The flags in Link-Status deny what is well, or report a fault that is none: the link looks worse than it is.
    // Shows LNK-3, LNK-4, LNK-5, LNK-6, LNK-7, LNK-8.
    LinkFlagsOver = "Link-Status tells of a fault that is none",
    /// The timestamp of Link-Status differs from the time since the DPR's start.
    // Shows LNK-9.
    LinkTime = "Link-Status tells a wrong time",
    /// Port-Status does not fit the uplinks, commands and access violations that were written.
    // Shows PORT-2, PORT-3.
    PortStatusWrong = "Port-Status tells what is not so",
    /// An uplink differs from what was written: in its bytes, in its age, or in its mark as fresh.
    // Shows PORT-1.
    UplinkWrong = "an uplink is read otherwise than it was written",
    // ---- Flight controller and base station

    /// The client uses a position that is too old, or that HORUS did not send.
    // Shows CLI-1, CLI-2.
    ClientWrong = "the client flies by a position that it must not",
    /// The age that the client states does not fit the tick of the sample and what the wires show.
    // Shows CLI-3.
    ClientAge = "the client tells a wrong age",
    /// The client states no position although it has read valid positions in sequence.
    ClientHides = "the client has no position although it reads them",
    /// The flight controller did not forward a new profile that it read complete and intact.
    // Shows GND-1.
    NotForwarded = "a profile is not forwarded",
    /// The age that the base station states does not fit the tick of the sample that it shows.
    // Shows GND-3.
    StationAge = "the base station tells a wrong age",
    /// The base station gives a wrong alarm, or does not give a required one.
    // Shows GND-4, GND-5, GND-6, GND-7.
    StationAlarm = "the base station alarms wrongly",

    /// The flight controller forwarded a profile that did not arrive at the base station.
    // Shows GND-1.
    BaseMissed = "the base station missed a profile",
    /// Bytes of a profile were changed, added or invented between the flight controller and the base station.
    // Shows GND-1.
    BaseChanged = "the base station got another profile than was forwarded",
    /// The base station shows an object whose CRC, identifier or offset is wrong.
    // Shows GND-2.
    BaseInvalid = "the base station shows an object that is not valid",
    /// The base station shows objects of several cycles as those of one cycle.
    // Shows GND-2.
    BaseMixed = "the base station shows objects of several cycles as one",
    /// The base station does not show an object that is valid.
    // Shows GND-2.
    BaseHidden = "the base station does not show an object that is valid",
    // ---- Boards

    /// HORUS restarted although the bench did not ask for it.
    HorusRestarted = "HORUS restarted unasked",
    /// The DPR restarted although the bench did not ask for it.
    DprRestarted = "the DPR restarted unasked",
    /// The bench stopped HORUS's core or ran a task out of turn, and the watchdog did not restart HORUS within
    /// its longest time.
    // Shows SAFE-1, SAFE-2, SAFE-16.
    HorusStaysHung = "HORUS hangs, and its watchdog does not restart it",
    /// The bench stopped the DPR's core or ran a task out of turn, and the watchdog did not restart the DPR within
    /// its longest time.
    // Shows SAFE-1, SAFE-16.
    DprStaysHung = "the DPR hangs, and its watchdog does not restart it",
    /// HORUS did something that its microcontroller does not allow.
    HorusFinding = "HORUS did what its part does not allow",
    /// The DPR did something that its microcontroller does not allow.
    DprFinding = "the DPR did what its part does not allow",
    /// A front end was used against its data sheet. The description names the board whose firmware did it.
    FrontEndMisuse = "a front end was used against its data sheet",
    /// HORUS's processor is awake for a greater share of the time than is allowed.
    // Shows TIME-8.
    HorusOverloaded = "HORUS's processor is loaded too much",
    /// The DPR's processor is awake for a greater share of the time than is allowed.
    // Shows TIME-8.
    DprOverloaded = "the DPR's processor is loaded too much",
    /// A fault counter of HORUS's firmware is not zero, and nothing observed from outside explains the count.
    HorusComplains = "HORUS counts faults that have no cause",
    /// A fault counter of the DPR's firmware is not zero, and nothing observed from outside explains the count.
    DprComplains = "the DPR counts faults that have no cause",
    /// A firmware's program lacks a counter that the judge needs.
    NoTelemetry = "an image without telemetry",
    // ---- Active hold

    /// The hold is silent: no Hold-Status came for more than a period and a half.
    HoldSilent = "the hold is silent",
    /// A frame of the hold began less than 99 ms after the one before it.
    // Shows HOLD-10.
    HoldEarly = "the hold sends too early",
    /// The map shows an object of the hold that did not come to the DPR within the last 300 ms.
    HoldShown = "the map shows what the hold did not say",
    /// The map does not show the hold's newest object.
    HoldHidden = "what the hold said is not shown",
    /// An answer to the hold is wrong: it comes without a frame, too early, too late or twice, or has an uplink that
    /// nobody wrote within the last second.
    HoldAnswer = "a wrong answer to the hold",
    /// The DPR showed a frame of the hold but did not answer the frame.
    HoldUnanswered = "a frame of the hold is not answered",
    /// The hold did not do what was commanded: its acknowledgement, set-point or lock does not follow from the commands
    /// that it received.
    HoldCommand = "the hold did what nobody commanded",
    /// The hold does not acknowledge a command that came three times, each time in a later uplink.
    HoldIgnores = "the hold ignores a command",
    /// The states of heater, cooler or lock differ from those in Hold-Status, or Hold-Status has a value that differs
    /// from the payload's.
    HoldOutput = "the hold's outputs or values are not what it says",
    /// The heater is on for a greater share of the time than the hold's limit, in a box that is too hot, or without a
    /// recent temperature since the hold's start.
    // Shows HOLD-9.
    HoldHeats = "the hold heats when it must not",
    /// The hold restarted unasked, or did something that its part, its front end or its sensors do not allow.
    HoldComplains = "the hold restarted unasked, or did what its parts do not allow",
    // ---- Bench

    /// The bench acted on a board too late, so the timing of the run is not exact.
    Late = "the bench acted late",
}

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.words())
    }
}
