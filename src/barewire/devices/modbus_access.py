"""Reading and writing by name over Modbus: conversations, planned, checked, and with values in the unit.

    ["STATUS WORD", "DC BUS"]      names
        | find                     one name -> one Parameter; UnknownName has the nearest names
        | access, range, address   all of the call, before anything is sent: EncodeError
        | plan                     the fewest requests; the device keeps the plan of each list of names
        | ask                      the exchanges
        v decode                   [Reading("STATUS WORD", 0x0637), Reading("DC BUS", 320.0)]   in this order

A value that is less than a register (a bit, half a register) is read, changed and written back. Between the two
exchanges the device may change the rest of it; that change is lost.

With `force` only the device checks range and access, for manuals that are wrong. A value that cannot be encoded is
still refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from barewire.codecs import Value
from barewire.conversation import DEFAULT_TIMEOUT, Conversation
from barewire.devices.device import Device
from barewire.devices.parameter import Parameter, Reading
from barewire.devices.plan import BlockDecoder, PlannedWrite, block_decoder, plan_reads, plan_writes
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
from barewire.errors import BarewireError
from barewire.modbus import (
    Bus,
    ModbusException,
    ReadCoils,
    ReadDiscreteInputs,
    ReadHoldingRegisters,
    ReadInputRegisters,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)

_READS: dict[int, Any] = {1: ReadCoils, 2: ReadDiscreteInputs, 3: ReadHoldingRegisters, 4: ReadInputRegisters}
_MOST_PLANS = 256
"""The most plans that are kept for one device: a program that polls has a few lists of names."""


class ReadPlan(NamedTuple):
    """The requests for a list of names, and the decoders of the responses. The device keeps it, so it is made once."""

    requests: list[Any]
    notes: list[str]
    """For each request the note of its errors, with the parameters that it reads."""

    decoders: list[BlockDecoder]
    parameters: list[Parameter]
    """The parameter of each name."""
    numbers: list[int]
    """For each name the index of its value among the values of all responses."""

    def readings(self, responses: Iterable[Any]) -> list[Reading]:
        """Return the readings in the responses to `requests`, one for each name."""
        values: list[Value] = []
        for request, decode, response in zip(self.requests, self.decoders, responses):
            values += decode(response.bits if request.function_code <= 2 else response.registers)
        return list(map(Reading, self.parameters, map(values.__getitem__, self.numbers)))


def read_plan(device: Device, names: tuple[NameOrParameter, ...]) -> ReadPlan:
    """Return the plan for reading these names. Raises the same errors at once as `read_modbus`."""
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
    bus: Bus, unit: int, device: Device, names: Iterable[NameOrParameter], *, timeout: float = DEFAULT_TIMEOUT
) -> Conversation[bytes, list[Reading]]:
    """Read parameters of `unit`, which is a `device`: one Reading for each name, in the order of the names.

    `timeout` (seconds) is that of each request. Raises at once UnknownName, and EncodeError for a parameter that is
    write only or not on Modbus. The conversation raises the errors of `ask`, and DecodeError.
    """
    return _read_modbus(bus, unit, read_plan(device, tuple(names)), timeout)


def _read_modbus(bus: Bus, unit: int, plan: ReadPlan, timeout: float) -> Conversation[bytes, list[Reading]]:
    responses = []
    for request, note in zip(plan.requests, plan.notes):
        try:
            responses.append((yield from bus.ask(unit, request, timeout=timeout)))
        except BarewireError as error:
            if isinstance(error, ModbusException):
                error.add_place(unit, request.address)
            error.add_context(note)
            raise
    return plan.readings(responses)


def write_modbus(
    bus: Bus, unit: int, device: Device, values: ValuesByName, *, timeout: float = DEFAULT_TIMEOUT, force: bool = False
) -> Conversation[bytes, None]:
    """Write parameters of `unit`, which is a `device`, in the order of `values`.

    Raises at once UnknownName, and EncodeError for a parameter that is read only, out of range, not on Modbus, or wider
    than one request of the device. The conversation raises the errors of `ask`, with a note of what was written before.
    """
    pairs = to_write(device, values, force)
    writes = plan_writes(device, [parameter for parameter, _ in pairs])
    for parameter, value in pairs:
        _registers(parameter, value, [0])
    return _write_modbus(bus, unit, writes, pairs, timeout)


def _registers(parameter: Parameter, value: Value, old: Sequence[int]) -> tuple[int, ...]:
    """Return the value as registers; the value of a coil as one number, 0 or 1."""
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
        with writing(write.parameters, done), _at(unit, write.address):
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


@contextmanager
def _at(unit: int, address: int) -> Iterator[None]:
    """Add the place to an exception response."""
    try:
        yield
    except ModbusException as error:
        error.add_place(unit, address)
        raise


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
