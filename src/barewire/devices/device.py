"""A device: its parameters by name, and its settings on Modbus, on CANopen and as a drive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

from barewire.codecs.order import Order
from barewire.devices.parameter import Parameter, TableName
from barewire.errors import BarewireError, EncodeError, fold, shown, suggest

_UNORDERED = ("bool", "text")


class UnknownName(BarewireError, LookupError):
    """No parameter or device has this name; the text has the nearest names."""


class ModbusSettings(NamedTuple):
    """The settings of a device on Modbus: its addresses as delivered, its limits (registers) and its functions."""

    unit: int = 1
    port: int = 502
    read_limit: int = 125
    write_limit: int = 123
    read_functions: Mapping[TableName, int] = {"holding": 3, "input": 4, "coil": 1, "discrete": 2}
    write_functions: Mapping[TableName, tuple[int, ...]] = {"holding": (6, 16), "coil": (5, 15)}
    order: Order = "ABCD"

    def __repr__(self) -> str:
        limits = f"reads up to {self.read_limit}, writes up to {self.write_limit} registers"
        return f"<ModbusSettings: unit {self.unit}, order {self.order}, {limits}>"


class DevicePdo(NamedTuple):
    """A default PDO: `cob_id` is without the node-ID, `map` holds (index, sub-index, bits)."""

    name: str
    cob_id: int
    transmission: int
    map: tuple[tuple[int, int, int], ...]


class CanopenSettings(NamedTuple):
    """The settings of a device on CANopen as delivered: node-ID, bit rate (bit/s), SDO dialect and default PDOs."""

    node: int = 1
    bitrate: int = 125_000
    dialect: str = "standard"
    pdos: tuple[DevicePdo, ...] = ()

    def __repr__(self) -> str:
        rate = f"{self.bitrate} bit/s, dialect {self.dialect}"
        return f"<CanopenSettings: node {self.node}, {rate}, {len(self.pdos)} PDOs>"


class DriveRoles(NamedTuple):
    """Names of the parameters with a role in a drive of CiA 402, numbers of its modes, departures from the profile.

    Every role except the two words may be missing (""); actions that need it then raise EncodeError.
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

    def __repr__(self) -> str:
        modes = ", ".join(f"{name} {number}" for name, number in self.modes.items()) or "none"
        return f"<DriveRoles: {self.status_word}, {self.control_word}, modes {modes}>"


@dataclass(frozen=True)
class Device:
    """A machine by its description. `extra` holds the tables of the description that the format does not define."""

    name: str
    title: str
    parameters: tuple[Parameter, ...]
    documents: tuple[str, ...] = ()
    modbus: ModbusSettings | None = None
    canopen: CanopenSettings | None = None
    drive: DriveRoles | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        buses = " and ".join(name for name, side in (("Modbus", self.modbus), ("CANopen", self.canopen)) if side)
        return f"<Device {self.name}: {self.title}, {len(self.parameters)} parameters{buses and f', {buses}'}>"

    def _repr_html_(self) -> str:
        from barewire._html import html_table  # only a notebook needs these two
        from barewire.devices.parameter import range_text

        titles = ("name", "access", "type", "range and unit", "Modbus", "CANopen")
        rows = (
            (row.name, row.access, row.type, f"{range_text(row)} {row.unit}".strip(), *row.places)
            for row in self.parameters
        )
        return html_table(titles, rows, f"{self.title}: {len(self.parameters)} parameters")

    @cached_property
    def _by_name(self) -> dict[str, Parameter]:
        return {fold(parameter.name): parameter for parameter in self.parameters}

    @cached_property
    def read_plans(self) -> dict[Any, Any]:
        """The plans of earlier reads by their names: see `modbus_access.py`."""
        return {}

    def find(self, name: str) -> Parameter:
        """Return the parameter of that name; case and extra blanks do not matter.

        Raises UnknownName with the nearest names.
        """
        parameter = self._by_name.get(fold(name))
        if parameter is None:
            hint = suggest(name, self._by_name, lambda folded: self._by_name[folded].name)
            raise UnknownName(f"{self.name} has no parameter {shown(name)}{hint}")
        return parameter

    def in_order(self, order: Order) -> Device:
        """Return the same machine with this order of bytes in registers; a row with an order of its own keeps it."""
        if self.modbus is None:
            return self
        parameters = []
        for parameter in self.parameters:
            place = parameter.modbus
            if place is not None and place.order == self.modbus.order and parameter.type not in _UNORDERED:
                parameter = replace(parameter, modbus=place._replace(order=order))
            parameters.append(parameter)
        return replace(self, parameters=tuple(parameters), modbus=self.modbus._replace(order=order))


def drive_roles(device: Device) -> DriveRoles:
    """Return the roles of a device as a drive. Raises EncodeError if its description has no table [drive]."""
    if device.drive is None:
        raise EncodeError(f"{device.name} is not a drive: its description has no table [drive]")
    return device.drive
