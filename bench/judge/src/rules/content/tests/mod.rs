//! A run in which receivers send messages and HORUS sends their values. Each test makes one change.

mod buses;
mod doubt;
mod reader;
mod status;
mod values;
mod vote;

use gnss_sim::ubx::{EsfIns, NavAtt, NavPvt};
use profile::{ABSENT_F32, ABSENT_F64, FixType, GpsStatus, GpsValues, HorusState, ReportedPosition, ReportedValues};

use super::*;
use crate::testing::{BYTE_NS, Events, FIRST_TICK, MS, found, header, silent_gps};

#[derive(Clone, Debug)]
struct Burst {
    /// The instant, ns, at which the burst's first byte begins.
    at: u64,
    pvt: Option<NavPvt>,
    att: Option<NavAtt>,
    ins: Option<EsfIns>,
    clean: bool,
    since: Option<u64>,
}

impl Burst {
    /// Returns a burst of all three messages, with values that follow from `number`.
    fn new(at: u64, number: u32, period_ms: u32) -> Self {
        let itow_ms = 400_000_000 + number * period_ms;
        let step = number as i32;
        Self {
            at,
            pvt: Some(NavPvt {
                itow_ms,
                fix_type: 3,
                flags: NavPvt::FLAG_FIX_OK,
                latitude_1e7: 474_979_123 + step,
                longitude_1e7: 87_296_456 - step,
                height_mm: 493_217 + step,
                horizontal_accuracy_mm: 4_000,
                vertical_accuracy_mm: 6_000,
                ..NavPvt::default()
            }),
            att: Some(NavAtt {
                itow_ms,
                roll_1e5: 123_456 + step,
                pitch_1e5: -234_567 + step,
                heading_1e5: 34_567_891 + step,
                accuracy_1e5: [40_000, 40_000, 60_000],
            }),
            ins: Some(EsfIns {
                itow_ms,
                rates_1e3: [0; 3],
                accelerations_1e2: [17, -981, 333].map(|axis| axis + step % APART as i32 + step / 10),
            }),
            clean: true,
            since: None,
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let pvt = self.pvt.iter().flat_map(NavPvt::encode);
        pvt.chain(self.att.iter().flat_map(NavAtt::encode)).chain(self.ins.iter().flat_map(EsfIns::encode)).collect()
    }

    fn arrived(&self) -> u64 {
        self.at + self.bytes().len() as u64 * BYTE_NS
    }

    fn values(&self, timestamp: u32) -> GpsValues {
        let mut values = GpsValues::absent(timestamp);
        let age = tick(u64::from(timestamp / CYCLE_MS)).saturating_sub(self.arrived());
        values.status = values.status.with_solution_age_ms(Some((age / MS) as u32));
        if let Some(pvt) = &self.pvt {
            values.status = values.status.with_position_valid(true).with_fix_type(FixType::Fix3D);
            values.latitude = f64::from(pvt.latitude_1e7) / 1e7;
            values.longitude = f64::from(pvt.longitude_1e7) / 1e7;
            values.altitude = f64::from(pvt.height_mm) / 1e3;
        }
        if let Some(att) = &self.att {
            let rad = |angle: i32| (f64::from(angle) * (std::f64::consts::PI / 180.0 / 1e5)) as f32;
            values.status = values.status.with_attitude_valid(true);
            (values.pitch, values.yaw, values.roll) = (rad(att.pitch_1e5), rad(att.heading_1e5), rad(att.roll_1e5));
        }
        if let Some(ins) = &self.ins {
            values.status = values.status.with_acceleration_valid(true);
            values.acceleration = ins.accelerations_1e2.map(|axis| (f64::from(axis) / 1e2) as f32);
        }
        values
    }
}

#[derive(Clone, Debug)]
struct Scene {
    receivers: Vec<Vec<Burst>>,
    period_ms: u32,
    cycles: u64,
}

/// The receivers' bursts have numbers that differ by this much, so that their positions and accelerations differ by
/// less than the voter's limits.
const APART: u32 = 200;
/// The first cycle that shows HORUS's inputs, which need three samples.
const INPUTS_KNOWN: u64 = 4;
/// The instant, ns, of the first burst; a burst follows every 100 ms.
const FIRST_BURST: u64 = 45 * MS;
/// The number of a tick in the middle of the run. By this tick HORUS knows each receiver's period.
const STEADY: u64 = 51;

impl Scene {
    fn new(gps: usize) -> Self {
        Self::with_period(gps, 100)
    }

