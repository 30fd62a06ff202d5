# SPDX-License-Identifier: MIT OR Apache-2.0
"""Whole profiles, images and maps, values for display, and what is written to the DPR."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, replace
from typing import Dict, Optional, Tuple, TypeVar, Union

from ._base import Object, Rejected, Rejection
from .objects import (
    FRAME, MAPS, MAPS_WITH_HOLD, MAX_ALTITUDE, MAX_LATITUDE, MAX_LONGITUDE, MIN_ALTITUDE, PAYLOAD_BYTES, CommandObject,
    CommandWord, Gps, HoldStatus, Identifier, LinkStatus, PortStatus, ReportedPosition, Uplink,
)

_S = TypeVar("_S", ReportedPosition, Gps)

#: The length of a request, bytes.
REQUEST_BYTES = 8


@dataclass(frozen=True)
class Reading:
    """The objects of a profile, an image or a map, each accepted or rejected separately.

    An object that these bytes do not have is None.
    """

    reported: Union[ReportedPosition, Rejection]
    gps: Tuple[Union[Gps, Rejection], ...]
    link: Union[LinkStatus, Rejection, None] = None
    port: Union[PortStatus, Rejection, None] = None
    base_station: Union[Uplink, Rejection, None] = None
    flight_controller: Union[Uplink, Rejection, None] = None
    hold: Union[HoldStatus, Rejection, None] = None


def read(data: bytes) -> Reading:
    """The objects of `data`, which are a profile, an image or a map: all their lengths differ.

    Raises `Rejected` if they have no such length.
    """
    for layout in (*MAPS.values(), *MAPS_WITH_HOLD.values()):
        start = layout.image_bytes - layout.profile_bytes
        begin = start if len(data) == layout.profile_bytes else 0
        if len(data) not in (layout.profile_bytes, layout.image_bytes, layout.map_bytes):
            continue
        found: Dict[int, Union[Object, Rejection]] = {}
        for place in layout.places:
            at = place.offset - begin
            if 0 <= at < len(data):
                found[place.identifier] = place.kind.judge(data[at : at + place.kind.SIZE], place.identifier)
        gps = tuple(found[identifier] for identifier in Gps.IDENTIFIERS if identifier in found)
        return Reading(
            found[Identifier.REPORTED_POSITION],  # type: ignore[arg-type]
            gps,  # type: ignore[arg-type]
            found.get(Identifier.LINK_STATUS),  # type: ignore[arg-type]
            found.get(Identifier.PORT_STATUS),  # type: ignore[arg-type]
            found.get(Identifier.UPLINK_BASE_STATION),  # type: ignore[arg-type]
            found.get(Identifier.UPLINK_FLIGHT_CONTROLLER),  # type: ignore[arg-type]
            found.get(Identifier.HOLD_STATUS),  # type: ignore[arg-type]
        )
    raise Rejected(Rejection.LENGTH)


def is_position(latitude: float, longitude: float, altitude: float) -> bool:
    """Whether these can be a position. An altitude of NaN is unknown, as in a 2D fix."""
    height = math.isnan(altitude) or MIN_ALTITUDE <= altitude <= MAX_ALTITUDE
    return abs(latitude) <= MAX_LATITUDE and abs(longitude) <= MAX_LONGITUDE and height


def checked(values: _S) -> _S:
    """The values for display.

    Those that their status does not mark as valid, or that are marked valid but impossible, are NaN, and their status
    bit is clear. `raw` is unchanged.
    """
    status = values.status
    located = status.position_valid and is_position(values.latitude, values.longitude, values.altitude)
    attitude = status.attitude_valid and all(map(math.isfinite, (values.pitch, values.yaw, values.roll)))
    accelerated = status.acceleration_valid and all(map(math.isfinite, values.acceleration))
    bits = int(status)
    if not located:
        bits &= ~status.POSITION_VALID
        values = replace(values, latitude=math.nan, longitude=math.nan)
    if not located or math.isnan(values.altitude):
        values = replace(values, altitude=math.nan)
    if not attitude:
        bits &= ~status.ATTITUDE_VALID
        values = replace(values, pitch=math.nan, yaw=math.nan, roll=math.nan)
    if not accelerated:
        bits &= ~status.ACCELERATION_VALID
        values = replace(values, acceleration=(math.nan,) * 3)
    return replace(values, status=type(status)(bits))


def seal_uplink(writer: Identifier, timestamp: int, payload: bytes, status: int = 0) -> bytes:
    """An uplink of 64 bytes; `payload` is filled with zeros.

    `writer` is `Identifier.UPLINK_BASE_STATION` or `Identifier.UPLINK_FLIGHT_CONTROLLER`; `timestamp` is in ms on its
    clock, wraps, and is later than that of the uplink before it.
    """
    if writer not in Uplink.IDENTIFIERS:
        raise ValueError(f"{writer!r} has no uplink")
    if len(payload) > PAYLOAD_BYTES:
        raise ValueError(f"an uplink carries {PAYLOAD_BYTES} bytes, not {len(payload)}")
    return _sealed(struct.pack("<IHH", timestamp & 0xFFFFFFFF, writer, status) + payload.ljust(PAYLOAD_BYTES, b"\0"))


def seal_command(timestamp: int, word: CommandWord) -> bytes:
    """A command of the flight controller to the DPR, 64 bytes."""
    head = struct.pack("<IHHI", timestamp & 0xFFFFFFFF, Identifier.COMMAND, 0, CommandWord(word))
    return _sealed(head.ljust(CommandObject.SIZE - 4, b"\0"))


def seal_request(offset: int, length: int) -> bytes:
    """A request of a window of the map, 8 bytes."""
    return _sealed(struct.pack("<HH", offset, length))


def verify_written(data: bytes) -> Union[Uplink, CommandObject]:
    """The uplink or command in `data`, if the DPR would accept such an object; else raises `Rejected`."""
    if len(data) != Uplink.SIZE:
        raise Rejected(Rejection.LENGTH)
    if FRAME(data[:-4]) != int.from_bytes(data[-4:], "big"):
        raise Rejected(Rejection.CRC)
    if int.from_bytes(data[4:6], "little") != Identifier.COMMAND:
        return Uplink.verify(data)
    command = CommandObject.verify(data)
    if command_word(command) is None:
        raise Rejected(Rejection.COMMAND)
    return command


def command_word(command: CommandObject) -> Optional[CommandWord]:
    """What the command asks; None if its word is unknown or a reserved byte is not zero."""
    if any(command.reserved) or command.word not in list(CommandWord):
        return None
    return CommandWord(command.word)


def _sealed(data: bytes) -> bytes:
    return data + FRAME(data).to_bytes(4, "big")
