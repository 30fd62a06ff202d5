//! Judges what the flight controller writes: uplinks and commands. Stores uplinks and seals Port-Status.
//!
//! # Design
//!
//! The SSI task hands over the bytes that a transaction brought ([`areas`]). The task `port`, whose priority is the
//! lowest above the idle loop, judges them here. Neither the RFID side nor the next transaction waits for that.
//!
//! | bytes that came in | consequence |
//! |---|---|
//! | nothing (0x00 or 0xFF throughout) | nothing changes |
//! | an intact uplink, [newer](Uplink) than its writer's last | it is stored in the writer's place |
//! | an intact [command](profile::Command), newer than its writer's last | it is carried out |
//! | anything else | it is counted by its [kind](profile::Violation), and changes nothing |
//!
//! Port-Status and both uplinks are one [`PortArea`] of 192 bytes. It is sealed here, before the commit task needs it
//! ([`Prepared`]), and the commit task only copies it into the image.
//!
//! A command acts only on [`WritePort`]. Nothing that is written over the SSI changes an object of HORUS. It changes
//! Link-Status only in its total of access violations and in its bit 7 (the last uplink was rejected).

pub mod areas;
pub mod newer;
mod prepared;
#[cfg(test)]
mod tests;

use core::marker::PhantomData;

use profile::{
    criticality::{BaseStation, Dpr, FlightController, Writer, WritesUplink},
    map::PortArea,
    ssi::REQUEST_SIZE,
    uplink::Written,
    Command, PortStatus, PortStatusBits, PortValues, Uplink, Violation, Violations,
};

pub use prepared::Prepared;

use crate::{
    hold,
    link::Clock,
    ssi::{Asked, ReceiveArea},
};
use areas::Transaction;
use newer::Timestamps;

/// The values that a received word has while the line MOSI is idle or not driven.
pub const IDLE: [u32; 2] = [0, u32::MAX];

/// Whether `bytes` are all 0x00 or all 0xFF, as an idle line brings them.
fn is_idle(bytes: &[u8]) -> bool {
    let (words, rest) = bytes.as_chunks();
    let words = words.iter().map(|word| u32::from_le_bytes(*word));
    // The idle byte is repeated four times, so that it can be compared with a word.
    let rest = rest.iter().map(|byte| u32::from(*byte) * 0x0101_0101);
    let (any, all) = words.chain(rest).fold((0, u32::MAX), |(any, all), word| (any | word, all & word));
    any == 0 || all == u32::MAX
}

/// Whether a transaction brought no byte. Areas are scrubbed, so its area has only zeros then. Most transactions only
/// read.
#[must_use]
pub fn brought_nothing(area: &ReceiveArea) -> bool {
    area.iter().fold(0, |any, word| any | word) == 0
}

/// The values for Port-Status that other tasks hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Diagnostics {
    /// How often, since start and wrapping, the SSI task has used up the budget of transactions or dropped an object.
    pub too_many: u32,
    /// The number of damaged objects that the idle loop found in published images.
    pub integrity_faults: u32,
    /// The number of passes over flash.
    pub flash_passes: u32,
    /// The number of stuck bits that scrubs found.
    pub stuck_bits: u32,
    /// The number of receive buffers and images that were taken out of use.
    pub buffers_out_of_use: u32,
    /// The code of the reason for the DPR's last safe state; 0 if there was none.
    pub last_stop: u32,
    /// The hold's bits of Port-Status.
    #[cfg(feature = "hold")]
    pub hold: PortStatusBits,
}

#[derive(Clone, Copy, Debug)]
struct Slot<W> {
    timestamps: Timestamps,
    stored: Uplink,
    /// The instant, µs since start, at which the uplink was stored; `None` before the first uplink.
    stored_us: Option<u64>,
    writer: PhantomData<W>,
}

impl<W: WritesUplink> Slot<W> {
    const fn new() -> Self {
        Self { timestamps: Timestamps::new(), stored: Uplink::EMPTY, stored_us: None, writer: PhantomData }
    }

    /// Stores an uplink that came in at `now_us`, if it is newer than its writer's last one.
    fn store(&mut self, uplink: &Uplink, now_us: u64) -> Result<(), Violation> {
        if !self.timestamps.accept(uplink.timestamp()) {
            return Err(Violation::UplinkNotNewer);
        }
        self.stored = *uplink;
        self.stored_us = Some(now_us);
        Ok(())
    }

