"""Parameters -> the fewest Modbus requests. Pure: nothing is sent here.

    asked for         A   C     E                     the device has parameters at 0 to 3 and at 6, and none at 4 and 5
    input registers   0 1 2 3 . . 6
                      A B C C     E
    plan_reads        [-------]   [-]                 B is read along, for it lies between; nobody knows what reading
                      input 0, 4  input 6, 1          4 would do, so that gap is never bridged

Reading may be in any order, so neighbours, overlaps and what known parameters lie between become one block, as far as
the device's limit goes. Writing is done in the order asked, and nothing is written that was not asked for.

I know: addresses, limits, which function a device has.  I never know: values, lines, time.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from barewire.devices.device import Device, ModbusSettings
from barewire.devices.parameter import ModbusAt, Parameter, TableName
from barewire.errors import EncodeError

BITS_IN_REGISTER = 16
COILS_READ_LIMIT = 2000  # of the standard [MB-APP 6.1]; registers have theirs in the description


class Member(NamedTuple):
    """A parameter in a block: its first register (or coil) is the block's `address` + `offset`."""

    parameter: Parameter
    offset: int


class PlannedRead(NamedTuple):
    """One read request: `quantity` registers or coils from `address`, with the function that reads that table."""

    table: TableName
    address: int
    quantity: int
    members: tuple[Member, ...]
    function: int


class PlannedWrite(NamedTuple):
    """One write: whole entries from `address`, with function 05, 06, 0F or 10h.

    Function 06 with a quantity of 2 or more means one request for each register, the lowest first. `keep` means that
    the members fill only a part of the register: read it with `read_function`, change it, write it back.
    """

    table: TableName
    address: int
    quantity: int
    members: tuple[Member, ...]
    function: int
    keep: bool = False
    read_function: int = 0


def modbus_place(device: Device, parameter: Parameter) -> tuple[ModbusAt, ModbusSettings]:
    """Where a parameter lives on Modbus; EncodeError that says where it lives instead."""
    if parameter.modbus is not None and device.modbus is not None:
        return parameter.modbus, device.modbus
    where = parameter.object
    elsewhere = f"it is object {where.index:04X}h:{where.sub:02X} on CANopen" if where else "nor anywhere else"
    raise EncodeError(f"{parameter.name} has no place on Modbus: {elsewhere}", parameter.name)


def known_addresses(device: Device, table: TableName) -> frozenset[int]:
    """Every address of a table that belongs to a parameter that may be read."""
    return frozenset(
        address
        for parameter in device.parameters
        if parameter.readable and (place := parameter.modbus) is not None and place.table == table
        for address in range(place.address, place.address + place.words)
    )


def plan_reads(device: Device, parameters: Iterable[Parameter]) -> list[PlannedRead]:
    """The fewest requests that read these parameters, by table and address.

    >>> from barewire.devices import load
    >>> adxl = load("adxl")
    >>> [block[:3] for block in plan_reads(adxl, map(adxl.find, ["L3 current", "L1 current", "Frequency"]))]
    [('input', 7, 6), ('input', 49, 2)]

    Raises EncodeError for a parameter without a place on Modbus, in a table that nothing reads, or wider than the
    device's limit.
    """
    by_table: dict[TableName, dict[str, Parameter]] = {}
    for parameter in parameters:
        place, _ = modbus_place(device, parameter)
        by_table.setdefault(place.table, {})[parameter.name] = parameter
    blocks: list[PlannedRead] = []
    for table in sorted(by_table):
        blocks += _plan_table(device, table, list(by_table[table].values()))
    return blocks


def _plan_table(device: Device, table: TableName, parameters: list[Parameter]) -> list[PlannedRead]:
    placed = [(modbus_place(device, parameter)[0], parameter) for parameter in parameters]
    placed.sort(key=lambda pair: (pair[0].address, pair[0].words))
    side = modbus_place(device, parameters[0])[1]
    function = side.read_functions.get(table)
    if function is None:
        raise EncodeError(f"{parameters[0].name}: {device.name} has no function that reads table {table!r}")
    limit = side.read_limit
    if table in ("coil", "discrete"):
        limit = min(COILS_READ_LIMIT, limit * BITS_IN_REGISTER)
    known = known_addresses(device, table)
    blocks = []
    while placed:
        # From the lowest address on, as far as known ground and the limit go: what fits into this block could only
        # be moved to a later one, never be saved by it.
        first, widest = placed[0]
        if first.words > limit:
            raise EncodeError(f"{widest.name} takes {first.words} registers, {device.name} gives {limit} in one answer")
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
    """The writes, in the order asked. Whole registers asked for as neighbours become one request where function 16 is.

    >>> from barewire.devices import load
    >>> csd = load("csd-mt")
    >>> [write[:3] for write in plan_writes(csd, [csd.find("Motor Code"), csd.find("Control Word")])]
    [('holding', 1090, 2), ('holding', 1040, 1)]

    Raises EncodeError for a parameter without a place on Modbus, in a table that nothing writes, or wider than one
    request of the device can carry.
    """
    writes: list[PlannedWrite] = []
    for parameter in parameters:
        write = _plan_one(device, parameter)
        side = modbus_place(device, parameter)[1]
        joined = _join(writes[-1], write, side) if writes else None
        if joined is None:
            writes.append(write)
        else:
            writes[-1] = joined
    return writes


def _plan_one(device: Device, parameter: Parameter) -> PlannedWrite:
    place, side = modbus_place(device, parameter)
    functions = side.write_functions.get(place.table, ())
    if not functions:
        raise EncodeError(
            f"{parameter.name} lies in table {place.table!r}, which nothing in {device.name} writes", parameter.name
        )
    single, multiple = (5, 15) if place.table == "coil" else (6, 16)
    function = single if place.words == 1 and single in functions else multiple
    if place.words > 1 and (multiple not in functions or place.words > side.write_limit):
        # Register by register the value is torn for a moment; a device with a limit of one does not have such values.
        if single not in functions or place.words > side.write_limit:
            raise EncodeError(
                f"{parameter.name} takes {place.words} registers, and {device.name} takes {side.write_limit} in one "
                f"write: it would arrive in pieces",
                parameter.name,
            )
        function = single
    member = (Member(parameter, 0),)
    if not place.partial:
        return PlannedWrite(place.table, place.address, place.words, member, function)
    read_function = side.read_functions.get(place.table)
    if read_function is None:
        raise EncodeError(
            f"{parameter.name} is part of a register that {device.name} does not let be read, so the rest of it "
            f"cannot be kept",
            parameter.name,
        )
    return PlannedWrite(place.table, place.address, 1, member, function, True, read_function)


def _join(last: PlannedWrite, write: PlannedWrite, side: ModbusSettings) -> PlannedWrite | None:
    """Both as one, or None: parts of the same register, or neighbours that one function 16 can carry."""
    if last.table != "holding" or write.table != "holding" or last.keep != write.keep:
        return None
    if last.keep:
        return last._replace(members=last.members + write.members) if last.address == write.address else None
    quantity = last.quantity + write.quantity
    neighbours = last.address + last.quantity == write.address
    if not neighbours or 16 not in side.write_functions["holding"] or quantity > side.write_limit:
        return None
    moved = tuple(Member(member.parameter, member.offset + last.quantity) for member in write.members)
    return PlannedWrite("holding", last.address, quantity, last.members + moved, 16)
