//! The flight controller's ordinary writes: uplinks of the base station and its own, and now and then a command.

use super::HoldUser;
use profile::criticality::{BaseStation, FlightController, Writer, WritesUplink};
use profile::ssi::REQUEST_SIZE;
use profile::{Command, CommandObject, Uplink, UplinkValues};

/// The number of control cycles between two uplinks. The base station and the flight controller write in turn.
const UPLINK_EVERY: u64 = 10;

/// The number of control cycles from one command to the next: one second.
const COMMAND_EVERY: u64 = 250;

/// The position, within [`UPLINK_EVERY`] control cycles, of the cycle that reads the whole map and writes nothing.
const MAP_READ: u64 = 8;

const MS: u64 = 1_000_000;

/// Whether the transaction of control cycle number `cycle` reads the whole map.
#[must_use]
pub fn reads_map(cycle: u64) -> bool {
    cycle % UPLINK_EVERY == MAP_READ
}

/// Returns the object to write in control cycle `cycle`, which begins at `own_ns` by the flight controller's clock;
/// `None` in most cycles. `hold` provides the commands to a hold.
#[must_use]
pub fn written(cycle: u64, own_ns: u64, hold: Option<&mut HoldUser>) -> Option<[u8; Uplink::SIZE]> {
    let timestamp = u32::try_from(own_ns / MS % (1 << 32)).unwrap_or(u32::MAX);
    if cycle % COMMAND_EVERY == COMMAND_EVERY / 2 + 1 {
        let command = Command::ALL[(cycle / COMMAND_EVERY % Command::ALL.len() as u64) as usize];
        return Some(*CommandObject::seal(Writer::<FlightController>::claim(), timestamp, command).as_bytes());
    }
    match cycle % (2 * UPLINK_EVERY) {
        0 => Some(uplink::<BaseStation>(timestamp, own_ns, hold)),
        UPLINK_EVERY => Some(uplink::<FlightController>(timestamp, own_ns, hold)),
        _ => None,
    }
}

/// Whether these bytes for MOSI have no object after the request.
#[must_use]
pub fn is_free(mosi: &[u8]) -> bool {
    mosi.iter().skip(REQUEST_SIZE).take(Uplink::SIZE).all(|byte| *byte == 0)
}

/// Appends an object to the request in the bytes for MOSI.
pub fn put(object: &[u8; Uplink::SIZE], mosi: &mut Vec<u8>) {
    let end = REQUEST_SIZE + object.len();
    mosi.resize(mosi.len().max(end), 0);
    mosi[REQUEST_SIZE..end].copy_from_slice(object);
}

/// Returns an uplink of writer `W` whose payload depends on its timestamp. With a hold, the payload begins with a
/// command.
fn uplink<W: WritesUplink>(timestamp: u32, own_ns: u64, hold: Option<&mut HoldUser>) -> [u8; Uplink::SIZE] {
    let bytes = timestamp.to_le_bytes();
    let mut payload = std::array::from_fn(|place| bytes[place % bytes.len()] ^ place as u8);
    if let Some(hold) = hold {
        hold.fill::<W>(&mut payload, own_ns / MS);
    }
    *Uplink::seal(Writer::<W>::claim(), &UplinkValues { timestamp, payload, ..UplinkValues::default() }).as_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use profile::uplink::Written;

    #[test]
    fn two_seconds_contain_uplinks_of_both_writers_and_every_command() {
        let (mut base, mut own, mut commands) = (0, 0, vec![]);
        for cycle in 0..2 * COMMAND_EVERY {
            let Some(object) = written(cycle, cycle * 4 * MS, None) else { continue };
            assert!(!reads_map(cycle), "{cycle}");
            match Written::verify(&object).unwrap() {
                Written::BaseStation(uplink) => {
                    assert_eq!(uplink.timestamp(), cycle as u32 * 4);
                    base += 1;
                }
                Written::FlightController(_) => own += 1,
                Written::Command(command, _) => commands.push(command),
            }
        }
        assert_eq!((base, own), (25, 25));
        assert_eq!(commands, Command::ALL);
        assert!((0..10).any(reads_map));
    }
}
