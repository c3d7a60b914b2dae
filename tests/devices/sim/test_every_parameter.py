"""Every parameter of the catalogue at its register and object: writable ones are read back, others refuse writes."""

from __future__ import annotations

import pytest

from barewire.codecs import Value
from barewire.codecs.numbers import Number
from barewire.devices.description.load import load, names
from barewire.devices.parameter import Parameter
from barewire.devices.sim import simulator
from barewire.modbus.messages import registers
from tests.devices.sim.bench import Bench
from tests.devices.sim.test_round_trips import PUSHED

pytestmark = pytest.mark.long

ALL = [(name, parameter) for name in names() for parameter in load(name).parameters]
ON_MODBUS = [(name, parameter) for name, parameter in ALL if parameter.modbus is not None]
IDS = [f"{name}-{parameter.name}" for name, parameter in ON_MODBUS]

MAPPINGS = range(0x1400, 0x1C00)  # with other rules, see tests/canopen


def wanted(parameter: Parameter) -> Value:
    """Return a value that the parameter may have, different from its default."""
    if parameter.type == "bool":
        return not parameter.default
    if parameter.name == "Parameter value":
        return 4
    if parameter.name in ("STORE ALL PARAMETERS", "Save All Parameters"):  # any value but a signature is refused
        return next(iter(parameter.values))
    if parameter.type.startswith("f"):
        return 1.5
    number, scale = Number(parameter.type), parameter.scale
    low = number.minimum * scale if parameter.minimum is None else parameter.minimum
    high = number.maximum * scale if parameter.maximum is None else parameter.maximum
    allowed = [value for value in parameter.values if low <= value <= high]
    candidates = [*allowed, high, low] if parameter.values else [high, low]
    return next((float(v) if v % 1 else int(v) for v in candidates if v != parameter.default), int(low))


@pytest.mark.parametrize(("name", "parameter"), ON_MODBUS, ids=IDS)
def test_every_parameter_over_modbus(name: str, parameter: Parameter) -> None:
    bench = Bench(simulator(name))
    place = parameter.modbus
    assert place is not None
    if not parameter.readable:
        gone = bench.refused(registers.ReadInputRegisters(place.address, 1))
        event = parameter.name == "Event index"  # its address has another meaning for reads
        assert gone == (0 if event else 2)
        return
    if name == "adxl":
        bench.write("Menu number selection", 1)
        bench.write("Parameter number selection", 4)
    before = bench.read(parameter.name)
    if not parameter.writable:
        if parameter.type == "text":
            assert before  # reading it again returns the next event
            return
        if place.table != "input":
            assert bench.refused(bench.writes(parameter.name, before)) == 2
        assert bench.read(parameter.name) == before
        return
    value = wanted(parameter)
    bench.write(parameter.name, value)
    if parameter.name not in PUSHED.get(name, ()):
        assert bench.read(parameter.name) == value
    if (
        place.table == "input" or parameter.name == "MODBUS FAIL THRESHOLD TIME"
    ):  # of another firmware, see ADDRESS 3, 4
        return
    # Out of range is 03, and nothing changes.
    kept = bench.read(parameter.name)
    if parameter.type.startswith(("i", "u")) and parameter.maximum is not None:
        above = Number(parameter.type).maximum
        if above * parameter.scale > parameter.maximum and not place.partial:
            words = Parameter("", parameter.type, modbus=place).to_registers(above)
            single = registers.WriteSingleRegister(place.address, words[0])
            several = registers.WriteMultipleRegisters(place.address, words)
            assert bench.refused(single if name == "adxl" else several) == 3
            assert bench.read(parameter.name) == kept


OBJECTS = [pair for pair in ALL if pair[1].object is not None]


@pytest.mark.parametrize(("name", "parameter"), OBJECTS, ids=[parameter.name for _, parameter in OBJECTS])
def test_every_parameter_over_canopen(name: str, parameter: Parameter) -> None:
    bench = Bench(simulator(name))
    bench.frames()
    place = parameter.object
    assert place is not None
    before = bench.upload(place.index, place.sub)
    assert isinstance(before, bytes)
    if place.index in MAPPINGS:
        assert parameter.from_object(before) == parameter.default
        return
    value = wanted(parameter)
    if parameter.name == "CAN BITRATE INDEX":  # 2068h is also CAN BIT RATE, which can be written
        assert before == b"\x05\x00"
        return
    if not parameter.writable:
        if place.bit is None:
            assert bench.download(place.index, place.sub, before) == 0x0601_0002
        return
    assert bench.download(place.index, place.sub, parameter.to_object(value, before)) == 0
    if parameter.name in PUSHED.get(name, ()):
        return
    after = bench.upload(place.index, place.sub)
    assert isinstance(after, bytes)
    assert parameter.from_object(after) == value
    if parameter.modbus is not None:
        assert bench.read(parameter.name) == value
