"""Conformance cases of SDO with one request and one response: reads, writes, refusals.   [CiA 301 7.2.4]"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from barewire.canopen.conformance.frames import (
    HEARTBEAT,
    NOWHERE,
    READ_ONLY_CODES,
    Sdo,
    little,
    make_case,
    multiplexer,
    silence,
)
from barewire.canopen.conformance.model import SILENCE, Effect, NodeCase, NodeStep, Subject

# Each case is a row: name, title, steps, needs, reason.
# fmt: off

_CLAUSE = "CiA 301 7.2.4 SDO"
_NO_OBJECT, _NO_SUB = 0x0602_0000, 0x0609_0011
_LONG = (0x0607_0010, 0x0607_0012)
_SHORT = (0x0607_0010, 0x0607_0013)
_COMMAND = 0x0504_0001
_VALUE = (0x0609_0030, 0x0609_0031)


def expedited_cases(subject: Subject) -> Iterator[NodeCase]:
    """Yield the cases of this service for one device."""
    yield from _uploads(subject)
    yield from _nonsense(subject)
    yield from _downloads(subject)


def _uploads(subject: Subject) -> Iterator[NodeCase]:
    s = Sdo(subject.node)

    case = partial(make_case, subject, _CLAUSE, (s.responses,), effect="reads")
    for name, index, sub, size, title in (
        ("SDO-01", 0x1000, 0, 4, "device type"),
        ("SDO-02", 0x1001, 0, 1, "error register"),
        ("SDO-03", 0x1018, 0, 1, "entries of the identity"),
        ("SDO-04", 0x1018, 1, 4, "vendor-ID"),
    ):
        data = bytes.fromhex(little(subject.number(index, sub, size), size))
        response = s.response(f"4F{multiplexer(index, sub)}") if index == 0x1001 else s.value(index, sub, data)
        yield case(name, f"upload of {index:04X}h:{sub:02X}, {title}", NodeStep((s.upload(index, sub),), (response,)),
                   why="mandatory object")
    again = s.works
    yield case("SDO-05", "the same object five times in a row", *[again] * 5)
    yield case("SDO-06", "upload of an object that does not exist", s.refuse_read(NOWHERE, 0, _NO_OBJECT), again,
               why="06020000")
    yield case("SDO-07", "upload of a sub-index that a variable does not have", s.refuse_read(0x1000, 1, _NO_SUB),
               again, why="06090011")
    yield case("SDO-08", "upload of a sub-index that a record does not have", s.refuse_read(0x1018, 0xFE, _NO_SUB),
               needs=("1018h",), why="06090011")
    for name, sub, first in (("SDO-09", 1, 0x600), ("SDO-10", 2, 0x580)):
        value = (first + subject.node).to_bytes(4, "little")
        yield case(name, f"1200h:0{sub} is the default COB-ID", s.read(0x1200, sub, value), needs=(f"1200h:0{sub}",))
    for index in (0x1003, 0x1010, 0x1011, 0x1016, 0x1029):
        yield case(f"SDO-{11 + (0x1003, 0x1010, 0x1011, 0x1016, 0x1029).index(index)}", f"{index:04X}h:00 is one byte",
                   NodeStep((s.upload(index),), (s.response(f"4F{multiplexer(index, 0)}"),)), needs=(f"{index:04X}h",),
                   why="sub-index 0 of a record or an array is UNSIGNED8")


def _nonsense(subject: Subject) -> Iterator[NodeCase]:
    node = subject.node
    s = Sdo(node)
    works = s.works
    unknown = s.aborted(_COMMAND)

    case = partial(make_case, subject, _CLAUSE, (s.responses,), effect="reads")
    for name, command in (("SDO-20", "E0"), ("SDO-21", "FF")):
        yield case(name, f"undefined command {command}h", NodeStep((s.request(command + "0010 00"),), (unknown,)),
                   works, why="05040001; devices differ in the object that they name")
    for name, command, title in (
        ("SDO-22", "60", "the next segment of an upload"),
        ("SDO-23", "00", "a segment of a download"),
        ("SDO-24", "A2", "an acknowledgement of a block"),
        ("SDO-25", "C1", "the end of a block download"),
        ("SDO-26", "A3", "the start of a block upload"),
    ):
        step = NodeStep((s.request(command),), (s.any_abort, SILENCE))
        yield case(name, f"{title} without a transfer", step, works, why="an abort, or no answer")
    yield case("SDO-27", "an abort without a transfer is not answered", silence(s.abort), works,
               why="an abort is never answered with an abort")
    short = s.upload(0x1000)
    for name, bytes_ in (("SDO-28", 7), ("SDO-29", 4), ("SDO-30", 0)):
        accepted = (SILENCE, s.any_abort, s.any_value(0x1000)) if bytes_ >= 4 else (SILENCE, s.any_abort)
        cut = NodeStep((short[: 4 + 2 * bytes_],), accepted)
        yield case(name, f"an upload request of {bytes_} bytes has no lasting effect", cut, works,
                   why="SDO frames have 8 bytes; devices ignore, refuse or serve shorter ones")
    yield case("SDO-31", "a remote frame is not answered", silence(f"{0x600 + node:03X}#R8"), works)
    extended = f"{0x600 + node:08X}#{short[4:]}"
    yield case("SDO-32", "a frame of the same number with 29 bits is ignored", silence(extended), works,
               why="identifier and format together identify a frame")
    yield case("SDO-33", "a response is not taken for a request", silence(f"{0x580 + node:03X}#{short[4:]}"), works)
    yield case("SDO-34", "reserved bits in the command 43h are ignored",
               NodeStep((s.request("43 0010 00"),), (s.any_value(0x1000), s.refused(0x1000, 0, _COMMAND))), works,
               why="the guide of a drive prints this request; devices serve it or answer 05040001")
    yield case("SDO-35", "the reserved bytes of an upload request are ignored",
               NodeStep((s.request("40 0010 00 FF FF FF FF"),), (s.any_value(0x1000),)))


def _downloads(subject: Subject) -> Iterator[NodeCase]:
    s = Sdo(subject.node)
    before, kept = s.unchanged(0x1017)

    def case(
        name: str, title: str, *steps: NodeStep, needs: tuple[str, ...] = (), why: str = "", effect: Effect = "writes"
    ) -> NodeCase:
        steps = (before, *steps) if kept in steps else steps
        return make_case(subject, _CLAUSE, (s.responses,), name, title, *steps, effect=effect, needs=needs, why=why)

    for name, index, sub, size in (("SDO-40", 0x1000, 0, 4), ("SDO-41", 0x1001, 0, 1), ("SDO-42", 0x1018, 1, 4)):
        request = s.download(index, sub, subject.number(index, sub, size) ^ 1, size)
        refused = s.refused(index, sub, *READ_ONLY_CODES)
        yield case(name, f"download to {index:04X}h:{sub:02X}, which is read-only", NodeStep((request,), (refused,)),
                   needs=() if index != 0x1018 else ("1018h:01",), why="06010002 or 06010000")
    yield case("SDO-43", "download to an object that does not exist", s.refuse(NOWHERE, 0, 0, 2, _NO_OBJECT),
               why="06020000")
    yield case("SDO-44", "download to a sub-index that does not exist", s.refuse(0x1017, 1, 0, 2, _NO_SUB),
               needs=HEARTBEAT, why="06090011")
    read_back = s.read(0x1017, 0, b"\x10\x27")
    yield case("SDO-45", "download of two bytes to 1017h, and read back", s.write(0x1017, 0, 10_000, 2), read_back,
               needs=HEARTBEAT)
    yield case("SDO-46", "download with 22h, without a size: the low bytes are the value",
               NodeStep((s.request("22 1710 00 1027"),), (s.accepted(0x1017),)), read_back, needs=HEARTBEAT,
               why="the bytes that the object needs are taken")
    yield case("SDO-47", "four bytes to an object of two", s.refuse(0x1017, 0, 10_000, 4, *_LONG), kept,
               needs=HEARTBEAT, why="06070012 or 06070010, and nothing is changed")
    yield case("SDO-48", "one byte to an object of two", s.refuse(0x1017, 0, 16, 1, *_SHORT), kept, needs=HEARTBEAT,
               why="06070013 or 06070010, and nothing is changed")
    yield case("SDO-49", "a value out of range: 1019h may not be 1", s.refuse(0x1019, 0, 1, 1, *_VALUE),
               needs=("1019h",), why="06090030 or 06090031")
    yield case("SDO-50", "two downloads: the second value remains", s.write(0x1017, 0, 20_000, 2),
               s.write(0x1017, 0, 10_000, 2), read_back, needs=HEARTBEAT)
    yield case("SDO-51", "1010h:01 is not stored without its signature",
               s.refuse(0x1010, 1, 0x1234_5678, 4, 0x0800_0020, 0x0800_0022), needs=("1010h:01",),
               why="0800002x: only 'save' stores")
    yield case("SDO-52", "1011h:01 is not restored without its signature",
               s.refuse(0x1011, 1, 0x1234_5678, 4, 0x0800_0020, 0x0800_0022), needs=("1011h:01",),
               why="0800002x: only 'load' restores")
    for name, index, done, word, right in (
        ("SDO-53", 0x1010, "stored", 0x7361_7665, "save"),
        ("SDO-54", 0x1011, "restored", 0x6C6F_6164, "load"),
    ):
        subs = [sub for sub in range(1, 9) if subject.has(index, sub)]
        yield case(name, f"{index:04X}h is not {done} with the signature '{right[::-1]}'",
                   *(s.refuse(index, sub, word, 4, 0x0800_0020, 0x0800_0022) for sub in subs or [1]),
                   needs=(f"{index:04X}h:01",), why=f"0800002x: '{right}' in the other order, at each sub-index")
