"""What a panel shows of a machine before anything is read, and the frames of a write before they are sent."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from barewire.codecs import Value
from barewire.devices import Device, Parameter
from barewire.devices.cia402 import STATUS_PATTERNS, TRANSITIONS
from barewire.devices.parameter import show
from barewire.devices.request_checks import to_write
from barewire.errors import EncodeError
from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.dry_run import address_text, frames_of
from barewire_workbench.cli.shown_frames import ShownFrames
from barewire_workbench.cli.value_text import parse_value
from barewire_workbench.settings.rules import KeptSetting, SettingRules


def value_to_write(
    device: Device, name: str, text: str, menus: Mapping[str, KeptSetting]
) -> tuple[Parameter, Any, dict[str, Any]]:
    """Return a parameter, its value in a text, and what is written for it, by name in this order: for a setting of a
    menu the numbers of the menu first. Raises BarewireError for what cannot be written."""
    if (setting := menus.get(name)) is not None:
        value = setting.parameter.check(parse_value(setting.parameter, text))
        return setting.parameter, value, {**setting.select, setting.read_as: value}
    parameter = device.find(name)
    value = parse_value(parameter, text)
    ((parameter, _),) = to_write(device, {parameter.name: value}, False)
    return parameter, value, {parameter.name: value}


def planned_frames(endpoint: str, device: Device, values: Mapping[str, Value]) -> list[tuple[str, str]]:
    """Return the frames that write values by name, in this order, each with its meaning."""
    rows: list[tuple[str, str]] = []
    shown = _Collected(endpoint, device, rows)
    for frame in frames_of(endpoint, device, values, force=False):
        shown.show("would send", frame)
    return rows


class _Collected(ShownFrames):
    """Collects explained frames."""

    def __init__(self, endpoint: str, device: Device, rows: list[tuple[str, str]]) -> None:
        super().__init__(endpoint, device)
        self._rows = rows

    def show_frame(self, word: str, digits: str, explanation: Any) -> None:
        """Add a frame."""
        self._rows.append((digits, explanation.verdict))


def description(device: Device, endpoint: str) -> dict[str, Any]:
    """Return what the page shows of a device before anything is read: its groups, parameters, and role as a drive."""
    is_can = Endpoint.parse(endpoint).scheme == "can"
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in device.parameters:
        if (row.object if is_can else row.modbus) is not None:
            groups.setdefault(row.group or "Parameters", []).append(_row(row, is_can))
    drive = None
    if device.drive is not None:
        drive = {
            "status": device.drive.status_word,
            "control": device.drive.control_word,
            "patterns": {state.value: pattern for state, pattern in STATUS_PATTERNS.items()},
            "transitions": [
                (step.number, step.source.value, step.target.value, step.command.text, int(step.command))
                for step in TRANSITIONS
                if step.command is not None
            ],
        }
    ramp = _ramp(device, is_can)
    first = _first_group(device, groups, ramp)
    return {"device": device.name, "endpoint": endpoint, "groups": groups, "first": first, "drive": drive, "ramp": ramp}


def _first_group(device: Device, groups: Mapping[str, list[dict[str, Any]]], ramp: dict[str, Any] | None) -> str:
    """Return the group that opens: that with most of what tells how the machine moves, by the roles of a drive or the
    traces of a ramp; then most measured values with a unit, then most values that only the machine changes. Rows
    that differ by a number, such as those of a log, count once."""
    roles = {role for role in device.drive or () if isinstance(role, str)}
    roles |= {ramp["status"], *ramp["traces"]} if ramp else set()

    def rank(group: str) -> tuple[int, int, int, bool]:
        rows = [row for row in groups[group] if row["access"] == "ro"]
        kinds = {re.sub(r"\d+", "", row["name"]): row for row in rows}
        moving = sum(row["name"] in roles for row in rows)
        is_readable = any(row["access"] != "wo" for row in groups[group])
        return moving, sum(bool(row["unit"]) for row in kinds.values()), len(kinds), is_readable

    return max(groups, key=rank, default="")


def _ramp(device: Device, is_can: bool) -> dict[str, Any] | None:
    """Return what a start and a stop are seen by, None without a table [ramp]. Raises EncodeError for a wrong one."""
    table = device.extra.get("ramp")
    if table is None:
        return None
    menus = SettingRules.of(device).behind_menus(is_can=is_can)
    try:
        found: dict[str, Any] = {key: device.find(table[key]).name for key in ("status", "start", "stop")}
        found["traces"] = [device.find(name).name for name in table["traces"]]
        found["settings"] = [
            _row(device.find(name), is_can)
            if name not in menus
            else _row(menus[name].parameter, is_can) | {"place": menus[name].place(is_can=is_can), "menu": True}
            for name in table["settings"]
        ]
    except (KeyError, TypeError, AttributeError):
        expected = "expected the names status, start and stop, and the lists traces and settings"
        raise EncodeError(f"{device.name}: [ramp]: {expected}") from None
    return found


def _row(row: Parameter, is_can: bool) -> dict[str, Any]:
    return {
        "name": row.name,
        "type": row.type,
        "unit": row.unit,
        "access": row.access,
        "range": range_text(row),
        "place": address_text(row, is_can=is_can),
        "values": {str(number): text for number, text in row.values.items()},
        "note": row.note,
    }


def range_text(row: Parameter) -> str:
    """Return the range as a page shows it; empty without limits."""
    if row.minimum is None and row.maximum is None:
        return ""
    low, high = ("" if limit is None else show(limit) for limit in (row.minimum, row.maximum))
    return f"{low} … {high}".strip()
