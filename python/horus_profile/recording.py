# SPDX-License-Identifier: MIT OR Apache-2.0
"""The base station's recordings: what arrived, when, and what the station thought of it.

A recording is an MCAP file without compression. What of it is read here are the arrivals, the messages of `/carried`;
each object in them is verified again. A recording that was cut off, or damaged, is read as far as it goes.
"""

from __future__ import annotations

import os
import struct
import zlib
from dataclasses import dataclass
from typing import Any, BinaryIO, Dict, Iterator, List, Optional, Tuple, Type, Union

from ._base import Object, Rejection
from .objects import MAPS, MAPS_WITH_HOLD, Identifier
from .tunnel import PLACES, Frames, Part, split, split_payload

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _CHANNEL, _MESSAGE, _CHUNK = 0x02, 0x04, 0x05, 0x06

#: A longer record ends the reading: no chunk of a recorder is so long.
_LONGEST = 256 << 20

_MAVLINK_DATAGRAMS, _MAVLINK_STREAM, _DATAGRAMS, _STREAM, _PUBLISHED = range(1, 6)


@dataclass(frozen=True)
class Arrival:
    """An object that arrived."""

    at_us: int  #: the instant, since 1970
    drone: str  #: the drone that it is from
    identifier: Identifier  #: what it should be
    verdict: str  #: the station's: new, duplicate, older, out-of-sequence, vacant, or why it was rejected
    found: Union[Object, Rejection]  #: the object, verified again


class Recording:
    """The parts of a recording, in their order. Once it was read, its attributes say what was left out."""

    def __init__(self, *paths: Union[str, os.PathLike[str]]) -> None:
        self._paths = paths
        #: Where a part was cut off or damaged.
        self.torn: List[str] = []
        #: The number of messages whose objects do not agree with the station's verdicts, and which are left out: not
        #: signed with the station's key, or begun before the recording.
        self.unmatched = 0

    def __iter__(self) -> Iterator[Arrival]:
        self.torn, self.unmatched = [], 0
        lines: Dict[Tuple[int, int], _Line] = {}
        for path in self._paths:
            with open(path, "rb") as file:
                for message in self._messages(file, os.fspath(path)):
                    yield from self._arrivals(message, lines)

    def arrays(self) -> Dict[str, Dict[Identifier, Any]]:
        """The new and intact objects of each drone, as arrays of numpy.

        An array has the fields of the object's class, in the form of the wire, and `at_us`. Values that are not valid
        are in it as well: see the status word.
        """
        import numpy

        rows: Dict[str, Dict[Identifier, List[bytes]]] = {}
        for arrival in self:
            if arrival.verdict == "new" and isinstance(arrival.found, Object):
                row = struct.pack("<Q", arrival.at_us) + arrival.found.raw
                rows.setdefault(arrival.drone, {}).setdefault(arrival.identifier, []).append(row)
        kinds: Dict[Identifier, Type[Object]] = {identifier: kind for kind, identifier in PLACES}

        def array(identifier: Identifier, rows: List[bytes]) -> Any:
            return numpy.frombuffer(b"".join(rows), [("at_us", "<u8"), *kinds[identifier].dtype()])

        return {
            drone: {identifier: array(identifier, rows) for identifier, rows in of_drone.items()}
            for drone, of_drone in rows.items()
        }

    def _messages(self, file: BinaryIO, name: str) -> Iterator[bytes]:
        """The data of each arrival."""
        channels: Dict[int, bool] = {}
        if file.read(len(_MAGIC)) != _MAGIC:
            self.torn.append(f"{name} is no MCAP file")
            return
        while True:
            at = file.tell()
            head = file.read(9)
            if len(head) == 9 and head[0] == _FOOTER:
                return
            length = int.from_bytes(head[1:], "little")
            body = file.read(length) if len(head) == 9 and length <= _LONGEST else b""
            if len(head) < 9 or len(body) < length:
                self.torn.append(f"{name} is cut off at {at}")
                return
            records = body if head[0] == _CHUNK else head + body
            if head[0] == _CHUNK:
                unpacked = _chunk(body)
                if unpacked is None:
                    self.torn.append(f"{name} has a damaged chunk at {at}")
                    continue
                records = unpacked
            for opcode, record in _records(records):
                if opcode == _CHANNEL:
                    number, _, size = struct.unpack_from("<HHI", record)
                    channels[number] = record[8 : 8 + size] == b"/carried"
                elif opcode == _MESSAGE and channels.get(int.from_bytes(record[:2], "little")):
                    yield record[22:]

    def _arrivals(self, message: bytes, lines: Dict[Tuple[int, int], _Line]) -> Iterator[Arrival]:
        try:
            found = self._judged(_Rest(message), lines)
        except (ValueError, IndexError, struct.error):
            found = None
        self.unmatched += found is None
        yield from found or ()

    @staticmethod
    def _judged(rest: _Rest, lines: Dict[Tuple[int, int], _Line]) -> Optional[List[Arrival]]:
        """The objects of a message; None if they are not those that the verdicts are about."""
        at_us, kind, number = rest.numbers("<QBH")
        rest.array()
        data = rest.array()
        drones = [rest.array().decode() for _ in range(rest.numbers("<I")[0])]
        places = rest.array()
        verdicts = [rest.array().decode() for _ in range(rest.numbers("<I")[0])]
        if not (rest.is_empty() and len(drones) == len(places) == len(verdicts)):
            return None
        line = lines.setdefault((number, kind), _Line(kind))
        parts = list(line.parts(data))
        if [identifier for _, identifier, _ in parts] != [PLACES[place][1] for place in places]:
            return None
        return [
            Arrival(at_us, drone, identifier, verdict, cls.judge(body, identifier))
            for (cls, identifier, body), drone, verdict in zip(parts, drones, verdicts)
        ]


