"""Answers for parameter, drive-state and drive-command."""

from __future__ import annotations

from fractions import Fraction

from barewire.codecs import Value, get_bit
from barewire.devices.cia402 import (
    CONTROL_PATTERNS,
    STATUS_PATTERNS,
    TRANSITIONS,
    DriveCommand,
    State,
    after,
    command_of,
    next_control_word,
    state_of,
)
from barewire.devices.parameter import ModbusAt, ObjectAt, Parameter
from barewire.errors import DecodeError
from barewire_workbench.vectors.answers.texts import hexed, number, octets, worded, words
from barewire_workbench.vectors.questions import Fields


def _parameter(described: Fields) -> Parameter:
    place, entry = described.get("modbus"), described.get("object")
    return Parameter(
        "the parameter",
        described["type"],
        unit=described.get("unit", ""),
        scale=Fraction(described.get("scale", "1")),
        modbus=ModbusAt(**place) if place else None,
        object=ObjectAt(int(entry["index"], 16), int(entry["sub"], 16), entry.get("bit")) if entry else None,
    )


def encode_parameter(given: Fields) -> Fields:
    """Return the value of a parameter in each of its places."""
    one = _parameter(given["parameter"])
    value: Value = given["value"] if one.type == "text" else number(given["value"])
    old, fields = given.get("old", ""), Fields()
    if one.modbus:
        fields["registers"] = worded(one.to_registers(value, words(old)))
    if one.object:
        fields["bytes"] = hexed(one.to_object(value, octets(old)))
    return fields


def decode_parameter(given: Fields) -> Fields:
    """Return the value of a parameter, which must be the same in each of its places."""
    one = _parameter(given["parameter"])
    found = []
    if "registers" in given:
        found.append(one.from_registers(words(given["registers"])))
    if "bytes" in given:
        found.append(one.from_object(octets(given["bytes"])))
    if any(value != found[0] for value in found):
        raise DecodeError("mismatch", b"", 0, "the places of the parameter have different values")
    value = found[0]
    return {"value": str(int(value)) if isinstance(value, bool) else str(value)}


def bits_of_word(given: Fields) -> Fields:
    """Return the set bits of a word."""
    return {"bits": [bit for bit in range(16) if get_bit(int(given["word"], 16), bit)]}


def drive_state(given: Fields) -> Fields:
    """Return the state that a status word tells, null for none."""
    word = int(given["word"], 16)
    try:
        return {"state": state_of(word).value}
    except DecodeError:
        return {"state": None}


def state_table(given: Fields) -> Fields:
    """Return the row of a state in the table of status words."""
    mask, masked = STATUS_PATTERNS[State(given["state"])]
    return {"mask": f"{mask:04X}", "masked": f"{masked:04X}"}


def _command(name: str) -> DriveCommand:
    """Return a command by its name. Disable operation has the word of switch on."""
    name = "switch on" if name == "disable operation" else name
    return DriveCommand[name.upper().replace(" ", "_")]


def is_command(given: Fields) -> Fields:
    """Return whether a control word is this command."""
    return {"matches": command_of(int(given["word"], 16)) is _command(given["command"])}


_OF_ANOTHER_COMMAND = {"switch on": 5, "disable operation": 3, "enable operation": 3}
"""By command: a transition that its control word makes too, but under the name of another command."""


def command_table(given: Fields) -> Fields:
    """Return the row of a command in the table of control words."""
    reset = (DriveCommand.FAULT_RESET, DriveCommand.FAULT_RESET)
    command, other = _command(given["command"]), _OF_ANOTHER_COMMAND.get(given["command"])
    mask, masked = CONTROL_PATTERNS.get(command, reset)
    causes = [step.number for step in TRANSITIONS if step.command is command and step.number != other]
    return {"mask": f"{mask:04X}", "masked": f"{masked:04X}", "transitions": causes}


def drive_states(given: Fields) -> Fields:
    """Return the states of a drive after each of several control words."""
    state, before = State(given["state"]), int(given["before"], 16)
    states = []
    for text in given["words"]:
        word = int(text, 16)
        state, before = after(state, word, before, stays_in_quick_stop=given.get("stays", False)), word
        states.append(state.value)
    return {"states": states}


def drive_path(given: Fields) -> Fields:
    """Return the control words of a master that sees these status words, null where it writes none."""
    words: list[str | None] = []
    for text in given["seen"]:
        stays = given.get("stays", False)
        word = next_control_word(state_of(int(text, 16)), State(given["goal"]), stays_in_quick_stop=stays)
        words.append(None if word is None else f"{word:04X}")
    return {"words": words}
