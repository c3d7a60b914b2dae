"""The planner: the fewest reads, gaps only over described registers, writes in their order; the values of a block."""

from __future__ import annotations

import random
from itertools import combinations
from typing import Any

import pytest
from hypothesis import given, strategies as st

from barewire.devices import Device, ModbusAt, ModbusSettings, Parameter, load, names, plan_reads, plan_writes
from barewire.devices.modbus_access import PlannedRead, PlannedWrite, block_decoder, known_addresses
from barewire.devices.parameter import TableName
from barewire.errors import EncodeError
from tests.helpers import modest, refused


def device(*places: ModbusAt, access: Any = "rw", **settings: Any) -> Device:
    """Return a device with one parameter in each place, named by its number."""
    kinds = {1: "u16", 2: "u32", 4: "u64"}
    rows = (
        Parameter(
            str(number),
            "bool" if place.bit is not None else "u8" if place.half else kinds.get(place.words, "text"),
            access=access,
            modbus=place,
        )
        for number, place in enumerate(places)
    )
    return Device("d", "d", tuple(rows), modbus=ModbusSettings(**settings))


def holding(address: int, words: int = 1, **rest: Any) -> ModbusAt:
    return ModbusAt("holding", address, words, **rest)


def reads(machine: Device, *numbers: int) -> list[tuple[str, int, int, list[tuple[str, int]]]]:
    blocks = plan_reads(machine, [machine.find(str(number)) for number in numbers])
    return [(b.table, b.address, b.quantity, [(m.parameter.name, m.offset) for m in b.members]) for b in blocks]


def writes(machine: Device, *numbers: int) -> list[tuple[int, int, int, list[str]]]:
    planned = plan_writes(machine, [machine.find(str(number)) for number in numbers])
    return [(w.function, w.address, w.quantity, [m.parameter.name for m in w.members]) for w in planned]


# Reading


def test_neighbours_are_one_request_in_any_order_of_the_names() -> None:
    machine = device(holding(0), holding(1, 2), holding(3))
    assert reads(machine, 2, 0, 1) == [("holding", 0, 4, [("0", 0), ("1", 1), ("2", 3)])]


def test_a_described_register_between_is_read_along_and_another_is_not() -> None:
    machine = device(holding(0), holding(1), holding(2), holding(4))
    assert reads(machine, 0, 2, 3) == [
        ("holding", 0, 3, [("0", 0), ("2", 2)]),
        ("holding", 4, 1, [("3", 0)]),
    ]


def test_a_register_that_cannot_be_read_bridges_no_gap() -> None:
    machine = device(holding(0), holding(2))
    secret = Parameter("secret", "u16", access="wo", modbus=holding(1))
    machine = Device("d", "d", (*machine.parameters, secret), modbus=machine.modbus)
    assert [row[:3] for row in reads(machine, 0, 1)] == [("holding", 0, 1), ("holding", 2, 1)]


def test_halves_and_bits_of_one_register_are_one_request() -> None:
    machine = device(holding(5, half="L"), holding(5, half="H"), holding(5, bit=3), holding(4, 2))
    assert reads(machine, 0, 1, 2) == [("holding", 5, 1, [("0", 0), ("1", 0), ("2", 0)])]
    assert reads(machine, 0, 3) == [("holding", 4, 2, [("3", 0), ("0", 1)])]


def test_each_table_has_its_own_requests() -> None:
    machine = device(holding(0), ModbusAt("input", 1), ModbusAt("coil", 2), ModbusAt("discrete", 3))
    assert [row[:3] for row in reads(machine, 0, 1, 2, 3)] == [
        ("coil", 2, 1),
        ("discrete", 3, 1),
        ("holding", 0, 1),
        ("input", 1, 1),
    ]


def test_the_limit_cuts_between_parameters_and_not_within_one() -> None:
    machine = device(holding(0, 2), holding(2, 2), holding(4, 2), read_limit=3)
    assert [row[1:3] for row in reads(machine, 0, 1, 2)] == [(0, 2), (2, 2), (4, 2)]


def test_coils_are_counted_sixteen_to_a_register() -> None:
    coils = [ModbusAt("coil", address) for address in range(40)]
    assert [row[1:3] for row in reads(device(*coils, read_limit=2), *range(40))] == [(0, 32), (32, 8)]
    many = [ModbusAt("coil", address) for address in range(2001)]
    assert [row[1:3] for row in reads(device(*many), *range(2001))] == [(0, 2000), (2000, 1)]


def test_a_parameter_given_twice_is_read_once() -> None:
    assert reads(device(holding(0)), 0, 0) == [("holding", 0, 1, [("0", 0)])]