class _Line:
    """What is kept of a line from one message to the next."""

    def __init__(self, kind: int) -> None:
        self._kind = kind
        self._frames = Frames()
        self._held = b""

    def parts(self, data: bytes) -> Iterator[Part]:
        """The objects that these bytes complete."""
        found: List[Optional[List[Part]]] = []
        if self._kind in (_MAVLINK_DATAGRAMS, _MAVLINK_STREAM):
            frames = Frames() if self._kind == _MAVLINK_DATAGRAMS else self._frames
            found = [split_payload(kind, payload) for _, kind, payload in frames.feed(data)]
        elif self._kind == _DATAGRAMS:
            found = [_datagram(data)]
        elif self._kind == _STREAM:
            *whole, self._held = (self._held + data).split(b"\0")
            found = [_datagram(_unstuffed(frame)) for frame in whole]
        elif self._kind == _PUBLISHED and len(data) >= 10:
            parts = split(data[0], data[10 + data[1] :])
            found = [parts if parts is not None and len(parts) == data[1] else None]
        for parts in found:
            yield from parts or ()


class _Rest:
    """The rest of a message in the serialisation of ROS 1."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def numbers(self, code: str) -> Tuple[int, ...]:
        values = struct.unpack_from(code, self._data, self._at)
        self._at += struct.calcsize(code)
        return values

    def array(self) -> bytes:
        (length,) = self.numbers("<I")
        self._at += length
        if self._at > len(self._data):
            raise ValueError("an array that is longer than its message")
        return self._data[self._at - length : self._at]

    def is_empty(self) -> bool:
        return self._at == len(self._data)


def _datagram(data: bytes) -> Optional[List[Part]]:
    """The objects of a profile, an image or a map; those of a map are without the flight controller's uplink."""
    for layout in MAPS.values():
        if len(data) == layout.image_bytes:
            return split(0, data)
        if len(data) == layout.profile_bytes:
            return split(1, data)
    for layout in (*MAPS.values(), *MAPS_WITH_HOLD.values()):
        if len(data) == layout.map_bytes:
            known = [place for place in layout.places if (place.kind, place.identifier) in PLACES]
            return [
                (place.kind, Identifier(place.identifier), data[place.offset : place.offset + place.kind.SIZE])
                for place in known
            ]
    return None


def _unstuffed(frame: bytes) -> bytes:
    """The payload of a frame in consistent overhead byte stuffing; empty if it ends within a run."""
    payload = bytearray()
    while frame:
        code = frame[0]
        if len(frame) < code:
            return b""
        payload += frame[1:code]
        frame = frame[code:]
        if code < 0xFF and frame:
            payload.append(0)
    return bytes(payload)


def _records(data: bytes) -> Iterator[Tuple[int, bytes]]:
    at = 0
    while at + 9 <= len(data):
        length = int.from_bytes(data[at + 1 : at + 9], "little")
        yield data[at], data[at + 9 : at + 9 + length]
        at += 9 + length


def _chunk(body: bytes) -> Optional[bytes]:
    """The records of a chunk; None if it is damaged, or compressed, which no recorder does."""
    if len(body) < 40:
        return None
    crc, compression = struct.unpack_from("<II", body, 24)
    length = int.from_bytes(body[32:40], "little")
    records = body[40 : 40 + length]
    if compression != 0 or len(records) != length or (crc != 0 and zlib.crc32(records) != crc):
        return None
    return records
