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

The plan of a read, here of A, C and E:

    to read           A   C     E                     the device has parameters at 0 to 3 and at 6, and none at 4 and 5
    input registers   0 1 2 3 . . 6
                      A B C C     E
    plan_reads        [-------]   [-]                 B is read too, because it lies between; register 4 is not
                      input 0, 4  input 6, 1          described, so that gap is never bridged

Reads may have any order, so neighbours, overlaps and the described parameters between them become one request, up to
the limit of the device. Writes keep their order, and no other address is written.

The registers of one read request become the values of its parameters with one struct call for all of them:

    registers   0      1      2      3      4          A u16, C f32 in the order CDAB, E i16, F the low half of 4
    bytes       0  1   2  3   4  5   6  7   8  9
                A  A          C  C   C  C   E  EF
    picked      0  1          6  7   4  5   8  9  9    each value with its most significant byte first
    struct      H             f             h     B    ">HfhB"
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from operator import itemgetter
from typing import Any, NamedTuple, TypeAlias

from barewire.codecs import Value, to_registers
from barewire.codecs.bits import get_bit
from barewire.codecs.order import reorder
from barewire.conversation import DEFAULT_TIMEOUT, Conversation, Listen
from barewire.devices.device import Device, ModbusSettings
from barewire.devices.parameter import ModbusAt, Parameter, Reading, TableName
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

_BITS_IN_REGISTER = 16
_COILS_READ_LIMIT = 2000  # of the standard [MB-APP 6.1]; the limit for registers is in the description


class Member(NamedTuple):
    """A parameter in a request: its first register (or coil) is the request's `address` + `offset`."""

    parameter: Parameter
    offset: int


class PlannedRead(NamedTuple):
    """One read request: `quantity` registers or coils from `address`, with the function that reads that table."""

    table: TableName
    address: int
    quantity: int
    members: tuple[Member, ...]
    function: int

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters that it reads."""
        return tuple(member.parameter for member in self.members)


class PlannedWrite(NamedTuple):
    """One write: whole registers or coils from `address`, with function 05, 06, 0F or 10h.

    Function 06 with a quantity of 2 or more stands for one request for each register, the lowest first. With `keep` the
    members are only a part of the register: read it with `read_function`, change it, write it back.
    """

    table: TableName
    address: int
    quantity: int
    members: tuple[Member, ...]
    function: int
    keep: bool = False
    read_function: int = 0

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters that it writes."""
        return tuple(member.parameter for member in self.members)


_Placed: TypeAlias = tuple[ModbusAt, Parameter]


def _modbus_address(device: Device, parameter: Parameter) -> tuple[ModbusAt, ModbusSettings]:
    """Return the Modbus address of a parameter. Raises EncodeError with its address on CANopen if it has none."""
    if parameter.modbus is not None and device.modbus is not None:
        return parameter.modbus, device.modbus
    where = parameter.object
    elsewhere = f"it is object {where.index:04X}h:{where.sub:02X} on CANopen" if where else "it has no other address"
    raise EncodeError(f"{parameter.name} has no address on Modbus: {elsewhere}", parameter.name)


def known_addresses(device: Device, table: TableName) -> frozenset[int]:
    """Return the addresses in a table that belong to readable parameters."""
    return frozenset(
        address
        for parameter in device.parameters
        if parameter.readable and (place := parameter.modbus) is not None and place.table == table
        for address in range(place.address, place.address + place.words)
    )


def plan_reads(device: Device, parameters: Iterable[Parameter]) -> list[PlannedRead]:
    """Return the fewest requests that read these parameters, by table and address.

    >>> from barewire.devices import load
    >>> adxl = load("adxl")
    >>> [block[:3] for block in plan_reads(adxl, map(adxl.find, ["L3 current", "L1 current", "Frequency"]))]
    [('input', 7, 6), ('input', 49, 2)]

    Raises EncodeError for a parameter without an address on Modbus, in a table that no function reads, or wider than
    the limit of the device.
    """
    by_table: dict[TableName, dict[str, _Placed]] = {}  # by name: one that is given twice is read once
    for parameter in parameters:
        place, _ = _modbus_address(device, parameter)
        by_table.setdefault(place.table, {})[parameter.name] = place, parameter
    blocks: list[PlannedRead] = []
    for table in sorted(by_table):
        blocks += _plan_table(device, table, list(by_table[table].values()))
    return blocks