    /// Puts the stored uplink into `area`, or zeros if it is older than [`Uplink::EXPIRY_MS`] at `now_us`. Returns the
    /// uplink's age, ms, saturating; `u32::MAX` / 1000 if none was stored.
    fn show(&mut self, now_us: u64, area: &mut PortArea) -> u32 {
        let age_us = self.stored_us.map_or(u64::MAX, |stored| now_us.wrapping_sub(stored));
        // A division of 64 bits would take some hundreds of cycles. The age is saturated to 32 bits of µs first, which
        // suffice for 16 bits of ms.
        let age_ms = u32::try_from(age_us).unwrap_or(u32::MAX) / 1000;
        if age_ms >= Uplink::EXPIRY_MS {
            self.stored = Uplink::EMPTY;
        }
        area.set_uplink(Writer::<W>::claim(), self.stored);
        age_ms
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct SelfTest {
    running: bool,
    passed: Option<bool>,
}

/// The state of the port task.
#[derive(Clone, Copy, Debug)]
pub struct WritePort {
    clock: Clock,
    base_station: Slot<BaseStation>,
    flight_controller: Slot<FlightController>,
    commands: Timestamps,
    self_test: SelfTest,
    uplinks_accepted: u32,
    commands_carried_out: u32,
    last_command: Option<(u32, Command)>,
    last_refused: bool,
    violations: Violations,
    total: u32,
    /// The value of [`Diagnostics::too_many`] that is already counted among the violations.
    too_many: u32,
}

impl Default for WritePort {
    fn default() -> Self {
        Self::new()
    }
}

impl WritePort {
    /// Returns the state before any transaction.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            clock: Clock::new(),
            base_station: Slot::new(),
            flight_controller: Slot::new(),
            commands: Timestamps::new(),
            self_test: SelfTest { running: false, passed: None },
            uplinks_accepted: 0,
            commands_carried_out: 0,
            last_command: None,
            last_refused: false,
            violations: Violations::new(),
            total: 0,
            too_many: 0,
        }
    }

    /// Judges the bytes that a transaction brought, which are the first bytes of `area`. `now_us` is the value of the
    /// µs counter. It must not go back between calls of this and of [`WritePort::prepare`], one of which must be called
    /// every 71 minutes. Returns whether the contents of Port-Status have changed.
    pub fn transaction(&mut self, transaction: Transaction, area: &ReceiveArea, now_us: u32) -> bool {
        self.clock.advance(now_us);
        let total = self.total;
        // Not covered: only this line, an area of zeros: the port task asks the same before it calls this.
        if brought_nothing(area) {
            return false;
        }
        let area: &[u8] = bytemuck::cast_slice(area);
        let came_in = area.get(..transaction.bytes).unwrap_or(area);
        let (request, behind) = came_in.split_at(came_in.len().min(REQUEST_SIZE));
        let (object, beyond) = behind.split_at(behind.len().min(Uplink::SIZE));

        match transaction.asked {
            Asked::Refused(violation) => self.refuse(violation, 1),
            // Not covered: in `is_idle`, the turn for four words and the one for a second word, which a short request
            // does not have; and zeros, since an area of zeros is not judged.
            Asked::Short if !is_idle(request) => self.refuse(Violation::TooShort, 1),
            Asked::Short | Asked::Nothing | Asked::Window => {}
        }
        if !is_idle(object) {
            // Not covered: only this line, the end of the `match` in `Violation::of_object`, for a rejection that is
            // explained there.
            let judged = Written::verify(object).map_err(Violation::of_object);
            let done = judged.and_then(|written| self.written(written));
            self.last_refused = done.is_err();
            if let Err(violation) = done {
                self.refuse(violation, 1);
            }
        }
        // Not covered: in `is_idle`, the turns for four words at a time, into which the compiler has unrolled its loop:
        // an area has two words beyond the object.
        if !is_idle(beyond) {
            self.refuse(Violation::TooLong, 1);
        }
        // Not covered: in `is_idle`, an object of less than four words in the path behind bytes that are too many: such
        // bytes come only behind a whole object.
        !is_idle(object) || self.total != total
    }

    /// Stores an uplink or carries out a command, whose CRCs and identifier were already found right.
    fn written(&mut self, written: Written<'_>) -> Result<(), Violation> {
        match written {
            Written::BaseStation(uplink) => self.base_station.store(uplink, self.clock.us())?,
            Written::FlightController(uplink) => self.flight_controller.store(uplink, self.clock.us())?,
            Written::Command(command, object) => return self.carry_out(command, object.timestamp()),
        }
        self.uplinks_accepted = self.uplinks_accepted.wrapping_add(1);
        Ok(())
    }

    fn carry_out(&mut self, command: Command, timestamp: u32) -> Result<(), Violation> {
        if !self.commands.accept(timestamp) {
            return Err(Violation::UplinkNotNewer);
        }
        match command {
            Command::ClearCounters => {
                self.violations = Violations::new();
                self.uplinks_accepted = 0;
                self.commands_carried_out = 0;
            }
            Command::SelfTest if self.self_test.running => return Err(Violation::CommandBusy),
            Command::SelfTest => self.self_test.running = true,
            _ => return Err(Violation::CommandUnknown),
        }
        self.commands_carried_out = self.commands_carried_out.wrapping_add(1);
        self.last_command = Some((timestamp, command));
        Ok(())
    }

