"""The table [drive] of a description: which parameter plays which part in CiA 402, and the numbers of the modes.

    status_word = "STATUS WORD"         the parameter must be there; what is watched must be readable,
    control_word = "CONTROL WORD"       what is commanded writable, a word a u16
    modes = { position = 1, velocity = 3 }

`drive.py` is written against the parts, so one code moves every drive that has such a table.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from barewire.devices.description.rules import Rule, TomlTable, Unfit, number, table_of, text, truth, whole
from barewire.devices.device import DriveRoles, fold, suggest
from barewire.devices.parameter import Parameter

WATCHED = ("status_word", "mode_display", "error_code", "position", "velocity")
COMMANDED = (
    *("control_word", "mode", "target_position", "target_velocity", "profile_velocity"),
    *("acceleration", "deceleration", "homing_method", "homing_speed_switch", "homing_speed_zero"),
)
MODES = ("position", "velocity", "homing")


def _seconds(value: Any) -> float:
    found = float(number(value))
    if not 0 <= found <= 60:
        raise Unfit("expected seconds, 0..60")
    return found


RULES: dict[str, Rule] = {
    **dict.fromkeys((*WATCHED, *COMMANDED), text),
    "modes": table_of(dict.fromkeys(MODES, whole(-128, 127))),
    "stays_in_quick_stop": truth,
    "settle": _seconds,
}
REQUIRED = ("status_word", "control_word")


def read_drive_table(block: TomlTable, parameters: Mapping[str, Parameter]) -> DriveRoles:
    """The table as a DriveSide; `parameters` by their folded names. DescriptionError with file, line and key."""
    values = block.read(RULES, REQUIRED)
    for key in (*WATCHED, *COMMANDED):
        if key in values:
            values[key] = _part(block, key, values[key], parameters)
    if values.get("modes") and "mode" not in values:
        raise block.error("modes", "nothing to write them to; expected mode in the same table")
    return DriveRoles(**values)


def _part(block: TomlTable, key: str, name: str, parameters: Mapping[str, Parameter]) -> str:
    """The name as the parameter has it, after a look at whether it can play this part."""
    found = parameters.get(fold(name))
    if found is None:
        titles = {folded: parameter.name for folded, parameter in parameters.items()}
        raise block.error(key, f"{name!r} is no parameter of this device{suggest(name, titles, titles.__getitem__)}")
    if key in WATCHED and not found.readable:
        raise block.error(key, f"{found.name!r} is write only; expected one that can be read")
    if key in COMMANDED and not found.writable:
        raise block.error(key, f"{found.name!r} is read only; expected one that can be written")
    if key in REQUIRED and found.type != "u16":
        raise block.error(key, f"{found.name!r} is of type {found.type!r}; expected u16")
    if found.type in ("text", "bool"):
        raise block.error(key, f"{found.name!r} is of type {found.type!r}; expected a number")
    return found.name
