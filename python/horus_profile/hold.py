# SPDX-License-Identifier: MIT OR Apache-2.0
"""The active hold, as the flight controller's client sees it, and the commands to it.

It is the same as `HoldTrack` and `Sender` in Rust and as `horus_dpr_hold_read` and `horus_dpr_sender_...` in C, and
plays the same recorded transactions.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, Optional, Tuple

from ._base import Rejection
from .client import AGE_UNKNOWN, Client
from .objects import (
    HOLD_COMMAND_BYTES, HOLD_EXPIRY_US, HOLD_FRAME_US, PAYLOAD_BYTES, HoldShown, HoldStatus, HoldWord, Identifier,
    Outcome, Uplink,
)


class Acknowledged(NamedTuple):
    """A command as the hold has acknowledged it."""

    number: int  #: its sequence number; 0 if there was none
    outcome: Optional[Outcome]  #: None if the code is reserved


def acknowledged(status: HoldStatus, writer: Identifier = Identifier.UPLINK_FLIGHT_CONTROLLER) -> Acknowledged:
    """What the hold says about the last command of `writer`."""
    place = 2 * Uplink.IDENTIFIERS.index(writer)
    number, code = status.acknowledged[place : place + 2]
    return Acknowledged(number, Outcome(code) if code in list(Outcome) else None)


@dataclass(frozen=True)
class HoldReport:
    """What is known of the hold after a transaction."""

    shown: HoldShown
    values: Optional[HoldStatus]  #: the last Hold-Status, if it is valid; a value that is not known is NaN
    age_us: int  #: its age when the transaction began; not less than the true one


class HoldTrack:
    """Follows Hold-Status from transaction to transaction, beside a client."""

    def __init__(self) -> None:
        self._last: Optional[HoldStatus] = None
        self._read_us = self._age_us = 0
        self._looked_us: Optional[int] = None

    def read(self, client: Client, began_us: int) -> HoldReport:
        """The report after `client.end` with the same `began_us`.

        A transaction that did not read the place of Hold-Status, met a busy DPR or read damaged bytes there only lets
        the last one age.
        """
        found = Rejection.LENGTH if client.is_busy() else client.view(HoldStatus, Identifier.HOLD_STATUS)
        if isinstance(found, HoldStatus):
            if self._last is None or self._last.timestamp != found.timestamp:
                # The reading before bounds its arrival, and the DPR shows none for longer than its expiry.
                shown_us = HOLD_EXPIRY_US
                if self._looked_us is not None and self._looked_us <= began_us:
                    shown_us = min(shown_us, began_us - self._looked_us)
                self._last, self._read_us, self._age_us = found, began_us, HOLD_FRAME_US + shown_us
        elif found is Rejection.VACANT:
            self._last = None
        if isinstance(found, HoldStatus) or found is Rejection.VACANT:
            self._looked_us = began_us
        if self._last is None:
            return HoldReport(HoldShown.ABSENT, None, AGE_UNKNOWN)
        since_us = began_us - self._read_us
        if since_us < 0:
            # The clock was set back.
            return HoldReport(HoldShown.OLD, None, AGE_UNKNOWN)
        age_us = min(self._age_us + since_us, AGE_UNKNOWN)
        if since_us > HOLD_EXPIRY_US:
            return HoldReport(HoldShown.OLD, None, age_us)
        return HoldReport(HoldShown.VALID, self._last, age_us)


class Sent(IntEnum):
    """What is known of the last command, with the numbers of `horus_dpr_sent_t` in C."""

    NOTHING = 0  #: none was sent
    WAITING = 1  #: it is in every uplink, and not acknowledged yet
    ANSWERED = 2  #: it is acknowledged, once and for all: see `Sender.outcome`
    LOST = 3  #: it is no longer sent and was not acknowledged: done once or not at all


class Sender:
    """The commands of a writer to the hold, one at a time.

    Give each Hold-Status that was read to `observe`, and let `fill` put the command into the payload of every uplink,
    with a later timestamp in each. The hold executes a command once, however often it comes.
    """

    def __init__(self, writer: Identifier = Identifier.UPLINK_FLIGHT_CONTROLLER) -> None:
        if writer not in Uplink.IDENTIFIERS:
            raise ValueError(f"{writer!r} has no uplink")
        self.writer = writer
        self.sent = Sent.NOTHING
        self.number = 0  #: that of the last command
        self.outcome = Outcome.NOTHING  #: with `Sent.ANSWERED`
        self._hold: Optional[Tuple[int, int]] = None
        self._command = bytes(HOLD_COMMAND_BYTES)

    def observe(self, status: HoldStatus) -> None:
        """Takes the acknowledgement.

        A command that is waiting is lost if the hold has restarted, or has acknowledged a later one.
        """
        number, outcome = acknowledged(status, self.writer)
        behind = 0 if self._hold is None else (self._hold[0] - status.timestamp) & 0xFFFFFFFF
        self._hold = (status.timestamp, number)
        if self.sent not in (Sent.WAITING, Sent.LOST):
            return
        if number == self.number and outcome not in (None, Outcome.NOTHING):
            self.sent, self.outcome = Sent.ANSWERED, Outcome(outcome)
        elif 0 < behind <= 0x7FFFFFFF or _is_newer(number, self.number):
            self.sent = Sent.LOST

    def send(self, word: HoldWord, value: float = 0.0) -> Optional[int]:
        """Sends a command from now on, and returns its number.

        None, and nothing is sent, while another one is waiting or before a Hold-Status was observed.
        """
        if self._hold is None or self.sent is Sent.WAITING:
            return None
        last = self._hold[1]
        if self.sent is not Sent.NOTHING and _is_newer(self.number, last):
            last = self.number
        self.number = (last + 1) & 0xFFFF
        self.sent, self.outcome = Sent.WAITING, Outcome.NOTHING
        self._command = struct.pack("<HHfI", self.number, HoldWord(word), value, 0)
        return self.number

    def give_up(self) -> None:
        """Stops sending the command that is waiting: it is lost."""
        if self.sent is Sent.WAITING:
            self.sent = Sent.LOST

    def fill(self, payload: bytes = b"") -> bytes:
        """The payload of an uplink, with the command that is waiting, or none, in place of its first bytes."""
        command = self._command if self.sent is Sent.WAITING else bytes(HOLD_COMMAND_BYTES)
        return command + payload.ljust(PAYLOAD_BYTES, b"\0")[HOLD_COMMAND_BYTES:]


def _is_newer(number: int, than: int) -> bool:
    """Whether a number is 1 to 32767 ahead of another."""
    return 0 < (number - than) & 0xFFFF <= 0x7FFF
