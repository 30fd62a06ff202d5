# SPDX-License-Identifier: MIT OR Apache-2.0
"""What all objects have in common: fields at fixed places, CRCs, identifiers."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, ClassVar, Dict, List, NamedTuple, Optional, Tuple, Type, TypeVar

_T = TypeVar("_T", bound="Object")
_E = TypeVar("_E", bound=IntEnum)

#: The code of a numpy type in the module `struct`.
_CODES = {"u1": "s", "<u2": "H", "<u4": "I", "<f4": "f", "<f8": "d", ">u4": "4s"}


class Rejection(IntEnum):
    """Why bytes were not accepted, with the numbers of `horus_dpr_result_t` in C.

    Where several reasons hold, it is the first in this order.
    """

    VACANT = 1  #: the place is vacant: every byte is 0x00 or 0xFF
    LENGTH = 2  #: it was not read, or not whole; there is no such object
    CRC = 3  #: damaged: the frame CRC does not match
    POSITION_CRC = 4  #: the frame CRC matches, that over latitude and longitude does not
    IDENTIFIER = 5  #: intact, but another object than the one that belongs here
    WINDOW = 6  #: a window that is empty or not in the map
    COMMAND = 7  #: a command that the DPR does not know, or whose reserved bytes are not zero


class Rejected(ValueError):
    """Bytes were not accepted, for the reason `why`."""

    def __init__(self, why: Rejection) -> None:
        super().__init__(why.name)
        self.why = why


class Crc:
    """A CRC-32, most significant bit first, stored most significant byte first."""

    def __init__(self, polynomial: int, *, init: int, xorout: int, check: int) -> None:
        self.init, self.xorout, self.check = init, xorout, check
        self._table = []
        for byte in range(256):
            register = byte << 24
            for _ in range(8):
                register = (register << 1) ^ (polynomial if register >> 31 else 0)
                register &= 0xFFFFFFFF
            self._table.append(register)

    def __call__(self, data: bytes) -> int:
        """The CRC of `data`."""
        register, table = self.init, self._table
        for byte in data:
            register = ((register << 8) & 0xFFFFFFFF) ^ table[(register >> 24) ^ byte]
        return register ^ self.xorout


class Word(int):
    """A status word; its bits and codes are properties."""

    USED: ClassVar[int] = 0xFFFF

    def _code(self, codes: Type[_E], mask: int) -> Optional[_E]:
        value = (self & mask) // (mask & -mask)
        try:
            return codes(value)
        except ValueError:
            return None

    def _age(self, mask: int, step: int, never: int) -> Optional[int]:
        steps = (self & mask) // (mask & -mask)
        return None if steps == never else steps * step


class Field(NamedTuple):
    """A field of an object."""

    name: str
    numpy: str  #: its type, or that of each of its elements, as numpy writes it
    elements: int  #: how many elements it has
    unit: str  #: empty if it has none


class Place(NamedTuple):
    """The place of an object in a map."""

    kind: Type[Object]
    identifier: int
    offset: int


class MapLayout(NamedTuple):
    """The layout for a number of receivers: lengths in bytes, and every place of the map."""

    profile_bytes: int
    image_bytes: int
    map_bytes: int
    places: Tuple[Place, ...]


@dataclass(frozen=True)
class Object:
    """An object, whose subclass has its fields. `raw` has its bytes, unchanged."""

    SIZE: ClassVar[int]
    IDENTIFIERS: ClassVar[Tuple[int, ...]]
    FIELDS: ClassVar[Tuple[Field, ...]]
    #: For each CRC: its field, and the first of the bytes that it covers and the one behind them, where it is.
    CRCS: ClassVar[Tuple[Tuple[str, Crc, int, int], ...]]
    BITS: ClassVar[Optional[Type[Word]]] = None

    raw: bytes = field(repr=False)

    @classmethod
    def decode(cls: Type[_T], data: bytes) -> _T:
        """The fields of `data`, which is not verified.

        Bits of the status word that have no meaning are dropped.
        """
        data = bytes(data)
        if len(data) != cls.SIZE:
            raise Rejected(Rejection.LENGTH)
        code = "<" + "".join(
            f"{item.elements if item.elements > 1 else ''}{_CODES[item.numpy]}" for item in cls.FIELDS
        )
        rest = list(struct.unpack(code, data))
        values: Dict[str, Any] = {}
        for item in cls.FIELDS:
            if item.elements > 1 and item.numpy != "u1":
                values[item.name], rest = tuple(rest[: item.elements]), rest[item.elements :]
                continue
            value = rest.pop(0)
            if item.numpy == ">u4":
                value = int.from_bytes(value, "big")
            values[item.name] = value
        if cls.BITS is not None:
            values["status"] = cls.BITS(values["status"] & cls.BITS.USED)
        return cls(raw=data, **values)

    @classmethod
    def verify(cls: Type[_T], data: bytes, identifier: Optional[int] = None) -> _T:
        """The object in `data`, if both CRCs and the identifier are right; else raises `Rejected`.

        Without `identifier`, any identifier of this kind of object is right.
        """
        data = bytes(data)
        if len(data) != cls.SIZE:
            raise Rejected(Rejection.LENGTH)
        right = cls.IDENTIFIERS if identifier is None else (identifier,)
        why = None
        if int.from_bytes(data[4:6], "little") not in right:
            why = Rejection.IDENTIFIER
        for name, crc, start, end in cls.CRCS:
            if crc(data[start:end]) != int.from_bytes(data[end : end + 4], "big"):
                found = Rejection.CRC if name == "crc" else Rejection.POSITION_CRC
                why = found if why is None else min(why, found)
        if why is not None and data in (bytes(cls.SIZE), b"\xff" * cls.SIZE):
            why = Rejection.VACANT
        if why is not None:
            raise Rejected(why)
        return cls.decode(data)

    @classmethod
    def judge(cls: Type[_T], data: bytes, identifier: Optional[int] = None) -> _T | Rejection:
        """The same as `verify`, with the reason of a rejection as the result."""
        try:
            return cls.verify(data, identifier)
        except Rejected as rejected:
            return rejected.why

    @classmethod
    def dtype(cls) -> List[Tuple[Any, ...]]:
        """The fields for `numpy.dtype`: `numpy.frombuffer(data, Gps.dtype())` decodes any number of them."""
        return [(item.name, item.numpy) if item.elements == 1 else (item.name, item.numpy, (item.elements,))
                for item in cls.FIELDS]
