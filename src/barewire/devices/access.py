"""Read and write by name: conversations over either bus, planned, checked, and told in the unit of the parameter.

    ["STATUS WORD", "DC BUS"]      what is asked for
        | find                     one name -> one Parameter; UnknownName suggests
        | access, range, place     all of the call, before anything is sent: EncodeError
        | plan                     Modbus: the fewest requests.   CANopen: each object once
        | ask, upload, download    the turns of talk
        v decode                   [Reading("STATUS WORD", 0x0637), Reading("DC BUS", 320.0)]   in the order asked

What is smaller than the thing that travels (a bit, half a register) is read, changed and written back; between the two
turns the rest of it may change on the device, and nobody would see it.

`force` leaves range and access to the device, for whoever knows better than its manual. What the wire cannot carry
is refused all the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from barewire.canopen import STANDARD, CanFrame, Channel, SdoDialect, download, fit, upload
from barewire.codecs import Value
from barewire.conversation import Conversation
from barewire.devices.block_decoder import block_decoder
from barewire.devices.device import Device
from barewire.devices.parameter import ObjectAt, Parameter, Reading
from barewire.devices.plan import PlannedRead, PlannedWrite, plan_reads, plan_writes
from barewire.devices.request_checks import Name, Values, naming, reading, to_read, to_write, unanswered, writing
from barewire.errors import EncodeError
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


def read_modbus(
    bus: Bus, unit: int, device: Device, names: Iterable[Name], *, timeout: float = 1.0
) -> Conversation[bytes, list[Reading]]:
    """Read parameters of `unit`, which is a `device`: one Reading for each name, in the order asked.

    Raises at once UnknownName, and EncodeError for what is write only or not on Modbus; in the conversation what
    `ask` raises, and DecodeError.
    """
    parameters = to_read(device, names)
    return _read_modbus(bus, unit, parameters, plan_reads(device, parameters), timeout)


def _read_modbus(
    bus: Bus, unit: int, parameters: Sequence[Parameter], blocks: Sequence[PlannedRead], timeout: float
) -> Conversation[bytes, list[Reading]]:
    values: dict[str, Value] = {}
    for block in blocks:
        with reading(parameter for parameter, _ in block.members):
            content = yield from _read_entries(bus, unit, block.function, block.address, block.quantity, timeout)
        values |= block_decoder(block)(content)
    return [Reading(parameter, values[parameter.name]) for parameter in parameters]


def _read_entries(
    bus: Bus, unit: int, function: int, address: int, quantity: int, timeout: float
) -> Conversation[bytes, Sequence[int]]:
    """Registers or bits, with the function that the device wants."""
    if function in (1, 2):
        bits = ReadCoils if function == 1 else ReadDiscreteInputs
        return (yield from bus.ask(unit, bits(address, quantity), timeout=timeout)).bits
    registers = ReadHoldingRegisters if function == 3 else ReadInputRegisters
    return (yield from bus.ask(unit, registers(address, quantity), timeout=timeout)).registers


def write_modbus(
    bus: Bus, unit: int, device: Device, values: Values, *, timeout: float = 1.0, force: bool = False
) -> Conversation[bytes, None]:
    """Write parameters of `unit`, which is a `device`, in the order of `values`.

    Raises at once UnknownName, and EncodeError for what is read only, out of range, not on Modbus, or more than
    one request of the device can carry; in the conversation what `ask` raises, with a note of what was written before.
    """
    pairs = to_write(device, values, force)
    writes = plan_writes(device, [parameter for parameter, _ in pairs])
    for parameter, value in pairs:
        _registers(parameter, value, [0])
    return _write_modbus(bus, unit, writes, pairs, timeout)


def _registers(parameter: Parameter, value: Value, old: Sequence[int]) -> tuple[int, ...]:
    """The value as registers, or as a coil: one number, 0 or 1."""
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
    # The members of all writes, one after the other, are the pairs: the plan keeps the order.
    coming = iter(pairs)
    done: list[str] = []
    for write in writes:
        with writing((member.parameter for member in write.members), done):
            content: list[int] = []
            if write.keep:
                content += yield from _read_entries(bus, unit, write.read_function, write.address, 1, timeout)
            for _ in write.members:
                parameter, value = next(coming)
                new = _registers(parameter, value, content)
                content = list(new) if write.keep else [*content, *new]
            with unanswered(member.parameter for member in write.members):
                yield from _write_entries(bus, unit, write.function, write.address, content, timeout)
        done += [member.parameter.name for member in write.members]


def _write_entries(
    bus: Bus, unit: int, function: int, address: int, content: Sequence[int], timeout: float
) -> Conversation[bytes, None]:
    """Registers or bits, with the function that the device has for them: singles one by one, the lowest first."""
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
    names: Iterable[Name],
    *,
    timeout: float = 1.0,
    dialect: SdoDialect | None = None,
) -> Conversation[CanFrame, list[Reading]]:
    """Read parameters of `node`, which is a `device`: one Reading for each name, in the order asked.

    The standard's SDO unless `dialect` says otherwise. Several bits of one object are one transfer.
    Raises at once UnknownName, and EncodeError for what is write only or no object; in the conversation what
    `upload` raises, and DecodeError.
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
            with reading([parameter]):
                contents[key] = yield from _upload(channel, parameter, place, timeout)
        readings.append(Reading(parameter, parameter.from_object(contents[key])))
    return readings


def write_canopen(
    node: int | Channel,
    device: Device,
    values: Values,
    *,
    timeout: float = 1.0,
    dialect: SdoDialect | None = None,
    force: bool = False,
) -> Conversation[CanFrame, None]:
    """Write parameters of `node`, which is a `device`, one after the other in the order of `values`.

    Raises at once UnknownName, and EncodeError for what is read only, out of range or no object; in the conversation
    what `download` raises, with a note of what was written before.
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
            with unanswered([parameter]):
                yield from download(channel, place.index, place.sub, data, timeout=timeout)
        done.append(parameter.name)


def _upload(channel: Channel, parameter: Parameter, place: ObjectAt, timeout: float) -> Conversation[CanFrame, bytes]:
    """The object's bytes, as many as the type has."""
    size = parameter.object_size
    data = yield from upload(channel, place.index, place.sub, timeout=timeout, size=size)
    # The size of a word of which only one bit is known is a guess, so it cuts nothing.
    return data if place.bit is not None else fit(data, size)


def _object(device: Device, parameter: Parameter) -> ObjectAt:
    """Where a parameter lives on CANopen; EncodeError that says where it lives instead, or why it cannot travel."""
    if parameter.object is None or device.canopen is None:
        where = parameter.modbus
        elsewhere = f"it is {where.table} {where.address} on Modbus (from 0)" if where else "nor anywhere else"
        raise EncodeError(f"{parameter.name} is no object of CANopen: {elsewhere}", parameter.name)
    _ = parameter.object_size  # text has no size: that is told before anything is sent
    return parameter.object


def _channel(node: int | Channel, dialect: SdoDialect | None) -> Channel:
    if isinstance(node, Channel):
        if dialect is not None and dialect != node.dialect:
            raise EncodeError(f"the channel to node {node.node} speaks {node.dialect.name}, not {dialect.name}")
        return node
    return Channel(node, dialect or STANDARD)
