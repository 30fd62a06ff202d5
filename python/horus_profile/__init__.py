# SPDX-License-Identifier: MIT OR Apache-2.0
"""The objects of HORUS: decode and verify them, seal uplinks and commands, read recordings and MAVLink.

`horus_profile.objects` has the objects with their fields, status words and codes, and `horus_profile.image` whole
profiles, images and maps. `horus_profile.client` is the flight controller's end of the SSI, `horus_profile.hold` that
of an active hold. The file `layout.json` in this folder describes the same for programs in other languages, and
`profile.ksy` for Kaitai Struct.
"""

from . import objects
from ._base import Crc, MapLayout, Object, Rejected, Rejection
from .image import (
    Reading, checked, command_word, is_position, read, seal_command, seal_request, seal_uplink, verify_written,
)
from .objects import (
    FRAME, MAPS, MAPS_WITH_HOLD, POSITION, CommandObject, CommandWord, Gps, HoldStatus, Identifier, LinkStatus,
    PortStatus, ReportedPosition, Uplink, Violation,
)

__all__ = [
    "FRAME", "MAPS", "MAPS_WITH_HOLD", "POSITION", "CommandObject", "CommandWord", "Crc", "Gps", "HoldStatus",
    "Identifier", "LinkStatus", "MapLayout", "Object", "PortStatus", "Reading", "Rejected", "Rejection",
    "ReportedPosition", "Uplink", "Violation", "checked", "command_word", "is_position", "objects", "read",
    "seal_command", "seal_request", "seal_uplink", "verify_written",
]
