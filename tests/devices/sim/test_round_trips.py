"""Every writable parameter of every machine over each of its transports: extremes and defaults are read back.
Every read-only parameter refuses writes, with the exception or the abort code of the standard."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from barewire.canopen import AbortCode, SdoAbort
from barewire.codecs import Value
from barewire.codecs.numbers import Number
from barewire.devices.description.load import load, names
from barewire.devices.parameter import Parameter
from barewire.devices.sim import simulator
from barewire.errors import BarewireError, EncodeError
from barewire.modbus import ModbusException
from barewire.modbus.messages.registers import ReadInputRegisters, WriteMultipleRegisters, WriteSingleRegister
from tests.devices.sim.bench import Bench
from tests.devices.sim.wires import WIRES, CanopenWire, ModbusWire, Wire, canopen
from tests.helpers import part_or_whole

pytestmark = pytest.mark.long

# Not read back as written: each acts and returns to its rest value, or shows a measured value.
PUSHED = {
    "csd-mt": {
        "Save All Parameters", "Restore All Default Parameters", "Reset Error Logs", "Read Temperature",
    },
    "az3": {
        "STORE ALL PARAMETERS", "RESET POSITION", "RESET ERROR", "SOFTWARE RESET", "POWER OFF RESET", "START PHASING",
        "ABSOLUTE ENCODER PHASING START", "ALIGNMENT REQUEST", "EEPROM DIAGNOSTIC LOG CLEANING",
        "EEPROM AUTOPHASING DATA CLEANING", "EEPROM PARAMETERS CLEANING", "EEPROM TOTAL CLEANING",
        *("COIL WORD 0", "COIL WORD 1", "COIL WORD 5"),  # all bits at once: among them those above, and states
        *("HEATSINK TEMPERATURE", "CUSTOM POSITION ACTUAL VALUE", "SENSORLESS MEASURED SPEED", "PHASING IN PROGRESS"),
    },
    "adxl": set(),
}  # fmt: skip

PDO_RECORDS = range(0x1400, 0x1C00)
"""Parameters with a required order of writes: see tests/canopen, and the last test here."""

MENU = {"Menu number selection": 1, "Parameter number selection": 4}
TRANSPORTS = pytest.mark.parametrize(("device", "wire"), WIRES, ids=[f"{name}-{made.__name__}" for name, made in WIRES])


def wanted(parameter: Parameter) -> list[Value]:
    """Return the default, both ends of the range, and every value that has a name."""
    if parameter.type == "bool":
        return [True, False]
    if parameter.name == "Parameter value":  # of P01.04
        return [1, 120, 10]
    if parameter.name == "STORE ALL PARAMETERS":  # any value but the signature is refused
        return list(parameter.values)
    found: list[Value] = list(parameter.values)
    if not parameter.values:
        number, scale = Number(parameter.type), parameter.scale
        low = number.minimum * scale if parameter.minimum is None else parameter.minimum
        high = number.maximum * scale if parameter.maximum is None else parameter.maximum
        if parameter.type == "f32":
            low, high = max(float(low), -3.4e38), min(float(high), 3.4e38)
        found += [float(end) if end % 1 else int(end) for end in (low, high)]
    if parameter.default is not None and parameter.access == "rw":
        found.append(parameter.default)
    return found


def in_range(parameter: Parameter, value: Value) -> bool:
    try:
        parameter.check(value)
    except EncodeError:
        return False
    return True


def same(parameter: Parameter, got: Value, value: Value) -> bool:
    return got == (pytest.approx(value, rel=1e-6) if parameter.type == "f32" else value)


@TRANSPORTS
def test_every_readable_parameter_is_read_by_name(device: str, wire: Callable[[str], Wire]) -> None:
    line = wire(device)
    here = [parameter for parameter in load(device).parameters if parameter.readable and line.has(parameter)]
    if device == "adxl":
        line.write({line.machine.device.find(name): value for name, value in MENU.items()})
    wrong = []
    for parameter in here:
        try:
            line.read(parameter)
        except BarewireError as error:
            wrong.append(f"{parameter.name}: {error}")
    assert wrong == []
    # Nearly all 354 of the AZ3 are on both of its buses.
    assert len(here) > {"az3": 240, "adxl": 40, "csd-mt": 100}[device]


@TRANSPORTS
def test_every_writable_parameter_is_read_back(device: str, wire: Callable[[str], Wire]) -> None:
    wrong, tried, acts, line = [], 0, False, wire(device)
    in_records = PDO_RECORDS if isinstance(line, CanopenWire) else ()
    for parameter in load(device).parameters:
        place = parameter.object
        if not parameter.writable or not line.has(parameter) or (place is not None and place.index in in_records):
            continue
        acts, acted = device == "adxl" or parameter.name in PUSHED[device], acts
        if acts or acted:  # on what is read later: a motor that starts, a reset
            line = wire(device)
        find = line.machine.device.find
        if parameter.name in ("Parameter value", "Sub-menu number selection"):
            line.write({find(name): value for name, value in MENU.items()})
        for value in filter(lambda value: in_range(parameter, value), wanted(parameter)):
            tried += 1
            if (parameter.name, value) == ("C14 Restore a copy of the setup parameters", 13):
                line.write({find("C13 Save a copy of the setup parameters"): 12})
            if parameter.name == "Event index" and value:
                continue  # one event is there, number 0
            before = line.now
            line.write({parameter: value})
            assert parameter.answered or line.now - before >= 1.0, "an answer to what is not answered"
            if parameter.readable and parameter.name not in PUSHED[device]:
                got = line.read(parameter)
                if not same(parameter, got, value):
                    wrong.append((parameter.name, value, got))
    assert wrong == []
    assert tried > {"az3": 300, "adxl": 15, "csd-mt": 100}[device]


@TRANSPORTS
def test_every_read_only_parameter_refuses_writes(device: str, wire: Callable[[str], Wire]) -> None:
    line, refused = wire(device), 0
    for parameter in load(device).parameters:
        if parameter.writable or not line.has(parameter) or parameter.type == "text":
            continue
        if parameter.name in ("Events counter", "Events pointer"):
            continue  # written, their register is the event index
        if device == "adxl":
            line.write({line.machine.device.find(name): value for name, value in MENU.items()})
        if parameter.name == "CAN BITRATE INDEX" and isinstance(line, CanopenWire):
            continue  # its object, 2068h, is that of CAN BIT RATE, which can be written
        before = line.read(parameter)
        if isinstance(line, ModbusWire):
            answer = _forced(line, parameter, before)
            if answer is None:
                continue
            assert answer == 2, parameter.name
        else:
            place = parameter.object
            assert place is not None
            if place.bit is not None:
                continue  # a bit of a writable word, which keeps its value: see test_az3
            with pytest.raises(SdoAbort) as declined:
                line.write({parameter: before}, force=True)
            assert declined.value.code == AbortCode.READ_ONLY, parameter.name
        refused += 1
        # The line voltage of the ADXL varies; nothing else changes in these milliseconds.
        assert line.read(parameter) == pytest.approx(before, rel=1e-3), parameter.name
    assert refused > {"az3": 7, "adxl": 20, "csd-mt": 20}[device]


def _forced(line: ModbusWire, parameter: Parameter, value: Value) -> int | None:
    """Return the exception code of a write that is sent all the same; None where the function for it does not exist.

    Nothing on Modbus writes an input register. Where all tables of a device have the same addresses, as in the ADXL and
    the CSD MT, function 06 addresses this one; on the AZ3 it would write the holding register of the same number.
    """
    place = parameter.modbus
    assert place is not None
    if place.table == "input":
        if line.machine.device.name == "az3":
            with pytest.raises(EncodeError, match="which no function of az3 writes"):
                line.write({parameter: value}, force=True)
            return None
        request = WriteSingleRegister(place.address, 0)
        try:
            line.machine.modbus.handle(request, line.now)  # type: ignore[union-attr]
        except ModbusException as declined:
            return declined.code
        return 0
    try:
        line.write({parameter: value}, force=True)
    except ModbusException as declined:
        return declined.code
    return 0


@pytest.mark.parametrize("name", names())
def test_what_no_function_reads_is_refused(name: str) -> None:
    bench = Bench(simulator(name))
    for parameter in load(name).parameters:
        if parameter.modbus is not None and not parameter.readable:
            # The address of the event index has another meaning for reads.
            expected = 0 if parameter.name == "Event index" else 2
            assert bench.refused(ReadInputRegisters(parameter.modbus.address, 1)) == expected, parameter.name


@pytest.mark.parametrize("name", ["az3", "csd-mt"])  # no range of the ADXL is smaller than that of its type
def test_a_number_out_of_range_is_refused_with_03_and_changes_nothing(name: str) -> None:
    bench, tried = Bench(simulator(name)), 0
    for parameter in load(name).parameters:
        place = parameter.modbus
        if place is None or place.partial or not (parameter.readable and parameter.writable):
            continue
        # Nothing writes input registers, and the last one is of another firmware, see ADDRESS 3, 4.
        if place.table == "input" or parameter.name == "MODBUS FAIL THRESHOLD TIME":
            continue
        if parameter.type[0] not in "iu" or parameter.maximum is None:
            continue
        highest = Number(parameter.type).maximum
        if highest * parameter.scale <= parameter.maximum:
            continue
        before = bench.read(parameter.name)
        words = Parameter("", parameter.type, modbus=place).to_registers(highest)
        assert bench.refused(WriteMultipleRegisters(place.address, words)) == 3, parameter.name
        assert bench.read(parameter.name) == before, parameter.name
        tried += 1
    assert tried > 40


@pytest.mark.parametrize("step", part_or_whole(4, 1))
def test_a_value_written_over_canopen_is_read_over_modbus(step: int) -> None:
    tried = 0
    for parameter in load("az3").parameters[::step]:
        place = parameter.object
        if place is None or parameter.modbus is None or not parameter.writable or parameter.name in PUSHED["az3"]:
            continue
        if place.index in PDO_RECORDS or parameter.name == "CAN BITRATE INDEX":
            continue
        bench = Bench(simulator("az3"))
        bench.frames()  # the boot-up message
        before = bench.upload(place.index, place.sub)
        assert isinstance(before, bytes), parameter.name
        value = next((value for value in wanted(parameter) if value != parameter.default), 0)
        assert bench.download(place.index, place.sub, parameter.to_object(value, before)) == 0, parameter.name
        assert same(parameter, bench.read(parameter.name), value), parameter.name
        tried += 1
    assert tried > 170 // step


def test_pdo_records_and_the_index_of_the_bit_rate_have_their_defaults_over_canopen() -> None:
    bench, tried = Bench(simulator("az3")), 0
    bench.frames()
    for parameter in load("az3").parameters:
        place = parameter.object
        if place is not None and place.index in PDO_RECORDS:
            data = bench.upload(place.index, place.sub)
            assert isinstance(data, bytes), parameter.name
            assert parameter.from_object(data) == parameter.default, parameter.name
            tried += 1
    assert tried > 50
    index = bench.parameter("CAN BITRATE INDEX").object  # 2068h is also CAN BIT RATE, which can be written
    assert index is not None
    assert bench.upload(index.index, index.sub) == b"\x05\x00"


@pytest.mark.parametrize("number", range(4))
def test_pdo_records_can_be_written_in_the_order_of_cia_301(number: int) -> None:
    """Communication and mapping records of the AZ3, every entry, in the order that CiA 301 requires."""
    line = canopen("az3")
    records = [p for p in load("az3").parameters if p.object is not None and p.object.index in PDO_RECORDS]
    for base in (0x1400, 0x1800):
        entries = _by_sub(records, base + number)
        mapped = _by_sub(records, base + 0x200 + number)
        count = mapped.pop(0)
        on = int(line.read(entries[1]))
        with pytest.raises(SdoAbort):
            line.write({mapped[1]: line.read(mapped[1])})  # the PDO is still switched on
        line.write({entries[1]: on | 1 << 31})
        for sub, values in ((2, (254, 255, 0)), (3, (6553.5, 0)), (5, (65535, 0)), (6, (240, 0))):
            for value in values:
                line.write({entries[sub]: value})
                assert line.read(entries[sub]) == value
        before = {sub: line.read(parameter) for sub, parameter in mapped.items()}
        line.write({count: 0})
        for sub, parameter in reversed(mapped.items()):
            line.write({parameter: before[1]})
            assert line.read(parameter) == before[1]
            line.write({parameter: before[sub]})
        line.write({count: len(before), entries[1]: on})
        assert {sub: line.read(parameter) for sub, parameter in mapped.items()} == before
        assert line.read(entries[1]) == on == entries[1].default


def _by_sub(records: list[Parameter], index: int) -> dict[int, Parameter]:
    return {p.object.sub: p for p in records if p.object is not None and p.object.index == index}
