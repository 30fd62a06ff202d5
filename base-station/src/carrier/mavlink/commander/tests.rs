use profile::criticality::{ActiveLoad, Writer};
use profile::hold::{Answer, COMMAND_AGE_MS, Commands, Executed};
use profile::{HoldStatus, HoldValues, LinkStatus, LinkValues};

use super::super::voice::State;
use super::super::{Forwarder, Inbound, Key, Rates, Signer, Verifier, Voice};
use super::*;
use crate::intake::{Carried, Intake, Kind};
use crate::{Bundle, Place, Who};

const NOW: u64 = 1_790_000_000_000_000;
const SECOND: u64 = 1_000_000;
const STEP: u64 = 10_000;
/// In the test's model, the time from writing an uplink over the SSI until the DPR hands it to the hold, µs.
const TO_DPR: u64 = 20_000;

fn key() -> Key {
    Key::new([9; 32])
}

struct Scene {
    now: u64,
    intake: Intake,
    voice: Voice,
    forwarder: Forwarder,
    inbound: Inbound,
    stored: Vec<(Uplink, u64)>,
    hold: Commands,
    /// The instant at which the hold started.
    started: u64,
    executed: Vec<HoldCommand>,
    told: Vec<CommandRecord>,
    loss: u64,
    drawn: u64,
}

impl Scene {
    fn new(loss: u64, seed: u64) -> Self {
        let rates = Rates { bytes_per_s: 6_000, ..Rates::default() };
        let mut scene = Self {
            now: NOW,
            intake: Intake::new(Some(Verifier::new(key()))),
            voice: Voice::new(254, Some(Signer::new(key(), 254))).with_commands(),
            forwarder: Forwarder::new(7, 1, rates).signed(Signer::new(key(), 1)),
            inbound: Inbound::new(7, Verifier::new(key())),
            stored: vec![],
            hold: Commands::new(),
            started: NOW,
            executed: vec![],
            told: vec![],
            loss: 0,
            drawn: seed | 1,
        };
        scene.fly(SETTLES_US + SECOND);
        scene.loss = loss;
        scene
    }

    fn is_lost(&mut self) -> bool {
        self.drawn ^= self.drawn << 13;
        self.drawn ^= self.drawn >> 7;
        self.drawn ^= self.drawn << 17;
        self.drawn % 100 < self.loss
    }

    fn fly(&mut self, span_us: u64) {
        let end = self.now + span_us;
        while self.now < end {
            self.now += STEP;
            self.step();
        }
    }

    fn command(&mut self, command: HoldCommand) -> Result<CommandRecord, NotSent> {
        let drone = Who::System(7).first();
        self.voice.command(self.now, self.intake.fleet(), drone, command)
    }

    fn step(&mut self) {
        let link = LinkValues { timestamp: ((self.now - NOW) / 1_000) as u32 + 50_000, ..LinkValues::default() };
        let link = LinkStatus::seal(&link);
        self.forwarder.offer(&Bundle::new(Place::LinkStatus, 1, link.as_bytes()).unwrap());
        let hold_ms = (self.now - self.started) / 1_000;
        if hold_ms.is_multiple_of(100) {
            let mut answer = Answer::EMPTY;
            let young =
                |(_, at): &&(Uplink, u64)| (TO_DPR..=1_000 * u64::from(COMMAND_AGE_MS)).contains(&(self.now - at));
            if let Some((uplink, _)) = self.stored.iter().rev().find(young) {
                answer.set_uplink(Writer::<BaseStation>::claim(), *uplink);
            }
            let executed = &mut self.executed;
            self.hold.take(&answer, hold_ms, |_, command| {
                executed.push(command);
                let refused = matches!(command, HoldCommand::SetPoint(celsius) if celsius > 30.0);
                if refused { Executed::Refused } else { Executed::Done }
            });
            let acknowledged = self.hold.acknowledged();
            let values = HoldValues { acknowledged, ..HoldValues::absent(hold_ms as u32) };
            let object = HoldStatus::seal(Writer::<ActiveLoad>::claim(), &values);
            self.forwarder.offer(&Bundle::new(Place::Hold, 1, object.as_bytes()).unwrap());
        }
        while let Some(bytes) = self.forwarder.poll(self.now, self.now) {
            if !self.is_lost() {
                let (at_us, kind, from) = (self.now, Kind::MavlinkDatagrams, "10.0.0.7:14555".into());
                self.intake.take(&Carried { at_us, kind, line: 3, from, bytes });
            }
        }
        for (_, bytes) in self.voice.tick(self.now, self.intake.fleet()) {
            if !self.is_lost()
                && let Some(uplink) = self.inbound.datagram(self.now, self.now, &bytes)
            {
                self.stored.push((uplink, self.now));
            }
        }
        self.told.extend(self.voice.take_commands());
    }

    fn state(&self) -> CommandState {
        self.told.last().unwrap().state
    }
}