def test_the_function_is_that_of_the_description() -> None:
    adxl = load("adxl")
    wanted = [adxl.find("Parameter value"), adxl.find("Frequency")]
    assert [(b.table, b.function, b.address) for b in plan_reads(adxl, wanted)] == [
        ("holding", 4, 0x5003),
        ("input", 4, 0x31),
    ]
    assert plan_reads(load("csd-mt"), [load("csd-mt").find("Status Word")])[0].function == 3


@pytest.mark.parametrize(
    ("machine", "message"),
    [
        (device(holding(0, 9), read_limit=8), "0 takes 9 registers, d allows 8 in one response"),
        (device(holding(0), read_functions={}), "0: d has no function that reads table 'holding'"),
    ],
)
def test_parameters_that_cannot_be_read(machine: Device, message: str) -> None:
    with refused(EncodeError, message):
        plan_reads(machine, machine.parameters)


def test_a_parameter_without_an_address_on_modbus() -> None:
    with refused(EncodeError, "IQRMSX10 has no address on Modbus: it is object 2002h:00 on CANopen"):
        plan_reads(load("az3"), [load("az3").find("IQRMSX10")])


def test_all_parameters_of_a_machine_are_read_in_few_requests() -> None:
    counts = {}
    for name in ("adxl", "az3", "csd-mt"):
        machine = load(name)
        wanted = [parameter for parameter in machine.parameters if parameter.readable and parameter.modbus]
        counts[name] = len(plan_reads(machine, wanted))
    assert counts == {"adxl": 18, "az3": 44, "csd-mt": 15}


def place(drawn: tuple[TableName, int, int]) -> ModbusAt:
    table, address, words = drawn
    return ModbusAt(table, address, 1 if table == "coil" else words)


tables: st.SearchStrategy[TableName] = st.sampled_from(["holding", "input", "coil"])
places = st.tuples(tables, st.integers(0, 40), st.sampled_from([1, 1, 1, 2, 4])).map(place)


@modest
@given(st.lists(places, min_size=1, max_size=14), st.integers(4, 12), st.data())
def test_property_any_reads_are_the_fewest_and_within_the_limits(
    rows: list[ModbusAt], limit: int, data: st.DataObject
) -> None:
    machine = device(*rows, read_limit=limit)
    wanted = data.draw(st.lists(st.sampled_from(machine.parameters), min_size=1, unique_by=lambda row: row.name))
    blocks = plan_reads(machine, wanted)
    assert sorted(m.parameter.name for block in blocks for m in block.members) == sorted(row.name for row in wanted)
    for block in blocks:
        assert block.quantity <= (limit * 16 if block.table == "coil" else limit)
        assert {*range(block.address, block.address + block.quantity)} <= known_addresses(machine, block.table)
        for parameter, offset in block.members:
            assert parameter.modbus is not None
            assert (parameter.modbus.table, parameter.modbus.address) == (block.table, block.address + offset)
            assert offset + parameter.modbus.words <= block.quantity
    assert len(blocks) == fewest(machine, wanted, limit)


def fewest(machine: Device, wanted: list[Parameter], limit: int) -> int:
    """Search for the smallest number of spans of described addresses that cover the parameters, table by table."""
    total = 0
    for table in {row.modbus.table for row in wanted if row.modbus}:
        spans = [
            (place.address, place.address + place.words)
            for row in wanted
            if (place := row.modbus) and place.table == table
        ]
        known = known_addresses(machine, table)
        longest = limit * 16 if table == "coil" else limit
        windows = []
        for start in {begin for begin, _ in spans}:
            end = start
            while end in known and end - start < longest:
                end += 1
            windows.append({span for span in spans if start <= span[0] and span[1] <= end})
        total += next(
            count
            for count in range(1, len(spans) + 1)
            if any(set(spans) <= set().union(*chosen) for chosen in combinations(windows, min(count, len(windows))))
        )
    return total


# Writing


def test_neighbours_in_order_become_one_function_16() -> None:
    machine = device(holding(0), holding(1, 2), holding(3))
    assert writes(machine, 0, 1, 2) == [(16, 0, 4, ["0", "1", "2"])]


def test_writes_keep_their_order_and_bridge_no_gap() -> None:
    machine = device(holding(0), holding(1), holding(2))
    assert writes(machine, 1, 0) == [(6, 1, 1, ["1"]), (6, 0, 1, ["0"])]
    assert writes(machine, 0, 2) == [(6, 0, 1, ["0"]), (6, 2, 1, ["2"])]