    fn with_period(gps: usize, period_ms: u32) -> Self {
        Self::of_cycles(gps, period_ms, 120)
    }

    fn of_cycles(gps: usize, period_ms: u32, cycles: u64) -> Self {
        let count = (cycles * u64::from(CYCLE_MS) / u64::from(period_ms)) as u32;
        let receiver = |receiver: u32| {
            let at = |number: u32| FIRST_BURST + u64::from(number * period_ms) * MS;
            (0..count).map(|number| Burst::new(at(number), number + APART * receiver, period_ms)).collect()
        };
        Self { receivers: (0..gps as u32).map(receiver).collect(), period_ms, cycles }
    }

    fn shown(&self, receiver: usize, tick: u64, timestamp: u32) -> GpsValues {
        let taken = |burst: &&Burst| burst.arrived() + MS <= tick;
        let bursts = self.receivers[receiver].iter().take_while(taken);
        let count = bursts.clone().count();
        let Some(last) = bursts.last() else { return silent_gps(timestamp) };
        let period = if count < 2 { 1_000 * MS } else { u64::from(self.period_ms) * MS };
        let age = tick - last.arrived();
        let values = if age <= period + 150 * MS { last.values(timestamp) } else { GpsValues::absent(timestamp) };
        let status = values.status.with_heard(age <= 250 * MS).with_stale(age >= period + 50 * MS);
        GpsValues { status: aged(status, &last.values(timestamp)), ..values }
    }

    /// Returns the events of the run, in which `change` may change what HORUS sends in a cycle (number from 1).
    fn events(&self, mut change: impl FnMut(u64, &mut ReportedValues, &mut [GpsValues])) -> Events {
        self.changed(&mut change)
    }

    // This function is not generic, so that it is compiled once and not for each closure.
    fn changed(&self, change: &mut dyn FnMut(u64, &mut ReportedValues, &mut [GpsValues])) -> Events {
        let gps = self.receivers.len();
        let mut events = Events::new(gps);
        let bytes = |reported: &ReportedValues| ReportedPosition::seal(reported).as_bytes().to_vec();
        let mut located = false;
        for number in 1..=self.cycles {
            let (tick, timestamp) = (tick(number), number as u32 * CYCLE_MS);
            let mut values: Vec<_> = (0..gps).map(|receiver| self.shown(receiver, tick, timestamp)).collect();
            let untouched = voted(&values);
            let mut reported = untouched;
            change(number, &mut reported, &mut values);
            if bytes(&reported) == bytes(&untouched) {
                reported = voted(&values);
            }
            located |= reported.status.position_valid();
            if reported.status.state() == Some(HorusState::Monitoring) && number < INPUTS_KNOWN {
                reported.status = reported.status.with_state(HorusState::Starting);
            }
            if located && number >= INPUTS_KNOWN && reported.status.state() == Some(HorusState::Starting) {
                let state = match reported.status.position_valid() {
                    true => HorusState::Monitoring,
                    false => HorusState::PositionLost,
                };
                reported.status = reported.status.with_state(state);
            }
            events.cycle_of(tick, &reported, &values);
        }
        for (receiver, bursts) in self.receivers.iter().enumerate() {
            for burst in bursts {
                let bytes = burst.bytes().into();
                events.add(
                    burst.at,
                    What::Fed { receiver, byte_ns: BYTE_NS, bytes, clean: burst.clean, since: burst.since },
                );
            }
        }
        events.end(tick(self.cycles + 1) - MS);
        events
    }

    fn said(&self, change: impl FnMut(u64, &mut ReportedValues, &mut [GpsValues])) -> Vec<(Violation, u64)> {
        kinds(&self.events(change))
    }

