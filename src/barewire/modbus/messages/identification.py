"""Identification of a device: function codes 11 (Report Server ID) and 2B/0E (Read Device Identification)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from barewire.codecs import Field, Layout
from barewire.errors import DecodeError, EncodeError
from barewire.modbus.messages.base import Request, Response, check_bytes, check_groups, check_range, checked

MEI_DEVICE_IDENTIFICATION = 0x0E
OBJECT_LIMIT = 244
"""Bytes of the longest object: 253 - 7 of the header - 2 for its number and length [MB-APP 6.21]."""

BASIC, REGULAR, EXTENDED, INDIVIDUAL = 1, 2, 3, 4
SINGLE_ACCESS = 0x80
"""Set in the conformity level of a device that also supports `INDIVIDUAL`."""

READ_CODES = {BASIC: "basic", REGULAR: "regular", EXTENDED: "extended", INDIVIDUAL: "one object"}
MORE, NO_MORE = 0xFF, 0x00

OBJECT_NAMES = {
    0x00: "VendorName",
    0x01: "ProductCode",
    0x02: "MajorMinorRevision",
    0x03: "VendorUrl",
    0x04: "ProductName",
    0x05: "ModelName",
    0x06: "UserApplicationName",
}


def object_texts(objects: Mapping[int, bytes]) -> dict[str, str]:
    """Return identification objects as text, by name."""
    return {
        OBJECT_NAMES.get(number, f"object {number:02X}h"): value.decode("latin-1") for number, value in objects.items()
    }


@dataclass(frozen=True, slots=True)
class ReportServerIdResponse(Response):
    """Device-specific bytes, which include an ID and a run indicator (FF or 00).          [MB-APP 6.13]

        11 | byte count | data ...

    >>> ReportServerIdResponse(bytes.fromhex("0102000005000000")).encode().hex(" ")
    '11 08 01 02 00 00 05 00 00 00'
    """

    data: bytes

    name: ClassVar[str] = "Report Server ID"
    function_code: ClassVar[int] = 0x11
    layout: ClassVar[Layout] = Layout(">BB", "function_code", "byte_count", tail="data", count="byte_count")

    def __post_init__(self) -> None:
        object.__setattr__(self, "data", check_bytes("data", self.data))
        check_range("byte_count", len(self.data), 0, 251)

    def encode(self) -> bytes:
        return self.layout.pack(self.function_code, len(self.data), tail=self.data)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        cls.check_function(pdu)
        return cls.make(pdu, bytes(cls.layout.unpack(pdu)[-1]))


@dataclass(frozen=True, slots=True)
class ReportServerId(Request[ReportServerIdResponse]):
    """Read the ID and the run indicator of a device.                                      [MB-APP 6.13]

        11

    >>> ReportServerId().encode().hex(" ")
    '11'
    """

    name: ClassVar[str] = "Report Server ID"
    function_code: ClassVar[int] = 0x11
    layout: ClassVar[Layout] = Layout(">B", "function_code")
    response: ClassVar[type[Response]] = ReportServerIdResponse


@dataclass(frozen=True, slots=True)
class ReadDeviceIdentificationResponse(Response):
    """Identification objects, as many as fit; `more_follows` if there are others.         [MB-APP 6.21]

        2B | 0E | read code | conformity | more follows | next object | number of objects
           then for each object:  id | length | value ...

    >>> ReadDeviceIdentificationResponse(1, 1, ((0, b"TEM"), (1, b"AZ3"))).encode().hex(" ")
    '2b 0e 01 01 00 00 02 00 03 54 45 4d 01 03 41 5a 33'
    """

    read_code: int
    conformity: int
    objects: tuple[tuple[int, bytes], ...]
    more_follows: bool = False
    next_object: int = 0

    name: ClassVar[str] = "Read Device Identification"
    function_code: ClassVar[int] = 0x2B
    layout: ClassVar[Layout] = Layout(
        ">BBBBBBB",
        "function_code",
        "mei_type",
        "read_code",
        "conformity",
        "more_follows",
        "next_object",
        "number_of_objects",
        tail="objects",
    )

    def __post_init__(self) -> None:
        check_range("read_code", self.read_code, BASIC, INDIVIDUAL)
        check_range("conformity", self.conformity, 0, 0xFF)
        check_range("next_object", self.next_object, 0, 0xFF)
        groups = check_groups("objects", self.objects, 2, "(object_id, value)")
        objects = tuple((object_id, check_bytes("value", value)) for object_id, value in groups)
        object.__setattr__(self, "objects", objects)
        for object_id, value in objects:
            check_range("object_id", object_id, 0, 0xFF)
            if len(value) > OBJECT_LIMIT:
                text = f"object {object_id:02X}h has {len(value)} bytes: more than {OBJECT_LIMIT} never fit a PDU"
                raise EncodeError(text, "objects")

    def encode(self) -> bytes:
        """Encode the message. Raises EncodeError if the objects together do not fit a PDU."""
        more = MORE if self.more_follows else NO_MORE
        values = (self.read_code, self.conformity, more, self.next_object, len(self.objects))
        tail = b"".join(bytes([object_id, len(value)]) + value for object_id, value in self.objects)
        return checked(self.layout.pack(self.function_code, MEI_DEVICE_IDENTIFICATION, *values, tail=tail))

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU, which must end exactly with its last object."""
        cls.check_function(pdu)
        _, mei_type, read_code, conformity, more, next_object, number, _ = cls.layout.unpack(pdu)
        if mei_type != MEI_DEVICE_IDENTIFICATION:
            raise DecodeError("mismatch", pdu, 1, f"MEI type {mei_type:02X}h where 0Eh was expected")
        if more not in (MORE, NO_MORE):
            raise DecodeError("value", pdu, 4, f"more follows is {more:02X}h: expected FFh or 00h")
        objects: list[tuple[int, bytes]] = []
        at = cls.layout.size
        for _ in range(number):
            if at + 2 > len(pdu) or at + 2 + pdu[at + 1] > len(pdu):
                raise DecodeError("short", pdu, min(at, len(pdu)), f"object {len(objects)} of {number} is incomplete")
            objects.append((pdu[at], bytes(pdu[at + 2 : at + 2 + pdu[at + 1]])))
            at += 2 + pdu[at + 1]
        if at < len(pdu):
            raise DecodeError("long", pdu, at, f"{len(pdu) - at} bytes are left over after {number} objects")
        return cls.make(pdu, read_code, conformity, tuple(objects), more == MORE, next_object)

    @classmethod
    def measure(cls, pdu: bytes) -> int | None:
        """Return the length from the objects that have arrived: each one gives the offset of the next."""
        at = cls.layout.size
        if len(pdu) < at:
            return at
        for _ in range(pdu[6]):
            if len(pdu) < at + 2:
                return at + 2
            at += 2 + pdu[at + 1]
        return at

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields of each object, with the standard's names."""
        fields = [field for field in cls.layout.fields(pdu) if field.name != "objects"]
        at = cls.layout.size
        while at + 1 < len(pdu):
            value = pdu[at + 2 : at + 2 + pdu[at + 1]]
            title = OBJECT_NAMES.get(pdu[at], "private" if pdu[at] >= 0x80 else "reserved")
            fields.append(Field(at, 1, "object_id", pdu[at], title))
            fields.append(Field(at + 1, 1, "object_length", pdu[at + 1]))
            if value:
                fields.append(Field(at + 2, len(value), "object_value", value.decode("latin-1")))
            at += 2 + pdu[at + 1]
        return fields


