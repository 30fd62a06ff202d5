//! Lists the violations that a run of the link must not show.

macro_rules! violations {
    ($($(#[$doc:meta])* $name:ident = $words:literal,)*) => {
        /// A fault that a run of the link must not show. The rule that finds it is in [`crate::rules`].
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

    /// HORUS does not tick: there was no tick within a start-up time after power-on or reset, or within one and a half
    /// cycles after the tick before.
    NoTick = "HORUS does not tick",
    /// The tick is not constant: the time between two ticks varies, or differs from 10 ms by more than the error of a
    /// clock without its crystal.
    TickIrregular = "the tick is not constant",
    /// A tick was not followed by the frames of its cycle.
    NoFrame = "a cycle without its frames",
    /// HORUS sent more frames in a cycle than the cycle has.
    ExtraFrame = "more frames than the cycle has",
    /// A transmit command was not followed by a frame.
    CommandWithoutFrame = "a transmit command without a frame",
    /// A frame began without a transmit command.
    FrameWithoutCommand = "a frame without a transmit command",
    /// HORUS broke a frame off: the poller ended the frame before all of it was sent.
    BrokenOff = "HORUS broke a frame off",
    /// HORUS sent something that does not consist of whole objects: the payload has none of the frames' lengths.
    SentNotWhole = "HORUS sent something that is not whole objects",
    /// HORUS sent an object that is not valid: its CRC or its identifier is wrong.
    SentInvalid = "HORUS sent an object that is not valid",
    /// HORUS's timestamp is wrong: it does not count 10 ms for each tick since the start, or lies in the future.
    TimestampWrong = "HORUS's timestamp is not its tick's",
    /// The time from a tick to the transmit command is not constant: its spread, peak to peak, exceeds the bound.
    CommandJitter = "the time from tick to command is not constant",
    /// The time from a tick to the first bit on the air is not constant: its spread, peak to peak, exceeds the bound.
    AirJitter = "the time from tick to air is not constant",
    /// The field dropped: HORUS's carrier went off while HORUS ran.
    FieldDropped = "the field dropped",
    /// A GPS object differs from what its receiver sent: a value is not that of the receiver's last message.
    ContentWrong = "a GPS object differs from what its receiver said",
    /// A GPS object's status differs from what its receiver sent, in a bit such as those for the fix, a valid position,
    /// a heard receiver or a stale solution.
    StatusWrong = "a GPS object's status differs from what its receiver sent",
    /// Reported-Position does not follow from the receivers that agree. Its position, attitude or acceleration is not
    /// the median of those of the receivers, or it states another number of agreeing receivers, or its status is wrong.
    ReportedWrong = "Reported-Position is not what the receivers that agree say",
    /// A position was voted without a majority, or it jumps. Without a majority means that too few receivers support
    /// the position, or no more than oppose it, or that the receivers that support it do not agree. A place or an
    /// altitude jumps if it is farther from the last one than an aircraft can have flown; it must not be shown before
    /// it has lasted for a second.
    VoteWrong = "a voted position without a majority, or one that jumps",
    /// There is no voted position although a majority agrees, and the position does not jump or has lasted for a
    /// second.
    VoteMissing = "no voted position although a majority agrees",
    /// A receiver is excluded without a cause, or is not excluded although it agrees with no receiver of the voted
    /// position. Or an excluded receiver takes part again before it has agreed for a second, or does not take part
    /// again after that.
    ExclusionWrong = "a receiver is wrongly excluded, or wrongly not",
    /// HORUS shows as valid the position of a receiver that does not navigate by the airborne model, although HORUS
    /// should have set the receiver's dynamic model long before.
    NotAirborne = "a position of a receiver that does not navigate as airborne",
    /// HORUS's state does not agree with its inputs (relay, motor cut, emergency measure). An input has been active, or
    /// has contradicted itself, for longer than the debounce time and the state does not show it. Or the state shows
    /// something that no input justifies.
    StateWrong = "HORUS's state is not what its inputs say",
    /// HORUS does not read what a receiver offers. This concerns receivers on a bus, whose bytes wait until HORUS reads
    /// them; the bytes of a receiver on a UART do not wait.
    NotRead = "HORUS does not read what a receiver offers",
    /// A receiver does not have the settings that HORUS needs: it sends no positions, although HORUS should have set it
    /// long before to send them.
    NotConfigured = "a receiver is not set as HORUS needs it",
    /// HORUS has no position although enough receivers work, and no other violation explains the absence.
    NoPosition = "HORUS has no position in a sound run",
    /// HORUS sends a position far from the aircraft: Reported-Position shows a valid position at which the aircraft was
    /// not at any instant within the time for which a solution may be valid.
    PositionOff = "a position far from where the aircraft is",
    /// HORUS states wrongly whether it runs without its crystal.
    CrystalWrong = "HORUS tells wrongly whether it runs without its crystal",
    /// A fault has no consequence. A bit of a board's program memory was changed, a bit of a buffer is stuck, or a
    /// supply falls, and the board neither reports the fault nor stops within the required time.
    FaultUnnoticed = "a fault has no consequence",
    // ---- DPR and SSI

    /// The listener answered: the DPR's front end sent something, although it must only receive.
    Answered = "the listener answered",
    /// The flight controller made no transaction for longer than its cycle allows.
    NoTransaction = "the flight controller reads nothing",
    /// The DPR never became ready for a transaction: nothing could be read although the start-up time after power-on or
    /// reset had passed.
    NeverReady = "the DPR never got ready for a transaction",
    /// The SSI was not ready in time: after the end of a transaction the DPR could not serve the next one within the
    /// bound.
    NotReady = "the SSI was not ready in time",
    /// A transaction read 0xFF throughout although an image was readable: no image was being put in, and no transaction
    /// had just ended.
    Unserved = "a transaction reads nothing although an image is readable",
    /// FRESH is high for too short a time, so that the flight controller's pin interrupt may miss the pulse.
    FreshShort = "FRESH is too short",
    /// The processor kept the SSI's buffers longer than the bound, so no transaction could be served.
    HeldBack = "the SSI was held back too long",
    /// Two transactions in a row found the DPR busy. Only one may do so while a new image is put in.
    BusyTwice = "two transactions in a row met the DPR busy",
    /// Nothing can be read although the DPR runs, because its images expire and no new one replaces them.
    Silent = "nothing can be read",
    /// An object is missing in the image although it was delivered whole: the image shows the object's cycle, but not
    /// this object, which reached the antenna whole.
    Vacant = "a vacant object although it was delivered whole",
    /// A cycle was not shown although it was delivered: it reached the antenna whole and in sequence.
    NotShown = "a cycle not shown although it was delivered",
    /// An invalid object is shown as valid: its CRC is right, but HORUS never sent these bytes.
    ShownNeverSent = "an invalid object shown as valid",
    /// An object out of sequence is shown as valid: its frame was repeated, delayed or inserted, or came before the
    /// sequence was found.
    ShownOutOfSequence = "an object out of sequence shown as valid",
    /// Stale data are shown past their deadline: an object is shown although the next frame was missed and the deadline
    /// has passed.
    ShownStale = "stale data shown past its deadline",
    /// An expired image can be read: an object is shown although its image was not replaced within its 25 ms.
    ShownExpired = "an expired image can be read",
    /// Old data are shown after new data: an object is older than an object with the same identifier that was shown
    /// before.
    Regression = "old data shown after new",
    /// A read is torn: the bytes that one transaction read come from several images, even within an object.
    Torn = "a torn read",
    /// Data in the image are damaged: the bytes of an object are neither intact nor empty nor torn.
    Damaged = "damaged data in the image",
    /// A valid object is where another object belongs: it is intact, but at another object's offset.
    Misplaced = "a valid object in another's place",
    /// FRESH announces no readable image: a transaction at the instant of the rise would have found the DPR busy, or
    /// would have read an unsound image.
    FreshUnreadable = "FRESH without a readable image",
    /// FRESH announces no new image: the image that was readable at the instant of the rise was the one before.
    FreshNotNew = "FRESH without a fresh image",
    /// An image is readable without FRESH: a transaction read an image that FRESH had not announced.
    FreshMissing = "an image readable without FRESH",
    /// A frame was readable too late after its last bit.
    LateReadable = "a frame was readable too late after its last bit",
    /// A sample was readable too late after its tick.
    LateSample = "a sample was readable too late",
    /// The link recovers too late: after the end of a disturbance, no valid object that HORUS sent after that end was
    /// read within the number of cycles that a recovery may take.
    RecoversLate = "the link recovers too late",
    /// Link-Status states a wrong age of the sample, compared with the tick at which the sample was taken.
    LinkAge = "Link-Status tells a wrong age",
    /// Link-Status states wrong counters, compared with the frames that reached the antenna.
    LinkCounters = "Link-Status tells wrong counters",
    /// Link-Status states wrong flags, compared with the frames that reached the antenna, the DPR's starts and the
    /// injected faults.
    LinkFlags = "Link-Status tells wrong flags",
    /// Link-Status states a wrong time: its timestamp differs from the time since the DPR's start.
    LinkTime = "Link-Status tells a wrong time",
    /// Port-Status states something wrong about uplinks, commands or the access violations of a kind, compared with
    /// what was written.
    PortStatusWrong = "Port-Status tells what is not so",
    /// An uplink differs from what was written: in its bytes, in its age, or in whether it counts as fresh.
    UplinkWrong = "an uplink is read otherwise than it was written",
    // ---- Flight controller and base station

    /// The client uses a position that it must not use: the position is too old, or HORUS did not send it.
    ClientWrong = "the client flies by a position that it must not",
    /// The client states a wrong age, compared with the tick of the sample and with what the wires show.
    ClientAge = "the client tells a wrong age",
    /// The client states no position although it reads valid positions in sequence.
    ClientHides = "the client has no position although it reads them",
    /// The flight controller did not forward a new profile that it read complete and intact.
    NotForwarded = "a profile is not forwarded",
    /// The base station states a wrong age, compared with the tick of the sample that it shows.
    StationAge = "the base station tells a wrong age",
    /// The base station's alarms are wrong: an alarm is given that must not be, or one that must be given is not.
    StationAlarm = "the base station alarms wrongly",

    /// The base station missed a profile: the flight controller forwarded it and it did not arrive.
    BaseMissed = "the base station missed a profile",
    /// The base station received another profile than the flight controller forwarded: bytes were changed, added or
    /// invented on the way.
    BaseChanged = "the base station got another profile than was forwarded",
    /// The base station shows an object that is not valid: its CRC or its identifier is wrong, or it is at the wrong
    /// offset.
    BaseInvalid = "the base station shows an object that is not valid",
    /// The base station shows objects of several cycles as those of one cycle.
    BaseMixed = "the base station shows objects of several cycles as one",
    /// The base station does not show an object that is valid.
    BaseHidden = "the base station does not show an object that is valid",
    // ---- Boards

    /// HORUS restarted although the bench did not ask for it.
    HorusRestarted = "HORUS restarted unasked",
    /// The DPR restarted although the bench did not ask for it.
    DprRestarted = "the DPR restarted unasked",
    /// HORUS hangs, and its watchdog does not restart it: the bench stopped HORUS's core, and the longest time that the
    /// watchdog may take has passed.
    HorusStaysHung = "HORUS hangs, and its watchdog does not restart it",
    /// The DPR hangs, and its watchdog does not restart it: the bench stopped the DPR's core, and the longest time that
    /// the watchdog may take has passed.
    DprStaysHung = "the DPR hangs, and its watchdog does not restart it",
    /// HORUS did something that its microcontroller does not allow.
    HorusFinding = "HORUS did what its part does not allow",
    /// The DPR did something that its microcontroller does not allow.
    DprFinding = "the DPR did what its part does not allow",
    /// A front end was used against its data sheet. The description names the board whose firmware did it.
    FrontEndMisuse = "a front end was used against its data sheet",
    /// HORUS's processor is awake for a greater share of the time than is allowed.
    HorusOverloaded = "HORUS's processor is loaded too much",
    /// The DPR's processor is awake for a greater share of the time than is allowed.
    DprOverloaded = "the DPR's processor is loaded too much",
    /// HORUS's firmware counts faults that have no cause: a counter differs from zero, and nothing observed from
    /// outside explains it.
    HorusComplains = "HORUS counts faults that have no cause",
    /// The DPR's firmware counts faults that have no cause: a counter differs from zero, and nothing observed from
    /// outside explains it.
    DprComplains = "the DPR counts faults that have no cause",
    /// A program has no telemetry: a counter that the judge needs is missing.
    NoTelemetry = "an image without telemetry",
    // ---- Active hold

    /// The hold is silent: no Hold-Status came for more than a period and a half.
    HoldSilent = "the hold is silent",
    /// The map shows an object of the hold that did not come to the DPR within the last 300 ms.
    HoldShown = "the map shows what the hold did not say",
    /// The map does not show the object of the hold that came last.
    HoldHidden = "what the hold said is not shown",
    /// An answer to the hold is wrong: it comes without a frame, too early, too late or twice, or has an uplink that
    /// nobody wrote within the last second.
    HoldAnswer = "a wrong answer to the hold",
    /// A frame of the hold was shown and not answered.
    HoldUnanswered = "a frame of the hold is not answered",
    /// The hold did something else than it was commanded: its acknowledgement, set-point or lock is not what follows
    /// from the commands that came.
    HoldCommand = "the hold did what nobody commanded",
    /// The hold does not acknowledge a command that came three times, each time in a later uplink.
    HoldIgnores = "the hold ignores a command",
    /// Heater, cooler or lock are not as Hold-Status says, or a value in it is not that of the box.
    HoldOutput = "the hold's outputs or values are not what it says",
    /// The hold restarted unasked, or did something that its part, its front end or its sensors do not allow.
    HoldComplains = "the hold restarted unasked, or did what its parts do not allow",
    // ---- Bench

    /// The bench acted on a board later than it was due, so the run is not exact in time.
    Late = "the bench acted late",
}

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.words())
    }
}
