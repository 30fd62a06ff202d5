# SPDX-License-Identifier: MIT OR Apache-2.0
"""Plays the recorded transactions to the client: its output is that of the clients in Rust and in C.

`profile/tests/support/tape.rs` describes a tape. The folder of the recordings is `profile/c/tests/recorded` of the
repository, or the one in the variable HORUS_TAPES.
"""

import os
import struct
import unittest
from pathlib import Path

from horus_profile import CommandWord, Identifier, Rejected, Rejection, seal_command, seal_uplink
from horus_profile.client import Client, Config
from horus_profile.hold import HoldTrack, Sender
from horus_profile.objects import Gps, HoldStatus, HoldWord, LinkStatus, PortStatus, ReportedPosition, Uplink

FOLDER = Path(os.environ.get("HORUS_TAPES", Path(__file__).parents[2] / "profile/c/tests/recorded"))
NO_FRESH = 2**64 - 1
WITH_HOLD = 0x80


def said(action):
    """The number of the result of an action that may be refused."""
    try:
        action()
    except Rejected as rejected:
        return int(rejected.why)
    return 0


def bits(code, value):
    """A float's bytes as hexadecimal digits, for each byte to be the same; the only NaN is the canonical one."""
    return struct.pack(">" + code, value).hex()


def sample(values):
    doubles = [bits("d", value) for value in (values.latitude, values.longitude, values.altitude)]
    singles = [bits("f", value) for value in (values.pitch, values.yaw, values.roll, *values.acceleration)]
    return " ".join([f" t={values.timestamp} s={values.status:04x}", *doubles, *singles])


def link(v):
    return (
        f" t={v.timestamp} s={v.status:04x} {v.objects_accepted} {v.objects_rejected} {v.frames_received}"
        f" {v.frames_missed} {v.age_100us} {v.access_violations}"
    )


def port(v):
    head = (
        f" t={v.timestamp} s={v.status:04x} {v.uplinks_accepted} {v.commands_carried_out} {v.last_command_timestamp}"
        f" {v.last_command:08x} {v.base_station_age_ms} {v.flight_controller_age_ms}"
    )
    rest = (v.integrity_faults, v.flash_passes, v.stuck_bits, v.buffers_out_of_use, v.last_stop)
    return " ".join([head, *map(str, v.violations), *map(str, rest)])


def hold(v):
    values = (v.temperature, v.humidity, v.set_point, *v.vibration, v.greatest_shock, v.supply, v.output)
    number, outcome, own, own_outcome = v.acknowledged
    return " ".join([f" t={v.timestamp} s={v.status:04x}", *(bits("f", value) for value in values),
                     f"{number}:{outcome} {own}:{own_outcome} {v.seconds}"])


def gps(v):
    age = v.status.age
    return sample(v) + (" never" if age is None else f" {age} ms")


def view(client):
    def line(name, kind, identifier, text):
        found = client.view(kind, identifier)
        return f"{name} {int(found)}\n" if isinstance(found, Rejection) else f"{name} 0{text(found)}\n"

    lines = [line("link", LinkStatus, Identifier.LINK_STATUS, link)]
    lines.append(line("object 0", ReportedPosition, Identifier.REPORTED_POSITION, sample))
    lines += [line(f"object {n}", Gps, Identifier.REPORTED_POSITION + n, gps) for n in range(1, 7)]
    lines.append(line("port", PortStatus, Identifier.PORT_STATUS, port))
    for identifier in Uplink.IDENTIFIERS:
        text = lambda v: f" t={v.timestamp} s={v.status:04x} {v.payload.hex()}"
        lines.append(line("uplink", Uplink, identifier, text))
    if client.config.hold:
        lines.append(line("hold", HoldStatus, Identifier.HOLD_STATUS, hold))
    return "".join(lines)


def report(r):
    text = f"end {int(r.verdict)} age={r.age_us}"
    if r.status is not None:
        text += f" status {r.status:04x}"
    if r.position is not None:
        text += " position" + sample(r.position)
    if r.link is not None:
        text += " link" + link(r.link)
    return text + "\n"


