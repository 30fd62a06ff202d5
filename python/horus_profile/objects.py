# SPDX-License-Identifier: MIT OR Apache-2.0
"""The objects of HORUS, their status words, codes and places.

Generated from the Rust crate `profile` by `cargo xtask layout`. Do not edit: `cargo xtask lint` fails if this file
differs from the generated one.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar, Dict, Optional, Tuple, Type

from ._base import Crc, Field, MapLayout, Object, Place, Word

FRAME = Crc(0xF1922815, init=0xFFFFFFFF, xorout=0xFFFFFFFF, check=0x12D3A0B1)
POSITION = Crc(0x3AFF2FAD, init=0xFFFFFFFF, xorout=0xFFFFFFFF, check=0xEA8707AB)
#: the cycle of HORUS: each timestamp is a multiple later
CYCLE_MS = 10
#: Link-Status and Reported-Position
PREFIX_BYTES = 96
#: what an uplink carries
PAYLOAD_BYTES = 52
#: a position older than this is not shown
AGE_LIMIT_US = 100000
#: so long without anything intact, and the DPR is silent
SILENCE_US = 30000
#: cycles between two samples in sequence
MAX_MISSED = 25
#: so many samples in sequence before one is shown
SEARCH_CYCLES = 3
#: a sample may be read so much too early or too late
TOLERANCE_US = 27500
#: and by one part in so many of the step
TOLERANCE_SHARE = 50
#: the DPR does not show an image for longer than this
EXPIRY_US = 25000
#: a command to the hold, the beginning of an uplink's payload
HOLD_COMMAND_BYTES = 12
#: the DPR does not show Hold-Status for longer
HOLD_EXPIRY_US = 300000
#: the age of Hold-Status when the DPR gets it
HOLD_FRAME_US = 1416
#: the step of the age of a receiver's solution
AGE_STEP_MS = 25
#: the code of that age: there was no solution since HORUS's start
AGE_NEVER = 63
#: degrees north and south
MAX_LATITUDE = 90.0
#: degrees east and west
MAX_LONGITUDE = 180.0
#: m above the ellipsoid
MIN_ALTITUDE = -1000.0
#: m above the ellipsoid
MAX_ALTITUDE = 20000.0


class Identifier(IntEnum):
    """The kind of an object."""

    LINK_STATUS = 0x4400
    REPORTED_POSITION = 0x4800
    PORT_STATUS = 0x4401
    UPLINK_BASE_STATION = 0x4200
    UPLINK_FLIGHT_CONTROLLER = 0x4300
    COMMAND = 0x4301
    HOLD_STATUS = 0x4100
    GPS1 = 0x4801
    GPS2 = 0x4802
    GPS3 = 0x4803
    GPS4 = 0x4804
    GPS5 = 0x4805


class State(IntEnum):
    """What HORUS is doing. Other codes are reserved."""

    STARTING = 0  #: no position since HORUS's start
    MONITORING = 1  #: there is a position now
    OUTSIDE_RANGE = 2  #: the position is outside the flight range
    SWITCHED = 3  #: switched to the redundant flight controller
    MOTORS_CUT = 4  #: motors cut
    EMERGENCY_FIRED = 5  #: emergency measure fired
    INPUTS_CONTRADICT = 6  #: an input that tells the state contradicts itself
    POSITION_LOST = 7  #: there was a position, and there is none now


class Fix(IntEnum):
    """A receiver's fix. Other codes are reserved."""

    NONE = 0  #: no fix
    DEAD_RECKONING = 1  #: dead reckoning only
    FIX_2D = 2  #: two-dimensional fix
    FIX_3D = 3  #: three-dimensional fix
    COMBINED = 4  #: GNSS and dead reckoning combined
    TIME_ONLY = 5  #: time only


class Reset(IntEnum):
    """Why the DPR, HORUS or the hold last started. Other codes are reserved."""

    POWER_ON = 0  #: its supply came on
    PIN = 1  #: its reset pin was low
    WATCHDOG = 2  #: its watchdog was not fed
    LOCKUP = 3  #: a fault while it handled a fault
    SOFTWARE = 4  #: software or a debugger asked for it
    OTHER = 5  #: its supply dipped, or something else


