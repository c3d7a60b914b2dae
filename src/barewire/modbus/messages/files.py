"""File records, the extended memory of older devices: function codes 14 (read) and 15 (write).

A file has 10000 records of one register each, 0 to 9999 (270Fh). One message has several groups of records, and each
group begins with the reference type 06.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import index
from typing import Any, ClassVar, NamedTuple, Self

from barewire.codecs import Field, Layout, from_registers, to_registers
from barewire.errors import DecodeError, EncodeError
from barewire.modbus.exceptions import ILLEGAL_DATA_ADDRESS, ILLEGAL_DATA_VALUE
from barewire.modbus.messages.base import (
    Message,
    R,
    Request,
    Response,
    check_groups,
    check_list,
    check_range,
    check_registers,
)
from barewire.modbus.messages.registers import register_rows

_REFERENCE_TYPE = 6
RECORD_LIMIT = 0x270F
_READ_LIMIT = 0xF5  # bytes of the longest request: 35 places of 7 bytes each
_BYTES_LIMIT = 0xFB  # bytes of the longest list of records: 253 - 2; figure 25 of the standard has F5h, its table FBh

_PLACE = Layout(">BHHH", "reference_type", "file", "record", "length")


class RecordPlace(NamedTuple):
    """A group to read: `length` registers of a file, from `record` on."""

    file: int
    record: int
    length: int


class FileRecord(NamedTuple):
    """A group to write: these registers into a file, from `record` on."""

    file: int
    record: int
    registers: tuple[int, ...]


def _check_place(file: int, record: int, length: int) -> None:
    check_range("file", file, 1, 0xFFFF)
    check_range("record", record, 0, RECORD_LIMIT)
    check_range("length", length, 1, _BYTES_LIMIT // 2)


def _group_error(pdu: bytes, at: int, file: int, record: int, length: int) -> DecodeError | None:
    """Return the error of the group at this offset, or None if it is valid."""
    if pdu[at] != _REFERENCE_TYPE:
        return DecodeError("value", pdu, at, f"reference type {pdu[at]}: expected {_REFERENCE_TYPE}")
    try:
        _check_place(file, record, length)
    except EncodeError as error:
        offset = {"file": 1, "record": 3}.get(error.field or "", 5)
        return DecodeError("value", pdu, at + offset, str(error))
    return None


class _FileRequest(Request[R]):
    __slots__ = ()

    @classmethod
    def declines(cls, error: DecodeError) -> int:
        """Return 02 for an invalid reference type, file or record, and 03 otherwise.      [MB-APP figures 24, 25]"""
        return ILLEGAL_DATA_ADDRESS if error.reason == "value" and error.at > 1 else ILLEGAL_DATA_VALUE


@dataclass(frozen=True, slots=True)
class ReadFileRecordResponse(Response):
    """The registers of each group, in the order of the request.                           [MB-APP 6.14]

        14 | byte count | for each group:  length (of what follows) | 06 | registers ...

    >>> ReadFileRecordResponse(((3582, 32), (13261, 64))).encode().hex(" ")
    '14 0c 05 06 0d fe 00 20 05 06 33 cd 00 40'
    """

    records: tuple[tuple[int, ...], ...]

    name: ClassVar[str] = "Read File Record"
    function_code: ClassVar[int] = 0x14
    layout: ClassVar[Layout] = Layout(">BB", "function_code", "byte_count", tail="records", count="byte_count")

    def __post_init__(self) -> None:
        check_list("records", self.records, "lists of registers")
        for registers in self.records:
            check_registers(registers)
        object.__setattr__(self, "records", tuple(map(tuple, self.records)))
        check_range("byte_count", sum(2 + 2 * len(registers) for registers in self.records), 4, _BYTES_LIMIT)
        for registers in self.records:
            check_range("length", len(registers), 1, _BYTES_LIMIT // 2)

    def encode(self) -> bytes:
        groups = map(from_registers, self.records)
        data = b"".join(bytes([1 + len(group), _REFERENCE_TYPE]) + group for group in groups)
        return self.layout.pack(self.function_code, len(data), tail=data)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU group by group. The last group ends with the PDU."""
        cls.check_function(pdu)
        cls.layout.unpack(pdu)
        records, at = [], cls.layout.size
        while at < len(pdu):
            size = pdu[at]
            if size < 3 or not size % 2:
                raise DecodeError("length", pdu, at, f"length {size}: expected 06 and whole registers, 3, 5, 7 ...")
            if at + 1 + size > len(pdu):
                raise DecodeError("short", pdu, at, f"a group of {size} bytes, but {len(pdu) - at - 1} follow")
            if pdu[at + 1] != _REFERENCE_TYPE:
                raise DecodeError("value", pdu, at + 1, f"reference type {pdu[at + 1]}: expected {_REFERENCE_TYPE}")
            records.append(to_registers(pdu[at + 2 : at + 1 + size]))
            at += 1 + size
        return cls.make(pdu, tuple(records))

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields of each group."""
        fields, at = cls.layout.fields(pdu)[:2], cls.layout.size
        while at < len(pdu):
            end = min(len(pdu), at + 1 + pdu[at])
            fields.append(Field(at, 1, "length", pdu[at], "bytes in this group"))
            fields += [Field(at + 1, 1, "reference_type", pdu[at + 1]) for _ in pdu[at + 1 : min(end, at + 2)]]
            fields += register_rows(pdu[at + 2 : end], at + 2)
            at = end
        return fields


@dataclass(frozen=True, slots=True)
class ReadFileRecord(_FileRequest[ReadFileRecordResponse]):
    """Read groups of records, each `(file, record, length)`.                              [MB-APP 6.14]

        14 | byte count | for each group:  06 | file 2 | record 2 | length 2, in registers

    >>> ReadFileRecord(((4, 1, 2), (3, 9, 2))).encode().hex(" ")
    '14 0e 06 00 04 00 01 00 02 06 00 03 00 09 00 02'
    """

    places: Sequence[tuple[int, int, int]]

    name: ClassVar[str] = "Read File Record"
    function_code: ClassVar[int] = 0x14
    layout: ClassVar[Layout] = Layout(">BB", "function_code", "byte_count", tail="places", count="byte_count")
    response: ClassVar[type[Response]] = ReadFileRecordResponse

    def __post_init__(self) -> None:
        places = check_groups("places", self.places, 3, "(file, record, length)")
        object.__setattr__(self, "places", tuple(RecordPlace(*place) for place in places))
        check_range("byte_count", _PLACE.size * len(self.places), _PLACE.size, _READ_LIMIT)
        for place in self.places:
            _check_place(*place)
        answered = sum(2 + 2 * length for _, _, length in self.places)
        if answered > _BYTES_LIMIT:
            raise EncodeError(f"the answer would have {2 + answered} bytes: more than the 253 of a PDU", "byte_count")

    def encode(self) -> bytes:
        data = b"".join(_PLACE.pack(_REFERENCE_TYPE, *place) for place in self.places)
        return self.layout.pack(self.function_code, len(data), tail=data)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        cls.check_function(pdu)
        _, byte_count, data = cls.layout.unpack(pdu)
        if byte_count % _PLACE.size:
            raise DecodeError("length", pdu, 1, f"byte count {byte_count}: expected groups of {_PLACE.size} bytes")
        places: list[RecordPlace] = []
        for start in range(0, byte_count, _PLACE.size):
            place = RecordPlace(*_PLACE.unpack(data[start : start + _PLACE.size])[1:])
            if error := _group_error(pdu, cls.layout.size + start, *place):
                raise error
            places.append(place)
        return cls.make(pdu, tuple(places))

    def fit(self, response: Any, pdu: bytes) -> Any:
        """Check that the response has as many groups as the request, each of the length asked for."""
        asked, answered = [length for _, _, length in self.places], list(map(len, response.records))
        if asked != answered:
            self.refuse(pdu, "byte_count", asked, answered)
        return response

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields of each group."""
        fields = cls.layout.fields(pdu)[:2]
        for start in range(cls.layout.size, len(pdu), _PLACE.size):
            fields += _PLACE.fields(pdu[start : start + _PLACE.size], start)
        return fields