def _plan_table(device: Device, table: TableName, placed: list[_Placed]) -> list[PlannedRead]:
    settings = _modbus_address(device, placed[0][1])[1]
    function = settings.read_functions.get(table)
    if function is None:
        raise EncodeError(f"{placed[0][1].name}: {device.name} has no function that reads table {table!r}")
    placed = sorted(placed, key=lambda pair: (pair[0].address, pair[0].words))
    limit = settings.read_limit
    if table in ("coil", "discrete"):
        limit = min(_COILS_READ_LIMIT, limit * _BITS_IN_REGISTER)
    known = known_addresses(device, table)
    blocks = []
    while placed:
        # From the lowest address as far as described addresses and the limit go. Greedy is optimal here: moving a
        # parameter to a later request never saves one.
        first, parameter = placed[0]
        if first.words > limit:
            text = f"{parameter.name} takes {first.words} registers, {device.name} allows {limit} in one response"
            raise EncodeError(text)
        reach = first.address + first.words
        while reach - first.address < limit and reach in known:
            reach += 1
        inside = [pair for pair in placed if pair[0].address + pair[0].words <= reach]
        placed = [pair for pair in placed if pair[0].address + pair[0].words > reach]
        quantity = max(place.address + place.words for place, _ in inside) - first.address
        members = tuple(Member(parameter, place.address - first.address) for place, parameter in inside)
        blocks.append(PlannedRead(table, first.address, quantity, members, function))
    return blocks


def plan_writes(device: Device, parameters: Sequence[Parameter]) -> list[PlannedWrite]:
    """Return the writes in the order of the parameters. Consecutive neighbours become one request with function 16.

    >>> from barewire.devices import load
    >>> csd = load("csd-mt")
    >>> [write[:3] for write in plan_writes(csd, [csd.find("Motor Code"), csd.find("Control Word")])]
    [('holding', 1090, 2), ('holding', 1040, 1)]

    Raises EncodeError for a parameter without an address on Modbus, in a table that no function writes, or wider than
    one request of the device.
    """
    writes: list[PlannedWrite] = []
    for parameter in parameters:
        write = _plan_write(device, parameter)
        settings = _modbus_address(device, parameter)[1]
        joined = _join(writes[-1], write, settings) if writes else None
        if joined is None:
            writes.append(write)
        else:
            writes[-1] = joined
    return writes


def _plan_write(device: Device, parameter: Parameter) -> PlannedWrite:
    place, settings = _modbus_address(device, parameter)
    functions = settings.write_functions.get(place.table, ())
    if not functions:
        raise EncodeError(
            f"{parameter.name} lies in table {place.table!r}, which no function of {device.name} writes", parameter.name
        )
    single, multiple = (5, 15) if place.table == "coil" else (6, 16)
    function = single if place.words == 1 and single in functions else multiple
    if place.words > 1 and (multiple not in functions or place.words > settings.write_limit):
        # Written register by register, the value is inconsistent for a moment: only if the device has no function 16.
        if single not in functions or place.words > settings.write_limit:
            raise EncodeError(
                f"{parameter.name} takes {place.words} registers, and {device.name} takes {settings.write_limit} in "
                f"one write: it would arrive in pieces",
                parameter.name,
            )
        function = single
    member = (Member(parameter, 0),)
    if not place.partial:
        return PlannedWrite(place.table, place.address, place.words, member, function)
    read_function = settings.read_functions.get(place.table)
    if read_function is None:
        raise EncodeError(
            f"{parameter.name} is part of a register that cannot be read in {device.name}, so the rest of it "
            f"cannot be kept",
            parameter.name,
        )
    return PlannedWrite(place.table, place.address, 1, member, function, True, read_function)


def _join(before: PlannedWrite, write: PlannedWrite, settings: ModbusSettings) -> PlannedWrite | None:
    """Return both as one write, or None: parts of the same register, or neighbours within the limit of function 16."""
    if before.table != "holding" or write.table != "holding" or before.keep != write.keep:
        return None
    if before.keep:
        return before._replace(members=before.members + write.members) if before.address == write.address else None
    quantity = before.quantity + write.quantity
    are_adjacent = before.address + before.quantity == write.address
    if not are_adjacent or 16 not in settings.write_functions["holding"] or quantity > settings.write_limit:
        return None
    following = tuple(Member(member.parameter, member.offset + before.quantity) for member in write.members)
    return PlannedWrite("holding", before.address, quantity, before.members + following, 16)