class Outcome(IntEnum):
    """What became of a command to the hold. Other codes are reserved."""

    NOTHING = 0  #: there was no command since the hold's start
    DONE = 1  #: it was carried out
    REFUSED = 2  #: the hold's own limits forbid it
    UNKNOWN = 3  #: its word is unknown
    TOO_OLD = 4  #: its uplink had the same timestamp for more than 1 s


class Verdict(IntEnum):
    """What a transaction brought."""

    NONE = 0  #: no transaction has ended: nobody filled the report
    FRESH = 1  #: a new sample, in sequence, valid, not too old: its position is shown
    SAME = 2  #: the same sample again, intact: not new, only older
    SEARCHING = 3  #: a new sample; the sequence is not found yet. Not shown
    OUT_OF_SEQUENCE = 4  #: a sample that does not continue the others. Not shown
    EMPTY = 5  #: Link-Status is intact; there is no Reported-Position
    INVALID = 6  #: a new sample whose position is not valid and not shown; its status is
    STALE = 7  #: an intact sample that is older than the limit. Not shown
    BUSY = 8  #: 0xFF throughout, or nothing: not heard; what was sent is sent again
    DAMAGED = 9  #: damaged, or not read whole: nothing of it is used
    SILENT = 10  #: busy or damaged, and nothing intact for too long
    OTHER_WINDOW = 11  #: the window that was asked for: see horus_dpr_view_...


class HoldShown(IntEnum):
    """Whether there is a Hold-Status."""

    ABSENT = 0  #: the DPR shows none, or none was read yet
    OLD = 1  #: the last one has not changed for more than HORUS_DPR_HOLD_EXPIRY_US
    VALID = 2  #: there is one


class CommandWord(IntEnum):
    """What a command asks of the DPR."""

    CLEAR_COUNTERS = 0x43524C43  #: sets Port-Status's counters to 0
    SELF_TEST = 0x54534554  #: one whole pass over flash and RAM in use


class HoldWord(IntEnum):
    """What a command asks of the hold; 0 is none."""

    SET_POINT = 1  #: the value is the temperature to keep, degrees Celsius
    LOCK = 2  #: locks it
    UNLOCK = 3  #: unlocks it
    CLEAR_SHOCK = 4  #: sets the greatest shock to 0


class Violation(IntEnum):
    """Places in `PortStatus.violations`."""

    REQUEST_DAMAGED = 0  #: a request whose CRC is wrong
    WINDOW_OUTSIDE = 1  #: a window that is empty or not in the map
    TOO_SHORT = 2  #: a request or an object that ended in the middle
    UPLINK_DAMAGED = 3  #: an object whose CRC is wrong
    UPLINK_IDENTIFIER = 4  #: an object that nobody may write
    UPLINK_NOT_NEWER = 5  #: an uplink or a command that is repeated or old
    COMMAND_UNKNOWN = 6  #: an unknown command, or reserved bytes that are not zero
    COMMAND_BUSY = 7  #: a self-test while one is under way
    TOO_MANY = 8  #: more transactions or objects than the DPR grants
    TOO_LONG = 9  #: something was driven behind the object


class ReportedBits(Word):
    """Status of Reported-Position."""

    USED: ClassVar[int] = 0xFFFF
    AGREEING: ClassVar[int] = 0x0007
    POSITION_VALID: ClassVar[int] = 0x0008
    ATTITUDE_VALID: ClassVar[int] = 0x0010
    ACCELERATION_VALID: ClassVar[int] = 0x0020
    DEGRADED: ClassVar[int] = 0x0040
    WITHOUT_CRYSTAL: ClassVar[int] = 0x0080
    STATE: ClassVar[int] = 0x0F00
    MEMORY_FAULT: ClassVar[int] = 0x1000
    RESET: ClassVar[int] = 0xE000

    @property
    def agreeing(self) -> int:
        """receivers that agree, 0 to 7"""
        return (self & self.AGREEING) >> 0

    @property
    def position_valid(self) -> bool:
        """latitude and longitude are valid"""
        return bool(self & self.POSITION_VALID)

    @property
    def attitude_valid(self) -> bool:
        """pitch, yaw and roll are valid"""
        return bool(self & self.ATTITUDE_VALID)

    @property
    def acceleration_valid(self) -> bool:
        """the accelerations are valid"""
        return bool(self & self.ACCELERATION_VALID)

    @property
    def degraded(self) -> bool:
        """fewer receivers agree than configured, or on no altitude"""
        return bool(self & self.DEGRADED)

    @property
    def without_crystal(self) -> bool:
        """HORUS runs without its crystal"""
        return bool(self & self.WITHOUT_CRYSTAL)

    @property
    def state(self) -> Optional[State]:
        """what HORUS is doing; None if the code is reserved"""
        return self._code(State, self.STATE)

    @property
    def memory_fault(self) -> bool:
        """HORUS has found a fault of its memory"""
        return bool(self & self.MEMORY_FAULT)

    @property
    def reset(self) -> Optional[Reset]:
        """why HORUS last started; None if the code is reserved"""
        return self._code(Reset, self.RESET)


