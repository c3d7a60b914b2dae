"""The control word and the status word of a CiA 402 drive, bit by bit, and the state machine between them.

    status word 0637h & 006Fh = 0027h     operation enabled
    control word 000Fh                    bits 7 3 2 1 0 = 0 1 1 1 1: enable operation

`devices.cia402` has the tables that the package drives by; the steps here find the row by their own arithmetic.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

from barewire.devices.cia402 import (
    CONTROL_PATTERNS,
    STATUS_BITS,
    STATUS_PATTERNS,
    TRANSITIONS,
    State,
    after,
    command_of,
    next_control_word,
    state_of,
    transitions_by,
)
from barewire.devices.device import Device
from barewire.errors import DecodeError, EncodeError
from barewire_workbench.steps.model import Steps, StepSection, StepTable, grouped_bits, parse_hex_number

_HIGHEST_FIRST = range(15, -1, -1)
_CONTROL_BITS: dict[int, str] = {
    0: "switch on",
    1: "enable voltage",
    2: "quick stop (0 = stop)",
    3: "enable operation",
    4: "mode specific",
    5: "mode specific",
    6: "mode specific",
    7: "fault reset (acts on the edge from 0 to 1)",
    8: "halt",
    9: "mode specific",
    10: "reserved",
    **dict.fromkeys(range(11, 16), "manufacturer specific"),
}
_STATUS_BITS: dict[int, str] = {
    **dict.fromkeys(range(16), "manufacturer specific"),
    **STATUS_BITS,
    5: "quick stop (0 = active)",
    **dict.fromkeys((12, 13), "mode specific"),
}
_MODES = ("profile position (1)", "profile velocity (3)", "homing (6)")
_CONTROL_MODES = {
    4: ("new set-point", "-", "start homing"),
    5: ("change set at once", "-", "-"),
    6: ("0 absolute, 1 relative", "-", "-"),
    8: ("halt", "halt", "halt"),
}
_STATUS_MODES = {
    10: ("target reached", "target reached", "target reached"),
    12: ("set-point acknowledge", "speed is 0", "homing attained"),
    13: ("following error", "slip too large", "homing error"),
}


def parse_word(text: str, name: str) -> int:
    """Return a word of 16 bits in hexadecimal digits, with 0x in front or h behind, or neither.

    >>> [f"{parse_word(text, 'status word'):04X}" for text in ("0637h", "0x637", "637")]
    ['0637', '0637', '0637']

    Raises EncodeError for any other text; `name` says there what the word is.
    """
    return parse_hex_number(text, 4, name, "0637", name)


def control_word_steps(word: int | None = None, previous: int = 0, device: Device | None = None) -> Steps:
    """Take a control word apart that follows `previous`; without a word, list the commands.

    >>> control_word_steps(0x000F)
    <Steps controlword: 000Fh is the command enable operation>

    Raises EncodeError for a word outside 16 bits and for a device that is no drive.
    """
    names = _bit_names(device, "control", _CONTROL_BITS)
    if word is None:
        meanings = StepTable("The bits:", ("bit", "meaning"), tuple((str(bit), names[bit]) for bit in _HIGHEST_FIRST))
        sections: tuple[StepSection, ...] = (meanings, _commands(None, 0), _transitions())
        result = "A control word is a command by bits 7, 3, 2, 1 and 0"
        return Steps("controlword", "Control word, object 6040h", _source(device), sections, result, {})
    _check_word(word)
    _check_word(previous)
    command = command_of(word, previous)
    stays = device is not None and device.drive is not None and device.drive.stays_in_quick_stop
    return Steps(
        "controlword",
        f"Control word {word:04X}h" + (f" after {previous:04X}h" if previous else ""),
        _source(device),
        (
            _bits(word, names),
            _commands(word, previous),
            *_edge(word, previous),
            _effect(word, previous, stays_in_quick_stop=stays),
            _mode_table(_CONTROL_MODES),
        ),
        f"{word:04X}h is {'no command' if command is None else f'the command {command.text}'}",
        {
            "word": word,
            "bits": [bit for bit in range(16) if word >> bit & 1],
            "command": None if command is None else command.text,
            "after": {state.value: after(state, word, previous, stays_in_quick_stop=stays).value for state in State},
        },
    )


def status_word_steps(word: int, device: Device | None = None) -> Steps:
    """Take a status word apart, and find the state in it.

    >>> status_word_steps(0x0637)
    <Steps statusword: 0637h is the state operation enabled>

    Raises EncodeError for a word outside 16 bits and for a device that is no drive.
    """
    _check_word(word)
    names = _bit_names(device, "status", _STATUS_BITS)
    state: State | None = None
    next_step = "No row fits. A drive shows such a word only during a transition; read it again."
    with suppress(DecodeError):
        state = state_of(word)
        next_step = _words_to_enable(state)
    return Steps(
        "statusword",
        f"Status word {word:04X}h",
        _source(device),
        (_bits(word, names), _states(word), next_step, _mode_table(_STATUS_MODES)),
        f"{word:04X}h is {f'the state {state.value}' if state else 'no state of CiA 402'}",
        {
            "word": word,
            "bits": [bit for bit in range(16) if word >> bit & 1],
            "state": state.value if state else None,
        },
    )


def _check_word(word: int) -> None:
    if not 0 <= word <= 0xFFFF:
        raise EncodeError(f"word {word:X}h: expected 0..FFFFh", "word")


def _source(device: Device | None) -> str:
    return "CiA 402, device control" + (
        f"; names of the bits: {device.title}, in parentheses those of the standard" if device is not None else ""
    )


def _bit_names(device: Device | None, which: str, standard: Mapping[int, str]) -> dict[int, str]:
    """Return the names of the bits: those of the description of a device, else those of the standard."""
    if device is None:
        return dict(standard)
    if device.drive is None:
        raise EncodeError(f"{device.name} is not a drive of CiA 402", "device")
    parameter = device.find(device.drive.control_word if which == "control" else device.drive.status_word)
    return {bit: parameter.bits.get(bit, f"({standard[bit]})") for bit in range(16)}


def _bits(word: int, names: Mapping[int, str]) -> StepTable:
    rows = tuple((str(bit), str(word >> bit & 1), names[bit]) for bit in _HIGHEST_FIRST)
    return StepTable(f"{word:04X}h = {grouped_bits(word, 16)}. The bits:", ("bit", "value", "meaning"), rows)


def _states(word: int) -> StepTable:
    rows = []
    for state, (mask, value) in STATUS_PATTERNS.items():
        masked = word & mask
        mark = "<--" if masked == value else ""
        rows.append((state.value, _pattern(mask, value, 7), f"{mask:04X}h", f"{masked:04X}h", f"{value:04X}h", mark))
    return StepTable(
        "The state is in bits 6, 5, 3, 2, 1 and 0 (x: any value). Keep the bits of the mask, and compare.",
        ("state", "6543210", "mask", "word & mask", "expected", ""),
        tuple(rows),
    )


def _pattern(mask: int, value: int, bits: int) -> str:
    """Return the lowest bits as drawn in CiA 402: x for a bit that may have any value."""
    return "".join(str(value >> bit & 1) if mask >> bit & 1 else "x" for bit in range(bits - 1, -1, -1))


def _commands(word: int | None, previous: int) -> StepTable:
    """Return the table of all commands; with a word, how it is compared with each of them."""
    header = ("command", "bit 7", "3", "2", "1", "0", "simplest")
    reset = ("fault reset", "0 to 1", "x", "x", "x", "x", "0080h")
    commands = []
    for command, (mask, value) in CONTROL_PATTERNS.items():
        pattern = _pattern(mask, value, 8)
        commands.append((command.text, *(pattern[7 - bit] for bit in (7, 3, 2, 1, 0)), f"{int(command):04X}h"))
    if word is None:
        return StepTable("The commands (x: any value):", header, (*commands, reset))
    is_reset = bool(word & ~previous & 0x80)  # the edge of bit 7; then the other bits are no command
    rows = []
    for cells, (mask, value) in zip(commands, CONTROL_PATTERNS.values()):
        mark = "<--" if word & mask == value and not is_reset else ""
        rows.append((*cells, f"{mask:04X}h", f"{word & mask:04X}h", f"{value:04X}h", mark))
    return StepTable(
        "The command is in bits 7, 3, 2, 1 and 0 (x: any value). Keep the bits of the mask, and compare.",
        (*header, "mask", "word & mask", "expected", ""),
        (*rows, (*reset, "", "", "", "<--" if is_reset else "")),
    )


def _edge(word: int, previous: int) -> list[StepSection]:
    if not word & 0x80:
        return []
    if previous & 0x80:
        return ["Bit 7 was 1 before and stays 1: there is no edge, so this is no fault reset. Write 0 first, then 1."]
    return [f"Bit 7 goes from 0 (in {previous:04X}h) to 1: that edge is the fault reset, whatever the other bits are."]


def _effect(word: int, previous: int, *, stays_in_quick_stop: bool) -> StepTable:
    rows = []
    for state in State:
        passed = transitions_by(state, word, previous, stays_in_quick_stop=stays_in_quick_stop)
        numbers = ", ".join(str(transition.number) for transition in passed)
        rows.append((state.value, numbers, passed[-1].target.value if passed else "stays"))
    return StepTable(
        "What it does, by the state that the drive is in:", ("state", "transition", "next state"), tuple(rows)
    )


def _transitions() -> StepTable:
    rows = []
    for number, source, target, command in TRANSITIONS:
        by = "by itself" if command is None else f"{command.text}, {int(command):04X}h"
        rows.append((str(number), source.value, by, target.value))
    return StepTable(
        "The transitions. Those that are not listed are 0, power on; 12, out of the quick stop by itself; 13, a fault. "
        "Only a drive that stays in its quick stop has 16.",
        ("no.", "from", "command", "to"),
        tuple(rows),
    )


def _words_to_enable(state: State) -> str:
    """Return the control words from this state to an enabled drive, in a sentence."""
    goal = State.OPERATION_ENABLED
    if state is goal:
        return "The motor is under control: the drive follows its target."
    if state in (State.NOT_READY_TO_SWITCH_ON, State.FAULT_REACTION_ACTIVE):
        return "The drive leaves this state by itself; no control word changes it."
    words: list[str] = []
    while state is not goal and len(words) < len(State):  # no way is longer
        word = next_control_word(state, goal)
        assert word is not None
        words.append(f"{word:04X}h")
        state = after(state, word)
    return (
        "From here to an enabled drive, write these control words, each after the state has changed: "
        f"{', '.join(words)}."
    )


def _mode_table(bits: Mapping[int, tuple[str, ...]]) -> StepTable:
    rows = tuple((str(bit), *texts) for bit, texts in bits.items())
    return StepTable("Bits that depend on the mode of operation (object 6060h):", ("bit", *_MODES), rows)