BlockDecoder: TypeAlias = Callable[[Sequence[int]], list[Value]]
_Conversion: TypeAlias = Callable[[Any], Value]

_LETTERS = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i8": "b", "i16": "h", "i32": "i", "i64": "q"}
_LETTERS |= {"f32": "f", "f64": "d", "bool": "H"}
_IN_REGISTER = {"u8": "H", "i8": "h"}
"""A byte that has a register to itself fills it as a 16-bit number."""


def block_decoder(block: PlannedRead) -> BlockDecoder:
    """Return a function from the content of a response to `block` to the values of its members, in their order.

    >>> from barewire.devices import load
    >>> from barewire.devices.modbus_access import plan_reads
    >>> adxl = load("adxl")
    >>> (block,) = plan_reads(adxl, [adxl.find("L1 current"), adxl.find("L3 current")])
    >>> block.quantity, block_decoder(block)(range(block.quantity))
    (6, [0.0001, 26.2149])
    """
    if block.table in ("coil", "discrete"):
        offsets = [offset for _, offset in block.members]
        return lambda content: [bool(content[offset]) for offset in offsets]
    format, positions = ">", []
    conversions: list[tuple[int, _Conversion]] = []
    for index, (parameter, offset) in enumerate(block.members):
        letter, positions_of_member, conversion = _member_format(parameter, 2 * offset)
        format += letter
        positions += positions_of_member
        if conversion is not None:
            conversions.append((index, conversion))
    registers = struct.Struct(f">{block.quantity}H")
    if positions == list(range(registers.size)):
        values = struct.Struct(format)
        return _with_conversions(lambda content: values.unpack(registers.pack(*content)), conversions)
    values = struct.Struct(format + "x")  # one byte more, since itemgetter returns a tuple for two at least
    pick = itemgetter(*positions, 0)
    return _with_conversions(lambda content: values.unpack(bytes(pick(registers.pack(*content)))), conversions)


def _with_conversions(
    unpack: Callable[[Sequence[int]], tuple[Any, ...]], conversions: list[tuple[int, _Conversion]]
) -> BlockDecoder:
    def decode(content: Sequence[int]) -> list[Value]:
        values = list(unpack(content))
        for index, conversion in conversions:
            values[index] = conversion(values[index])
        return values

    return decode


def _member_format(parameter: Parameter, start: int) -> tuple[str, list[int], _Conversion | None]:
    """Return the letter of `struct`, the positions of the bytes with the most significant first, and the function from
    the number to the value (None: the number is the value)."""
    place = parameter.modbus
    assert place is not None
    positions = list(range(start, start + 2 * place.words))
    if place.bit is not None:
        bit = place.bit
        return "H", positions, lambda register: get_bit(register, bit)
    if place.half is not None:
        high, low = positions
        return _LETTERS[parameter.type], [high if place.half == "H" else low], _scaling(parameter)
    letter = _IN_REGISTER.get(parameter.type) or _LETTERS.get(parameter.type, "")
    if not letter or struct.calcsize(f">{letter}") != len(positions):  # text
        return f"{len(positions)}s", positions, lambda data: parameter.from_registers(to_registers(data))
    in_order = reorder(bytes(range(len(positions))), place.order)
    return letter, [start + position for position in in_order], _scaling(parameter)


def _scaling(parameter: Parameter) -> _Conversion | None:
    """Return `Parameter.from_raw` as a prepared function; None if it changes nothing."""
    if parameter.type == "bool":
        return bool
    if parameter.scale == 1:
        return None
    if parameter.type[0] == "f":
        factor = float(parameter.scale)
        return lambda raw: raw * factor
    numerator, denominator = parameter.scale.numerator, parameter.scale.denominator

    def scaled(raw: int) -> Value:
        # A quotient of whole numbers is rounded once, so this is the exact fraction as a float.
        product = raw * numerator
        return product / denominator if product % denominator else product // denominator

    return scaled


_READS: dict[int, Any] = {1: ReadCoils, 2: ReadDiscreteInputs, 3: ReadHoldingRegisters, 4: ReadInputRegisters}
_PLANS_MAX = 256
"""The most plans that are kept for one device: a program that polls has a few lists of names."""


