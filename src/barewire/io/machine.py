"""A machine by name, on Modbus or CANopen: `barewire.connect("az3", "can://socketcan/can0?node=5")`.

    with connect("az3", "rtu:///dev/ttyUSB0?unit=1") as az3:                  on Modbus, with the same methods
        az3["STATUS WORD"], az3.read_all(), az3.drive.enable()

    async with connect_async("az3", "can://socketcan/can0?node=5") as az3:
        await az3.read("STATUS WORD")

A can:// URL means CANopen, any other one Modbus. The unit or node is that of the URL, or the device's own; so are the
settings of a serial line. On a line that several machines share, they are those of the one that opens it.
`machine.client` is the Modbus or CANopen client, for everything that has no name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self

from barewire.devices.device import Device
from barewire.devices.parameter import Reading
from barewire.errors import EncodeError
from barewire.io.endpoint import Endpoint
from barewire.io.named_values import AsyncNamedValues, ModbusNames, NamedValues, described

if TYPE_CHECKING:
    from pathlib import Path

    from barewire.codecs import Value
    from barewire.io.canopen.async_client import AsyncCanopenClient
    from barewire.io.canopen.client import CanopenClient
    from barewire.io.canopen.node import AsyncDeviceNode, DeviceNode
    from barewire.io.modbus.async_client import AsyncModbusClient
    from barewire.io.modbus.client import ModbusClient

_SERIAL = {"baudrate": "baudrate", "data_bits": "bytesize", "parity": "parity", "stop_bits": "stopbits"}
"""The keys of a table [serial] that set the line, and their options in a URL."""


def connect(device: str | Path | Device, url: str, **options: Any) -> MachineClient:
    """Connect to a machine, and return a client for its values by name.

    device      the description of the machine, or the name or path of one
    url         `barewire.io.endpoint` lists the forms
    options     those of `ModbusClient` or `CanopenClient`: `unit` or `node`, `timeout` in seconds, `watch`, ...

    Raises UnknownName for a name that is not in the catalogue, EncodeError for a wrong URL or option, or a device that
    is not on this kind of bus, and PortError for a port that cannot be opened.
    """
    return MachineClient(_described(device, url), url, **options)


def connect_async(device: str | Path | Device, url: str, **options: Any) -> AsyncMachineClient:
    """Return the same client for asyncio. `async with` connects; without it, the first request does."""
    return AsyncMachineClient(_described(device, url), url, **options)


def _described(device: str | Path | Device, url: str) -> Device:
    if isinstance(device, str) and "://" in device:
        raise EncodeError(f"device {device!r} is a URL: the device comes first, connect({url!r}, {device!r})", "device")
    return described(device)


def _is_canopen(device: Device, url: str) -> bool:
    is_canopen = Endpoint.parse(url).scheme == "can"
    if (device.canopen if is_canopen else device.modbus) is None:
        raise EncodeError(f"endpoint {url!r}: {device.name} has no {'CANopen' if is_canopen else 'Modbus'}")
    return is_canopen


def serial_settings(device: Device, url: str) -> dict[str, Any]:
    """Return the settings of a serial line with which the device is delivered, without those that the URL names.

    >>> serial_settings(described("adxl"), "rtu:///dev/ttyUSB0?baudrate=19200&stopbits=2")
    {'bytesize': 8, 'parity': 'N'}
    """
    endpoint, delivered = Endpoint.parse(url), device.extra.get("serial")
    if not endpoint.is_serial_port or not isinstance(delivered, dict):
        return {}
    given = {option: delivered[key] for key, option in _SERIAL.items() if key in delivered}
    settings = {option: value for option, value in given.items() if option not in endpoint.options}
    try:
        Endpoint.parse(url, settings)
    except EncodeError as error:
        error.add_context(f"so says [serial] in the description of {device.name}")
        raise
    return settings


def _with_settings(device: Device, url: str, options: dict[str, Any]) -> dict[str, Any]:
    settings = serial_settings(device, url)
    return options | {option: value for option, value in settings.items() if options.get(option) is None}


class MachineClient(NamedValues):
    """A machine and its client."""

    def __init__(self, device: Device, url: str, **options: Any) -> None:
        self.device = device
        self.client: ModbusClient | CanopenClient
        self._access: _ModbusValues | DeviceNode
        # Imported here, so that a machine on Modbus loads no module of CANopen, nor one on CANopen any of Modbus.
        if _is_canopen(device, url):
            from barewire.io.canopen.client import CanopenClient

            self.client = CanopenClient(url, **options)
            self._access = self.client.node(device=device)
        else:
            from barewire.io.modbus.client import ModbusClient

            self.client = ModbusClient(url, **_with_settings(device, url, options))
            self._access = _ModbusValues(self.client, device)

    def __repr__(self) -> str:
        return f"<{self.device.name} by {self.client!r}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the client."""
        self.client.close()

    @property
    def readable(self) -> list[str]:
        """The names of all parameters that can be read over this wire."""
        return self._access.readable

    def _read(self, names: Sequence[str]) -> list[Reading]:
        return self._access.read_all(names)

    def _write(self, values: Mapping[str, Value], force: bool) -> None:
        self._access.write(values, force=force)


