"""How the vectors write values, both ways, and the answers for values: number, bits, register-part, text, object-value,
parameter and the words of a drive.

>>> octets("01 04"), hexed(b"\\x01\\x04"), words("022B 0000"), bits("101")
(b'\\x01\\x04', '01 04', (555, 0), (True, False, True))
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import Any, TypeAlias

from barewire.canopen.datatypes import DATA_TYPES, DAY, TimeDifference, TimeOfDay, object_codec
from barewire.codecs import Number, Text, Value, codec, get_bit, get_half, pack_bits, set_bit, set_half, unpack_bits
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
from barewire.errors import DecodeError, EncodeError
from barewire_workbench.vectors.questions import Fields

Answers: TypeAlias = dict[str, dict[str, Callable[[Fields], Fields]]]
"""By kind and operation: the function that answers."""

MICROSECOND = 1e-6
"""In seconds, which are the unit of barewire; the vectors have microseconds."""
START = 0.0
"""What the clock of barewire shows where the vectors begin to count."""


def octets(text: str) -> bytes:
    """Return the bytes of a text of hexadecimal digits."""
    return bytes.fromhex(text)


def hexed(data: bytes) -> str:
    """Return bytes as hexadecimal digits, a blank between two bytes."""
    return data.hex(" ").upper()


def word(text: str) -> int:
    """Return the number of hexadecimal digits."""
    return int(text, 16)


def words(text: str) -> tuple[int, ...]:
    """Return the registers of a text."""
    return tuple(map(word, text.split()))


def worded(registers: Iterable[int]) -> str:
    """Return registers as four digits each."""
    return " ".join(f"{register:04X}" for register in registers)


def bits(text: str) -> tuple[bool, ...]:
    """Return a row of bits, the first one first."""
    return tuple(place == "1" for place in text.replace(" ", ""))


def bitted(row: Iterable[bool]) -> str:
    """Return bits as a text, in groups of eight."""
    text = "".join("1" if bit else "0" for bit in row)
    return " ".join(text[at : at + 8] for at in range(0, len(text), 8))


def number(text: str) -> int | float:
    """Return a number that is written as text."""
    try:
        return int(text)
    except ValueError:
        return float(text)


def value_text(value: Value) -> str:
    """Return a value as text; of a bool 0 or 1."""
    return str(int(value)) if isinstance(value, bool) else str(value)


def latin(characters: str) -> bytes:
    """Return the bytes of a text of an ASCII line, one for each character."""
    return characters.encode("latin-1")


def milliseconds_of(days: int, milliseconds: int) -> int:
    """Return a time of CANopen in milliseconds: barewire has days and milliseconds as one number."""
    if not 0 <= milliseconds < DAY:
        raise EncodeError(f"milliseconds {milliseconds}: a day has 0 to {DAY - 1}")
    return days * DAY + milliseconds


def days_of(total: int) -> Fields:
    """Return a time of CANopen as days and milliseconds."""
    return dict(zip(("days", "milliseconds"), divmod(total, DAY)))


# Numbers, bits and characters


def _number_codec(given: Fields) -> Number:
    return codec(given["type"], given["order"])


def _text_codec(given: Fields) -> Text:
    return Text(given["size"], given["charset"], octets(given["pad"]))


def _read_part(given: Fields) -> Fields:
    """Read half a register or a bit of it."""
    register, part = word(given["register"]), given["part"]
    return {"value": get_half(register, part) if part in ("L", "H") else int(get_bit(register, int(part[4:])))}


def _write_part(given: Fields) -> Fields:
    register, part, value = word(given["register"]), given["part"], given["write"]
    then = set_half(register, part, value) if part in ("L", "H") else set_bit(register, int(part[4:]), bool(value))
    return {"then": f"{then:04X}"}


# Values of the object dictionary

_TYPES = {row.standard: row.name for row in DATA_TYPES}


def _encode_object(given: Fields) -> Fields:
    name, value = _TYPES[given["type"]], given["value"]
    if name in ("octets", "domain"):
        value = octets(value)
    elif isinstance(value, dict):
        total = milliseconds_of(value["days"], value["milliseconds"])
        value = TimeOfDay(total) if name == "time_of_day" else TimeDifference(total)
    return {"bytes": hexed(object_codec(name).encode(value))}


def _decode_object(given: Fields) -> Fields:
    value: Any = object_codec(_TYPES[given["type"]]).decode(octets(given["bytes"]))
    if isinstance(value, bytes):
        return {"value": hexed(value)}
    return {"value": days_of(int(value)) if isinstance(value, (TimeOfDay, TimeDifference)) else value}


# Parameters of devices


def _parameter(described: Fields) -> Parameter:
    place, entry = described.get("modbus"), described.get("object")
    return Parameter(
        "the parameter",
        described["type"],
        unit=described.get("unit", ""),
        scale=Fraction(described.get("scale", "1")),
        modbus=ModbusAt(**place) if place else None,
        object=ObjectAt(word(entry["index"]), word(entry["sub"]), entry.get("bit")) if entry else None,
    )


def _encode_parameter(given: Fields) -> Fields:
    """Return the value of a parameter in each of its places."""
    parameter = _parameter(given["parameter"])
    value: Value = given["value"] if parameter.type == "text" else number(given["value"])
    old, fields = given.get("old", ""), Fields()
    if parameter.modbus:
        fields["registers"] = worded(parameter.to_registers(value, words(old)))
    if parameter.object:
        fields["bytes"] = hexed(parameter.to_object(value, octets(old)))
    return fields


def _decode_parameter(given: Fields) -> Fields:
    """Return the value of a parameter, which must be the same in each of its places."""
    parameter = _parameter(given["parameter"])
    values: list[Value] = []
    if "registers" in given:
        values.append(parameter.from_registers(words(given["registers"])))
    if "bytes" in given:
        values.append(parameter.from_object(octets(given["bytes"])))
    if any(value != values[0] for value in values):
        raise DecodeError("mismatch", b"", 0, "the places of the parameter have different values")
    return {"value": value_text(values[0])}


# The words of a CiA 402 drive

_OF_ANOTHER_COMMAND = {"switch on": 5, "disable operation": 3, "enable operation": 3}
"""By command: a transition that its control word makes too, but under the name of another command."""


def _pattern(mask: int, masked: int) -> Fields:
    return {"mask": f"{mask:04X}", "masked": f"{masked:04X}"}


def _command(name: str) -> DriveCommand:
    # Disable operation has the word of switch on.
    name = "switch on" if name == "disable operation" else name
    return DriveCommand[name.upper().replace(" ", "_")]


def _command_table(given: Fields) -> Fields:
    """Return the row of a command in the table of control words."""
    command, other = _command(given["command"]), _OF_ANOTHER_COMMAND.get(given["command"])
    causes = [step.number for step in TRANSITIONS if step.command is command and step.number != other]
    # The word of a fault reset has one bit, which is its mask as well.
    reset = (DriveCommand.FAULT_RESET, DriveCommand.FAULT_RESET)
    return {**_pattern(*CONTROL_PATTERNS.get(command, reset)), "transitions": causes}


def _drive_states(given: Fields) -> Fields:
    """Return the states of a drive after each of several control words."""
    state, before = State(given["state"]), word(given["before"])
    states = []
    for control_word in map(word, given["words"]):
        state = after(state, control_word, before, stays_in_quick_stop=given.get("stays", False))
        before = control_word
        states.append(state.value)
    return {"states": states}


def _drive_path(given: Fields) -> Fields:
    """Return the control words of a master that sees these status words, null where it writes none."""
    states = [state_of(word(text)) for text in given["seen"]]
    goal, stays = State(given["goal"]), given.get("stays", False)
    control_words = [next_control_word(state, goal, stays_in_quick_stop=stays) for state in states]
    return {"words": [None if control_word is None else f"{control_word:04X}" for control_word in control_words]}


ANSWERS: Answers = {
    "number": {
        "encode": lambda given: {"bytes": hexed(_number_codec(given).encode(number(given["value"])))},
        "decode": lambda given: {"value": str(_number_codec(given).decode(octets(given["bytes"])))},
    },
    "bits": {
        "encode": lambda given: {"bytes": hexed(pack_bits(bits(given["bits"])))},
        "decode": lambda given: {"bits": bitted(unpack_bits(octets(given["bytes"]), given["count"]))},
    },
    "register-part": {"encode": _write_part, "decode": _read_part},
    "text": {
        "encode": lambda given: {"bytes": hexed(_text_codec(given).encode(given["text"]))},
        "decode": lambda given: {"text": _text_codec(given).decode(octets(given["bytes"]))},
    },
    "object-value": {"encode": _encode_object, "decode": _decode_object},
    "parameter": {"encode": _encode_parameter, "decode": _decode_parameter},
    "drive-path": {"encode": _drive_path, "decode": _drive_states},
    "drive-state": {
        "bits": lambda given: {"bits": [bit for bit in range(16) if get_bit(word(given["word"]), bit)]},
        "decode": lambda given: {"state": state_of(word(given["word"])).value},
        "table": lambda given: _pattern(*STATUS_PATTERNS[State(given["state"])]),
    },
    "drive-command": {
        "decode": lambda given: {"matches": command_of(word(given["word"])) is _command(given["command"])},
        "table": _command_table,
    },
}
