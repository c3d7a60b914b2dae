"""parameter, drive-state, drive-command."""

from __future__ import annotations

from fractions import Fraction

from tests.vectors_runner.common import Case, check, octets, whole_or_float, words

from barewire.codecs import Value, codec, get_bit
from barewire.devices.parameter import ModbusAt, ObjectAt, Parameter

STATES = {
    "not ready to switch on": (0x4F, 0x00),
    "switch on disabled": (0x4F, 0x40),
    "ready to switch on": (0x6F, 0x21),
    "switched on": (0x6F, 0x23),
    "operation enabled": (0x6F, 0x27),
    "quick stop active": (0x6F, 0x07),
    "fault reaction active": (0x4F, 0x0F),
    "fault": (0x4F, 0x08),
}

COMMANDS = {
    "shutdown": (0x87, 0x06, [2, 6, 8]),
    "switch on": (0x8F, 0x07, [3]),
    "disable voltage": (0x82, 0x00, [7, 9, 10, 12]),
    "quick stop": (0x86, 0x02, [7, 10, 11]),
    "disable operation": (0x8F, 0x07, [5]),
    "enable operation": (0x8F, 0x0F, [4, 16]),
    "fault reset": (0x80, 0x80, [15]),
}


def parameter(case: Case) -> None:
    """A value, and its bytes in each of its places."""
    told = case["parameter"]
    place, entry = told.get("modbus"), told.get("object")
    one = Parameter(
        "the parameter",
        told["type"],
        unit=told.get("unit", ""),
        scale=Fraction(told.get("scale", "1")),
        modbus=ModbusAt(**place) if place else None,
        object=ObjectAt(int(entry["index"], 16), int(entry["sub"], 16), entry.get("bit")) if entry else None,
    )
    value: Value | None = None
    if "value" in case:
        value = case["value"] if one.type == "text" else whole_or_float(case["value"])
        if one.type.startswith("f"):
            value = codec(one.type).decode(codec(one.type).encode(value))  # the nearest float

    def said() -> Value:
        assert value is not None
        return value

    if place:
        check(
            case,
            encode=lambda: one.to_registers(said(), words(case.get("old", ""))),
            wire=words(case.get("registers", "")),
            decode=lambda: one.from_registers(words(case["registers"])),
            value=value,
        )
    if entry:
        check(
            case,
            encode=lambda: one.to_object(said(), octets(case.get("old", ""))),
            wire=octets(case.get("bytes", "")),
            decode=lambda: one.from_object(octets(case["bytes"])),
            value=value,
        )


def drive_state(case: Case) -> None:
    """Exactly one state fits a status word."""
    word = int(case["word"], 16)
    assert [bit for bit in range(16) if get_bit(word, bit)] == case["bits"]
    mask, masked = STATES[case["state"]]
    fits = [state for state, (mask_of, value) in STATES.items() if word & mask_of == value]
    if case["result"] == "valid":
        assert (int(case["mask"], 16), int(case["masked"], 16)) == (mask, masked)
        assert fits == [case["state"]]
    else:
        assert case["state"] not in fits


def drive_command(case: Case) -> None:
    """The bits of a command, whatever the others are."""
    mask, masked, transitions = COMMANDS[case["command"]]
    assert (int(case["mask"], 16), int(case["masked"], 16), case["transitions"]) == (mask, masked, transitions)
    assert (int(case["word"], 16) & mask == masked) == (case["result"] == "valid")
