"""Conformance cases of segmented SDO transfers: the toggle bit, sizes, ends and interruptions.   [CiA 301 7.2.4]

Downloads go to 1017h in one segment, and in several to an object for any bytes if the user names one.
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
    little,
    make_case,
    multiplexer,
    parts,
    segment,
    silence,
)
from barewire.canopen.conformance.model import SILENCE, NodeCase, NodeStep, Subject

# Each case is a row: name, title, steps, needs, reason.
# fmt: off

_CLAUSE = "CiA 301 7.2.4 SDO segments"
_TOGGLE, _COMMAND = 0x0503_0000, 0x0504_0001


def segmented_cases(subject: Subject) -> Iterator[NodeCase]:
    """Yield the cases of this service for one device."""
    yield from _uploads(subject)
    yield from _downloads(subject)
    yield from _large(subject)


def _uploads(subject: Subject) -> Iterator[NodeCase]:
    s = Sdo(subject.node)
    index, text = subject.text_object
    pieces = parts(text)
    size = little(len(text), 4)
    begin = NodeStep(
        (s.upload(index),), (s.response(f"41{multiplexer(index, 0)}{size}"), s.response(f"40{multiplexer(index, 0)}"))
    )
    asks = [s.request("60" if number % 2 == 0 else "70") for number in range(len(pieces))]
    fetch = [
        NodeStep((ask,), (s.response(segment(number, piece, piece is pieces[-1])),))
        for number, (ask, piece) in enumerate(zip(asks, pieces))
    ]
    works = s.works
    abort = silence(s.abort, wait=0.02)

    case = partial(make_case, subject, _CLAUSE, (s.responses,), effect="reads", needs=TEXT)
    yield case("SEG-01", "upload of a text, toggle 0 first", begin, *fetch,
               why="every segment repeats the toggle bit of its request")
    yield case("SEG-02", "the same again: the toggle begins with 0", begin, *fetch, begin, *fetch)
    yield case("SEG-03", "the first segment requested with toggle 1", begin,
               NodeStep((s.request("70"),), (s.refused(index, 0, _TOGGLE),)), works, why="05030000")
    yield case("SEG-04", "the same toggle twice", begin, fetch[0],
               NodeStep((s.request("60"),), (s.refused(index, 0, _TOGGLE),)), works, why="05030000")
    yield case("SEG-05", "a segment requested after the last", begin, *fetch,
               NodeStep((s.request("60" if len(pieces) % 2 == 0 else "70"),), (s.aborted(_COMMAND, _TOGGLE), SILENCE)),
               works, why="the transfer is over")
    yield case("SEG-06", "the client aborts after a segment", begin, fetch[0], abort, works)
    yield case("SEG-07", "the client aborts at once", begin, abort, works)
    yield case("SEG-08", "a download segment during an upload", begin,
               NodeStep((s.request("00 AA"),), (s.aborted(_COMMAND),)), works, why="05040001")
    yield case("SEG-09", "an undefined command during an upload", begin,
               NodeStep((s.request("E0"),), (s.aborted(_COMMAND),)), works, why="05040001")
    yield case("SEG-10", "a new request during an upload", begin,
               NodeStep((s.upload(0x1000),), (s.aborted(_COMMAND), s.any_value(0x1000))), works,
               why="05040001, or the new request is served; the next one is")


def _downloads(subject: Subject) -> Iterator[NodeCase]:
    s = Sdo(subject.node)
    works = s.works
    before, kept = s.unchanged(0x1017)

    def case(name: str, title: str, *steps: NodeStep, needs: tuple[str, ...] = HEARTBEAT, why: str = "") -> NodeCase:
        steps = (before, *steps) if kept in steps else steps
        return make_case(subject, _CLAUSE, (s.responses,), name, title, *steps, effect="writes", needs=needs, why=why)

    begin = NodeStep((s.request("21 1710 00 02"),), (s.accepted(0x1017),))
    send = NodeStep((s.request("0B 1027"),), (s.response("20"),))
    read_back = s.read(0x1017, 0, b"\x10\x27")
    abort = silence(s.abort, wait=0.02)
    yield case("SEG-20", "download of two bytes in one segment", begin, send, read_back)
    guard = NodeStep((s.request("21 0C10 00 02"),), (s.accepted(0x100C),))
    yield case("SEG-34", "download of two bytes to 100Ch in one segment", guard, send, s.read(0x100C, 0, b"\x10\x27"),
               needs=("100Ch",))
    unsized = NodeStep((s.request("20 1710 00"),), (s.accepted(0x1017),))
    yield case("SEG-21", "the same without a size", unsized, send, read_back, why="the size is optional")
    yield case("SEG-22", "the first segment with toggle 1", begin,
               NodeStep((s.request("1B 1027"),), (s.refused(0x1017, 0, _TOGGLE),)), kept,
               why="05030000, and nothing is changed")
    wrong = s.refused(0x1017, 0, *LENGTH_CODES)
    for name, announced, data, title in (
        ("SEG-23", 4, "07 10270000", "four bytes announced and sent to an object of two"),
        ("SEG-24", 2, "07 10270000", "two bytes announced and four sent"),
        ("SEG-25", 2, "0D 10", "two bytes announced and one sent"),
        ("SEG-26", 1, "0D 10", "one byte announced and sent to an object of two"),
    ):
        start = NodeStep((s.request(f"21 1710 00 0{announced}"),), (s.accepted(0x1017), wrong))
        # A device that refuses at once has no transfer: the segment then belongs to none.
        sent = NodeStep((s.request(data),), (wrong, s.aborted(_COMMAND), SILENCE))
        yield case(name, title, start, sent, kept, why="0607001x at the start or at the end, and nothing is changed")
    for name, index, sub, codes, title in (
        ("SEG-27", 0x1000, 0, READ_ONLY_CODES, "a read-only object"),
        ("SEG-28", NOWHERE, 0, (0x0602_0000,), "an object that does not exist"),
        ("SEG-29", 0x1000, 1, (0x0609_0011,), "a sub-index that does not exist"),
    ):
        refused = s.refused(index, sub, *codes)
        start = NodeStep((s.request(f"21 {multiplexer(index, sub)} 04"),), (s.accepted(index, sub),), (refused,))
        yield case(name, f"download to {title}", start, NodeStep((s.request("07 01000000"),), (refused,)), needs=(),
                   why="refused at the start or at the end")
    yield case("SEG-30", "the client aborts: nothing is changed", begin, abort, kept)
    yield case("SEG-31", "the next segment of an upload during a download", begin,
               NodeStep((s.request("60"),), (s.aborted(_COMMAND),)), kept, why="05040001")
    yield case("SEG-32", "a new request during a download", begin,
               NodeStep((s.upload(0x1000),), (s.aborted(_COMMAND), s.any_value(0x1000))), works,
               why="05040001, or the new request is served; the next one is")
    after = NodeStep((s.request("0B 1027"),), (s.aborted(_COMMAND), SILENCE))
    yield case("SEG-33", "a segment after the last", begin, send, after, works, why="the transfer is over")


def _large(subject: Subject) -> Iterator[NodeCase]:
    """Yield downloads of several segments to the object that the user has named."""
    s = Sdo(subject.node)
    index, sub = subject.large or (0x2000, 0)
    place = multiplexer(index, sub)

    case = partial(make_case, subject, _CLAUSE, (s.responses,), effect="writes", needs=LARGE)

    def down(value: bytes, announced: int | None = None) -> list[NodeStep]:
        pieces = parts(value)
        sends = [segment(number, piece, piece is pieces[-1]) for number, piece in enumerate(pieces)]
        size = len(value) if announced is None else announced
        return [
            NodeStep((s.request(f"21 {place}{little(size, 4)}"),), (s.accepted(index, sub),)),
            *(
                NodeStep((s.request(data),), (s.response("30" if number % 2 else "20"),))
                for number, data in enumerate(sends)
            ),
        ]

    def up(value: bytes) -> list[NodeStep]:
        pieces = parts(value)
        return [
            NodeStep(
                (s.upload(index, sub),), (s.response(f"41{place}{little(len(value), 4)}"), s.response(f"40{place}"))
            ),
            *(
                NodeStep(
                    (s.request("70" if number % 2 else "60"),),
                    (s.response(segment(number, piece, piece is pieces[-1])),),
                )
                for number, piece in enumerate(pieces)
            ),
        ]

    for name, length in (("SEG-40", 7), ("SEG-41", 8), ("SEG-42", 14), ("SEG-43", 100)):
        value = ascending(length)
        yield case(name, f"{length} bytes written and read back", *down(value), *up(value))
    value = ascending(20)
    begin, first, second, _ = down(value)
    toggled = NodeStep((s.request(f"00{value[7:14].hex().upper()}"),), (s.refused(index, sub, _TOGGLE),))
    works = s.works
    yield case("SEG-44", "the same toggle twice", begin, first, toggled, works, why="05030000")
    short = s.refused(index, sub, *LENGTH_CODES)
    yield case("SEG-45", "more bytes sent than announced", *down(value, 14)[:3],
               NodeStep((s.request(segment(2, value[14:], True)),), (short,)), works, why="06070012, 06070010")
    yield case("SEG-46", "fewer bytes sent than announced", *down(value, 21)[:3],
               NodeStep((s.request(segment(2, value[14:], True)),), (short,)), works, why="06070013, 06070010")
    yield case("SEG-47", "a value without bytes",
               NodeStep((s.request(f"21 {place}"),), (s.accepted(index, sub),), (s.any_abort,)),
               NodeStep((s.request("0F"),), (s.response("20"), s.any_abort)), works, why="devices accept or refuse it")
    yield case("SEG-48", "the client aborts between two segments", begin, first, second, silence(s.abort, wait=0.02),
               works, *down(value), *up(value))