class AsyncMachineClient(AsyncNamedValues):
    """A machine and its client, for asyncio.

    With `shared`, the client of another machine on the same line, it uses that one's connection. Raises EncodeError if
    that is of the other protocol.
    """

    def __init__(
        self,
        device: Device,
        url: str,
        *,
        shared: AsyncModbusClient | AsyncCanopenClient | None = None,
        **options: Any,
    ) -> None:
        self.device = device
        self.client: AsyncModbusClient | AsyncCanopenClient
        self._access: _AsyncModbusValues | AsyncDeviceNode
        endpoint = Endpoint.parse(url)
        if _is_canopen(device, url):
            from barewire.io.canopen.async_client import AsyncCanopenClient

            if shared is not None and not isinstance(shared, AsyncCanopenClient):
                raise EncodeError(f"{url}: shared is {shared!r}: expected the client of a machine on the same CAN bus")
            self.client = AsyncCanopenClient(url, **options) if shared is None else shared
            node = endpoint.integer("node", 0) or None
            self._access = self.client.node(node, device=device, timeout=endpoint.timeout)
        else:
            from barewire.io.modbus.async_client import AsyncModbusClient

            if shared is not None and not isinstance(shared, AsyncModbusClient):
                raise EncodeError(
                    f"{url}: shared is {shared!r}: expected the client of a machine on the same Modbus line"
                )
            if shared is None:
                client = AsyncModbusClient(url, **_with_settings(device, url, options))
            else:
                from barewire.io.modbus.carriers import unit_options

                assert device.modbus is not None, "`_is_canopen` has checked it"
                unit = endpoint.integer("unit", device.modbus.unit)
                options_of_unit = shared.bus.state.units.own[unit] = unit_options(endpoint, unit)
                client = shared.at(unit=unit, timeout=options_of_unit.timeout)
            self.client = client
            self._access = _AsyncModbusValues(client, device)

    def __repr__(self) -> str:
        return f"<{self.device.name} by {self.client!r}>"

    async def __aenter__(self) -> Self:
        await self.client.__aenter__()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the client."""
        await self.client.close()

    @property
    def readable(self) -> list[str]:
        """The names of all parameters that can be read over this wire."""
        return self._access.readable

    async def _read(self, names: Sequence[str]) -> list[Reading]:
        return await self._access.read_all(names)

    async def _write(self, values: Mapping[str, Value], force: bool) -> None:
        await self._access.write(values, force=force)


class _ModbusValues(ModbusNames, NamedValues):
    """The values of a device on Modbus."""

    def __init__(self, client: ModbusClient, device: Device) -> None:
        self.client, self.device = client, device

    def _read(self, names: Sequence[str]) -> list[Reading]:
        return self.client.read(self.device, *names) if names else []

    def _write(self, values: Mapping[str, Value], force: bool) -> None:
        self.client.write(self.device, values, force=force)


class _AsyncModbusValues(ModbusNames, AsyncNamedValues):
    """The values of a device on Modbus, for asyncio."""

    def __init__(self, client: AsyncModbusClient, device: Device) -> None:
        self.client, self.device = client, device

    async def _read(self, names: Sequence[str]) -> list[Reading]:
        return await self.client.read(self.device, *names) if names else []

    async def _write(self, values: Mapping[str, Value], force: bool) -> None:
        await self.client.write(self.device, values, force=force)
