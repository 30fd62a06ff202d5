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

    /// HORUS does not tick: a start-up time after power-on or reset there has been no tick, or one and a half cycles
    /// after a tick there has been no further one.
    NoTick = "HORUS does not tick",
    /// The tick is not constant: the time between two ticks differs from 10 ms by more than the error of a clock
    /// without its crystal, or varies.
    TickIrregular = "the tick is not constant",
    /// A tick was not followed by the frames of its cycle.
    NoFrame = "a cycle without its frames",
    /// HORUS sent a frame that its cycle does not have.
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
    /// The time from tick to command is not constant: its spread, peak to peak, exceeds the bound.
    CommandJitter = "the time from tick to command is not constant",
    /// The time from tick to air is not constant: its spread, peak to peak, exceeds the bound.
    AirJitter = "the time from tick to air is not constant",
    /// The field dropped: HORUS's carrier went off while HORUS ran.
    FieldDropped = "the field dropped",
    /// A GPS object differs from what its receiver sent: a value is not that of the receiver's last message.
    ContentWrong = "a GPS object differs from what its receiver said",
    /// A GPS object's status differs from what its receiver sent, in a bit such as fix, valid, heard or stale.
    StatusWrong = "a GPS object's status differs from what its receiver sent",
    /// Reported-Position does not follow from the receivers that agree: its position, attitude or acceleration is not
    /// the median of theirs, it states another number of receivers than agree, or its status is wrong.
    ReportedWrong = "Reported-Position is not what the receivers that agree say",
    /// A position was voted without a majority, or jumps. Too few receivers support it, or no more than oppose it, or
    /// its receivers do not agree; or a place or an altitude is farther from the last one than an aircraft can have
    /// flown, and is shown before it has lasted for a second.
    VoteWrong = "a voted position without a majority, or one that jumps",
    /// There is no voted position although a majority agrees, and the position does not jump or has lasted for a
    /// second.
    VoteMissing = "no voted position although a majority agrees",
    /// A receiver is excluded without a cause, or is not excluded although it agrees with no receiver of the voted
    /// position; or an excluded receiver returns before it has agreed for a second, or does not return after that.
    ExclusionWrong = "a receiver is wrongly excluded, or wrongly not",
    /// HORUS shows the position of a receiver that does not navigate as airborne as valid, long after it should have
    /// set the receiver's dynamic model.
    NotAirborne = "a position of a receiver that does not navigate as airborne",
    /// HORUS's state does not agree with its inputs. The relay, the motor cut or the emergency measure is active or
    /// contradicts itself for longer than the debounce time and the state shows something else, or the state shows one
    /// of these and the input is not so.
    StateWrong = "HORUS's state is not what its inputs say",
    /// HORUS does not read what a receiver offers. The bytes of a receiver on a bus wait until HORUS reads them; those
    /// of a receiver on a UART do not wait.
    NotRead = "HORUS does not read what a receiver offers",
    /// A receiver does not have the settings that HORUS needs: it sends no positions, long after HORUS should have set
    /// it to send them.
    NotConfigured = "a receiver is not set as HORUS needs it",
    /// HORUS has no position in a sound run: enough receivers work, and no other violation explains the absence.
    NoPosition = "HORUS has no position in a sound run",
    /// A position lies far from the aircraft: Reported-Position shows it as valid, although the aircraft was not there
    /// at any instant within the time for which a solution may be valid.
    PositionOff = "a position far from where the aircraft is",
    /// HORUS states wrongly whether it runs without its crystal.
    CrystalWrong = "HORUS tells wrongly whether it runs without its crystal",
    /// A fault has no consequence: a bit of a board's program memory was changed, a bit of a buffer is stuck, or a
    /// supply falls, and the board neither reports the fault nor stops within the required time.
    FaultUnnoticed = "a fault has no consequence",
    // ---- DPR and SSI

    /// The listener answered: the DPR's front end sent something.
    Answered = "the listener answered",
    /// The flight controller reads nothing: there was no transaction for longer than its cycle allows.
    NoTransaction = "the flight controller reads nothing",
    /// The DPR never became ready for a transaction: nothing could be read from a start-up time after power-on or reset
    /// on.
    NeverReady = "the DPR never got ready for a transaction",
    /// The SSI was not ready in time: after the end of a transaction the DPR could not serve the next one within the
    /// bound.
    NotReady = "the SSI was not ready in time",
    /// A transaction reads nothing although an image is readable: it reads 0xFF throughout, although no image was being
    /// put in and no transaction had just ended.
    Unserved = "a transaction reads nothing although an image is readable",
    /// FRESH is too short: the flight controller's pin interrupt may miss the pulse.
    FreshShort = "FRESH is too short",
    /// The SSI was held back too long: the processor kept the SSI's buffers longer than the bound.
    HeldBack = "the SSI was held back too long",
    /// Two transactions in a row met the DPR busy. Only one may do so while a new image is put in.
    BusyTwice = "two transactions in a row met the DPR busy",
    /// Nothing can be read although the DPR runs, because its images expire instead of being replaced.
    Silent = "nothing can be read",
    /// An object is missing in the image although it was delivered whole: the image shows the cycle, and lacks an
    /// object of it that reached the antenna whole.
    Vacant = "a vacant object although it was delivered whole",
    /// A cycle is not shown although it was delivered: it reached the antenna whole and in sequence and was never
    /// shown.
    NotShown = "a cycle not shown although it was delivered",
    /// An invalid object is shown as valid: HORUS never sent these bytes, although their CRC is right.
    ShownNeverSent = "an invalid object shown as valid",
    /// An object out of sequence is shown as valid: its frame was repeated, delayed or inserted, or came before the
    /// sequence was found.
    ShownOutOfSequence = "an object out of sequence shown as valid",
    /// Stale data are shown past their deadline: an object is shown although the next frame was missed and the deadline
    /// has passed.
    ShownStale = "stale data shown past its deadline",
    /// An expired image can be read: an object is shown although its image was not replaced within its 25 ms.
    ShownExpired = "an expired image can be read",
    /// Old data are shown after new data: an object is older than one with the same identifier that was shown before.
    Regression = "old data shown after new",
    /// A read is torn: the bytes that one transaction read come from several images, even within an object.
    Torn = "a torn read",
    /// Data in the image are damaged: the bytes of an object are neither intact nor empty nor torn.
    Damaged = "damaged data in the image",
    /// A valid object is where another object belongs: it is intact, but at another object's offset.
    Misplaced = "a valid object in another's place",
    /// FRESH announces no readable image: it rose, and a transaction at that instant would have met the DPR busy, or
    /// read an unsound image.
    FreshUnreadable = "FRESH without a readable image",
    /// FRESH announces no new image: it rose, and the image that was readable at that instant was the one before.
    FreshNotNew = "FRESH without a fresh image",
    /// An image is readable without FRESH: a transaction brought an image that FRESH had not announced.
    FreshMissing = "an image readable without FRESH",
    /// A frame was readable too late after its last bit.
    LateReadable = "a frame was readable too late after its last bit",
    /// A sample was readable too late.
    LateSample = "a sample was readable too late",
    /// The link recovers too late: after a disturbance has ended, no valid object that HORUS sent after it was read
    /// within the number of cycles that a recovery may take.
    RecoversLate = "the link recovers too late",
    /// Link-Status states a wrong age of the sample, compared with the instant of the sample as it was on the wires.
    LinkAge = "Link-Status tells a wrong age",
    /// Link-Status states wrong counters, compared with the frames that reached the antenna.
    LinkCounters = "Link-Status tells wrong counters",
    /// Link-Status states wrong flags, compared with the frames that reached the antenna and with what happened to the
    /// board.
    LinkFlags = "Link-Status tells wrong flags",
    /// Link-Status states a wrong time: its timestamp differs from the time since the DPR's start.
    LinkTime = "Link-Status tells a wrong time",
    /// Port-Status is wrong about uplinks, commands or access violations of a kind, compared with what was written.
    PortStatusWrong = "Port-Status tells what is not so",
    /// An uplink is read otherwise than it was written: its bytes, its age, or whether it is fresh.
    UplinkWrong = "an uplink is read otherwise than it was written",
    // ---- Flight controller and base station

    /// The client uses a position that it must not use: the position is too old, or HORUS did not send it.
    ClientWrong = "the client flies by a position that it must not",
    /// The client states a wrong age, compared with the instant of the sample, as far as the wires show it.
    ClientAge = "the client tells a wrong age",
    /// The client states no position although it reads valid ones in sequence.
    ClientHides = "the client has no position although it reads them",
    /// A profile is not forwarded, although the flight controller read a new one that was whole and sound.
    NotForwarded = "a profile is not forwarded",
    /// The base station states a wrong age, compared with the instant of the sample that it shows.
    StationAge = "the base station tells a wrong age",
    /// The base station's alarms are wrong: an alarm holds that must not, or one that must hold does not.
    StationAlarm = "the base station alarms wrongly",

    /// The base station missed a profile: the flight controller forwarded it and it did not arrive.
    BaseMissed = "the base station missed a profile",
    /// The base station got another profile than the flight controller forwarded: bytes were changed, added or invented
    /// on the way.
    BaseChanged = "the base station got another profile than was forwarded",
    /// The base station shows an object that is not valid, by its CRC, its identifier or its place.
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
    /// HORUS hangs, and its watchdog does not restart it: the bench had its core stop, and the longest time that the
    /// watchdog may take has passed.
    HorusStaysHung = "HORUS hangs, and its watchdog does not restart it",
    /// The DPR hangs, and its watchdog does not restart it: the bench had its core stop, and the longest time that the
    /// watchdog may take has passed.
    DprStaysHung = "the DPR hangs, and its watchdog does not restart it",
    /// HORUS did what its part does not allow.
    HorusFinding = "HORUS did what its part does not allow",
    /// The DPR did what its part does not allow.
    DprFinding = "the DPR did what its part does not allow",
    /// A front end was used against its data sheet; the description names the firmware that did it.
    FrontEndMisuse = "a front end was used against its data sheet",
    /// HORUS's processor is loaded too much.
    HorusOverloaded = "HORUS's processor is loaded too much",
    /// The DPR's processor is loaded too much.
    DprOverloaded = "the DPR's processor is loaded too much",
    /// HORUS's firmware counts faults that have no cause: a counter differs from zero, and nothing observed from
    /// outside explains it.
    HorusComplains = "HORUS counts faults that have no cause",
    /// The DPR's firmware counts faults that have no cause: a counter differs from zero, and nothing observed from
    /// outside explains it.
    DprComplains = "the DPR counts faults that have no cause",
    /// A program has no telemetry: a counter that the judge needs is missing.
    NoTelemetry = "an image without telemetry",
    /// The bench acted on a board late, so the run is not exact in time.
    Late = "the bench acted late",
}

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.words())
    }
}
