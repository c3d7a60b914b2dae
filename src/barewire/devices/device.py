"""A device: its parameters by name, and what it says of itself on Modbus and on CANopen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from typing import Any, NamedTuple

from barewire.codecs.order import Order
from barewire.devices.parameter import Parameter, TableName
from barewire.errors import BarewireError

UNORDERED = ("bool", "text")


class UnknownName(BarewireError, LookupError):
    """No parameter or device has this name; the text tells the nearest ones."""


class ModbusSettings(NamedTuple):
    """What a device says of itself on Modbus."""

    unit: int = 1
    port: int = 502
    read_limit: int = 125
    write_limit: int = 123
    read_functions: Mapping[TableName, int] = {"holding": 3, "input": 4, "coil": 1, "discrete": 2}
    write_functions: Mapping[TableName, tuple[int, ...]] = {"holding": (6, 16), "coil": (5, 15)}
    order: Order = "ABCD"


class DevicePdo(NamedTuple):
    """A default PDO: `cob_id` is without the node id, `map` holds (index, sub-index, bits)."""

    name: str
    cob_id: int
    transmission: int
    map: tuple[tuple[int, int, int], ...]


class CanopenSettings(NamedTuple):
    """What a device says of itself on CANopen."""

    node: int = 1
    bitrate: int = 125_000
    dialect: str = "standard"
    pdos: tuple[DevicePdo, ...] = ()


class DriveRoles(NamedTuple):
    """What a drive of CiA 402 says of itself: which parameter plays which part, and where it departs from the profile.

    Every part but the two words may be missing (""): what needs it is then refused, and nothing else.
    """

    status_word: str
    control_word: str
    mode: str = ""
    mode_display: str = ""
    error_code: str = ""
    position: str = ""
    velocity: str = ""
    target_position: str = ""
    target_velocity: str = ""
    profile_velocity: str = ""
    acceleration: str = ""
    deceleration: str = ""
    homing_method: str = ""
    homing_speed_switch: str = ""
    homing_speed_zero: str = ""
    modes: Mapping[str, int] = {}
    stays_in_quick_stop: bool = False
    settle: float = 0.0


@dataclass(frozen=True)
class Device:
    """A machine by its description. `extra` holds the tables of its description that are no parameters."""

    name: str
    title: str
    parameters: tuple[Parameter, ...]
    documents: tuple[str, ...] = ()
    modbus: ModbusSettings | None = None
    canopen: CanopenSettings | None = None
    drive: DriveRoles | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def _by_name(self) -> dict[str, Parameter]:
        return {fold(parameter.name): parameter for parameter in self.parameters}

    def find(self, name: str) -> Parameter:
        """The parameter of that name, whatever its case and blanks. UnknownName suggests the nearest ones."""
        found = self._by_name.get(fold(name))
        if found is None:
            raise UnknownName(f"{self.name} has no parameter {name!r}{suggest(name, self._by_name, self._named)}")
        return found

    def in_order(self, order: Order) -> Device:
        """The same machine, laying its numbers in registers in another order than described.

        What a row of the description orders by itself keeps its order.
        """
        if self.modbus is None:
            return self
        usual = self.modbus.order
        moved = tuple(
            replace(parameter, modbus=place._replace(order=order))
            if (place := parameter.modbus) is not None and place.order == usual and parameter.type not in UNORDERED
            else parameter
            for parameter in self.parameters
        )
        return replace(self, parameters=moved, modbus=self.modbus._replace(order=order))

    def _named(self, folded: str) -> str:
        return self._by_name[folded].name


def fold(name: str) -> str:
    """A name as it is compared.

    >>> fold("  Thyristors   Temperature ")
    'thyristors temperature'
    """
    return " ".join(name.casefold().split())


def suggest(name: str, known: Mapping[str, Any], title: Any = str) -> str:
    """'; did you mean ...?' with up to three near names, or nothing."""
    wanted = fold(name)
    near = get_close_matches(wanted, known, n=3, cutoff=0.6)
    near += [other for other in known if wanted and wanted in other and other not in near][: 3 - len(near)]
    return f"; did you mean {' or '.join(repr(title(other)) for other in near)}?" if near else ""
