"""Reading and writing by name: conversations over either bus, planned, checked, and with values in the unit.

    ["STATUS WORD", "DC BUS"]      names
        | find                     one name -> one Parameter; UnknownName has the nearest names
        | access, range, address   all of the call, before anything is sent: EncodeError
        | plan                     Modbus: the fewest requests.   CANopen: each object once
        | ask, upload, download    the exchanges
        v decode                   [Reading("STATUS WORD", 0x0637), Reading("DC BUS", 320.0)]   in this order

A value that is less than a register or an object (a bit, half a register) is read, changed and written back. Between
the two exchanges the device may change the rest of it; that change is lost.

`force` leaves range and access to the device, for users who know better than its manual. A value that cannot be encoded
is refused nevertheless.

Depends on: Device, the plan, the Modbus bus, the SDO channel.  Used by: the clients of `io`, the drive code.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from barewire.canopen import STANDARD, CanFrame, Channel, SdoDialect, download, fit, upload
from barewire.codecs import Value
from barewire.conversation import Conversation
from barewire.devices.block_decoder import BlockDecoder, block_decoder
from barewire.devices.device import Device
from barewire.devices.parameter import ObjectAt, Parameter, Reading
from barewire.devices.plan import PlannedWrite, plan_reads, plan_writes
from barewire.devices.request_checks import (
    NameOrParameter,
    ValuesByName,
    may_not_answer,
    naming,
    reading_note,
    to_read,
    to_write,
    writing,
)
from barewire.errors import BarewireError, EncodeError
from barewire.modbus import (
    Bus,
    ReadCoils,
    ReadDiscreteInputs,
    ReadHoldingRegisters,
    ReadInputRegisters,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)

# Modbus

_READS: dict[int, Any] = {1: ReadCoils, 2: ReadDiscreteInputs, 3: ReadHoldingRegisters, 4: ReadInputRegisters}
_MOST_PLANS = 256
"""More plans than this are not kept for one device: a program that polls has a few lists of names."""


class ReadPlan(NamedTuple):
    """The requests for a list of names, and how to decode the responses. The device keeps it: it is made once."""

    requests: list[Any]
    notes: list[str]
    """The note that an error of each request gets: the parameters that it reads."""

    decoders: list[BlockDecoder]
    parameters: list[Parameter]
    """The parameter of each name."""
    numbers: list[int]
    """The number of its value among those of all responses."""

    def readings(self, responses: Iterable[Any]) -> list[Reading]:
        """The readings in the responses to `requests`, one for each name."""
        values: list[Value] = []
        for request, decode, response in zip(self.requests, self.decoders, responses):
            values += decode(response.bits if request.function_code <= 2 else response.registers)
        return list(map(Reading, self.parameters, map(values.__getitem__, self.numbers)))


def read_plan(device: Device, names: tuple[NameOrParameter, ...]) -> ReadPlan:
    """The plan for reading these names. Raises what `read_modbus` raises at once."""
    plan: ReadPlan | None = device.read_plans.get(names)
    if plan is None:
        parameters = to_read(device, names)
        blocks = plan_reads(device, parameters)
        members = [member.parameter.name for block in blocks for member in block.members]
        numbers = {name: number for number, name in enumerate(members)}
        plan = ReadPlan(
            [_READS[block.function](block.address, block.quantity) for block in blocks],
            [reading_note(block.parameters) for block in blocks],
            [block_decoder(block) for block in blocks],
            parameters,
            [numbers[parameter.name] for parameter in parameters],
        )
        if len(device.read_plans) >= _MOST_PLANS:
            device.read_plans.clear()
        device.read_plans[names] = plan
    return plan


def read_modbus(
    bus: Bus, unit: int, device: Device, names: Iterable[NameOrParameter], *, timeout: float = 1.0
) -> Conversation[bytes, list[Reading]]:
    """Read parameters of `unit`, which is a `device`: one Reading for each name, in the order of the names.

    Raises at once UnknownName, and EncodeError for a parameter that is write only or not on Modbus; in the conversation
    the errors of `ask`, and DecodeError. `timeout` (seconds) is that of each request.
    """
    return _read_modbus(bus, unit, read_plan(device, tuple(names)), timeout)


def _read_modbus(bus: Bus, unit: int, plan: ReadPlan, timeout: float) -> Conversation[bytes, list[Reading]]:
    responses = []
    for request, note in zip(plan.requests, plan.notes):
        try:
            responses.append((yield from bus.ask(unit, request, timeout=timeout)))
        except BarewireError as error:
            error.add_note(note)
            raise
    return plan.readings(responses)


def write_modbus(
    bus: Bus, unit: int, device: Device, values: ValuesByName, *, timeout: float = 1.0, force: bool = False
) -> Conversation[bytes, None]:
    """Write parameters of `unit`, which is a `device`, in the order of `values`.

    Raises at once UnknownName, and EncodeError for a parameter that is read only, out of range, not on Modbus, or wider
    than one request of the device; in the conversation the errors of `ask`, with a note of what was written before.
    """
    pairs = to_write(device, values, force)
    writes = plan_writes(device, [parameter for parameter, _ in pairs])
    for parameter, value in pairs:
        _registers(parameter, value, [0])
    return _write_modbus(bus, unit, writes, pairs, timeout)


def _registers(parameter: Parameter, value: Value, old: Sequence[int]) -> tuple[int, ...]:
    """The value as registers; that of a coil as one number, 0 or 1."""
    if parameter.modbus is not None and parameter.modbus.table == "coil":
        return (int(bool(parameter.check(value))),)
    with naming(parameter, value):
        return parameter.to_registers(value, old)


def _write_modbus(
    bus: Bus,
    unit: int,
    writes: Sequence[PlannedWrite],
    pairs: Sequence[tuple[Parameter, Value]],
    timeout: float,
) -> Conversation[bytes, None]:
    # The plan keeps the order: the members of all writes, one after the other, are the pairs.
    remaining = iter(pairs)
    done: list[str] = []
    for write in writes:
        with writing(write.parameters, done):
            content: list[int] = []
            if write.keep:
                old = yield from bus.ask(unit, _READS[write.read_function](write.address, 1), timeout=timeout)
                content += old.registers
            for _ in write.members:
                parameter, value = next(remaining)
                new = _registers(parameter, value, content)
                content = list(new) if write.keep else [*content, *new]
            with may_not_answer(write.parameters):
                yield from _write_entries(bus, unit, write.function, write.address, content, timeout)
        done += [parameter.name for parameter in write.parameters]


def _write_entries(
    bus: Bus, unit: int, function: int, address: int, content: Sequence[int], timeout: float
) -> Conversation[bytes, None]:
    """Write registers or bits with this function; function 06 writes one register at a time, the lowest first."""
    if function == 15:
        yield from bus.ask(unit, WriteMultipleCoils(address, tuple(map(bool, content))), timeout=timeout)
    elif function == 16:
        yield from bus.ask(unit, WriteMultipleRegisters(address, tuple(content)), timeout=timeout)
    elif function == 5:
        yield from bus.ask(unit, WriteSingleCoil(address, bool(content[0])), timeout=timeout)
    else:
        for offset, register in enumerate(content):
            yield from bus.ask(unit, WriteSingleRegister(address + offset, register), timeout=timeout)


# CANopen


def read_canopen(
    node: int | Channel,
    device: Device,
    names: Iterable[NameOrParameter],
    *,
    timeout: float = 1.0,
    dialect: SdoDialect | None = None,
) -> Conversation[CanFrame, list[Reading]]:
    """Read parameters of `node`, which is a `device`: one Reading for each name, in the order of the names.

    `node` is a node-ID or a channel to it; `dialect` is that of the standard if it is not given. Several bits of one
    object are one transfer. Raises at once UnknownName, and EncodeError for a parameter that is write only or not on
    CANopen; in the conversation the errors of `upload`, and DecodeError.
    """
    parameters = to_read(device, names)
    for parameter in parameters:
        _object(device, parameter)
    return _read_canopen(_channel(node, dialect), device, parameters, timeout)


def _read_canopen(
    channel: Channel, device: Device, parameters: Sequence[Parameter], timeout: float
) -> Conversation[CanFrame, list[Reading]]:
    contents: dict[tuple[int, int, int], bytes] = {}
    readings = []
    for parameter in parameters:
        place = _object(device, parameter)
        key = (place.index, place.sub, parameter.object_size)
        if key not in contents:
            try:
                contents[key] = yield from _upload(channel, parameter, place, timeout)
            except BarewireError as error:
                error.add_note(reading_note([parameter]))
                raise
        readings.append(Reading(parameter, parameter.from_object(contents[key])))
    return readings


def write_canopen(
    node: int | Channel,
    device: Device,
    values: ValuesByName,
    *,
    timeout: float = 1.0,
    dialect: SdoDialect | None = None,
    force: bool = False,
) -> Conversation[CanFrame, None]:
    """Write parameters of `node`, which is a `device`, one after the other in the order of `values`.

    Raises at once UnknownName, and EncodeError for a parameter that is read only, out of range or not on CANopen; in
    the conversation the errors of `download`, with a note of what was written before.
    """
    pairs = to_write(device, values, force)
    for parameter, value in pairs:
        place = _object(device, parameter)
        with naming(parameter, value):
            parameter.to_object(value, bytes(parameter.object_size))
        if place.bit is not None and not parameter.readable and not force:
            raise EncodeError(f"{parameter.name} is one bit of an object that cannot be read: the rest would be lost")
    return _write_canopen(_channel(node, dialect), device, pairs, timeout)


def _write_canopen(
    channel: Channel, device: Device, pairs: Sequence[tuple[Parameter, Value]], timeout: float
) -> Conversation[CanFrame, None]:
    done: list[str] = []
    for parameter, value in pairs:
        place = _object(device, parameter)
        with writing([parameter], done):
            old = b""
            if place.bit is not None:
                old = yield from _upload(channel, parameter, place, timeout)
            data = parameter.to_object(value, old)
            if channel.dialect.lengths == "in four":
                data = data.ljust(4, b"\0")
            with may_not_answer([parameter]):
                yield from download(channel, place.index, place.sub, data, timeout=timeout)
        done.append(parameter.name)


def _upload(channel: Channel, parameter: Parameter, place: ObjectAt, timeout: float) -> Conversation[CanFrame, bytes]:
    """The bytes of the object, as many as the type has."""
    size = parameter.object_size
    data = yield from upload(channel, place.index, place.sub, timeout=timeout, size=size)
    # The size of an object of which only one bit is described is assumed, so nothing is cut off.
    return data if place.bit is not None else fit(data, size)


def _object(device: Device, parameter: Parameter) -> ObjectAt:
    """The object of a parameter; EncodeError with its address on Modbus if it has none, or if it has no size."""
    if parameter.object is None or device.canopen is None:
        where = parameter.modbus
        elsewhere = f"it is {where.table} {where.address} on Modbus (from 0)" if where else "it has no other address"
        raise EncodeError(f"{parameter.name} is no object of CANopen: {elsewhere}", parameter.name)
    _ = parameter.object_size  # text has no size: refused before anything is sent
    return parameter.object


def _channel(node: int | Channel, dialect: SdoDialect | None) -> Channel:
    if isinstance(node, Channel):
        if dialect is not None and dialect != node.dialect:
            raise EncodeError(
                f"the channel to node {node.node} has the SDO dialect {node.dialect.name}, not {dialect.name}"
            )
        return node
    return Channel(node, dialect or STANDARD)
