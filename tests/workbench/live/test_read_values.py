"""Many values of a machine: the bad ones cost only themselves, a silent machine is given up, faults change no value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from barewire import ModbusServer, connect, load
from barewire.devices import Reading, UnknownName
from barewire.devices.sim import simulator
from barewire.errors import EncodeError, NoAnswer
from barewire.modbus import AnyUnit
from barewire.modbus.exceptions import ModbusException
from barewire_workbench.live.read_values import ReadValue, read_alone, read_values, readable_names, selected

NAMES = [row.name for row in load("csd-mt").parameters if row.readable][:100]


class Machine:
    """A machine that answers with 0, but raises an error when one of some names is asked for."""

    def __init__(self, bad: set[str], error: Callable[[], Exception]) -> None:
        self.device = load("csd-mt")
        self.bad, self.error = bad, error
        self.calls: list[list[str]] = []

    def read_all(self, names: list[str]) -> list[Reading]:
        self.calls.append(names)
        if self.bad.intersection(names):
            raise self.error()
        return [Reading(self.device.find(name), 0) for name in names]


def read(machine: Any, names: list[str]) -> list[ReadValue]:
    return list(read_values(machine, names))


@pytest.mark.parametrize("error", [lambda: ModbusException(2), lambda: NoAnswer("silence")], ids=["02", "silence"])
@pytest.mark.parametrize("bad", [{7}, {0, 99}, {30, 31, 32}])
def test_each_bad_value_costs_itself_and_the_order_is_kept(bad: set[int], error: Callable[[], Exception]) -> None:
    machine = Machine({NAMES[place] for place in bad}, error)
    values = read(machine, NAMES)
    assert [value.parameter.name for value in values] == NAMES
    assert {place for place, value in enumerate(values) if value.reading is None} == bad
    assert len(machine.calls) <= 5 + 14 * len(bad)  # three values, two blocks, and the halves that lead to each


def test_a_machine_that_answers_nothing_is_asked_three_times() -> None:
    machine = Machine(set(NAMES), lambda: NoAnswer("unit 1 did not answer"))
    values = read(machine, NAMES)
    assert len(machine.calls) == 3
    assert [value.problem for value in values[:3]] == ["unit 1 did not answer"] * 3
    assert {value.problem for value in values[3:]} == {"not asked for: unit 1 did not answer"}


def test_a_machine_that_falls_silent_is_given_up() -> None:
    machine = Machine(set(NAMES[70:]), lambda: NoAnswer("gone"))
    values = read(machine, NAMES)
    assert sum(value.reading is not None for value in values) >= 64
    assert len(machine.calls) <= 30


def test_what_cannot_be_read_is_in_the_fields() -> None:
    good, bad = read(Machine({NAMES[1]}, lambda: ModbusException(2)), NAMES[:2])
    assert good.as_dict()["value"] == 0
    assert "error" not in good.as_dict()
    assert (bad.as_dict()["value"], "exception 02" in str(bad.as_dict()["error"])) == (None, True)
    assert str(bad).startswith(f"{NAMES[1]}: not read: exception 02")


def units_of(name: str) -> dict[int, AnyUnit]:
    unit = simulator(name).modbus
    assert unit is not None
    return {1: unit}


@pytest.mark.parametrize("name", ["csd-mt", "adxl", "az3"])
def test_a_fifth_of_the_answers_lost_or_damaged_changes_no_value(name: str) -> None:
    """Rows are right, or say what failed. The values that a simulator changes by itself are left out."""
    device = load(name)
    names = [row.name for row in device.parameters if row.readable and row.modbus and row.access == "rw"][:60]
    with ModbusServer("rtu://pty", units_of(name)) as server, connect(name, server.url, unit=1) as machine:
        right = {value.parameter.name: value.reading for value in read_values(machine, names)}
    with (
        ModbusServer("rtu://pty", units_of(name), faults="drop:0.1,flip:0.1", fault_seed=4) as server,
        connect(name, f"{server.url}?timeout=0.15&late_window=1.5", unit=1) as machine,  # late, on a busy computer
    ):
        values = read(machine, names)
    assert [value.parameter.name for value in values] == names
    assert all(value.reading in (None, right[value.parameter.name]) for value in values)
    assert any(value.reading is not None for value in values)


def test_a_wrong_table_of_what_is_read_alone() -> None:
    for table, error in ((["Status"], EncodeError), ({"Status": 1}, EncodeError), ({"Statsu": "why"}, UnknownName)):
        with pytest.raises(error, match=r"\[read_alone\]|Statsu"):
            read_alone(replace(load("adxl"), extra={"read_alone": table}))


def test_names_groups_and_access() -> None:
    device = load("csd-mt")
    readable = readable_names(device, "tcp://127.0.0.1")
    assert selected(device, readable, []) == readable
    assert selected(device, readable, ["homing m*", "status word"]) == ["Homing Method", "Status Word"]
    homing = selected(device, readable, [], groups=["homing"])
    assert homing == [row.name for row in device.parameters if row.group == "Homing" and row.readable]
    assert set(selected(device, readable, [], access="ro")) < set(readable)
    assert selected(device, readable, ["Status Word", "status*"])[0] == "Status Word"
    assert readable_names(device, "can://socketcan/can0") == []
    for patterns, groups, message in [
        (["*nothing*"], [], "has a name like '[*]nothing[*]'"),
        ([], ["Hming"], "did you mean 'Homing'"),
        (["Statsu Word"], [], "did you mean 'Status Word'"),
    ]:
        with pytest.raises(UnknownName, match=message):
            selected(device, readable, patterns, groups=groups)
