# SPDX-License-Identifier: MIT OR Apache-2.0
"""MAVLink's TUNNEL, the message in which a flight controller forwards objects to a base station.

Objects travel whole and unchanged, several in one message. The payload type tells the first of them: its identifier
with bit 15 set. The others follow it in the order of the map, and their number follows from the length.
"""

from __future__ import annotations

from typing import Any, Iterator, List, Optional, Tuple, Type

from ._base import Object
from .objects import MAPS_WITH_HOLD, Identifier

#: The message's number in MAVLink's common dialect.
MESSAGE_ID = 385
#: Payload types from here on are for private use.
PRIVATE = 0x8000
#: The most payload bytes in one message.
MAX_PAYLOAD = 128

#: The seed of the message's checksum, which stands for its fields.
_CRC_EXTRA = 147
_HEAD = 10
_SIGNED = 0x01

#: The objects that a base station knows, in the order of the map.
PLACES: Tuple[Tuple[Type[Object], Identifier], ...] = tuple(
    (place.kind, Identifier(place.identifier))
    for place in MAPS_WITH_HOLD[max(MAPS_WITH_HOLD)].places
    if place.identifier != Identifier.UPLINK_FLIGHT_CONTROLLER
)

#: The bytes of an object, with what should be in them: judge them by `kind.judge(data, identifier)`.
Part = Tuple[Type[Object], Identifier, bytes]


def split(first: int, data: bytes) -> Optional[List[Part]]:
    """The successive objects from number `first` of `PLACES` on that fill `data`; None if none do.

    Hold-Status is always alone: it does not follow the base station's uplink in the map.
    """
    parts: List[Part] = []
    at = 0
    for kind, identifier in PLACES[first:]:
        if parts and identifier == Identifier.HOLD_STATUS:
            break
        parts.append((kind, identifier, data[at : at + kind.SIZE]))
        at += kind.SIZE
        if at >= len(data):
            break
    return parts if parts and at == len(data) else None


def split_payload(payload_type: int, payload: bytes) -> Optional[List[Part]]:
    """The objects in the payload of a TUNNEL message; None if it carries something else."""
    for first, (_, identifier) in enumerate(PLACES):
        if payload_type == PRIVATE | identifier:
            return split(first, payload)
    return None


def split_message(message: Any) -> Optional[List[Part]]:
    """The objects in a message that pymavlink has received; None if it is no TUNNEL, or carries something else."""
    if message.get_type() != "TUNNEL" or message.payload_length > MAX_PAYLOAD:
        return None
    return split_payload(message.payload_type, bytes(message.payload[: message.payload_length]))


def checksum(data: bytes) -> int:
    """The checksum of MAVLink: CRC-16/MCRF4XX."""
    crc = 0xFFFF
    for byte in data:
        byte ^= crc & 0xFF
        byte ^= (byte << 4) & 0xFF
        crc = (crc >> 8) ^ (byte << 8) ^ (byte << 3) ^ (byte >> 4)
    return crc


class Frames:
    """Finds the TUNNEL messages in MAVLink 2, a datagram or a piece of a stream at a time.

    Signatures are not verified.
    """

    def __init__(self) -> None:
        self._held = b""

    def feed(self, data: bytes) -> Iterator[Tuple[int, int, bytes]]:
        """The system, the payload type and the payload of each TUNNEL message that these bytes complete."""
        held = self._held + data
        while True:
            start = held.find(0xFD)
            held = held[start:] if start >= 0 else b""
            if len(held) < _HEAD:
                break
            end = _HEAD + held[1]
            whole = end + 2 + (13 if held[2] & _SIGNED else 0)
            if len(held) < whole:
                break
            if int.from_bytes(held[7:10], "little") == MESSAGE_ID:
                if checksum(held[1:end] + bytes([_CRC_EXTRA])) != int.from_bytes(held[end : end + 2], "little"):
                    held = held[1:]
                    continue
                # MAVLink 2 leaves zeros at the end out.
                body = held[_HEAD:end].ljust(5 + MAX_PAYLOAD, b"\0")
                if body[4] <= MAX_PAYLOAD:
                    yield held[5], int.from_bytes(body[:2], "little"), body[5 : 5 + body[4]]
            held = held[whole:]
        self._held = held