def _records(records: Any) -> tuple[FileRecord, ...]:
    """Return the groups as `FileRecord`, after checking each."""
    groups = check_groups("records", records, 3, "(file, record, registers)")
    for _, _, registers in groups:
        check_registers(registers)
        from_registers(registers)  # raises EncodeError for a value outside 0..65535
    checked = tuple(FileRecord(file, record, tuple(map(index, registers))) for file, record, registers in groups)
    for group in checked:
        _check_place(group.file, group.record, len(group.registers))
    check_range("byte_count", sum(_PLACE.size + 2 * len(group.registers) for group in checked), 9, _BYTES_LIMIT)
    return checked


@dataclass(frozen=True, slots=True)
class _WrittenRecords(Message):
    """What request and response of Write File Record have in common: all of it."""

    records: Sequence[tuple[int, int, Sequence[int]]]

    name: ClassVar[str] = "Write File Record"
    function_code: ClassVar[int] = 0x15
    layout: ClassVar[Layout] = Layout(">BB", "function_code", "byte_count", tail="records", count="byte_count")

    def __post_init__(self) -> None:
        object.__setattr__(self, "records", _records(self.records))

    def encode(self) -> bytes:
        data = b"".join(
            _PLACE.pack(_REFERENCE_TYPE, file, record, len(registers), tail=from_registers(registers))
            for file, record, registers in self.records
        )
        return self.layout.pack(self.function_code, len(data), tail=data)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU group by group. The last group ends with the PDU."""
        cls.check_function(pdu)
        cls.layout.unpack(pdu)
        records, at = [], cls.layout.size
        while at < len(pdu):
            if at + _PLACE.size > len(pdu):
                raise DecodeError("short", pdu, at, f"a group begins here, but only {len(pdu) - at} bytes follow")
            _, file, record, length = _PLACE.unpack(pdu[at : at + _PLACE.size])
            if error := _group_error(pdu, at, file, record, length):
                raise error
            start = at + _PLACE.size
            at = start + 2 * length
            if at > len(pdu):
                raise DecodeError("short", pdu, start, f"{length} registers, but {len(pdu) - start} bytes follow")
            records.append(FileRecord(file, record, to_registers(pdu[start:at])))
        return cls.make(pdu, tuple(records))

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields of each group, with each register."""
        fields, at = cls.layout.fields(pdu)[:2], cls.layout.size
        while at < len(pdu):
            head = _PLACE.fields(pdu[at : at + _PLACE.size], at)
            start = at + _PLACE.size
            length = int(str(head[3].value)) if len(head) > 3 else 0
            at = min(len(pdu), start + 2 * length)
            fields += [*head, *register_rows(pdu[start:at], start)]
        return fields


@dataclass(frozen=True, slots=True)
class WriteFileRecordResponse(_WrittenRecords, Response):
    """The request, repeated.                                                              [MB-APP 6.15]

    15 | byte count | for each group:  06 | file 2 | record 2 | length 2, in registers | registers ...
    """


@dataclass(frozen=True, slots=True)
class WriteFileRecord(_WrittenRecords, _FileRequest[WriteFileRecordResponse]):
    """Write groups of records, each `(file, record, registers)`.                          [MB-APP 6.15]

        15 | byte count | for each group:  06 | file 2 | record 2 | length 2, in registers | registers ...

    >>> WriteFileRecord(((4, 7, (1711, 1214, 4109)),)).encode().hex(" ")
    '15 0d 06 00 04 00 07 00 03 06 af 04 be 10 0d'
    """

    response: ClassVar[type[Response]] = WriteFileRecordResponse
    writes: ClassVar[bool] = True