class ReadPlan(NamedTuple):
    """The requests for a list of names, and the decoders of the responses. The device keeps it, so it is made once."""

    requests: list[Any]
    notes: list[str]
    """For each request the note of its errors, with the parameters that it reads."""

    decoders: list[BlockDecoder]
    parameters: list[Parameter]
    """The parameter of each name."""
    indices: list[int]
    """For each name the index of its value among the values of all responses."""

    def readings(self, responses: Iterable[Any]) -> list[Reading]:
        """Return the readings in the responses to `requests`, one for each name."""
        values: list[Value] = []
        for request, decode, response in zip(self.requests, self.decoders, responses):
            values += decode(response.bits if request.function_code <= 2 else response.registers)
        # Two maps are faster than a comprehension, and a program that polls does this for every value.
        return list(map(Reading, self.parameters, map(values.__getitem__, self.indices)))


def read_plan(device: Device, names: tuple[NameOrParameter, ...]) -> ReadPlan:
    """Return the plan for reading these names. Raises the same errors at once as `read_modbus`."""
    plan: ReadPlan | None = device.read_plans.get(names)
    if plan is None:
        parameters = to_read(device, names)
        blocks = plan_reads(device, parameters)
        names_read = [member.parameter.name for block in blocks for member in block.members]
        index_of = {name: index for index, name in enumerate(names_read)}
        plan = ReadPlan(
            [_READS[block.function](block.address, block.quantity) for block in blocks],
            [reading_note(block.parameters) for block in blocks],
            [block_decoder(block) for block in blocks],
            parameters,
            [index_of[parameter.name] for parameter in parameters],
        )
        if len(device.read_plans) >= _PLANS_MAX:
            device.read_plans.clear()  # rare, and cheaper than an order of use, which each read would have to keep
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
        # Encoded once before anything is sent, so that no value is refused after others were written. What else is in
        # the register of half a register, here 0, makes no difference.
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
        with writing(write.parameters, done), _naming_place(unit, write.address):
            content: tuple[int, ...] = ()
            if write.keep:
                response = yield from bus.ask(unit, _READS[write.read_function](write.address, 1), timeout=timeout)
                content = response.registers
            for parameter, value in islice(remaining, len(write.members)):
                registers = _registers(parameter, value, content)
                content = registers if write.keep else content + registers
            with may_not_answer(write.parameters):
                yield from _write_entries(bus, unit, write.function, write.address, content, timeout)
        done += [parameter.name for parameter in write.parameters]


@contextmanager
def _naming_place(unit: int, address: int) -> Iterator[None]:
    """Add the unit and the address to an exception response."""
    try:
        yield
    except ModbusException as error:
        error.add_place(unit, address)
        raise


def _write_entries(
    bus: Bus, unit: int, function: int, address: int, content: tuple[int, ...], timeout: float
) -> Conversation[bytes, None]:
    """Write registers or bits with this function; function 06 writes one register at a time, the lowest first."""
    if function == 15:
        yield from bus.ask(unit, WriteMultipleCoils(address, tuple(map(bool, content))), timeout=timeout)
    elif function == 16:
        yield from bus.ask(unit, WriteMultipleRegisters(address, content), timeout=timeout)
    elif function == 5:
        yield from bus.ask(unit, WriteSingleCoil(address, bool(content[0])), timeout=timeout)
    else:
        for offset, register in enumerate(content):
            yield from bus.ask(unit, WriteSingleRegister(address + offset, register), timeout=timeout)


class ModbusAccess:
    """Access to the drive with address `unit` on a Modbus line."""

    def __init__(self, bus: Bus, unit: int, device: Device, *, timeout: float = DEFAULT_TIMEOUT) -> None:
        self.bus, self.unit, self.device, self.timeout = bus, unit, device, timeout

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.device.name}, unit {self.unit}>"

    def read(self, names: Sequence[str]) -> Conversation[bytes, list[Reading]]:
        """Read with as few requests as the device allows."""
        return read_modbus(self.bus, self.unit, self.device, names, timeout=self.timeout)

    def write(self, values: Mapping[str, Value]) -> Conversation[bytes, None]:
        """Check all values, then write them."""
        return write_modbus(self.bus, self.unit, self.device, values, timeout=self.timeout)

    def wait(self, until: float) -> Conversation[bytes, float]:
        """Wait, and pass received bytes to `Bus.overhear`."""
        while True:
            received = yield Listen(until)
            self.bus.overhear(received.item, received.now)
            if received.now >= until:
                return received.now
