# SPDX-License-Identifier: MIT OR Apache-2.0
"""The flight controller's end of the SSI: what is sent to the DPR, and what its answer is worth.

It is the same client as `profile::ssi::client` in Rust and `horus_dpr.c`, and plays the same recorded transactions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Optional, Tuple, Type, TypeVar, Union

from ._base import Object, Rejected, Rejection
from .image import REQUEST_BYTES, checked, seal_request, verify_written
from .objects import (
    AGE_LIMIT_US, CYCLE_MS, EXPIRY_US, MAPS, MAPS_WITH_HOLD, MAX_MISSED, PREFIX_BYTES, SEARCH_CYCLES, SILENCE_US,
    TOLERANCE_SHARE, TOLERANCE_US, Identifier, LinkStatus, ReportedBits, ReportedPosition, Verdict,
)

_T = TypeVar("_T", bound=Object)

#: An age that is unknown: there was no sample yet, or its age cannot be told.
AGE_UNKNOWN = 0xFFFFFFFF


@dataclass(frozen=True)
class Config:
    """The settings of a client."""

    receivers: int  #: receivers of the profile: 1, 2, 3 or 5
    read_bytes: int = PREFIX_BYTES  #: what a transaction reads from the map's start
    age_limit_us: int = AGE_LIMIT_US  #: a position older than this is not shown
    silence_us: int = SILENCE_US  #: so long without anything intact, and the DPR is silent
    hold: bool = False  #: whether the DPR has an active hold: the map is longer by its object


@dataclass(frozen=True)
class Report:
    """What a transaction brought."""

    verdict: Verdict
    age_us: int  #: age of the last intact sample when the transaction began; not less than the true one
    position: Optional[ReportedPosition]  #: the position to fly by, for display; None: use your own receiver
    status: Optional[ReportedBits]  #: HORUS's status, with a valid position or without one
    link: Optional[LinkStatus]  #: Link-Status, if this transaction brought it


@dataclass
class _Last:
    """The last intact sample."""

    timestamp: int
    due_us: int
    read_us: int
    age_us: int


class Client:
    """A client. Call `begin`, transfer what it returns, and call `end` with the answer, once in each control cycle."""

    def __init__(self, config: Config) -> None:
        """Raises `Rejected` if no profile has these receivers, or if `read_bytes` are too few or too many."""
        if config.receivers not in MAPS:
            raise Rejected(Rejection.WINDOW)
        self.config = config
        self._layout = (MAPS_WITH_HOLD if config.hold else MAPS)[config.receivers]
        if config.read_bytes < PREFIX_BYTES or not self._is_inside(0, config.read_bytes):
            raise Rejected(Rejection.WINDOW)
        self._default = (0, config.read_bytes)
        self._asked: Optional[Tuple[int, int]] = None
        self._sent: Optional[Tuple[int, int]] = None
        self._window: Optional[Tuple[int, int]] = None
        self._shown = self._default
        self._miso = b""
        self._object: Optional[bytes] = None
        self._under_way = False
        self._last: Optional[_Last] = None
        self._found = 0
        self._image: Optional[Tuple[int, int]] = None
        self._intact_us: Optional[int] = None
        self._position: Optional[ReportedPosition] = None
        self._has_position = self._has_status = False

    def _is_inside(self, offset: int, length: int) -> bool:
        return length > 0 and offset + length <= self._layout.map_bytes

    def ask(self, offset: int, length: int) -> None:
        """Requests bytes of the map; the transaction after the next one reads them.

        Raises `Rejected` if the window is empty or not in the map.
        """
        if not self._is_inside(offset, length):
            raise Rejected(Rejection.WINDOW)
        self._asked = (offset, length)

    def write(self, data: bytes) -> None:
        """Writes an uplink or a command in the next transaction; raises `Rejected` if the DPR would refuse it."""
        verify_written(data)
        self._object, self._under_way = bytes(data), False

    def begin(self) -> bytes:
        """What is sent in the next transaction, which reads as many bytes."""
        _, length = self._window or self._default
        if self._asked is not None:
            self._sent, self._asked = self._asked, None
        mosi = seal_request(*self._sent) if self._sent is not None else bytes(REQUEST_BYTES)
        if self._object is not None:
            mosi += self._object
            self._under_way = True
        return mosi.ljust(length, b"\0")

    def end(self, miso: bytes, began_us: int, fresh_us: Optional[int] = None) -> Report:
        """Ends the transaction with the answer; empty if the bus failed.

        `began_us` is the instant at which chip select fell, `fresh_us` that of the last edge of FRESH before it, None
        if the line is not wired: both in µs on one clock that never goes back.
        """
        self._shown = self._window or self._default
        offset, length = self._shown
        self._miso = bytes(miso[:length])
        busy = self.is_busy()
        another = offset != 0 or length < PREFIX_BYTES
        if not busy:
            # The DPR has received the request. A busy one has not, and still shows the earlier window.
            self._window, self._sent = self._sent, None
            if self._under_way:
                self._object = None
            self._under_way = False
        link: Union[LinkStatus, Rejection] = Rejection.LENGTH
        reported: Union[ReportedPosition, Rejection] = Rejection.LENGTH
        if not another and not busy and len(self._miso) >= PREFIX_BYTES:
            link = self.view(LinkStatus, Identifier.LINK_STATUS)
            reported = self.view(ReportedPosition, Identifier.REPORTED_POSITION)
        intact = False
        verdict = Verdict.DAMAGED
        if isinstance(link, LinkStatus) and isinstance(reported, ReportedPosition):
            verdict = self._judge(link, reported, began_us, fresh_us)
        elif isinstance(link, LinkStatus) and reported is Rejection.VACANT:
            verdict = Verdict.EMPTY
        elif busy:
            verdict = Verdict.BUSY
        elif another:
            verdict = Verdict.OTHER_WINDOW
            intact = any(not isinstance(found, Rejection) for found in self.view_all())
        if isinstance(link, LinkStatus):
            self._image = (link.timestamp, began_us)
        if isinstance(link, LinkStatus) or intact or self._intact_us is None:
            self._intact_us = began_us
        if verdict in (Verdict.BUSY, Verdict.DAMAGED) and began_us - self._intact_us > self.config.silence_us:
            verdict = Verdict.SILENT
        age_us = self._last_age_us(began_us)
        if self._is_too_old(age_us):
            self._has_position = self._has_status = False
        position = self._position if self._has_position else None
        status = self._position.status if self._position is not None and self._has_status else None
        return Report(verdict, age_us, position, status, link if isinstance(link, LinkStatus) else None)

    def is_busy(self) -> bool:
        """Whether the DPR was busy in the last transaction, or nothing came: 0xFF throughout."""
        return self._miso == b"\xff" * len(self._miso)

    def view(self, kind: Type[_T], identifier: int) -> Union[_T, Rejection]:
        """An object of the last transaction, or why there is none."""
        for place in self._layout.places:
            at = place.offset - self._shown[0]
            if place.identifier == identifier and 0 <= at <= len(self._miso) - kind.SIZE:
                return kind.judge(self._miso[at : at + kind.SIZE], identifier)
        return Rejection.LENGTH

    def view_all(self) -> List[Union[Object, Rejection]]:
        """Every object of the map, in its order, as `view` has it."""
        return [self.view(place.kind, place.identifier) for place in self._layout.places]

    def _judge(
        self, link: LinkStatus, reported: ReportedPosition, began_us: int, fresh_us: Optional[int]
    ) -> Verdict:
        """Judges an intact sample."""
        last = self._last
        if last is not None and last.timestamp == reported.timestamp:
            return Verdict.STALE if self._is_too_old(self._last_age_us(began_us)) else Verdict.SAME
        due_us = self._due_us(reported.timestamp, began_us)
        age_us = self._sample_age_us(link, began_us, fresh_us)
        self._last = _Last(reported.timestamp, began_us if due_us is None else due_us, began_us, age_us)
        self._found = 0 if due_us is None else min(self._found + 1, SEARCH_CYCLES)
        self._position = checked(reported)
        if due_us is None and last is not None:
            verdict = Verdict.OUT_OF_SEQUENCE
        elif self._found < SEARCH_CYCLES:
            verdict = Verdict.SEARCHING
        elif not self._position.status.position_valid:
            verdict = Verdict.INVALID
        elif self._is_too_old(age_us):
            verdict = Verdict.STALE
        else:
            verdict = Verdict.FRESH
        self._has_position = verdict is Verdict.FRESH
        self._has_status = self._has_position or verdict is Verdict.INVALID
        return verdict

    def _due_us(self, timestamp: int, read_us: int) -> Optional[int]:
        """The earliest instant at which a sample that continues the last one could have been read; else None."""
        if self._last is None:
            return None
        step_ms = (timestamp - self._last.timestamp) & 0xFFFFFFFF
        step_us = step_ms * 1000
        drift_us = step_us // TOLERANCE_SHARE
        expected_us = self._last.due_us + step_us
        whole = 0 < step_ms <= CYCLE_MS * (1 + MAX_MISSED) and step_ms % CYCLE_MS == 0
        if not whole or abs(read_us - expected_us) > TOLERANCE_US + drift_us:
            return None
        # A sample that is read early shows that the others were read late. HORUS's clock may be slower by 2 %.
        return min(read_us, expected_us + drift_us)

    def _sample_age_us(self, link: LinkStatus, began_us: int, fresh_us: Optional[int]) -> int:
        """The greatest possible age of the sample of an image that was not read before."""
        if link.age_100us == 0xFFFF:
            return AGE_UNKNOWN
        shown_us = EXPIRY_US
        if fresh_us is not None and fresh_us <= began_us:
            shown_us = min(shown_us, began_us - fresh_us)
        # The reading before bounds the image's publication only if it showed another image.
        if self._image is not None and self._image[0] != link.timestamp and self._image[1] <= began_us:
            shown_us = min(shown_us, began_us - self._image[1])
        return min(100 * (link.age_100us + 1) + shown_us, AGE_UNKNOWN)

    def _last_age_us(self, now_us: int) -> int:
        if self._last is None or now_us < self._last.read_us:
            return AGE_UNKNOWN
        return min(self._last.age_us + now_us - self._last.read_us, AGE_UNKNOWN)

    def _is_too_old(self, age_us: int) -> bool:
        return age_us > self.config.age_limit_us or age_us == AGE_UNKNOWN
