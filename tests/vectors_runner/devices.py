"""parameter, drive-state, drive-command."""

from __future__ import annotations

from fractions import Fraction

from barewire.codecs import Value, codec, get_bit
from barewire.devices.drive.cia402 import (
    CONTROL_PATTERNS,
    STATUS_PATTERNS,
    TRANSITIONS,
    DriveCommand,
    State,
    command_of,
    state_of,
)
from barewire.devices.parameter import ModbusAt, ObjectAt, Parameter
from barewire.errors import DecodeError
from tests.vectors_runner.common import Case, check, octets, whole_or_float, words


def parameter(case: Case) -> None:
    """A value, and its registers and bytes."""
    described = case["parameter"]
    place, entry = described.get("modbus"), described.get("object")
    one = Parameter(
        "the parameter",
        described["type"],
        unit=described.get("unit", ""),
        scale=Fraction(described.get("scale", "1")),
        modbus=ModbusAt(**place) if place else None,
        object=ObjectAt(int(entry["index"], 16), int(entry["sub"], 16), entry.get("bit")) if entry else None,
    )
    value: Value | None = None
    if "value" in case:
        value = case["value"] if one.type == "text" else whole_or_float(case["value"])
        if one.type.startswith("f"):
            value = codec(one.type).decode(codec(one.type).encode(value))  # the nearest float

    def given() -> Value:
        assert value is not None
        return value

    if place:
        check(
            case,
            encode=lambda: one.to_registers(given(), words(case.get("old", ""))),
            wire=words(case.get("registers", "")),
            decode=lambda: one.from_registers(words(case["registers"])),
            value=value,
        )
    if entry:
        check(
            case,
            encode=lambda: one.to_object(given(), octets(case.get("old", ""))),
            wire=octets(case.get("bytes", "")),
            decode=lambda: one.from_object(octets(case["bytes"])),
            value=value,
        )


def drive_state(case: Case) -> None:
    """At most one state matches a status word."""
    word, given = int(case["word"], 16), State(case["state"])
    assert [bit for bit in range(16) if get_bit(word, bit)] == case["bits"]
    assert (int(case["mask"], 16), int(case["masked"], 16)) == STATUS_PATTERNS[given]
    try:
        found: State | None = state_of(word)
    except DecodeError:
        found = None
    assert (found is given) == (case["result"] == "valid")
    assert sum(word & mask == value for mask, value in STATUS_PATTERNS.values()) == (found is not None)


def drive_command(case: Case) -> None:
    """The bits of a command; other bits are ignored. Disable operation has the word of switch on."""
    name: str = "switch on" if case["command"] == "disable operation" else case["command"]
    given = DriveCommand[name.upper().replace(" ", "_")]
    bits = (int(case["mask"], 16), int(case["masked"], 16))
    assert bits == CONTROL_PATTERNS.get(given, (DriveCommand.FAULT_RESET, DriveCommand.FAULT_RESET))
    assert (command_of(int(case["word"], 16)) is given) == (case["result"] == "valid")
    causes = {step.number for step in TRANSITIONS if step.command is given}
    assert set(case["transitions"]) <= causes