class GpsBits(Word):
    """Status of GPS1 to GPS5."""

    USED: ClassVar[int] = 0xFFFF
    FIX: ClassVar[int] = 0x000F
    POSITION_VALID: ClassVar[int] = 0x0010
    ATTITUDE_VALID: ClassVar[int] = 0x0020
    ACCELERATION_VALID: ClassVar[int] = 0x0040
    HEARD: ClassVar[int] = 0x0080
    STALE: ClassVar[int] = 0x0100
    EXCLUDED: ClassVar[int] = 0x0200
    AGE: ClassVar[int] = 0xFC00

    @property
    def fix(self) -> Optional[Fix]:
        """UBX fixType; None if the code is reserved"""
        return self._code(Fix, self.FIX)

    @property
    def position_valid(self) -> bool:
        """latitude and longitude are valid"""
        return bool(self & self.POSITION_VALID)

    @property
    def attitude_valid(self) -> bool:
        """pitch, yaw and roll are valid"""
        return bool(self & self.ATTITUDE_VALID)

    @property
    def acceleration_valid(self) -> bool:
        """the accelerations are valid"""
        return bool(self & self.ACCELERATION_VALID)

    @property
    def heard(self) -> bool:
        """heard in the last 250 ms"""
        return bool(self & self.HEARD)

    @property
    def stale(self) -> bool:
        """the solution is older than its period allows"""
        return bool(self & self.STALE)

    @property
    def excluded(self) -> bool:
        """the voter excluded this receiver"""
        return bool(self & self.EXCLUDED)

    @property
    def age(self) -> Optional[int]:
        """age of its solution, ms; None if there never was one"""
        return self._age(self.AGE, AGE_STEP_MS, AGE_NEVER)


class LinkBits(Word):
    """Status of Link-Status."""

    USED: ClassVar[int] = 0xF7FF
    UP: ClassVar[int] = 0x0001
    ALL_ACCEPTED: ClassVar[int] = 0x0002
    HORUS_FROZEN: ClassVar[int] = 0x0004
    HORUS_RESTARTED: ClassVar[int] = 0x0008
    RAM_FAULT: ClassVar[int] = 0x0010
    FRONT_END_FAULT: ClassVar[int] = 0x0020
    UNASKED_RESET: ClassVar[int] = 0x0040
    UPLINK_REJECTED: ClassVar[int] = 0x0080
    OUT_OF_SEQUENCE: ClassVar[int] = 0x0100
    CLOCK_IMPLAUSIBLE: ClassVar[int] = 0x0200
    FLASH_FAULT: ClassVar[int] = 0x0400
    RESET: ClassVar[int] = 0x7000
    NO_FIELD: ClassVar[int] = 0x8000

    @property
    def up(self) -> bool:
        """frames arrive within their deadline"""
        return bool(self & self.UP)

    @property
    def all_accepted(self) -> bool:
        """every object of the last cycle was accepted"""
        return bool(self & self.ALL_ACCEPTED)

    @property
    def horus_frozen(self) -> bool:
        """HORUS repeats its timestamp"""
        return bool(self & self.HORUS_FROZEN)

    @property
    def horus_restarted(self) -> bool:
        """HORUS started again"""
        return bool(self & self.HORUS_RESTARTED)

    @property
    def ram_fault(self) -> bool:
        """a scrub found a RAM fault"""
        return bool(self & self.RAM_FAULT)

    @property
    def front_end_fault(self) -> bool:
        """the RFID front end has a fault"""
        return bool(self & self.FRONT_END_FAULT)

    @property
    def unasked_reset(self) -> bool:
        """nobody asked for the DPR's last reset"""
        return bool(self & self.UNASKED_RESET)

    @property
    def uplink_rejected(self) -> bool:
        """the last uplink was rejected"""
        return bool(self & self.UPLINK_REJECTED)

    @property
    def out_of_sequence(self) -> bool:
        """nothing is shown until it is found again"""
        return bool(self & self.OUT_OF_SEQUENCE)

    @property
    def clock_implausible(self) -> bool:
        """HORUS's clock is off by > 2 %"""
        return bool(self & self.CLOCK_IMPLAUSIBLE)

    @property
    def flash_fault(self) -> bool:
        """the DPR's program memory is damaged"""
        return bool(self & self.FLASH_FAULT)

    @property
    def reset(self) -> Optional[Reset]:
        """why the DPR last started; None if the code is reserved"""
        return self._code(Reset, self.RESET)

    @property
    def no_field(self) -> bool:
        """the front end works and senses no field of the sender"""
        return bool(self & self.NO_FIELD)


