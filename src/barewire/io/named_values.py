"""The values of a described machine by name, on Modbus or CANopen.

    az3["STATUS WORD"]                     Reading: the parameter, its value and unit
    az3["TARGET VELOCITY"] = 1500
    az3.read("STATUS WORD")                Reading
    az3.read("STATUS WORD", "DC BUS")      list of Reading, with as few requests as the device allows
    az3.read_all()                         every readable parameter
    az3.write("TARGET VELOCITY", 1500)
    az3.write({"PROFILE ACCELERATION": 100, "TARGET VELOCITY": 1500})         in this order
    az3.drive.enable()                     if it is a drive of CiA 402

With asyncio each method is awaited, and brackets are not available. Names, ranges and access are checked before
anything is sent.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING, Any, overload

from barewire.errors import DecodeError, EncodeError, Refused, shown

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from barewire.codecs import Value
    from barewire.devices.device import Device
    from barewire.devices.parameter import Reading
    from barewire.io.drive import AsyncDriveClient, DriveClient


def described(device: str | Path | Device) -> Device:
    """Return a description, or load it by its name or path. Raises EncodeError for any other object."""
    from pathlib import Path

    from barewire.devices.description.load import load
    from barewire.devices.device import Device

    if isinstance(device, (str, Path)):
        return load(device)
    if not isinstance(device, Device):
        raise EncodeError(f"device {shown(device)}: expected the name or the path of a description, or a Device")
    return device


def _in_a_list(readings: list[Reading]) -> list[Reading]:
    """Return the readings in a list that a notebook shows as a table."""
    from barewire.devices.parameter import Readings

    return Readings(readings)


class _Names(ABC):
    """The base class of values by name: the device, and the checks of arguments."""

    device: Device

    @property
    @abstractmethod
    def readable(self) -> list[str]:
        """The names of all parameters that can be read over this wire."""

    def _names(self, names: Iterable[Any] | None) -> list[str]:
        if isinstance(names, str):
            raise EncodeError(f"read_all({names!r}): expected several names; one is read(name)")
        if names is None:
            alone = self.device.extra.get("read_alone", ())  # a reading changes something, or needs something first
            return [name for name in self.readable if name not in alone]
        wanted = list(names)
        for name in wanted:
            if not isinstance(name, str):
                by_index = self.device.canopen is not None and isinstance(name, (int, tuple))
                hint = "by index it is node.sdo.upload" if by_index else "expected a text"
                raise EncodeError(f"{shown(name)} is not the name of a parameter of {self.device.name}; {hint}")
        return wanted

    def _values(self, name: Any, value: Value | None) -> Mapping[str, Value]:
        if isinstance(name, Mapping):
            if value is not None:
                raise EncodeError("write: expected a name and a value, or a mapping of names to values")
        elif value is None:
            raise EncodeError(f"write({name!r}): expected a value, or a mapping of names to values")
        else:
            name = {name: value}
        self._names(name)
        return name  # type: ignore[no-any-return]

    # The values cannot be iterated over or searched: Python would call __getitem__ with 0, 1, 2, ...
    __iter__: None = None
    __contains__: None = None


class ModbusNames(_Names):
    """The names of the values of a device on Modbus."""

    @property
    def readable(self) -> list[str]:
        """The names of all parameters that can be read over Modbus."""
        return [parameter.name for parameter in self.device.parameters if parameter.modbus and parameter.readable]


class CanopenNames(_Names):
    """The names of the values of a device in its object dictionary."""

    @property
    def readable(self) -> list[str]:
        """The names of all parameters that can be read over CANopen."""
        return [parameter.name for parameter in self.device.parameters if parameter.object and parameter.readable]


class NamedValues(_Names):
    """The values of a machine."""

    @abstractmethod
    def _read(self, names: Sequence[str]) -> list[Reading]:
        """Read these parameters."""

    @abstractmethod
    def _write(self, values: Mapping[str, Value], force: bool) -> None:
        """Write these parameters."""

    @overload
    def read(self, name: str, /) -> Reading: ...
    @overload
    def read(self, first: str, second: str, /, *others: str) -> list[Reading]: ...
    def read(self, *names: str) -> Reading | list[Reading]:
        """Read one parameter, or several; return one reading, or a list in the order of the names."""
        if not names:
            raise EncodeError("read(): expected a name; every readable parameter is read_all()")
        readings = self._read(self._names(names))
        return readings[0] if len(names) == 1 else _in_a_list(readings)

    def read_all(self, names: Iterable[str] | None = None) -> list[Reading]:
        """Read the parameters with these names, in their order. Without names, read every readable parameter, and leave
        out those that the machine refuses, and those that the description lists under [read_alone]."""
        wanted = self._names(names)
        try:
            return _in_a_list(self._read(wanted))
        except (Refused, DecodeError):
            if names is not None:
                raise
        readings = []
        for name in wanted:
            with suppress(Refused, DecodeError):
                readings += self._read([name])
        return _in_a_list(readings)

    @overload
    def write(self, name: str, value: Value, /, *, force: bool = False) -> None: ...
    @overload
    def write(self, values: Mapping[str, Value], /, *, force: bool = False) -> None: ...
    def write(self, name: str | Mapping[str, Value], value: Value | None = None, /, *, force: bool = False) -> None:
        """Write one parameter, or several in the order given. `force` skips the checks of range and access."""
        self._write(self._values(name, value), force)

    def __getitem__(self, name: str) -> Reading:
        return self._read(self._names([name]))[0]

    def __setitem__(self, name: str, value: Value) -> None:
        self._write(self._values(name, value), False)

    @cached_property
    def drive(self) -> DriveClient:
        """The machine as a CiA 402 drive. Raises EncodeError for any other machine."""
        from barewire.io.drive import DriveClient

        return DriveClient(self)


class AsyncNamedValues(_Names):
    """The values of a machine, for asyncio."""

    if not TYPE_CHECKING:

        def __getitem__(self, name: str) -> Any:
            raise TypeError(f"{type(self).__name__}: reading takes time: write `await machine.read({name!r})`")

        def __setitem__(self, name: str, value: Value) -> None:
            raise TypeError(
                f"{type(self).__name__}: writing takes time: write `await machine.write({name!r}, {value!r})`"
            )

    @abstractmethod
    async def _read(self, names: Sequence[str]) -> list[Reading]:
        """Read these parameters."""

    @abstractmethod
    async def _write(self, values: Mapping[str, Value], force: bool) -> None:
        """Write these parameters."""

    @overload
    async def read(self, name: str, /) -> Reading: ...
    @overload
    async def read(self, first: str, second: str, /, *others: str) -> list[Reading]: ...
    async def read(self, *names: str) -> Reading | list[Reading]:
        """Read one parameter, or several; return one reading, or a list in the order of the names."""
        if not names:
            raise EncodeError("read(): expected a name; every readable parameter is read_all()")
        readings = await self._read(self._names(names))
        return readings[0] if len(names) == 1 else _in_a_list(readings)

    async def read_all(self, names: Iterable[str] | None = None) -> list[Reading]:
        """Read the parameters with these names, in their order. Without names, read every readable parameter, and leave
        out those that the machine refuses, and those that the description lists under [read_alone]."""
        wanted = self._names(names)
        try:
            return _in_a_list(await self._read(wanted))
        except (Refused, DecodeError):
            if names is not None:
                raise
        readings = []
        for name in wanted:
            with suppress(Refused, DecodeError):
                readings += await self._read([name])
        return _in_a_list(readings)

    @overload
    async def write(self, name: str, value: Value, /, *, force: bool = False) -> None: ...
    @overload
    async def write(self, values: Mapping[str, Value], /, *, force: bool = False) -> None: ...
    async def write(
        self, name: str | Mapping[str, Value], value: Value | None = None, /, *, force: bool = False
    ) -> None:
        """Write one parameter, or several in the order given. `force` skips the checks of range and access."""
        await self._write(self._values(name, value), force)

    @cached_property
    def drive(self) -> AsyncDriveClient:
        """The machine as a CiA 402 drive. Raises EncodeError for any other machine."""
        from barewire.io.drive import AsyncDriveClient

        return AsyncDriveClient(self)
