"""Which values of a described device are settings, and what its manual requires when they are written.

The table [settings] of a description (`catalog/README.md` of `barewire.devices`) becomes `SettingRules`:

    kind = "setting"      of a row       -> a KeptSetting
    first, communication                 -> the order: first, the others as described, communication at last
    select, selected, menus              -> a KeptSetting behind numbers, which are written before it
    store, store_takes, idle, ...        -> what restoring does besides

A device without this table has settings too, and nothing that stores them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

from barewire.codecs import Value
from barewire.devices import Device, Parameter
from barewire.errors import EncodeError, shown


class KeptSetting(NamedTuple):
    """A setting of a device.

    parameter        its name, unit, range and place
    read_as          the name of the parameter by which it is read and written: its own, or that of all menus
    select           what is written before that: the numbers of a menu
    communication    whether it changes how the device is reached
    """

    parameter: Parameter
    read_as: str
    select: Mapping[str, int]
    communication: bool = False

    @property
    def name(self) -> str:
        """The name of the setting."""
        return self.parameter.name

    def place(self, *, is_can: bool) -> str:
        """Return where it is, in words.

        >>> from barewire import load
        >>> [setting.place(is_can=False) for setting in SettingRules.of(load("adxl")).settings(is_can=False)][0]
        'holding 20483 after 1, 0, 4'
        """
        place = self.parameter.places[is_can]
        return place + (f" after {', '.join(map(str, self.select.values()))}" if self.select else "")


class SettingRules(NamedTuple):
    """The settings of a device and how they are restored.

    store, store_communication   the commands that make the device keep what was written, with their values
    store_takes                  seconds that this takes, in which the device must stay on
    idle                         the values of parameters at which it may be written
    model, versions              names of parameters that identify the device: what it must be, and what may differ
    """

    device: Device
    first: Sequence[str] = ()
    communication: Sequence[str] = ()
    store: Mapping[str, Value] = {}
    store_communication: Mapping[str, Value] = {}
    store_takes: float = 0.0
    idle: Mapping[str, Sequence[Value]] = {}
    model: Sequence[str] = ()
    versions: Sequence[str] = ()
    select: Sequence[str] = ()
    selected: str = ""
    menus: Sequence[Mapping[str, Any]] = ()

    @classmethod
    def of(cls, device: Device) -> SettingRules:
        """Return the rules of a device. Raises EncodeError for a wrong table [settings]."""
        table = device.extra.get("settings", {})
        if not isinstance(table, Mapping):
            raise EncodeError(f"{device.name}: settings: expected a table with {', '.join(_TYPES)}")
        for key, value in table.items():
            if key not in _TYPES:
                raise EncodeError(f"{device.name}: [settings] {shown(key)}: expected {', '.join(_TYPES)}")
            if not isinstance(value, _TYPES[key]):
                expected = {list: "a list", dict: "a table", str: "a name"}.get(_TYPES[key], "a number")
                raise EncodeError(f"{device.name}: [settings] {key} = {shown(value)}: expected {expected}")
        rules = cls(device, **table)
        rules._check()
        return rules

    def _check(self) -> None:
        for name in (*self.store, *self.store_communication, *self.idle, *self.model, *self.versions, *self.select):
            self.device.find(name)
        if self.menus:
            self.device.find(self.selected)
        for menu in self.menus:
            at = menu.get("at")
            if not (isinstance(menu.get("name"), str) and isinstance(at, list) and len(at) == len(self.select)):
                expected = f"name and at = [{', '.join(self.select)}]"
                raise EncodeError(f"{self.device.name}: [settings] menus: {shown(menu)}: expected {expected}")

    def settings(self, *, is_can: bool) -> list[KeptSetting]:
        """Return the settings that can be reached on this kind of bus, in the order in which they are written."""
        rows = [row for row in self.device.parameters if (row.object if is_can else row.modbus)]
        kept = [KeptSetting(row, row.name, {}) for row in rows if row.kind == "setting"]
        kept += self._of_menus(rows)
        kept = [setting._replace(communication=_matches(setting.name, self.communication)) for setting in kept]
        return sorted(kept, key=lambda setting: (setting.communication, self._rank(setting.name)))

    def behind_menus(self, *, is_can: bool) -> dict[str, KeptSetting]:
        """Return the settings that are reached behind the numbers of a menu, by name."""
        return {setting.name: setting for setting in self.settings(is_can=is_can) if setting.select}

    def _of_menus(self, rows: Iterable[Parameter]) -> list[KeptSetting]:
        carrier = next((row for row in rows if row.name == self.selected), None)
        if carrier is None:
            return []
        found = []
        for menu in self.menus:
            parameter = replace(
                carrier,
                name=menu["name"],
                unit=menu.get("unit", ""),
                minimum=menu.get("min"),
                maximum=menu.get("max"),
                kind="setting",
                storable=True,
                note="",
            )
            found.append(KeptSetting(parameter, carrier.name, dict(zip(self.select, menu["at"]))))
        return found

    def _rank(self, name: str) -> int:
        return next((rank for rank, first in enumerate(self.first) if fnmatchcase(name, first)), len(self.first))


_TYPES: Mapping[str, Any] = {
    **dict.fromkeys(("first", "communication", "model", "versions", "select", "menus"), list),
    **dict.fromkeys(("store", "store_communication", "idle"), dict),
    "selected": str,
    "store_takes": (int, float),
}


def without_unmapped(settings: Iterable[KeptSetting], values: Mapping[str, Value | None]) -> list[KeptSetting]:
    """Return the settings without entries of a PDO mapping behind the number of mapped objects, which say nothing.
    `values` has that number by the name of its setting."""
    kept, counts = [], {}
    for setting in sorted(settings, key=lambda setting: setting.parameter.places[1]):
        place, value = setting.parameter.object, values.get(setting.name)
        if place is not None and place.index in _MAPPINGS:
            if place.sub == 0:
                counts[place.index] = value
            count = counts.get(place.index)
            if isinstance(count, int) and place.sub > count:
                continue
        kept.append(setting.name)
    return [setting for setting in settings if setting.name in set(kept)]


_MAPPINGS = (*range(0x1600, 0x1800), *range(0x1A00, 0x1C00))


def _matches(name: str, patterns: Iterable[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)
