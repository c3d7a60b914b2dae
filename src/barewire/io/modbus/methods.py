"""The base class of both Modbus clients: their methods, under the names of the standard.

    client.read_holding_registers(107, 3)                 -> (555, 0, 100)          the blocking client
    await client.read_holding_registers(107, 3)           -> (555, 0, 100)          the asyncio client
    client.at(unit=7).read_coils(0, 8)                    another unit of the same line

Each definition describes an operation once: an `Exchange` (a request, and the function for its response), several
`Exchanges`, or a `BusConversation`. `barewire.io.engine.methods` makes a method of it, blocking or awaited. The
parameters are those of the message; unit and time-out are those of the client, see `at`.

All methods raise ModbusException for an exception response, NoAnswer (WriteOutcomeUnknown for a write) after the
time-out, PortError if the port fails, and EncodeError for values that the message cannot carry. The file of a message
is loaded when its method is first called.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import index
from typing import TYPE_CHECKING, Any, Self, TypeVar

from barewire import modbus
from barewire.conversation import DEFAULT_TIMEOUT
from barewire.errors import EncodeError, shown
from barewire.io.endpoint import check_timeout
from barewire.io.engine.methods import bus_conversation, exchange, exchanges
from barewire.io.modbus.carriers import modbus_endpoint, unit_options

if TYPE_CHECKING:
    from pathlib import Path
    from ssl import SSLContext

    from barewire.codecs import Value
    from barewire.devices.device import Device
    from barewire.devices.parameter import Reading
    from barewire.io.endpoint import Endpoint, SetDirection
    from barewire.io.engine.methods import BusConversation, Exchange, Exchanges
    from barewire.modbus.client.read_identification import DeviceIdentification
    from barewire.modbus.messages.base import Request, Response
    from barewire.modbus.messages.comm_events import GetCommEventCounterResponse, GetCommEventLogResponse

V = TypeVar("V")


def checked_request(request: Request[Any]) -> None:
    """Raise TypeError unless this is a request message."""
    if isinstance(request, type) or not hasattr(request, "read_response"):
        text = "expected a request message, such as ReadHoldingRegisters(0, 2) of barewire.modbus"
        raise TypeError(f"{text}, got {request.__name__ if isinstance(request, type) else shown(request)}")


def _checked_unit(unit: Any) -> Any:
    """Return a unit address as a plain `int`, or None. Raise EncodeError for anything else."""
    if unit is None or (type(unit) is int and 0 <= unit <= 255):
        return unit
    from barewire.codecs.order import is_whole  # most units are plain numbers: a client loads no codec

    if isinstance(unit, bool) or not is_whole(unit, 0, 255):
        kind = "" if type(unit) is int else "a whole number in "
        raise EncodeError(f"unit {shown(unit)}: expected {kind}0..255", "unit")
    return index(unit)


def _described(device: str | Path | Device) -> Device:
    """Return the description of a device. A description needs no import, so a read by name stays quick."""
    if hasattr(device, "read_plans"):
        return device  # type: ignore[return-value]  # only a Device has plans
    from barewire.io.named_values import described

    return described(device)


def _bits(response: Any) -> tuple[bool, ...]:
    return response.bits  # type: ignore[no-any-return]


def _registers(response: Any) -> tuple[int, ...]:
    return response.registers  # type: ignore[no-any-return]


def _nothing(response: Response) -> None:
    """Return nothing: the response to a write only repeats the request."""


def _whole(response: V) -> V:
    return response


class ModbusMethods:
    """The settings and methods that both Modbus clients have. Their `ask` sends any other request message."""

    url: str
    """The URL of the server, with all options."""
    unit: int | None
    """The unit that methods address. None means the unit of the device that is passed, or 1."""
    timeout: float = DEFAULT_TIMEOUT
    """Seconds that a request waits for its response, except to a unit that has a time-out for itself."""
    _timeouts: Mapping[int, float]
    retries: int = 0
    """How often a read that got no response is repeated."""

    def __repr__(self) -> str:
        other = self.unit is not None and f"unit={self.unit}" not in self.url.partition("?")[2].split("&")
        return f"<{type(self).__name__} {self.url}{f', unit {self.unit}' if other else ''}>"

    def _configure(
        self,
        url: str,
        set_direction: SetDirection | None,
        ssl_context: SSLContext | None,
        options: Mapping[str, object],
    ) -> Endpoint:
        """Set the URL, the unit and the time-out, and return the endpoint."""
        if "unit" in options:
            options = {**options, "unit": _checked_unit(options["unit"])}
        check_timeout(options.get("timeout"))
        endpoint = modbus_endpoint(url, options).with_direction(set_direction).with_context(ssl_context)
        self.url = str(endpoint)
        self.unit = endpoint.integer("unit", 0) if "unit" in endpoint.options else None
        self.timeout = endpoint.timeout
        self._timeouts = {unit: unit_options(endpoint, unit).timeout for unit in endpoint.own_units}
        self.retries = endpoint.integer("retries", 0)
        return endpoint

    def at(self, unit: int | None = None, timeout: float | None = None) -> Self:
        """Return the same client on the same connection, with another unit, another time-out in seconds, or both. This
        time-out is that of every unit; it has an end.

        Closing either of them, also by `with`, closes the connection of both.
        """
        unit = _checked_unit(unit)
        check_timeout(timeout)
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other.unit = self.unit if unit is None else unit
        if timeout is not None:
            other.timeout, other._timeouts = timeout, {}
        return other

    def timeout_for(self, unit: int) -> float:
        """Return the seconds that a request to a unit waits for its response."""
        return self._timeouts.get(unit, self.timeout)

    def unit_for(self, unit: int | None = None, device: Device | None = None) -> int:
        """Return the given unit, or the client's, or the device's own, or 1."""
        if unit is not None:
            return int(_checked_unit(unit))
        if self.unit is not None:
            return self.unit
        return device.modbus.unit if device and device.modbus else 1

    def _ask_arguments(
        self, request: Request[Any], unit: int | None, timeout: float | None, retries: int | None
    ) -> tuple[int, float, int]:
        """Check the arguments of `ask`, and return the unit, the time-out and the number of retries."""
        checked_request(request)
        check_timeout(timeout)
        address = self.unit_for(unit)
        limit = self.timeout_for(address) if timeout is None else timeout
        return address, limit, self.retries if retries is None else retries

    @exchange
    def read_coils(self, address: int, quantity: int) -> Exchange[tuple[bool, ...]]:
        """Read 1 to 2000 coils from `address` on (function 01)."""
        return modbus.ReadCoils(address, quantity), _bits

    @exchange
    def read_discrete_inputs(self, address: int, quantity: int) -> Exchange[tuple[bool, ...]]:
        """Read 1 to 2000 discrete inputs from `address` on (function 02)."""
        return modbus.ReadDiscreteInputs(address, quantity), _bits

    @exchange
    def read_holding_registers(self, address: int, quantity: int) -> Exchange[tuple[int, ...]]:
        """Read 1 to 125 holding registers from `address` on (function 03)."""
        return modbus.ReadHoldingRegisters(address, quantity), _registers

    @exchange
    def read_input_registers(self, address: int, quantity: int) -> Exchange[tuple[int, ...]]:
        """Read 1 to 125 input registers from `address` on (function 04)."""
        return modbus.ReadInputRegisters(address, quantity), _registers

    @exchange
    def write_single_coil(self, address: int, value: bool) -> Exchange[None]:
        """Write one coil (function 05)."""
        return modbus.WriteSingleCoil(address, value), _nothing

    @exchange
    def write_single_register(self, address: int, value: int) -> Exchange[None]:
        """Write one holding register, 0..65535 (function 06)."""
        return modbus.WriteSingleRegister(address, value), _nothing

    @exchange
    def write_multiple_coils(self, address: int, bits: Sequence[bool | int]) -> Exchange[None]:
        """Write 1 to 1968 coils from `address` on (function 0F)."""
        return modbus.WriteMultipleCoils(address, bits), _nothing

    @exchange
    def write_multiple_registers(self, address: int, registers: Sequence[int]) -> Exchange[None]:
        """Write 1 to 123 holding registers from `address` on (function 10h)."""
        return modbus.WriteMultipleRegisters(address, registers), _nothing

    @exchange
    def mask_write_register(self, address: int, and_mask: int, or_mask: int) -> Exchange[None]:
        """Set a holding register to (its value AND and_mask) OR (or_mask AND NOT and_mask) (function 16h)."""
        return modbus.MaskWriteRegister(address, and_mask, or_mask), _nothing

    @exchange
    def read_write_multiple_registers(
        self, read_address: int, read_quantity: int, write_address: int, registers: Sequence[int]
    ) -> Exchange[tuple[int, ...]]:
        """Write 1 to 121 holding registers, then read 1 to 125, in one exchange (function 17h)."""
        request = modbus.ReadWriteMultipleRegisters(read_address, read_quantity, write_address, registers)
        return request, _registers

    @exchange
    def read_fifo_queue(self, address: int) -> Exchange[tuple[int, ...]]:
        """Read the up to 31 registers of a FIFO queue, which stay in it (function 18h)."""
        return modbus.ReadFifoQueue(address), _registers

    @exchange
    def read_file_record(self, places: Sequence[tuple[int, int, int]]) -> Exchange[tuple[tuple[int, ...], ...]]:
        """Read records of files (function 14h). `places` are (file, record, length in registers)."""
        return modbus.ReadFileRecord(places), lambda response: response.records

    @exchange
    def write_file_record(self, records: Sequence[tuple[int, int, Sequence[int]]]) -> Exchange[None]:
        """Write records of files (function 15h). `records` are (file, record, registers)."""
        return modbus.WriteFileRecord(records), _nothing

    @exchange
    def read_exception_status(self) -> Exchange[int]:
        """Read the eight exception status bits (function 07, serial lines)."""
        return modbus.ReadExceptionStatus(), lambda response: response.status

    @exchange
    def diagnostics(self, sub_function: int, data: bytes = b"\0\0") -> Exchange[bytes]:
        """Carry out a diagnostic sub-function and return the data of its response (function 08, serial lines)."""
        return modbus.Diagnostics(sub_function, data), lambda response: response.data

    @exchange
    def get_comm_event_counter(self) -> Exchange[GetCommEventCounterResponse]:
        """Read the status and the event counter (function 0B, serial lines)."""
        return modbus.GetCommEventCounter(), _whole

    @exchange
    def get_comm_event_log(self) -> Exchange[GetCommEventLogResponse]:
        """Read the status, the counters and the latest 64 events (function 0C, serial lines)."""
        return modbus.GetCommEventLog(), _whole

    @exchange
    def report_server_id(self) -> Exchange[bytes]:
        """Read the server's ID, run indicator and additional data (function 11h, serial lines)."""
        return modbus.ReportServerId(), lambda response: response.data

    @bus_conversation
    def read_device_identification(self, read_code: int = 1) -> BusConversation[DeviceIdentification]:
        """Read the basic (1), regular (2) or extended (3) identification objects (function 2Bh/0Eh), all of them."""
        from barewire.modbus.client.read_identification import read_device_identification

        unit = self.unit_for()
        timeout = self.timeout_for(unit)
        return (lambda bus: read_device_identification(bus, unit, read_code, timeout=timeout)), unit

    @exchanges
    def read(self, device: str | Path | Device, *names: str, unit: int | None = None) -> Exchanges[list[Reading]]:
        """Read the named values of a device with as few requests as it allows. The result is in the order of `names`.

        `device` is a description, or the name or path of one. Raises UnknownName, and EncodeError without names.
        """
        if not names:
            raise EncodeError("read: expected names of parameters; every one is connect(device, url).read_all()")
        description = _described(device)
        plan = description.read_plans.get(names)
        if plan is None:
            from barewire.devices.modbus_access import read_plan

            plan = read_plan(description, names)
        return self.unit_for(unit, description), plan.requests, plan.notes, plan.readings

    @bus_conversation
    def write(
        self, device: str | Path | Device, values: Mapping[str, Value], *, unit: int | None = None, force: bool = False
    ) -> BusConversation[None]:
        """Write named values in the order given. Ranges and access are checked before anything is sent.

        `device` is a description, or the name or path of one. `force` leaves ranges and access to the device; a value
        that the wire cannot carry is still an EncodeError.
        """
        from barewire.devices.modbus_access import write_modbus

        description = _described(device)
        address = self.unit_for(unit, description)
        timeout = self.timeout_for(address)
        return (lambda bus: write_modbus(bus, address, description, values, timeout=timeout, force=force)), address

    @bus_conversation
    def broadcast(self, request: Request[Any], *, turnaround: float = 0.1) -> BusConversation[None]:
        """Send a write request to all units of a serial line, which do not answer. Then wait `turnaround` seconds, in
        which the units act."""
        checked_request(request)
        return (lambda bus: bus.broadcast(request, turnaround=turnaround)), None

    @bus_conversation
    def settle(self) -> BusConversation[None]:
        """Wait until no late answer can arrive any more, for example before another program uses the serial line."""
        return (lambda bus: bus.settle()), None