class Player:
    def __init__(self, tape):
        self.tape, self.at, self.text = tape, 0, ""
        #: Of each transaction: the map's layout, the first byte that was read, and the answer.
        self.answers = []
        self.renew(Config(3))

    def renew(self, config):
        self.client = Client(config)
        self.track, self.sender = HoldTrack(), Sender()

    def take(self, count):
        taken = self.tape[self.at : self.at + count]
        assert len(taken) == count, "a recorded tape is whole"
        self.at += count
        return taken

    def play(self):
        while self.at < len(self.tape):
            self.text += self.step(self.take(1)[0] % 10)
        return self.text

    def step(self, kind):
        if kind == 0:
            receivers, *limits = struct.unpack("<BHII", self.take(11))
            config = Config(receivers & ~WITH_HOLD, *limits, hold=bool(receivers & WITH_HOLD))
            return f"config {said(lambda: self.renew(config))}\n"
        if kind == 1:
            window = struct.unpack("<HH", self.take(4))
            return f"ask {said(lambda: self.client.ask(*window))}\n"
        if kind == 2:
            data = self.take(64)
            return f"write {said(lambda: self.client.write(data))}\n"
        if kind == 3:
            began_us, fresh_us, count = struct.unpack("<QQH", self.take(18))
            mosi = self.client.begin()
            text = f"begin {len(mosi)} {mosi[:72].hex()}\n"
            fresh = None if fresh_us == NO_FRESH else fresh_us
            text += report(self.client.end(self.take(count), began_us, fresh))
            self.answers.append((self.client._layout, self.client._shown[0], self.client._miso))
            return text + (self.hold(began_us) if self.client.config.hold else "")
        if kind == 4:
            return view(self.client)
        if kind == 5:
            timestamp, which = struct.unpack("<IB", self.take(5))
            word = CommandWord.SELF_TEST if which % 2 else CommandWord.CLEAR_COUNTERS
            return self.write("command", seal_command(timestamp, word))
        if kind == 7:
            which, value = struct.unpack("<Bf", self.take(5))
            word = list(HoldWord)[which % 4]
            number = self.sender.send(word, value if word is HoldWord.SET_POINT else 0.0)
            return f"send {'none' if number is None else number}\n"
        if kind == 8:
            self.sender.give_up()
            return "give up\n"
        timestamp, status, payload = struct.unpack("<IH52s", self.take(58))
        payload = self.sender.fill(payload) if kind == 9 else payload
        uplink = seal_uplink(Identifier.UPLINK_FLIGHT_CONTROLLER, timestamp, payload, status)
        return self.write("own", uplink)

    def hold(self, began_us):
        status = self.client.view(HoldStatus, Identifier.HOLD_STATUS)
        if isinstance(status, HoldStatus):
            self.sender.observe(status)
        said = self.track.read(self.client, began_us)
        values = "" if said.values is None else hold(said.values)
        sent = f" sent {self.sender.sent:d} {self.sender.number} {self.sender.outcome:d}\n"
        return f"hold {said.shown:d} age={said.age_us}{values}{sent}"

    def write(self, name, data):
        return f"{name} {said(lambda: self.client.write(data))} {data.hex()}\n"


def answers():
    """The layout, the first byte and the bytes of every answer in the tapes."""
    for tape in sorted(FOLDER.glob("*.tape")):
        player = Player(tape.read_bytes())
        player.play()
        yield from player.answers


def objects():
    """Every intact object in the tapes, once."""
    found = {}
    for layout, offset, data in answers():
        for kind, identifier, at in layout.places:
            if 0 <= at - offset <= len(data) - kind.SIZE:
                judged = kind.judge(data[at - offset : at - offset + kind.SIZE], identifier)
                if not isinstance(judged, Rejection):
                    found[judged.raw] = judged
    return list(found.values())


class Tapes(unittest.TestCase):
    maxDiff = 1000

    def test_every_tape_gives_the_recorded_output(self):
        tapes = sorted(FOLDER.glob("*.tape"))
        self.assertGreater(len(tapes), 20, f"no recordings in {FOLDER}")
        for tape in tapes:
            with self.subTest(tape=tape.stem):
                lines = Player(tape.read_bytes()).play().splitlines()
                expected = tape.with_suffix(".txt").read_text().splitlines()
                for number, (line, want) in enumerate(zip(lines, expected), 1):
                    self.assertEqual(line, want, f"line {number}")
                self.assertEqual(len(lines), len(expected))

    def test_what_is_written_during_a_transaction_is_sent_in_the_next(self):
        client = Client(Config(3))
        first, second = (seal_command(timestamp, CommandWord.SELF_TEST) for timestamp in (1, 2))
        client.write(first)
        self.assertEqual(client.begin()[8:72], first)
        client.write(second)
        client.end(bytes(96), 0)
        self.assertEqual(client.begin()[8:72], second)
        client.end(bytes(96), 10_000)
        self.assertEqual(client.begin()[8:72], bytes(64))


if __name__ == "__main__":
    unittest.main()