class PortBits(Word):
    """Status of Port-Status."""

    USED: ClassVar[int] = 0xFFFF
    BASE_STATION_FRESH: ClassVar[int] = 0x0001
    FLIGHT_CONTROLLER_FRESH: ClassVar[int] = 0x0002
    LAST_REFUSED: ClassVar[int] = 0x0004
    SELF_TEST_RUNNING: ClassVar[int] = 0x0008
    SELF_TEST_PASSED: ClassVar[int] = 0x0010
    SELF_TEST_FAILED: ClassVar[int] = 0x0020
    BUFFERS_OUT_OF_USE: ClassVar[int] = 0x0040
    HOLD_HEARD: ClassVar[int] = 0x0080
    HOLD_ACCEPTED: ClassVar[int] = 0x0100
    HOLD_ACCEPTED_COUNT: ClassVar[int] = 0x1E00
    HOLD_REJECTED_COUNT: ClassVar[int] = 0xE000

    @property
    def base_station_fresh(self) -> bool:
        """its uplink is shown"""
        return bool(self & self.BASE_STATION_FRESH)

    @property
    def flight_controller_fresh(self) -> bool:
        """its uplink is shown"""
        return bool(self & self.FLIGHT_CONTROLLER_FRESH)

    @property
    def last_refused(self) -> bool:
        """the last uplink or command was refused"""
        return bool(self & self.LAST_REFUSED)

    @property
    def self_test_running(self) -> bool:
        """a self-test is under way"""
        return bool(self & self.SELF_TEST_RUNNING)

    @property
    def self_test_passed(self) -> bool:
        """the last one found nothing"""
        return bool(self & self.SELF_TEST_PASSED)

    @property
    def self_test_failed(self) -> bool:
        """the last one found a fault"""
        return bool(self & self.SELF_TEST_FAILED)

    @property
    def buffers_out_of_use(self) -> bool:
        """a buffer or image is out of use"""
        return bool(self & self.BUFFERS_OUT_OF_USE)

    @property
    def hold_heard(self) -> bool:
        """a frame of the hold came in the last 300 ms"""
        return bool(self & self.HOLD_HEARD)

    @property
    def hold_accepted(self) -> bool:
        """the last one was accepted"""
        return bool(self & self.HOLD_ACCEPTED)

    @property
    def hold_accepted_count(self) -> int:
        """objects of the hold accepted, mod 16"""
        return (self & self.HOLD_ACCEPTED_COUNT) >> 9

    @property
    def hold_rejected_count(self) -> int:
        """frames of the hold rejected, mod 8"""
        return (self & self.HOLD_REJECTED_COUNT) >> 13