#[test]
fn each_command_is_executed_once_or_shown_as_lost() {
    let (mut done, mut lost) = (0, 0);
    for (seed, loss) in (1..40).flat_map(|seed| [(seed, 30), (seed, 90)]) {
        let mut scene = Scene::new(loss, seed * 0x9E37_79B9);
        for celsius in 1..=5_u8 {
            let command = HoldCommand::SetPoint(f32::from(celsius));
            let Ok(_) = scene.command(command) else {
                scene.fly(SECOND);
                continue;
            };
            scene.fly(GIVES_UP_US + SECOND);
            let times = scene.executed.iter().filter(|executed| **executed == command).count();
            match scene.state() {
                CommandState::Done => assert_eq!(times, 1, "seed {seed}, loss {loss} %"),
                CommandState::Lost => assert!(times <= 1, "seed {seed}, loss {loss} %"),
                other => panic!("seed {seed}, loss {loss} %: {other:?}"),
            }
            *if scene.state() == CommandState::Done { &mut done } else { &mut lost } += 1;
        }
        assert!(scene.executed.is_sorted_by(|one, next| matches!(
            (one, next),
            (HoldCommand::SetPoint(one), HoldCommand::SetPoint(next)) if one < next
        )));
    }
    println!("{done} done, {lost} lost");
    assert!(done > 150 && lost > 10, "{done} done, {lost} lost");
}

#[test]
fn without_loss_it_is_acknowledged_within_a_second_and_not_repeated() {
    let mut scene = Scene::new(0, 1);
    for phase in 0..20 {
        scene.fly(STEP * (17 + phase));
        scene.command(HoldCommand::Lock).unwrap();
        assert_eq!(scene.command(HoldCommand::Unlock), Err(NotSent::CommandWaits));
        scene.fly(SECOND);
        let told = scene.told.last().unwrap();
        assert_eq!((told.state, scene.executed.len()), (CommandState::Done, 1 + phase as usize));
        assert!(told.at_us - told.since_us <= 700_000, "{} us", told.at_us - told.since_us);
        let stored = scene.stored.len();
        scene.fly(SECOND);
        assert_eq!(scene.stored.len(), stored, "it is not sent any more");
    }
}

#[test]
fn what_the_hold_refuses_is_said() {
    let mut scene = Scene::new(0, 1);
    scene.command(HoldCommand::SetPoint(99.0)).unwrap();
    scene.fly(2 * SECOND);
    assert_eq!(scene.state(), CommandState::Refused);
    let states = [Outcome::Done, Outcome::Refused, Outcome::Unknown, Outcome::TooOld];
    let states = states.map(|outcome| CommandState::of(Sent::Answered(1, outcome)).code());
    assert_eq!(states, ["done", "refused", "unknown", "too-old"]);
}

#[test]
fn a_restart_of_the_hold_loses_a_command_that_waits() {
    let mut scene = Scene::new(0, 1);
    scene.command(HoldCommand::Lock).unwrap();
    scene.fly(2 * SECOND);
    assert_eq!(scene.state(), CommandState::Done);
    // The radio loses every message, and then the hold restarts. So the hold never receives the command.
    scene.loss = 100;
    scene.fly(250_000);
    scene.command(HoldCommand::Unlock).unwrap();
    (scene.hold, scene.started) = (Commands::new(), scene.now);
    scene.stored.clear();
    scene.fly(100_000);
    assert_eq!(scene.state(), CommandState::Pending);
    scene.loss = 0;
    scene.stored.clear();
    // Within 110 ms one object of the restarted hold arrives.
    scene.fly(110_000);
    assert_eq!(scene.state(), CommandState::Lost);
    let stored = scene.stored.len();
    scene.fly(2 * SECOND);
    assert_eq!(scene.stored.len(), stored, "it is not repeated to a hold that may have forgotten");
    scene.command(HoldCommand::ClearShock).unwrap();
    scene.fly(2 * SECOND);
    assert_eq!((scene.state(), scene.executed.last()), (CommandState::Done, Some(&HoldCommand::ClearShock)));
}

#[test]
fn who_may_not_commands_no_hold() {
    let mut scene = Scene::new(0, 1);
    let (drone, fleet) = (Who::System(7).first(), scene.intake.fleet());
    let mut silent = Voice::new(254, Some(Signer::new(key(), 254))).with_uplinks();
    assert_eq!(silent.command(scene.now, fleet, drone, HoldCommand::Lock), Err(NotSent::NoCommands));
    let mut unsigned = Voice::new(254, None).with_commands();
    assert_eq!(unsigned.command(scene.now, fleet, drone, HoldCommand::Lock), Err(NotSent::NoCommands));
    assert!(!silent.sends_commands() && !unsigned.sends_commands() && scene.voice.sends_commands());
    let uplink = scene.voice.send(scene.now, fleet, drone, profile::UplinkStatus::default(), [1; 52]);
    assert_eq!(uplink, Err(NotSent::NotAllowed), "its payload could be a command");
    assert_eq!(scene.voice.sending(drone).map(|sending| sending.state == State::Sent), None);
    let other = scene.voice.command(scene.now, fleet, Who::System(8).first(), HoldCommand::Lock);
    assert_eq!(other, Err(NotSent::UnknownDrone));
    let mut late = Voice::new(254, Some(Signer::new(key(), 254))).with_commands();
    assert_eq!(late.command(scene.now, fleet, drone, HoldCommand::Lock), Err(NotSent::NoHold));
    late.tick(scene.now, fleet);
    assert_eq!(late.command(scene.now, fleet, drone, HoldCommand::Lock), Err(NotSent::HoldIsNew));
    scene.loss = 100;
    scene.fly(SECOND);
    assert_eq!(scene.command(HoldCommand::Lock), Err(NotSent::NoHold), "it has expired");
}

#[test]
fn a_command_is_named_with_its_value() {
    let all = [HoldCommand::SetPoint(-3.5), HoldCommand::Lock, HoldCommand::Unlock, HoldCommand::ClearShock];
    for known in all {
        let (word, value) = name(&known);
        assert_eq!(command(word, value), Some(known));
    }
    assert_eq!([command("set-point", None), command("lock", Some(1.0)), command("open", None)], [None; 3]);
}
