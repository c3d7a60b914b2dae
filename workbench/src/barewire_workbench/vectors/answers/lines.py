"""Answers for rtu-talk, ascii-talk and tcp-talk: a receiver that is fed step by step."""

from __future__ import annotations

from collections.abc import Callable

from barewire.ascii import AsciiLine
from barewire.modbus.adu import Noise
from barewire.modbus.framing import Line
from barewire.rtu import Timing
from barewire.rtu.line import RtuLine
from barewire.tcp import TcpLine
from barewire_workbench.vectors.answers.frames import adu_fields
from barewire_workbench.vectors.answers.texts import hexed, latin, octets
from barewire_workbench.vectors.questions import Fields

LONG_SILENCE = 10_000_000
"""Microseconds that are longer than any time-out."""


def talk_rtu(given: Fields) -> Fields:
    """Feed a receiver of RTU."""
    setup = given["line"]
    patience = None if setup["patience"] is None else setup["patience"] / 1e6
    timing = Timing.of(setup["baud"], setup["bits"])
    line = RtuLine(timing, role=setup["role"], units=set(setup.get("units", ())), patience=patience)
    return _talk(line, given, octets, hexed)


def talk_ascii(given: Fields) -> Fields:
    """Feed a receiver of ASCII."""
    setup = given["line"]
    line = AsciiLine(character_timeout=setup["timeout"] / 1e6, data_bits=setup["data_bits"])
    return _talk(line, given, latin, lambda data: data.decode("latin-1"))


def talk_tcp(given: Fields) -> Fields:
    """Feed a receiver of TCP."""
    return _talk(TcpLine(), given, octets, hexed)


def frames_only(talk: Callable[[Fields], Fields]) -> Callable[[Fields], Fields]:
    """Return the answer that has the frames alone, silence behind the last step included."""

    def answer(given: Fields) -> Fields:
        ends = {"at": given["talk"][-1]["at"] + LONG_SILENCE}
        steps = talk({**given, "talk": [*given["talk"], ends]})["talk"]
        return {"frames": [event for step in steps for event in step["events"] if "pdu" in event]}

    return answer


def _talk(line: Line, given: Fields, read: Callable[[str], bytes], write: Callable[[bytes], str]) -> Fields:
    steps = []
    for step in given["talk"]:
        events = line.feed(read(step["hear"]) if "hear" in step else None, step["at"] / 1e6)
        told = [
            {"noise": write(event.data), "reason": event.reason} if isinstance(event, Noise) else adu_fields(event)
            for event in events
        ]
        steps.append({"events": told})
    return {"talk": steps, "held": write(line.held)}