class HoldStatusBits(Word):
    """Status of Hold-Status."""

    USED: ClassVar[int] = 0x01FF
    VALUES_VALID: ClassVar[int] = 0x0001
    WITHIN_LIMITS: ClassVar[int] = 0x0002
    LOCKED: ClassVar[int] = 0x0004
    SENSOR_FAULT: ClassVar[int] = 0x0008
    MEMORY_FAULT: ClassVar[int] = 0x0010
    SAFE_STATE: ClassVar[int] = 0x0020
    RESET: ClassVar[int] = 0x01C0

    @property
    def values_valid(self) -> bool:
        """the values are valid"""
        return bool(self & self.VALUES_VALID)

    @property
    def within_limits(self) -> bool:
        """the values are within the hold's limits"""
        return bool(self & self.WITHIN_LIMITS)

    @property
    def locked(self) -> bool:
        """locked"""
        return bool(self & self.LOCKED)

    @property
    def sensor_fault(self) -> bool:
        """a sensor has a fault"""
        return bool(self & self.SENSOR_FAULT)

    @property
    def memory_fault(self) -> bool:
        """the hold has found a fault of its memory"""
        return bool(self & self.MEMORY_FAULT)

    @property
    def safe_state(self) -> bool:
        """the output is off, the lock stays as it is"""
        return bool(self & self.SAFE_STATE)

    @property
    def reset(self) -> Optional[Reset]:
        """why the hold last started; None if the code is reserved"""
        return self._code(Reset, self.RESET)


@dataclass(frozen=True)
class LinkStatus(Object):
    """Link-Status, 32 bytes."""

    SIZE: ClassVar[int] = 32
    IDENTIFIERS: ClassVar[Tuple[int, ...]] = (0x4400,)
    BITS: ClassVar[Optional[Type[Word]]] = LinkBits
    FIELDS: ClassVar[Tuple[Field, ...]] = (
        Field("timestamp", "<u4", 1, "ms"),
        Field("identifier", "<u2", 1, ""),
        Field("status", "<u2", 1, ""),
        Field("objects_accepted", "<u4", 1, ""),
        Field("objects_rejected", "<u4", 1, ""),
        Field("frames_received", "<u4", 1, ""),
        Field("frames_missed", "<u4", 1, ""),
        Field("age_100us", "<u2", 1, "100 us"),
        Field("access_violations", "<u2", 1, ""),
        Field("crc", ">u4", 1, ""),
    )
    CRCS: ClassVar[Tuple[Tuple[str, Crc, int, int], ...]] = (
        ("crc", FRAME, 0, 28),
    )

    timestamp: int  #: ms since DPR start
    identifier: int
    status: LinkBits
    objects_accepted: int  #: objects accepted
    objects_rejected: int  #: objects rejected
    frames_received: int  #: frames received
    frames_missed: int  #: frames missed
    age_100us: int  #: age of Reported-Position, 100 us
    access_violations: int  #: accesses refused
    crc: int  #: over all before


@dataclass(frozen=True)
class ReportedPosition(Object):
    """Reported-Position, 64 bytes."""

    SIZE: ClassVar[int] = 64
    IDENTIFIERS: ClassVar[Tuple[int, ...]] = (0x4800,)
    BITS: ClassVar[Optional[Type[Word]]] = ReportedBits
    FIELDS: ClassVar[Tuple[Field, ...]] = (
        Field("timestamp", "<u4", 1, "ms"),
        Field("identifier", "<u2", 1, ""),
        Field("status", "<u2", 1, ""),
        Field("latitude", "<f8", 1, "degrees"),
        Field("longitude", "<f8", 1, "degrees"),
        Field("position_crc", ">u4", 1, ""),
        Field("altitude", "<f8", 1, "m"),
        Field("pitch", "<f4", 1, "rad"),
        Field("yaw", "<f4", 1, "rad"),
        Field("roll", "<f4", 1, "rad"),
        Field("acceleration", "<f4", 3, "m/s2"),
        Field("crc", ">u4", 1, ""),
    )
    CRCS: ClassVar[Tuple[Tuple[str, Crc, int, int], ...]] = (
        ("position_crc", POSITION, 8, 24),
        ("crc", FRAME, 0, 60),
    )

    timestamp: int  #: ms since HORUS start
    identifier: int
    status: ReportedBits
    latitude: float  #: degrees
    longitude: float  #: degrees
    position_crc: int  #: over latitude and longitude
    altitude: float  #: m
    pitch: float  #: rad
    yaw: float  #: rad
    roll: float  #: rad
    acceleration: Tuple[float, float, float]  #: m/s2
    crc: int  #: over all before