    fn refuse(&mut self, violation: Violation, times: u32) {
        // Not covered: the limit of the sum, which takes days with a violation in every transaction.
        self.total = self.total.saturating_add(times);
        // Not covered: the limit of the conversion: `times` is 1, or the number of transactions between two images that
        // were too many, of which few fit.
        self.violations.count(violation, saturated(times));
    }

    /// Returns the number of access violations of all kinds since start, saturating.
    #[must_use]
    pub const fn access_violations(&self) -> u32 {
        self.total
    }

    /// Whether the last uplink or command that came in was refused.
    #[must_use]
    pub const fn last_refused(&self) -> bool {
        self.last_refused
    }

    /// Returns the number of uplinks stored since start or since the counters were cleared.
    #[must_use]
    pub const fn uplinks_accepted(&self) -> u32 {
        self.uplinks_accepted
    }

    /// Keeps the uplinks that were stored for the hold. To be called before [`WritePort::prepare`].
    pub fn hand_on(&self, hold: &mut hold::Shared) {
        hold.keep::<BaseStation>(&self.base_station.stored, self.base_station.stored_us);
        hold.keep::<FlightController>(&self.flight_controller.stored, self.flight_controller.stored_us);
    }

    /// Whether a self-test was requested and has not ended.
    #[must_use]
    pub const fn self_test_requested(&self) -> bool {
        self.self_test.running
    }

    /// Records the result of the self-test, if one was requested.
    pub fn self_test_done(&mut self, passed: bool) {
        // Not covered: a result that nobody waits for: the port task asks for a result only while a self-test runs.
        if core::mem::take(&mut self.self_test.running) {
            self.self_test.passed = Some(passed);
        }
    }

    /// Seals Port-Status, and puts it into `area` with the uplinks that have not expired at `now_us`.
    pub fn prepare(&mut self, diagnostics: &Diagnostics, now_us: u32, area: &mut PortArea) {
        self.clock.advance(now_us);
        let more = diagnostics.too_many.wrapping_sub(self.too_many);
        self.too_many = diagnostics.too_many;
        self.refuse(Violation::TooMany, more);

        let now_us = self.clock.us();
        let base_station_ms = self.base_station.show(now_us, area);
        let flight_controller_ms = self.flight_controller.show(now_us, area);
        let status = PortStatusBits::new()
            .with_base_station_fresh(base_station_ms < Uplink::EXPIRY_MS)
            .with_flight_controller_fresh(flight_controller_ms < Uplink::EXPIRY_MS)
            .with_last_refused(self.last_refused)
            .with_self_test_running(self.self_test.running)
            .with_self_test_passed(self.self_test.passed == Some(true))
            .with_self_test_failed(self.self_test.passed == Some(false))
            .with_buffers_out_of_use(diagnostics.buffers_out_of_use > 0);
        #[cfg(feature = "hold")]
        let status = PortStatusBits::from_bits(status.bits() | diagnostics.hold.bits());
        let (last_command_timestamp, last_command) =
            self.last_command.map_or((0, 0), |(timestamp, command)| (timestamp, command.word()));
        let status = PortStatus::seal(
            Writer::<Dpr>::claim(),
            &PortValues {
                timestamp: self.clock.ms(),
                status,
                uplinks_accepted: self.uplinks_accepted,
                commands_carried_out: self.commands_carried_out,
                last_command_timestamp,
                last_command,
                base_station_age_ms: saturated(base_station_ms),
                flight_controller_age_ms: saturated(flight_controller_ms),
                violations: self.violations,
                // Not covered: a count above 65 535: the patrol finds one damaged object after the other, and a pass
                // over flash takes seconds.
                integrity_faults: saturated(diagnostics.integrity_faults),
                // Not covered: a count above 65 535, which takes days: a pass over flash takes seconds.
                flash_passes: saturated(diagnostics.flash_passes),
                // Not covered: a count above 65 535: a buffer with stuck bits is taken out of use, and the least number
                // that stays is scrubbed once for each frame.
                stuck_bits: saturated(diagnostics.stuck_bits),
                // Not covered: a count above 65 535, since the DPR has few buffers.
                buffers_out_of_use: saturated(diagnostics.buffers_out_of_use),
                last_stop: diagnostics.last_stop,
            },
        );
        area.set_status(Writer::<Dpr>::claim(), status);
    }
}

fn saturated(count: u32) -> u16 {
    u16::try_from(count).unwrap_or(u16::MAX)
}
