"""rtu-talk, ascii-talk, tcp-talk: a receiver fed step by step, and the events that it reports.

A valid case must hold for every receiver that follows the standard. So it is checked with more than our receivers: on
RTU with one that uses silence and CRC only, and everywhere with the encoded frames.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import barewire.ascii
import barewire.rtu
import barewire.tcp
from barewire.ascii import AsciiLine
from barewire.errors import DecodeError
from barewire.modbus.adu import Adu, Noise
from barewire.modbus.framing import Line
from barewire.rtu import Timing
from barewire.rtu.line import RtuLine
from barewire.tcp import TcpLine
from tests.vectors_runner.common import Case, octets
from tests.vectors_runner.lines import text


def adu_of(expected: dict[str, Any]) -> Adu:
    """The frame of an expected event."""
    return Adu(expected["unit"], octets(expected["pdu"]), expected.get("transaction"))


def talk(case: Case, line: Line, read: Callable[[str], bytes]) -> list[Adu]:
    """Feed each step at its time and compare the events; return the frames."""
    assert case["result"] in ("valid", "acceptable"), "a talk has no invalid result"
    for step in case["talk"]:
        events = line.feed(read(step["hear"]) if "hear" in step else None, step["at"] / 1e6)
        assert [event[:2] if isinstance(event, Noise) else event for event in events] == [
            (read(expected["noise"]), expected["reason"]) if "noise" in expected else adu_of(expected)
            for expected in step["events"]
        ]
    assert line.held == read(case["held"])
    return [adu_of(expected) for step in case["talk"] for expected in step["events"] if "pdu" in expected]


def assert_encoded(case: Case, frames: list[Adu], fed: bytes, pack: Callable[[Adu], bytes]) -> None:
    """Assert that each frame, encoded, is part of the fed bytes; in a tolerant case it must not be."""
    found = [pack(frame) in fed for frame in frames]
    assert found == ["tolerant" not in case.get("flags", ())] * len(frames)


def fed_in(case: Case, read: Callable[[str], bytes]) -> bytes:
    """All bytes that are fed, joined."""
    return b"".join(read(step["hear"]) for step in case["talk"] if "hear" in step)


def by_silence(case: Case, timing: Timing) -> list[Adu]:
    """The frames of a receiver that uses silence and CRC, and neither function codes nor byte counts."""
    setup, found, piece, spoiled, last_at = case["line"], list[Adu](), b"", False, 0.0
    ends = timing.t35 if setup["patience"] is None else setup["patience"] / 1e6
    breaks = timing.t15 if setup["patience"] is None else ends
    for step in case["talk"]:
        data, at = octets(step.get("hear", "")), step["at"] / 1e6
        gap = at - len(data) * timing.character - last_at
        if piece and gap >= ends:
            with suppress(DecodeError):
                found += [] if spoiled else [barewire.rtu.decode(piece)]
            piece, spoiled = b"", False
        spoiled = spoiled or (bool(piece and data) and gap > breaks)
        piece, last_at = piece + data, at if data else last_at
    if piece and not spoiled and not case["held"]:
        with suppress(DecodeError):
            found.append(barewire.rtu.decode(piece))
    return found


def rtu_talk(case: Case) -> None:
    """`line`: role, units of a server, baud, bits, patience in microseconds or null for strict.

    A valid case, unlike an acceptable one, needs silence and CRC only: other stacks need no more than that.
    """
    setup = case["line"]
    patience = None if setup["patience"] is None else setup["patience"] / 1e6
    timing = Timing.of(setup["baud"], setup["bits"])
    line = RtuLine(timing, role=setup["role"], units=set(setup.get("units", ())), patience=patience)
    frames = talk(case, line, octets)
    assert_encoded(case, frames, fed_in(case, octets), lambda frame: barewire.rtu.encode(frame.unit, frame.pdu))
    if case["result"] == "valid":
        assert by_silence(case, timing) == frames


def ascii_talk(case: Case) -> None:
    """`line`: timeout in microseconds, data bits. The last character of a frame may differ, so it is not compared."""
    setup = case["line"]
    frames = talk(case, AsciiLine(character_timeout=setup["timeout"] / 1e6, data_bits=setup["data_bits"]), text)
    fed = fed_in(case, text)
    if setup["data_bits"] == 7:
        fed = bytes(byte & 0x7F for byte in fed)
    assert_encoded(case, frames, fed, lambda frame: barewire.ascii.encode(frame.unit, frame.pdu)[:-1])


def tcp_talk(case: Case) -> None:
    """`line` has no settings."""
    frames = talk(case, TcpLine(), octets)

    def pack(frame: Adu) -> bytes:
        return barewire.tcp.encode(frame.unit, frame.pdu, frame.transaction or 0)

    assert_encoded(case, frames, fed_in(case, octets), pack)