@dataclass(frozen=True)
class Gps(Object):
    """GPS1 to GPS5, 60 bytes."""

    SIZE: ClassVar[int] = 60
    IDENTIFIERS: ClassVar[Tuple[int, ...]] = (0x4801, 0x4802, 0x4803, 0x4804, 0x4805)
    BITS: ClassVar[Optional[Type[Word]]] = GpsBits
    FIELDS: ClassVar[Tuple[Field, ...]] = (
        Field("timestamp", "<u4", 1, "ms"),
        Field("identifier", "<u2", 1, ""),
        Field("status", "<u2", 1, ""),
        Field("latitude", "<f8", 1, "degrees"),
        Field("longitude", "<f8", 1, "degrees"),
        Field("altitude", "<f8", 1, "m"),
        Field("pitch", "<f4", 1, "rad"),
        Field("yaw", "<f4", 1, "rad"),
        Field("roll", "<f4", 1, "rad"),
        Field("acceleration", "<f4", 3, "m/s2"),
        Field("crc", ">u4", 1, ""),
    )
    CRCS: ClassVar[Tuple[Tuple[str, Crc, int, int], ...]] = (
        ("crc", FRAME, 0, 56),
    )

    timestamp: int  #: ms since HORUS start
    identifier: int
    status: GpsBits
    latitude: float  #: degrees
    longitude: float  #: degrees
    altitude: float  #: m
    pitch: float  #: rad
    yaw: float  #: rad
    roll: float  #: rad
    acceleration: Tuple[float, float, float]  #: m/s2
    crc: int  #: over all before


@dataclass(frozen=True)
class PortStatus(Object):
    """Port-Status, 64 bytes."""

    SIZE: ClassVar[int] = 64
    IDENTIFIERS: ClassVar[Tuple[int, ...]] = (0x4401,)
    BITS: ClassVar[Optional[Type[Word]]] = PortBits
    FIELDS: ClassVar[Tuple[Field, ...]] = (
        Field("timestamp", "<u4", 1, "ms"),
        Field("identifier", "<u2", 1, ""),
        Field("status", "<u2", 1, ""),
        Field("uplinks_accepted", "<u4", 1, ""),
        Field("commands_carried_out", "<u4", 1, ""),
        Field("last_command_timestamp", "<u4", 1, "ms"),
        Field("last_command", "<u4", 1, ""),
        Field("base_station_age_ms", "<u2", 1, "ms"),
        Field("flight_controller_age_ms", "<u2", 1, "ms"),
        Field("violations", "<u2", 10, ""),
        Field("integrity_faults", "<u2", 1, ""),
        Field("flash_passes", "<u2", 1, ""),
        Field("stuck_bits", "<u2", 1, ""),
        Field("buffers_out_of_use", "<u2", 1, ""),
        Field("last_stop", "<u4", 1, ""),
        Field("crc", ">u4", 1, ""),
    )
    CRCS: ClassVar[Tuple[Tuple[str, Crc, int, int], ...]] = (
        ("crc", FRAME, 0, 60),
    )

    timestamp: int  #: ms since DPR start
    identifier: int
    status: PortBits
    uplinks_accepted: int  #: uplinks stored
    commands_carried_out: int  #: commands carried out
    last_command_timestamp: int  #: ms, timestamp of the last command
    last_command: int  #: its word
    base_station_age_ms: int  #: ms since the base station's uplink
    flight_controller_age_ms: int  #: ms since the flight controller's uplink
    violations: Tuple[int, ...]
    integrity_faults: int  #: faults found in images
    flash_passes: int  #: passes over the flash
    stuck_bits: int  #: stuck bits found
    buffers_out_of_use: int  #: buffers out of use
    last_stop: int  #: reason of the last safe state
    crc: int  #: over all before


@dataclass(frozen=True)
class Uplink(Object):
    """Uplink, 64 bytes."""

    SIZE: ClassVar[int] = 64
    IDENTIFIERS: ClassVar[Tuple[int, ...]] = (0x4200, 0x4300)
    FIELDS: ClassVar[Tuple[Field, ...]] = (
        Field("timestamp", "<u4", 1, "ms"),
        Field("identifier", "<u2", 1, ""),
        Field("status", "<u2", 1, ""),
        Field("payload", "u1", 52, ""),
        Field("crc", ">u4", 1, ""),
    )
    CRCS: ClassVar[Tuple[Tuple[str, Crc, int, int], ...]] = (
        ("crc", FRAME, 0, 60),
    )

    timestamp: int  #: ms on the writer's clock
    identifier: int
    status: int  #: as writer and reader agree
    payload: bytes  #: the writer's
    crc: int  #: over all before


