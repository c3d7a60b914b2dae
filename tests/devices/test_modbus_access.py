"""Reading and writing by name over Modbus: the three machines as tables, in virtual time, in any word order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from barewire.codecs import Text, Value, codec, to_registers
from barewire.conversation import Conversation, play
from barewire.devices import Reading, UnknownName, load, read_modbus, write_modbus
from barewire.devices.sim import simulator
from barewire.errors import DecodeError, EncodeError, NoAnswer
from barewire.modbus import Bus, ModbusException, Server, Table
from barewire.modbus.messages.base import Response
from barewire.modbus.messages.registers import ReadHoldingRegisters, ReadHoldingRegistersResponse
from barewire.tcp import TcpLine
from tests.helpers import Peer, refused, serving

AZ3, ADXL, CSD = load("az3"), load("adxl"), load("csd-mt")


class Machine(Table):
    """A table that records the requests: (function, address, quantity or value)."""

    def __init__(self) -> None:
        super().__init__()
        self.requests: list[tuple[int, int, Any]] = []
        self.refuses: set[int] = set()

    def handle(self, request: Any, now: float) -> Response | None:
        content = next(getattr(request, name) for name in ("value", "values", "registers", "bits", "quantity")
                       if hasattr(request, name))  # fmt: skip
        self.requests.append((request.function_code, request.address, content))
        if request.address in self.refuses:
            raise ModbusException(2)
        return super().handle(request, now)

    @property
    def peer(self) -> Peer:
        return serving(Server(TcpLine(), {1: self}, serial=False))


@pytest.fixture
def machine() -> Machine:
    return Machine()


def values(machine: Machine, conversation: Conversation[bytes, list[Reading]]) -> list[Value]:
    return [reading.value for reading in play(conversation, machine.peer)[0]]


def read(machine: Machine, device: Any, *names: str) -> list[Value]:
    return values(machine, read_modbus(Bus(TcpLine()), 1, device, names))


def write(machine: Machine, device: Any, wanted: dict[str, Value], **options: Any) -> None:
    play(write_modbus(Bus(TcpLine()), 1, device, wanted, **options), machine.peer)


def put(table: Any, address: int, registers: Sequence[int]) -> None:
    for offset, register in enumerate(registers):
        table[address + offset] = register


# Reading


def test_readings_have_the_order_of_the_names_with_unit_and_bit_names(machine: Machine) -> None:
    machine.input_registers[24] = 0x0637
    put(machine.input_registers, 0x31, to_registers(codec("u32").encode(50_003)))
    line = TcpLine()
    readings, _ = play(read_modbus(Bus(line), 1, AZ3, ["status word", AZ3.find("STATUS WORD")]), machine.peer)
    assert [(reading.name, reading.value) for reading in readings] == [("STATUS WORD", 0x0637)] * 2
    assert str(readings[0]).startswith("STATUS WORD = 1591 (ready to switch on, switched on, operation enabled,")
    assert read(machine, ADXL, "Frequency") == [50.003]
    assert machine.requests == [(4, 24, 1), (4, 0x31, 2)]


def test_a_float_with_its_low_word_first(machine: Machine) -> None:
    put(machine.holding_registers, 4, (0xCCCD, 0x3F8C))
    value = read(machine, AZ3, "SPIDAC CHANNEL 1 SCALE")[0]
    assert value == pytest.approx(1.1)
    assert machine.requests == [(3, 4, 2)]


def test_halves_bits_and_negative_bytes(machine: Machine) -> None:
    machine.holding_registers[2] = 0x1234
    machine.holding_registers[155] = 0x00FF
    assert read(machine, AZ3, "SPIDAC CHANNEL SEL2", "SPIDAC CHANNEL SEL1") == [0x12, 0x34]
    assert read(machine, AZ3, "MODES OF OPERATION") == [-1]
    machine.input_registers[0x20FF] = 0b101
    assert read(machine, ADXL, "Input 1", "Input 2", "Input 3") == [True, False, True]
    assert machine.requests == [(3, 2, 1), (3, 155, 1), (4, 0x20FF, 1)]


def test_coils_are_read_with_01(machine: Machine) -> None:
    machine.coils[1] = 1
    assert read(machine, AZ3, "START PHASING", "PHASING IN PROGRESS") == [True, False]
    assert machine.requests == [(1, 0, 2)]


def test_wide_numbers_signs_scales_and_text(machine: Machine) -> None:
    put(machine.input_registers, 19, to_registers(codec("i32").encode(-12_345)))
    put(machine.input_registers, 6943, to_registers(codec("u64").encode(1 << 40)))
    put(machine.input_registers, 0x5031, to_registers(Text(56).encode("Overtemperature")))
    names = ["Event description", "L1 active power", "Total active energy"]
    assert read(machine, ADXL, *names) == ["Overtemperature", -0.12345, (1 << 40) / 100]


def test_a_byte_that_has_a_register_to_itself(machine: Machine) -> None:
    machine.holding_registers[1080] = 70
    assert read(machine, CSD, "Current Ratio") == [70]
    write(machine, CSD, {"Current Ratio": 80})
    assert machine.holding_registers[1080] == 80
    assert machine.requests[-1] == (6, 1080, 80)


def test_every_readable_parameter_can_be_read(machine: Machine) -> None:
    for device in (AZ3, ADXL, CSD):
        names = [p.name for p in device.parameters if p.readable and p.modbus]
        assert len(read(machine, device, *names)) == len(names)


# Writing


def test_neighbours_are_written_in_one_request_and_the_order_is_kept(machine: Machine) -> None:
    write(machine, CSD, {"Target Position": -100_000, "Profile Velocity": 5000, "Control Word": 0x1F})
    assert machine.requests == [(16, 1042, (0x7960, 0xFFFE, 5000, 0)), (6, 1040, 0x1F)]


def test_one_value_of_two_registers_is_one_request(machine: Machine) -> None:
    write(machine, AZ3, {"SPIDAC CHANNEL 1 SCALE": 1.1})
    assert machine.requests == [(16, 4, (0xCCCD, 0x3F8C))]


def test_writing_half_a_register_keeps_the_other_half(machine: Machine) -> None:
    machine.holding_registers[2] = 0x1234
    write(machine, AZ3, {"SPIDAC CHANNEL SEL2": 0})
    assert machine.holding_registers[2] == 0x0034
    assert machine.requests == [(3, 2, 1), (6, 2, 0x0034)]


def test_both_halves_of_a_register_are_written_in_one_request(machine: Machine) -> None:
    machine.holding_registers[2] = 0xFFFF
    write(machine, AZ3, {"SPIDAC CHANNEL SEL1": 1, "SPIDAC CHANNEL SEL2": 2, "SPIDAC CHANNEL 1 SCALE": 0.5})
    assert machine.holding_registers[2] == 0x0201
    assert machine.requests == [(3, 2, 1), (6, 2, 0x0201), (16, 4, (0, 0x3F00))]


def test_coils_are_written_with_05(machine: Machine) -> None:
    write(machine, AZ3, {"START PHASING": True, "PHASING IN PROGRESS": 0})
    assert machine.requests == [(5, 1, True), (5, 0, False)]


def test_a_soft_starter_takes_one_register_with_06_at_the_address_below_the_printed_one(machine: Machine) -> None:
    write(machine, ADXL, {"Menu number selection": 1, "Sub-menu number selection": 2, "Parameter value": 10})
    assert machine.requests == [(6, 0x4FFF, 1), (6, 0x5000, 2), (6, 0x5003, 10)]


# Refused before anything is sent


@pytest.mark.parametrize(
    ("device", "wanted", "message"),
    [
        (AZ3, {"STATUS WORD": 1}, "STATUS WORD is read only"),
        (CSD, {"Control Word": 0, "Profile Velocity": 800_001}, "Profile Velocity = 800001: expected 0..800000"),
        (CSD, {"Control Word": 0.5}, "Control Word = 0.5: 0.5 is not a whole number for u16"),
        (CSD, {"Control Word": "on"}, "Control Word = 'on': expected a number"),
        (CSD, {"Control Word": float("nan")}, "Control Word = nan: expected 0..65535"),
        (AZ3, {"START PHASING": 2}, "START PHASING = 2: expected 0 (off) or 1 (on)"),
        (AZ3, {"TDI CW MODE": 256}, "TDI CW MODE = 256: expected"),
        (AZ3, {"COIL WORD 0": 0}, "COIL WORD 0 has no address on Modbus: it is object 2018h:00 on CANopen"),
    ],
)
def test_refused_before_anything_is_sent(device: Any, wanted: dict[str, Value], message: str) -> None:
    with refused(EncodeError, message):
        write_modbus(Bus(TcpLine()), 1, device, wanted)


def test_force_leaves_range_and_access_to_the_device(machine: Machine) -> None:
    write(machine, CSD, {"Profile Velocity": 800_001, "Status Word": 7}, force=True)
    assert machine.requests == [(16, 1044, (800_001 & 0xFFFF, 12)), (6, 1001, 7)]


@pytest.mark.parametrize(
    ("device", "wanted", "message"),
    [
        (CSD, {"Control Word": 70_000}, "Control Word = 70000: 70000 does not fit u16: expected 0..65535"),
        (AZ3, {"STATUS WORD": 1}, "STATUS WORD lies in table 'input', which no function of az3 writes"),
        (AZ3, {"MODES OF OPERATION": 200}, "MODES OF OPERATION = 200: 200 does not fit i8"),
    ],
)
def test_force_does_not_write_values_that_cannot_be_encoded(
    device: Any, wanted: dict[str, Value], message: str
) -> None:
    with refused(EncodeError, message):
        write_modbus(Bus(TcpLine()), 1, device, wanted, force=True)


def test_reading_is_refused_before_anything_is_sent() -> None:
    with refused(EncodeError, "C02 Thermal status reset is write only"):
        read_modbus(Bus(TcpLine()), 1, ADXL, ["Frequency", "C02 Thermal status reset"])
    with refused(UnknownName, "csd-mt has no parameter 'Staus Word'; did you mean 'Status Word'"):
        read_modbus(Bus(TcpLine()), 1, CSD, ["Staus Word"])


# Errors of the other side


def test_what_was_written_before_a_refusal_is_noted(machine: Machine) -> None:
    machine.refuses.add(1080)
    with pytest.raises(ModbusException) as caught:
        write(machine, CSD, {"Control Word": 6, "Mode of Operation": 3, "Current Ratio": 50})
    before = "written before that: Control Word, Mode of Operation"
    assert str(caught.value).endswith("; while writing Current Ratio")
    assert caught.value.__notes__ == [before]
    with pytest.raises(ModbusException) as caught:
        write(machine, CSD, {"Current Ratio": 50})
    assert str(caught.value).endswith("; while writing Current Ratio")
    assert not hasattr(caught.value, "__notes__")


def test_a_command_that_the_device_does_not_answer() -> None:
    """2F03h restarts an ADXL "without any response": a time-out is expected. A refusal is still an error."""
    sent: list[bytes] = []

    def silent(item: bytes, now: float) -> list[tuple[float, bytes]]:
        sent.append(item)
        return []

    play(write_modbus(Bus(TcpLine()), 1, ADXL, {"Save and reboot": 5}), silent)
    assert [item[7:].hex(" ") for item in sent] == ["06 2f 02 00 05"]
    with pytest.raises(NoAnswer) as caught:
        play(write_modbus(Bus(TcpLine()), 1, ADXL, {"Motor start command": 1}), silent)
    assert str(caught.value).endswith("; while writing Motor start command")
    busy = Machine()
    busy.refuses.add(0x2F02)
    with pytest.raises(ModbusException):
        write(busy, ADXL, {"Save and reboot": 5})


def test_no_answer() -> None:
    with pytest.raises(NoAnswer):
        play(read_modbus(Bus(TcpLine()), 1, CSD, ["Status Word"], timeout=0.5), lambda item, now: [])


def test_a_wrong_number_of_registers_for_a_text() -> None:
    with pytest.raises(DecodeError):
        ADXL.find("Event description").from_registers([1, 2])


WORD_ORDER = "Little Endian / Big Endian"


def test_a_machine_with_changed_word_order_is_read_with_that_order() -> None:
    drive, bus = simulator("csd-mt"), Bus(TcpLine())
    assert drive.modbus is not None
    peer = serving(Server(TcpLine(), {1: drive.modbus}, serial=False))
    little, big = load("csd-mt"), load("csd-mt?order=abcd")
    play(write_modbus(bus, 1, little, {"Profile Velocity": 70_000, WORD_ORDER: 0}), peer)
    readings, _ = play(read_modbus(bus, 1, big, ["Profile Velocity"]), peer)
    assert readings[0].value == 70_000
    play(write_modbus(bus, 1, big, {"Target Position": -2, WORD_ORDER: 1}), peer)
    readings, _ = play(read_modbus(bus, 1, little, ["Target Position"]), peer)
    assert readings[0].value == -2


def test_a_simulator_with_changed_word_order() -> None:
    """Setting the register in the simulator changes the word order as a write does."""
    drive = simulator("csd-mt")
    assert drive.modbus is not None
    drive.store[WORD_ORDER] = 0
    drive.store["Profile Velocity"] = 70_000
    answer = drive.modbus.handle(ReadHoldingRegisters(1044, 2), 0.0)
    assert isinstance(answer, ReadHoldingRegistersResponse)
    assert answer.registers == (1, 4464)


def test_a_parameter_with_an_order_of_its_own_keeps_it() -> None:
    az3 = load("az3").in_order("ABCD")
    assert {place.order for row in az3.parameters if (place := row.modbus) and row.type == "f32"} == {"ABCD"}
    assert load("az3").find("ID KP").modbus == az3.find("ID KP").modbus._replace(order="CDAB")  # type: ignore[union-attr]
    assert az3.find("STATUS WORD").object == load("az3").find("STATUS WORD").object


@pytest.mark.parametrize("name", ["csd-mt?order=XYZ", "csd-mt?orders=ABCD", "csd-mt?"])
def test_an_unknown_order(name: str) -> None:
    with refused(UnknownName, f"device '{name}': expected ?order= and one of ABCD, CDAB, BADC, DCBA behind the name"):
        load(name)
