"""Conformance cases of SDO block transfers: segment numbers, acknowledgements, block sizes, the CRC.   [CiA 301 7.2.4]

A device without block transfers aborts the first request with 0504 0001h, and passes.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from barewire.canopen.conformance.frames import (
    HEARTBEAT,
    LARGE,
    LENGTH_CODES,
    NOWHERE,
    READ_ONLY_CODES,
    TEXT,
    Sdo,
    ascending,
    block_end,
    block_segment,
    little,
    make_case,
    multiplexer,
    parts,
    silence,
)
from barewire.canopen.conformance.model import SILENCE, NodeCase, NodeStep, Subject

# Each case is a row: name, title, steps, needs, reason.
# fmt: off

_CLAUSE = "CiA 301 7.2.4 SDO block"
_COMMAND, _SIZE, _SEQUENCE, _CRC = 0x0504_0001, 0x0504_0002, 0x0504_0003, 0x0504_0004


def block_cases(subject: Subject) -> Iterator[NodeCase]:
    """Yield the cases of this service for one device."""
    yield from _uploads(subject)
    yield from _downloads(subject)
    yield from _large(subject)


class _Block:
    """The steps of block transfers with one device."""

    def __init__(self, subject: Subject) -> None:
        self.s = s = Sdo(subject.node)
        self.none = s.aborted(_COMMAND)
        self.works = s.works
        self.done = silence(s.request("A1"), wait=0.02)
        self.abort = silence(s.abort, wait=0.02)

    def begin_up(self, index: int, size: int, blksize: int = 20, *, crc: bool = True, switch: int = 0) -> NodeStep:
        """Request an upload in blocks of `blksize` segments."""
        place = multiplexer(index, 0)
        request = self.s.request(f"{'A4' if crc else 'A0'}{place}{blksize:02X}{switch:02X}")
        sized = self.s.response(f"C[26]{place}{little(size, 4)}")
        return NodeStep((request,), (f"{sized}|{self.s.response(f'C[04]{place}')}",), (self.none,))

    def blocks(self, value: bytes, first: int, count: int, request: str) -> NodeStep:
        """Send a request and expect these segments, numbered from 1."""
        pieces = parts(value)
        accepted = [
            self.s.response(block_segment(number + 1, pieces[first + number], first + number == len(pieces) - 1))
            for number in range(count)
        ]
        return NodeStep((self.s.request(request),), (", ".join(accepted),))

    def up(self, index: int, value: bytes, *, crc: bool = True, blksize: int = 20) -> list[NodeStep]:
        """Return the steps of a complete upload."""
        count, first, steps, sends = len(parts(value)), 0, [self.begin_up(index, len(value), blksize, crc=crc)], "A3"
        while first < count:
            size = min(blksize, count - first)
            steps.append(self.blocks(value, first, size, sends))
            first, sends = first + size, f"A2{size:02X}{blksize:02X}"
        ends = self.s.response(block_end(value, 0))
        accepted = f"{self.s.response(block_end(value))}|{ends}" if crc else ends
        return [*steps, NodeStep((self.s.request(sends),), (accepted,)), self.done]

    def begin_down(self, index: int, sub: int, size: int | None, *, crc: bool = True, more: str = "") -> NodeStep:
        """Request a download in blocks; `more` is another accepted response."""
        place = multiplexer(index, sub)
        request = f"{0xC0 | crc << 2 | (size is not None) << 1:02X}{place}{little(size or 0, 4)}"
        accepted = (self.s.response(f"A[04]{place}"), *([more] if more else []))
        return NodeStep((self.s.request(request),), accepted, (self.none,))


def _uploads(subject: Subject) -> Iterator[NodeCase]:
    block = _Block(subject)
    s, works = block.s, block.works
    index, text = subject.text_object
    count = len(parts(text))
    device_type = subject.number(0x1000).to_bytes(4, "little")

    case = partial(make_case, subject, _CLAUSE, (s.responses,), effect="reads")
    yield case("BLK-01", "upload of four bytes without CRC", *block.up(0x1000, device_type, crc=False), works,
               why="the CRC is 0 if one side does not support it")
    yield case("BLK-02", "upload of four bytes with CRC", *block.up(0x1000, device_type), works)
    yield case("BLK-03", "upload of a text with CRC", *block.up(index, text), works, needs=TEXT)
    yield case("BLK-04", "upload in blocks of one segment", *block.up(index, text, blksize=1), works, needs=TEXT)
    yield case("BLK-05", "upload in blocks of 127 segments", *block.up(index, text, blksize=127), works, needs=TEXT)
    yield case("BLK-21", "upload of a text without CRC", *block.up(index, text, crc=False), works, needs=TEXT)
    for name, blksize in (("BLK-06", 0), ("BLK-07", 128), ("BLK-08", 255)):
        step = NodeStep((s.request(f"A4 0010 00 {blksize:02X}"),), (s.aborted(_SIZE, _COMMAND),))
        yield case(name, f"upload in blocks of {blksize} segments", step, works, why="05040002: 1 to 127")
    for name, target, sub, code, title in (
        ("BLK-09", NOWHERE, 0, 0x0602_0000, "an object that does not exist"),
        ("BLK-10", 0x1000, 1, 0x0609_0011, "a sub-index that does not exist"),
    ):
        step = NodeStep((s.request(f"A4 {multiplexer(target, sub)} 14"),), (s.refused(target, sub, code), block.none))
        yield case(name, f"upload of {title}", step, works, why=f"{code:08X}")
    begin = block.begin_up(0x1000, 4, switch=4)
    yield case("BLK-11", "upload with protocol switch for up to four bytes",
               begin._replace(accepts=(*begin.accepts, s.any_value(0x1000))), block.abort, works,
               why="the device answers as to 40h, or continues in blocks")
    start = [block.begin_up(index, len(text)), block.blocks(text, 0, count, "A3")]
    yield case("BLK-12", "no segment acknowledged: the block is repeated", *start,
               block.blocks(text, 0, count, "A20014"), block.abort, works, needs=TEXT, why="ackseq 0")
    yield case("BLK-13", "only the first segment acknowledged: the rest follows, numbered from 1", *start,
               block.blocks(text, 1, count - 1, "A20114"), block.abort, works, needs=TEXT)
    first_only = block.blocks(text, 0, 1, "A20001")
    yield case("BLK-14", "another block size with the acknowledgement", *start, first_only, block.abort, works,
               needs=TEXT)
    yield case("BLK-15", "more segments acknowledged than sent", *start,
               NodeStep((s.request(f"A2 {count + 1:02X} 14"),), (s.aborted(_SEQUENCE, _COMMAND),)), works, needs=TEXT,
               why="05040003")
    yield case("BLK-16", "block size 0 with the acknowledgement", *start,
               NodeStep((s.request("A2 01 00"),), (s.aborted(_SIZE, _COMMAND),)), works, needs=TEXT, why="05040002")
    yield case("BLK-17", "the client aborts before the start", start[0], block.abort, works, needs=TEXT)
    yield case("BLK-18", "the client aborts instead of acknowledging", *start, block.abort, works, needs=TEXT)
    whole = block.up(index, text)
    yield case("BLK-19", "the end is not confirmed, a new request follows", *whole[:-1],
               NodeStep((s.upload(0x1000),), (s.any_value(0x1000), s.aborted(_COMMAND))), works, needs=TEXT,
               why="the transfer is complete; devices serve the request or abort once")
    yield case("BLK-20", "a segment request of a segmented upload during the block", start[0],
               NodeStep((s.request("60"),), (s.aborted(_COMMAND),)), works, needs=TEXT, why="05040001")


def _downloads(subject: Subject) -> Iterator[NodeCase]:
    block = _Block(subject)
    s, works = block.s, block.works
    value = b"\x10\x27"
    read_back = s.read(0x1017, 0, value)
    send = NodeStep((s.request("81 1027"),), (s.response("A201"),))
    before, kept = s.unchanged(0x1017)

    def case(name: str, title: str, *steps: NodeStep, needs: tuple[str, ...] = HEARTBEAT, why: str = "") -> NodeCase:
        steps = (before, *steps) if kept in steps else steps
        return make_case(subject, _CLAUSE, (s.responses,), name, title, *steps, effect="writes", needs=needs, why=why)

    def end(data: bytes, crc: int | None = None) -> NodeStep:
        return NodeStep((s.request(block_end(data, crc)),), (s.response("A1"),))

    begin = block.begin_down(0x1017, 0, 2)
    yield case("BLK-30", "download of two bytes with CRC", begin, send, end(value), read_back)
    plain = block.begin_down(0x1017, 0, 2, crc=False)
    yield case("BLK-31", "download without CRC", plain, send, end(value, 0), read_back)
    for name, crc in (("BLK-45", True), ("BLK-46", False)):
        start = block.begin_down(0x100C, 0, 2, crc=crc)
        yield case(name, f"download to 100Ch with{'' if crc else 'out'} CRC", start, send,
                   end(value, None if crc else 0), s.read(0x100C, 0, value), needs=("100Ch",))
    yield case("BLK-32", "download without a size", block.begin_down(0x1017, 0, None), send, end(value), read_back)
    strict = NodeStep(begin.sends, (s.response("A4171000"),), (block.none, s.response("A0171000")))
    yield case("BLK-33", "a wrong CRC, if the device supports CRC", strict, send,
               NodeStep((s.request(block_end(value, 0x1234)),), (s.refused(0x1017, 0, _CRC),)), kept,
               why="05040004, and nothing is changed")
    for name, number in (("BLK-34", "82"), ("BLK-35", "80")):
        title = "a block begins with segment 2" if number == "82" else "a segment 0 with the last bit is an abort"
        accepted = (s.aborted(_SEQUENCE, _COMMAND), s.response("A200"), SILENCE) if number == "82" else (SILENCE,)
        yield case(name, title, begin, NodeStep((s.request(f"{number} 1027"),), accepted), block.abort, kept,
                   why="05040003, or acknowledged as 0" if number == "82" else "80h")
    yield case("BLK-36", "a segment 0", begin,
               NodeStep((s.request("00 1027"),), (s.aborted(_SEQUENCE, _COMMAND), SILENCE)), block.abort, kept,
               why="05040003, or ignored")
    for name, target, sub, codes, title in (
        ("BLK-37", 0x1000, 0, READ_ONLY_CODES, "a read-only object"),
        ("BLK-38", NOWHERE, 0, (0x0602_0000,), "an object that does not exist"),
        ("BLK-39", 0x1000, 1, (0x0609_0011,), "a sub-index that does not exist"),
    ):
        start = block.begin_down(target, sub, 4)
        refused = s.refused(target, sub, *codes)
        yield case(name, f"download to {title}", start._replace(ends=(*start.ends, refused)),
                   NodeStep((s.request("81 01000000"),), (s.response("A201"),), (refused,)),
                   NodeStep((s.request(block_end(b"\1\0\0\0")),), (refused,)), needs=(),
                   why="refused at the start or at the end")
    wrong = s.refused(0x1017, 0, *LENGTH_CODES)
    for name, data in (("BLK-40", bytes(4)), ("BLK-41", bytes(1))):
        start = block.begin_down(0x1017, 0, len(data))
        yield case(name, f"{len(data)} bytes to an object of two", start._replace(ends=(*start.ends, wrong)),
                   NodeStep((s.request("81"),), (s.response("A201"),), (wrong,)),
                   NodeStep((s.request(block_end(data)),), (wrong,)), kept, why="0607001x, and nothing is changed")
    yield case("BLK-42", "the client aborts before the first segment", begin, block.abort, kept)
    yield case("BLK-43", "the client aborts before the end", begin, send, block.abort, kept, works)
    again = NodeStep((s.request("81 1027"),), (SILENCE, s.response("A201")), (s.aborted(_SEQUENCE, _COMMAND),), 0.05)
    yield case("BLK-44", "the last segment repeated, then the end", begin, send, again, end(value), read_back,
               why="its acknowledgement may have been lost; or 05040001, 05040003: the standard has no repetition")


def _large(subject: Subject) -> Iterator[NodeCase]:
    """Yield downloads of several segments to the object that the user has named."""
    block = _Block(subject)
    s = block.s
    index, sub = subject.large or (0x2000, 0)

    case = partial(make_case, subject, _CLAUSE, (s.responses,), effect="writes", needs=LARGE)

    def segments(value: bytes, first: int, last: int, ack: int, *more: str) -> NodeStep:
        pieces = parts(value)
        sends = [s.request(block_segment(n - first + 1, pieces[n], n == len(pieces) - 1)) for n in range(first, last)]
        return NodeStep(tuple(sends), (s.response(f"A2{ack:02X}"), *more))

    for name, length in (("BLK-50", 7), ("BLK-51", 20), ("BLK-52", 100)):
        value = ascending(length)
        count = len(parts(value))
        yield case(name, f"{length} bytes written and read back", block.begin_down(index, sub, length),
                   segments(value, 0, count, count), NodeStep((s.request(block_end(value)),), (s.response("A1"),)),
                   *block.up(index, value) if sub == 0 else ())
    value = ascending(20)
    pieces = parts(value)
    texts = [s.request(block_segment(number + 1, piece, piece is pieces[-1])) for number, piece in enumerate(pieces)]
    finish = NodeStep((s.request(block_end(value)),), (s.response("A1"),))
    begin = block.begin_down(index, sub, len(value))
    for name, kept, acked in (("BLK-53", (0, 2), 1), ("BLK-54", (1, 2), 0)):
        lost = "second" if acked else "first"
        # Devices acknowledge at the end of the block, at the first gap, or after a pause.
        gap = NodeStep(tuple(texts[number] for number in kept), (s.response(f"A20{acked}"),), wait=2.5)
        yield case(name, f"the {lost} segment is lost: the device requests it again", begin, gap,
                   segments(value, acked, 3, 3 - acked), finish, *block.up(index, value) if sub == 0 else (),
                   why="numbered from 1 again; the standard does not define how soon")
    wrong = NodeStep((s.request(block_end(value, 0x1234)),), (s.refused(index, sub, _CRC),))
    strict = NodeStep(
        begin.sends,
        (s.response(f"A4{multiplexer(index, sub)}"),),
        (block.none, s.response(f"A0{multiplexer(index, sub)}")),
    )
    yield case("BLK-55", "a wrong CRC of several segments", strict, segments(value, 0, 3, 3), wrong, block.works,
               why="05040004")
    yield case("BLK-56", "more bytes than announced", block.begin_down(index, sub, 14),
               segments(value, 0, 3, 3, s.any_abort),
               NodeStep((s.request(block_end(value)),), (s.aborted(*LENGTH_CODES, _COMMAND), SILENCE)), block.works,
               why="06070012, 06070010; some devices report it at a segment")