@dataclass(frozen=True)
class CommandObject(Object):
    """Command, 64 bytes."""

    SIZE: ClassVar[int] = 64
    IDENTIFIERS: ClassVar[Tuple[int, ...]] = (0x4301,)
    FIELDS: ClassVar[Tuple[Field, ...]] = (
        Field("timestamp", "<u4", 1, "ms"),
        Field("identifier", "<u2", 1, ""),
        Field("status", "<u2", 1, ""),
        Field("word", "<u4", 1, ""),
        Field("reserved", "u1", 48, ""),
        Field("crc", ">u4", 1, ""),
    )
    CRCS: ClassVar[Tuple[Tuple[str, Crc, int, int], ...]] = (
        ("crc", FRAME, 0, 60),
    )

    timestamp: int  #: ms on the flight controller's clock
    identifier: int
    status: int  #: not evaluated
    word: int
    reserved: bytes  #: zero
    crc: int  #: over all before


@dataclass(frozen=True)
class HoldStatus(Object):
    """Hold-Status, 64 bytes."""

    SIZE: ClassVar[int] = 64
    IDENTIFIERS: ClassVar[Tuple[int, ...]] = (0x4100,)
    BITS: ClassVar[Optional[Type[Word]]] = HoldStatusBits
    FIELDS: ClassVar[Tuple[Field, ...]] = (
        Field("timestamp", "<u4", 1, "ms"),
        Field("identifier", "<u2", 1, ""),
        Field("status", "<u2", 1, ""),
        Field("temperature", "<f4", 1, "degrees Celsius"),
        Field("humidity", "<f4", 1, "%"),
        Field("set_point", "<f4", 1, "degrees Celsius"),
        Field("vibration", "<f4", 3, "m/s2"),
        Field("greatest_shock", "<f4", 1, "m/s2"),
        Field("supply", "<f4", 1, "V"),
        Field("output", "<f4", 1, ""),
        Field("acknowledged", "<u2", 4, ""),
        Field("seconds", "<u4", 1, "s"),
        Field("reserved", "u1", 4, ""),
        Field("crc", ">u4", 1, ""),
    )
    CRCS: ClassVar[Tuple[Tuple[str, Crc, int, int], ...]] = (
        ("crc", FRAME, 0, 60),
    )

    timestamp: int  #: ms since the hold's start
    identifier: int
    status: HoldStatusBits
    temperature: float  #: degrees Celsius
    humidity: float  #: relative, %
    set_point: float  #: degrees Celsius
    vibration: Tuple[float, float, float]  #: m/s2, RMS over the last second
    greatest_shock: float  #: m/s2, since the start or since it was cleared
    supply: float  #: V
    output: float  #: -1 (cooling) to 1 (heating)
    acknowledged: Tuple[int, int, int, int]  #: u16 number, u16 outcome: base station's, own
    seconds: int  #: s since the hold's start
    reserved: bytes  #: zero
    crc: int  #: over all before

