"""rtu-talk, ascii-talk, tcp-talk: a receiver fed step by step, and what it reports.

A case that is valid must hold for every receiver of the standard, so here it is held against more than ours: on RTU
against one that knows silence and CRC only, and everywhere against the frames as anybody would write them.
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


def adu_of(told: dict[str, Any]) -> Adu:
    """The frame of an event."""
    return Adu(told["unit"], octets(told["pdu"]), told.get("transaction"))


def talk(case: Case, line: Line, read: Callable[[str], bytes]) -> list[Adu]:
    """Step by step: what is fed at which time, and what comes out of it. Returns the frames."""
    assert case["result"] in ("valid", "acceptable"), "a receiver is never wrong to hear what was said"
    for step in case["talk"]:
        events = line.feed(read(step["hear"]) if "hear" in step else None, step["at"] / 1e6)
        assert [event[:2] if isinstance(event, Noise) else event for event in events] == [
            (read(told["noise"]), told["reason"]) if "noise" in told else adu_of(told) for told in step["events"]
        ]
    assert line.held == read(case["held"])
    return [adu_of(told) for step in case["talk"] for told in step["events"] if "pdu" in told]


def said_as_written(case: Case, frames: list[Adu], heard: bytes, pack: Callable[[Adu], bytes]) -> None:
    """A frame stands in what was heard as anybody would write it; where the case is tolerant, it does not."""
    written = [pack(frame) in heard for frame in frames]
    assert written == ["tolerant" not in case.get("flags", ())] * len(frames)


def heard_in(case: Case, read: Callable[[str], bytes]) -> bytes:
    """All that is fed, one behind the other."""
    return b"".join(read(step["hear"]) for step in case["talk"] if "hear" in step)


def by_silence(case: Case, timing: Timing) -> list[Adu]:
    """The frames that a receiver hears which knows silence and CRC, and neither functions nor counts."""
    setup, found, piece, spoiled, heard_at = case["line"], list[Adu](), b"", False, 0.0
    ends = timing.t35 if setup["patience"] is None else setup["patience"] / 1e6
    breaks = timing.t15 if setup["patience"] is None else ends
    for step in case["talk"]:
        data, at = octets(step.get("hear", "")), step["at"] / 1e6
        gap = at - len(data) * timing.character - heard_at
        if piece and gap >= ends:
            with suppress(DecodeError):
                found += [] if spoiled else [barewire.rtu.decode(piece)]
            piece, spoiled = b"", False
        spoiled = spoiled or (bool(piece and data) and gap > breaks)
        piece, heard_at = piece + data, at if data else heard_at
    if piece and not spoiled and not case["held"]:
        with suppress(DecodeError):
            found.append(barewire.rtu.decode(piece))
    return found


def rtu_talk(case: Case) -> None:
    """`line`: role, units of a server, baud, bits, patience in microseconds or null for strict.

    What is valid, and not only acceptable, is heard by silence and CRC alone: more cannot be asked of another stack.
    """
    setup = case["line"]
    patience = None if setup["patience"] is None else setup["patience"] / 1e6
    timing = Timing.of(setup["baud"], setup["bits"])
    line = RtuLine(timing, role=setup["role"], units=set(setup.get("units", ())), patience=patience)
    frames = talk(case, line, octets)
    said_as_written(case, frames, heard_in(case, octets), lambda frame: barewire.rtu.encode(frame.unit, frame.pdu))
    if case["result"] == "valid":
        assert by_silence(case, timing) == frames


def ascii_talk(case: Case) -> None:
    """`line`: timeout in microseconds, data bits. What ends a frame can be changed, so it is not compared here."""
    setup = case["line"]
    frames = talk(case, AsciiLine(character_timeout=setup["timeout"] / 1e6, data_bits=setup["data_bits"]), text)
    heard = heard_in(case, text)
    if setup["data_bits"] == 7:
        heard = bytes(byte & 0x7F for byte in heard)
    said_as_written(case, frames, heard, lambda frame: barewire.ascii.encode(frame.unit, frame.pdu)[:-1])


def tcp_talk(case: Case) -> None:
    """`line` has nothing to set."""
    frames = talk(case, TcpLine(), octets)

    def pack(frame: Adu) -> bytes:
        return barewire.tcp.encode(frame.unit, frame.pdu, frame.transaction or 0)

    said_as_written(case, frames, heard_in(case, octets), pack)