@dataclass(frozen=True, slots=True)
class ReadDeviceIdentification(Request[ReadDeviceIdentificationResponse]):
    """Read the basic (01), regular (02) or extended (03) objects, or one of them (04).     [MB-APP 6.21]

        2B | 0E | read code | object id

    >>> ReadDeviceIdentification(read_code=1, object_id=0).encode().hex(" ")
    '2b 0e 01 00'
    """

    read_code: int = BASIC
    object_id: int = 0

    name: ClassVar[str] = "Read Device Identification"
    function_code: ClassVar[int] = 0x2B
    mei_type: ClassVar[int | None] = MEI_DEVICE_IDENTIFICATION
    layout: ClassVar[Layout] = Layout(">BBBB", "function_code", "mei_type", "read_code", "object_id")
    response: ClassVar[type[Response]] = ReadDeviceIdentificationResponse

    def __post_init__(self) -> None:
        check_range("read_code", self.read_code, BASIC, INDIVIDUAL)
        check_range("object_id", self.object_id, 0, 0xFF)

    def encode(self) -> bytes:
        return self.layout.pack(self.function_code, MEI_DEVICE_IDENTIFICATION, self.read_code, self.object_id)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        cls.check_function(pdu)
        _, mei_type, read_code, object_id = cls.layout.unpack(pdu)
        if mei_type != MEI_DEVICE_IDENTIFICATION:
            raise DecodeError("mismatch", pdu, 1, f"MEI type {mei_type:02X}h where 0Eh was expected")
        return cls.make(pdu, read_code, object_id)

    def fit(self, response: Any, pdu: bytes) -> Any:
        """Check that the response has the read code of the request."""
        if response.read_code != self.read_code:
            self.refuse(pdu, "read_code", self.read_code, response.read_code)
        return response

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with the codes in words."""
        fields = cls.layout.fields(pdu)
        if len(fields) > 2:
            fields[2] = fields[2]._replace(meaning=READ_CODES.get(pdu[2], "not defined"))
        return fields