#: The map for each number of receivers.
MAPS: Dict[int, MapLayout] = {
    1: MapLayout(
        124,
        156,
        348,
        (
            Place(LinkStatus, Identifier.LINK_STATUS, 0),
            Place(ReportedPosition, Identifier.REPORTED_POSITION, 32),
            Place(Gps, Identifier.GPS1, 96),
            Place(PortStatus, Identifier.PORT_STATUS, 156),
            Place(Uplink, Identifier.UPLINK_BASE_STATION, 220),
            Place(Uplink, Identifier.UPLINK_FLIGHT_CONTROLLER, 284),
        ),
    ),
    2: MapLayout(
        184,
        216,
        408,
        (
            Place(LinkStatus, Identifier.LINK_STATUS, 0),
            Place(ReportedPosition, Identifier.REPORTED_POSITION, 32),
            Place(Gps, Identifier.GPS1, 96),
            Place(Gps, Identifier.GPS2, 156),
            Place(PortStatus, Identifier.PORT_STATUS, 216),
            Place(Uplink, Identifier.UPLINK_BASE_STATION, 280),
            Place(Uplink, Identifier.UPLINK_FLIGHT_CONTROLLER, 344),
        ),
    ),
    3: MapLayout(
        244,
        276,
        468,
        (
            Place(LinkStatus, Identifier.LINK_STATUS, 0),
            Place(ReportedPosition, Identifier.REPORTED_POSITION, 32),
            Place(Gps, Identifier.GPS1, 96),
            Place(Gps, Identifier.GPS2, 156),
            Place(Gps, Identifier.GPS3, 216),
            Place(PortStatus, Identifier.PORT_STATUS, 276),
            Place(Uplink, Identifier.UPLINK_BASE_STATION, 340),
            Place(Uplink, Identifier.UPLINK_FLIGHT_CONTROLLER, 404),
        ),
    ),
    5: MapLayout(
        364,
        396,
        588,
        (
            Place(LinkStatus, Identifier.LINK_STATUS, 0),
            Place(ReportedPosition, Identifier.REPORTED_POSITION, 32),
            Place(Gps, Identifier.GPS1, 96),
            Place(Gps, Identifier.GPS2, 156),
            Place(Gps, Identifier.GPS3, 216),
            Place(Gps, Identifier.GPS4, 276),
            Place(Gps, Identifier.GPS5, 336),
            Place(PortStatus, Identifier.PORT_STATUS, 396),
            Place(Uplink, Identifier.UPLINK_BASE_STATION, 460),
            Place(Uplink, Identifier.UPLINK_FLIGHT_CONTROLLER, 524),
        ),
    ),
}

#: The same where the DPR has an active hold.
MAPS_WITH_HOLD: Dict[int, MapLayout] = {
    1: MapLayout(
        124,
        156,
        412,
        (
            Place(LinkStatus, Identifier.LINK_STATUS, 0),
            Place(ReportedPosition, Identifier.REPORTED_POSITION, 32),
            Place(Gps, Identifier.GPS1, 96),
            Place(PortStatus, Identifier.PORT_STATUS, 156),
            Place(Uplink, Identifier.UPLINK_BASE_STATION, 220),
            Place(Uplink, Identifier.UPLINK_FLIGHT_CONTROLLER, 284),
            Place(HoldStatus, Identifier.HOLD_STATUS, 348),
        ),
    ),
    2: MapLayout(
        184,
        216,
        472,
        (
            Place(LinkStatus, Identifier.LINK_STATUS, 0),
            Place(ReportedPosition, Identifier.REPORTED_POSITION, 32),
            Place(Gps, Identifier.GPS1, 96),
            Place(Gps, Identifier.GPS2, 156),
            Place(PortStatus, Identifier.PORT_STATUS, 216),
            Place(Uplink, Identifier.UPLINK_BASE_STATION, 280),
            Place(Uplink, Identifier.UPLINK_FLIGHT_CONTROLLER, 344),
            Place(HoldStatus, Identifier.HOLD_STATUS, 408),
        ),
    ),
    3: MapLayout(
        244,
        276,
        532,
        (
            Place(LinkStatus, Identifier.LINK_STATUS, 0),
            Place(ReportedPosition, Identifier.REPORTED_POSITION, 32),
            Place(Gps, Identifier.GPS1, 96),
            Place(Gps, Identifier.GPS2, 156),
            Place(Gps, Identifier.GPS3, 216),
            Place(PortStatus, Identifier.PORT_STATUS, 276),
            Place(Uplink, Identifier.UPLINK_BASE_STATION, 340),
            Place(Uplink, Identifier.UPLINK_FLIGHT_CONTROLLER, 404),
            Place(HoldStatus, Identifier.HOLD_STATUS, 468),
        ),
    ),
    5: MapLayout(
        364,
        396,
        652,
        (
            Place(LinkStatus, Identifier.LINK_STATUS, 0),
            Place(ReportedPosition, Identifier.REPORTED_POSITION, 32),
            Place(Gps, Identifier.GPS1, 96),
            Place(Gps, Identifier.GPS2, 156),
            Place(Gps, Identifier.GPS3, 216),
            Place(Gps, Identifier.GPS4, 276),
            Place(Gps, Identifier.GPS5, 336),
            Place(PortStatus, Identifier.PORT_STATUS, 396),
            Place(Uplink, Identifier.UPLINK_BASE_STATION, 460),
            Place(Uplink, Identifier.UPLINK_FLIGHT_CONTROLLER, 524),
            Place(HoldStatus, Identifier.HOLD_STATUS, 588),
        ),
    ),
}
