"""A CAN bus behind the gateway: Modbus clients reach the objects of CANopen nodes.

    2B/0D, both dialects       read or write any object          an SDO abort is the extended exception of 2B/0D
    01 to 06, 0F, 10           named parameters as registers     of a description of the device, or of an EDS
                               and coils                         and a table of registers

Each unit is a node. Its registers are those that the description has for Modbus: a client made for an AZ3 on RS-485
drives one on CAN. A request reads or writes whole parameters, and is one SDO transfer for each object.

    SDO abort code                                                           exception
    0602 0000, 0609 0011 no such object; 0601 xxxx no access                 02
    0609 003x, 0606 0010, 0607 001x a value, or a length                     03
    0504 0000 the node did not respond in time                               0B
    any other; the object has another type than the description says         04
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from barewire.canopen import SdoAbort
from barewire.codecs import Value, pack_bits
from barewire.devices.device import CanopenSettings, Device, ModbusSettings
from barewire.devices.parameter import ModbusAt, ObjectAt, Parameter, TableName
from barewire.errors import BarewireError, DecodeError, EncodeError, NoAnswer, PortError
from barewire.gateway.backend import FAILED, Backend
from barewire.gateway.dispatch import NO_RESPONSE, Exchange
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire.modbus.exceptions import (
    ILLEGAL_DATA_ADDRESS,
    ILLEGAL_DATA_VALUE,
    ILLEGAL_FUNCTION,
    SERVER_DEVICE_FAILURE,
    ModbusException,
)
from barewire.modbus.messages import coils, registers
from barewire.modbus.messages.base import Response
from barewire.modbus.messages.canopen_reference import (
    CanopenReference,
    CanopenReferenceResponse,
    ExtendedExceptionResponse,
)
from barewire.modbus.messages.raw import RawRequest
from barewire.modbus.messages.registry import request_class

_LANES = 8
"""Nodes that are asked at the same time. Each node has one request under way."""

_READS: dict[int, TableName] = {1: "coil", 2: "discrete", 3: "holding", 4: "input"}
_LONGEST = 253
"""Bytes of the longest PDU."""
_RETRY = 1.0
"""Seconds after which a bus that could not be opened is tried again."""


@dataclass(frozen=True)
class NodeConfig:
    """A node behind a unit address. `device` has the names that are served as registers."""

    node: int
    device: Device | None = None


def device_of_eds(eds: str | Path, table: Mapping[int, tuple[int, int]]) -> Device:
    """Return a description with objects of an EDS as holding registers: first register -> (index, sub-index).

    A value of 32 bits takes two registers, the more significant first. Raises EncodeError for an object that the EDS
    does not have or whose type has no fixed width, and for registers that overlap.
    """
    from barewire.io.canopen.node import dictionary_of

    objects = dictionary_of(eds, 1)
    parameters, after = [], 0
    for address, (index, sub) in sorted(table.items()):
        entry = objects.entry(index, sub)
        if entry.type not in ("bool", "u8", "u16", "u32", "u64", "i8", "i16", "i32", "i64", "f32", "f64"):
            raise EncodeError(f"register {address}: {index:04X}h:{sub:02X} is {entry.type}, which fits no registers")
        if address < after:
            raise EncodeError(f"register {address}: it belongs to the value before")
        words = max(1, int(entry.type[1:]) // 16) if entry.type != "bool" else 1
        after = address + words
        parameters.append(
            Parameter(
                f"{index:04X}:{sub:02X} {entry.name}",
                entry.type,
                access={"const": "ro"}.get(entry.access, entry.access),  # type: ignore[arg-type]
                minimum=entry.minimum,
                maximum=entry.maximum,
                modbus=ModbusAt("holding", address, words),
                object=ObjectAt(index, sub),
            )
        )
    return Device("eds", str(eds), tuple(parameters), modbus=ModbusSettings(), canopen=CanopenSettings())


@dataclass
class _Registers:
    """The parameters of a device by the addresses that they take, in one table."""

    by_address: dict[int, list[Parameter]] = field(default_factory=dict)

    def add(self, parameter: Parameter, place: ModbusAt) -> None:
        for address in range(place.address, place.address + place.words):
            self.by_address.setdefault(address, []).append(parameter)

    def within(self, first: int, quantity: int) -> list[tuple[ModbusAt, Parameter]]:
        """Return the parameters at these addresses, by address. Raises ModbusException 02 unless every address belongs
        to one, and none is cut."""
        place_of: dict[Parameter, ModbusAt] = {}
        for address in range(first, first + quantity):
            parameters = self.by_address.get(address)
            if not parameters:
                raise ModbusException(ILLEGAL_DATA_ADDRESS)
            place_of |= {parameter: parameter.modbus for parameter in parameters if parameter.modbus is not None}
        for place in place_of.values():
            if place.address < first or place.address + place.words > first + quantity:
                raise ModbusException(ILLEGAL_DATA_ADDRESS)
        return [(place, parameter) for parameter, place in place_of.items()]


class CanopenUnit:
    """One node as a Modbus unit."""

    def __init__(self, client: AsyncCanopenClient, config: NodeConfig, timeout: float) -> None:
        self.config = config
        self._sdo = client.node(config.node, timeout=timeout).sdo
        self._tables: dict[TableName, _Registers] = {}
        self._node: Any = None
        if config.device is not None:
            self._node = client.node(config.node, device=config.device, timeout=timeout)
            for parameter in config.device.parameters:
                if parameter.modbus is not None and parameter.object is not None and parameter.type != "text":
                    table = self._tables.setdefault(parameter.modbus.table, _Registers())
                    table.add(parameter, parameter.modbus)
            # A device may report a value that it would not accept, and the client shall see it.
            unlimited = [replace(row, minimum=None, maximum=None) for row in config.device.parameters]
            reader = replace(config.device, parameters=tuple(unlimited))
            self._reader = client.node(config.node, device=reader, timeout=timeout)

    async def handle(self, request: RawRequest) -> bytes:
        """Return the PDU of the response. Raises ModbusException, SdoAbort, NoAnswer, PortError."""
        known = request.known
        if known is None:
            raise ModbusException(ILLEGAL_DATA_VALUE if request_class(request.pdu) else ILLEGAL_FUNCTION)
        if isinstance(known, CanopenReference):
            return (await self._reference(known)).encode()
        match known:
            case registers.ReadHoldingRegisters(address, quantity) | coils.ReadCoils(address, quantity):
                return await self._read(known.function_code, address, quantity)
            case registers.WriteSingleRegister(address, value):
                await self._write_registers(address, (value,))
            case registers.WriteMultipleRegisters(address, values):
                await self._write_registers(address, values)
            case coils.WriteSingleCoil(address, on):
                await self._write_coils(address, (on,))
            case coils.WriteMultipleCoils(address, bits):
                await self._write_coils(address, bits)
            case _:
                raise ModbusException(ILLEGAL_FUNCTION)
        return request.pdu[:5]  # address and value, or address and quantity

    async def _reference(self, request: CanopenReference) -> Response:
        """Read or write an object by 2B/0D. A long value is read in parts, each from `start` on."""
        if request.node != self.config.node:
            raise ModbusException(ILLEGAL_DATA_ADDRESS)
        answer = CanopenReferenceResponse(
            request.node, request.index, request.sub_index, request.start, dialect=request.dialect
        )
        try:
            if request.write:
                if request.start:
                    raise ModbusException(ILLEGAL_DATA_VALUE)
                await self._sdo.download(request.index, request.sub_index, request.data)
                return replace(answer, write=True, count=request.count)
            data = await self._sdo.upload(request.index, request.sub_index)
        except SdoAbort as abort:
            return ExtendedExceptionResponse(abort.code)
        fits = _LONGEST - len(answer.encode())
        part = bytes(data[request.start : request.start + min(request.count, fits)])
        return replace(answer, count=len(part), data=part)

    async def _read(self, function: int, first: int, quantity: int) -> bytes:
        table = self._tables.get(_READS[function], _Registers())
        cells = table.within(first, quantity)
        if not all(parameter.readable for _, parameter in cells):
            raise ModbusException(ILLEGAL_DATA_ADDRESS)
        readings = await self._reader.read_all([parameter.name for _, parameter in cells])
        content = dict.fromkeys(range(first, first + quantity), 0)
        for (place, parameter), reading in zip(cells, readings):
            if place.table in ("coil", "discrete"):
                content[place.address] = int(bool(reading.value))
                continue
            unlimited = replace(parameter, minimum=None, maximum=None)
            words = unlimited.to_registers(reading.value, (content[place.address],) if place.partial else ())
            content |= dict(zip(range(place.address, place.address + place.words), words))
        if function in (1, 2):
            return _response(function, pack_bits([bool(bit) for bit in content.values()]))
        return _response(function, b"".join(word.to_bytes(2, "big") for word in content.values()))

    async def _write_registers(self, first: int, words: Sequence[int]) -> None:
        table = self._tables.get("holding", _Registers())
        values: dict[str, Value] = {}
        for place, parameter in table.within(first, len(words)):
            start = place.address - first
            values[parameter.name] = parameter.from_registers(words[start : start + place.words])
        await self._write(values)

    async def _write_coils(self, first: int, bits: Sequence[Any]) -> None:
        table = self._tables.get("coil", _Registers())
        cells = table.within(first, len(bits))
        await self._write({parameter.name: bool(bits[place.address - first]) for place, parameter in cells})

    async def _write(self, values: dict[str, Value]) -> None:
        try:
            await self._node.write(values)
        except EncodeError as error:
            writable = all(self.config.device.find(name).writable for name in values) if self.config.device else False
            raise ModbusException(ILLEGAL_DATA_VALUE if writable else ILLEGAL_DATA_ADDRESS) from error


def _response(function: int, data: bytes) -> bytes:
    return bytes((function, len(data))) + data


def exception_of(abort: SdoAbort) -> int:
    """Return the exception code of an SDO abort, see the head of this file.

    >>> [exception_of(SdoAbort(code, 0x6040, 0)) for code in (0x06020000, 0x06090030, 0x05040000, 0x08000022)]
    [2, 3, 11, 4]
    """
    code = abort.code
    if code == 0x05040000:
        return NO_RESPONSE
    if code in (0x06020000, 0x06090011) or code >> 16 == 0x0601:
        return ILLEGAL_DATA_ADDRESS
    if code >> 16 in (0x0607,) or code in (0x06060010, 0x06090030, 0x06090031, 0x06090032, 0x06090036):
        return ILLEGAL_DATA_VALUE
    return SERVER_DEVICE_FAILURE


class CanopenBackend(Backend):
    """A CAN bus. `nodes` are by unit address."""

    def __init__(self, *arguments: Any, nodes: Mapping[int, NodeConfig], **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.dispatcher.one_each = True
        self._nodes = nodes
        self._free = list(range(min(_LANES, len(nodes))))
        self._units: dict[int, CanopenUnit] = {}
        self._client: AsyncCanopenClient | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._not_before = 0.0
        self._quiet_at = 0.0  # until then an answer to an earlier transfer may come

    @property
    def is_connected(self) -> bool:
        """Whether the bus is open. A bus that fails is opened again by the client."""
        return self._client is not None

    def _is_ready(self, lane: int) -> bool:
        return self._client is not None

    def _may_open(self, now: float) -> bool:
        return now >= self._not_before

    @property
    def awaits_answers(self) -> bool:
        """Whether an answer to an earlier request may still come."""
        return self._loop.time() < self._quiet_at

    async def _settle(self) -> None:
        await asyncio.sleep(self._quiet_at - self._loop.time())

    def _take_over(self, before: Backend) -> None:
        if isinstance(before, CanopenBackend):
            self._quiet_at = max(self._quiet_at, before._quiet_at)

    async def _open(self) -> None:
        await self._settle()  # after another backend on this bus
        client = AsyncCanopenClient(str(self.endpoint))
        try:
            self._units = {
                unit: CanopenUnit(client, config, self.dispatcher.unit(unit).options.timeout)
                for unit, config in self._nodes.items()
            }
            await client.open()
        except BarewireError:
            self._not_before = self._loop.time() + _RETRY
            raise
        self._client = client

    def _send(self, lane: int, exchange: Exchange) -> None:
        task = self._loop.create_task(self._carry_out(lane, exchange))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _carry_out(self, lane: int, exchange: Exchange) -> None:
        response: bytes | int = FAILED
        is_silence = False
        function = exchange.request.function_code | 0x80
        try:
            response = await self._units[exchange.unit].handle(exchange.request)
            self.cannot_open = False
        except ModbusException as declined:
            response = bytes((function, declined.code))
        except SdoAbort as abort:
            self._note(exchange.unit, str(abort))
            response = bytes((function, exception_of(abort)))
        except DecodeError as error:  # it answered, and its description has another type
            self._note(exchange.unit, str(error))
            response = bytes((function, SERVER_DEVICE_FAILURE))
        except (NoAnswer, PortError) as error:
            self._note(exchange.unit, str(error))
            is_silence = not isinstance(error, PortError)
            self.cannot_open = not is_silence
            response = NO_RESPONSE
        except asyncio.CancelledError:
            response = NO_RESPONSE
            raise
        except Exception as error:
            self._fail(error)
        finally:
            if response == NO_RESPONSE:
                self._quiet_at = max(self._quiet_at, self._loop.time() + 2 * exchange.timeout)
            self._ended(lane, response, is_silence=is_silence)

    async def _close(self) -> None:
        for task in self._tasks:
            task.cancel()
        if self._tasks:
            await asyncio.wait(self._tasks)
        if self._client is not None:
            await self._client.close()