def test_neighbours_stay_apart_without_function_16_and_beyond_the_limit() -> None:
    places = (holding(0), holding(1), holding(2))
    assert writes(device(*places, write_functions={"holding": (6,)}), 0, 1) == [(6, 0, 1, ["0"]), (6, 1, 1, ["1"])]
    assert writes(device(*places, write_limit=2), 0, 1, 2) == [(16, 0, 2, ["0", "1"]), (6, 2, 1, ["2"])]


def test_a_device_with_function_16_alone_gets_16_for_one_register_too() -> None:
    assert writes(device(holding(0), write_functions={"holding": (16,)}), 0) == [(16, 0, 1, ["0"])]


def test_two_registers_take_function_16_or_06_twice() -> None:
    assert writes(device(holding(0, 2)), 0) == [(16, 0, 2, ["0"])]
    assert writes(device(holding(0, 2), write_functions={"holding": (6,)}), 0) == [(6, 0, 2, ["0"])]


def test_two_registers_for_a_device_that_takes_one() -> None:
    machine = device(holding(0, 2), write_functions={"holding": (6,)}, write_limit=1)
    with refused(EncodeError, "0 takes 2 registers, and d takes 1 in one write: it would arrive in pieces"):
        plan_writes(machine, machine.parameters)


def test_parts_of_a_register_are_read_changed_and_written_together() -> None:
    machine = device(holding(7, half="L"), holding(7, half="H"), holding(7, bit=2), holding(8))
    planned = plan_writes(machine, [machine.find(name) for name in "0123"])
    assert [(w.address, w.keep, w.read_function, len(w.members)) for w in planned] == [
        (7, True, 3, 3),
        (8, False, 0, 1),
    ]


def test_parts_of_a_register_that_cannot_be_read_are_refused() -> None:
    machine = device(holding(7, half="L"), read_functions={})
    with refused(EncodeError, "0 is part of a register that cannot be read in d"):
        plan_writes(machine, machine.parameters)


def test_coils_one_by_one() -> None:
    coils = (ModbusAt("coil", 0), ModbusAt("coil", 1))
    assert writes(device(*coils), 0, 1) == [(5, 0, 1, ["0"]), (5, 1, 1, ["1"])]
    assert writes(device(*coils, write_functions={"coil": (15,)}), 0) == [(15, 0, 1, ["0"])]


def test_a_table_without_a_write_function() -> None:
    machine = device(ModbusAt("input", 0))
    with refused(EncodeError, "0 lies in table 'input', which no function of d writes"):
        plan_writes(machine, machine.parameters)


@modest
@given(st.lists(places.filter(lambda place: place.table != "input"), min_size=1, max_size=10), st.integers(4, 12))
def test_property_any_writes_keep_order_and_limits(rows: list[ModbusAt], limit: int) -> None:
    machine = device(*rows, write_limit=limit)
    planned = plan_writes(machine, machine.parameters)
    assert [m.parameter for write in planned for m in write.members] == [*machine.parameters]
    for write in planned:
        assert write.quantity <= limit
        covered = [(write.address + m.offset, m.parameter.modbus) for m in write.members]
        assert all(place is not None and place.address == address for address, place in covered)
        assert sum(place.words for _, place in covered if place is not None) == write.quantity


def test_plans_compare_by_value() -> None:
    assert PlannedRead("holding", 0, 1, (), 3) == PlannedRead("holding", 0, 1, (), 3)
    assert PlannedWrite("holding", 0, 1, (), 6).keep is False


def one_by_one(block: PlannedRead, content: list[int]) -> dict[str, object]:
    found: dict[str, object] = {}
    for parameter, offset in block.members:
        if block.table in ("coil", "discrete"):
            found[parameter.name] = bool(content[offset])
        else:
            assert parameter.modbus is not None
            found[parameter.name] = parameter.from_registers(content[offset : offset + parameter.modbus.words])
    return found


@pytest.mark.parametrize("device_name", names())
def test_a_block_is_decoded_like_its_parameters_one_by_one(device_name: str) -> None:
    device = load(device_name)
    readable = [parameter for parameter in device.parameters if parameter.readable and parameter.modbus]
    blocks = plan_reads(device, readable)
    assert blocks
    random_numbers = random.Random(1)
    for block in blocks:
        for _ in range(5):
            top = 1 if block.table in ("coil", "discrete") else 0xFFFF
            content = [random_numbers.randint(0, top) for _ in range(block.quantity)]
            expected = one_by_one(block, content)
            found = dict(zip(expected, block_decoder(block)(content), strict=True))
            for name, value in expected.items():
                same = found[name] == value or (value != value and found[name] != found[name])  # not-a-number
                assert same, name
                assert type(found[name]) is type(value), name