    /// Returns the violations if `change` changes GPS1 in cycle `number`. Reported-Position follows the change.
    fn gps1(&self, number: u64, change: impl Fn(&mut GpsValues)) -> Vec<(Violation, u64)> {
        self.said(|cycle, as_reported, gps| {
            if cycle == number {
                change(&mut gps[0]);
                *as_reported = reported(&gps[0]);
            }
        })
    }
}

fn aged(status: GpsStatus, gps: &GpsValues) -> GpsStatus {
    status.with_solution_age_ms(gps.status.solution_age_ms().map(u32::from))
}

fn tick(number: u64) -> u64 {
    FIRST_TICK + (number - 1) * bounds::CYCLE
}

/// Returns the first cycle whose tick is at least `age` after a burst has arrived.
fn cycle_after(burst: &Burst, age: u64) -> u64 {
    (burst.arrived() + age - FIRST_TICK).div_ceil(bounds::CYCLE) + 1
}

fn reported(gps: &GpsValues) -> ReportedValues {
    voted(std::slice::from_ref(gps))
}

fn voted(gps: &[GpsValues]) -> ReportedValues {
    let members: Vec<_> =
        gps.iter().filter(|gps| gps.status.position_valid() && !gps.status.excluded()).copied().collect();
    let absent = ReportedValues::absent(gps[0].timestamp);
    let status = absent.status.with_degraded(true).with_receivers_agreeing(members.len() as u8);
    if members.is_empty() {
        return ReportedValues { status, ..absent };
    }
    let quorum = [0, 1, 1, 2, 2, 3][gps.len()];
    let f64_of = |least: usize, of: fn(&GpsValues) -> f64| {
        let values: Vec<f64> = members.iter().map(of).filter(|value| !value.is_nan()).collect();
        if values.len() < least { None } else { middle(values) }
    };
    // A quorum of receivers must have values, and no two values may differ by more than the limits. Angles differ by at
    // most pi.
    let are_agreed = |of: &[[f32; 3]], limits: [f64; 3]| {
        let off = |axis: usize, one: &[f32; 3], its: &[f32; 3]| (f64::from(one[axis]) - f64::from(its[axis])).abs();
        let turned = |off: f64| if limits[0] < 0.1 { off.min(std::f64::consts::TAU - off) } else { off };
        let agree = |axis: usize| of.iter().all(|one| of.iter().all(|its| turned(off(axis, one, its)) <= limits[axis]));
        of.len() >= quorum && (0..3).all(agree)
    };
    let medians = |of: &[[f32; 3]], limits: [f64; 3]| {
        are_agreed(of, limits).then(|| {
            [0, 1, 2].map(|axis| middle(of.iter().map(|of| f64::from(of[axis])).collect()).unwrap_or(f64::NAN) as f32)
        })
    };
    let of = |valid: fn(&GpsValues) -> bool, values: fn(&GpsValues) -> [f32; 3]| -> Vec<[f32; 3]> {
        members.iter().filter(|gps| valid(gps)).map(values).collect()
    };
    let attitudes = of(|gps| gps.status.attitude_valid(), |gps| [gps.pitch, gps.yaw, gps.roll]);
    let attitude = medians(&attitudes, [5.0, 10.0, 5.0].map(f64::to_radians));
    let acceleration = medians(&of(|gps| gps.status.acceleration_valid(), |gps| gps.acceleration), [2.0; 3]);
    let [pitch, yaw, roll] = attitude.unwrap_or([ABSENT_F32; 3]);
    let altitude = f64_of(quorum, |gps| gps.altitude).unwrap_or(ABSENT_F64);
    ReportedValues {
        status: status
            .with_position_valid(true)
            .with_attitude_valid(attitude.is_some())
            .with_acceleration_valid(acceleration.is_some())
            .with_degraded(members.len() < gps.len() || altitude.is_nan()),
        latitude: f64_of(1, |gps| gps.latitude).unwrap_or(ABSENT_F64),
        longitude: f64_of(1, |gps| gps.longitude).unwrap_or(ABSENT_F64),
        altitude,
        pitch,
        yaw,
        roll,
        acceleration: acceleration.unwrap_or([ABSENT_F32; 3]),
        ..absent
    }
}

fn middle(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let (low, high) = (values.len().checked_sub(1)? / 2, values.len() / 2);
    Some(if low == high { values[low] } else { (values[low] + values[high]) / 2.0 })
}

fn kinds(events: &Events) -> Vec<(Violation, u64)> {
    let found = found(Content::new(&header(events.gps)), &events.log()).0;
    found.into_iter().map(|(violation, count, _)| (violation, count)).collect()
}

fn unchanged(_: u64, _: &mut ReportedValues, _: &mut [GpsValues]) {}

const CONTENT: [(Violation, u64); 1] = [(Violation::ContentWrong, 1)];
const STATUS: [(Violation, u64); 1] = [(Violation::StatusWrong, 1)];
const REPORTED: [(Violation, u64); 1] = [(Violation::ReportedWrong, 1)];
const STATE: [(Violation, u64); 1] = [(Violation::StateWrong, 1)];
