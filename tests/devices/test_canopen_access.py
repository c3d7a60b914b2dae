"""Reading and writing by name over CANopen: a dictionary behind an SDO server, in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from barewire.canopen import STANDARD, CanFrame, Channel, Entry, ObjectDictionary, SdoAbort, SdoServer
from barewire.codecs import Value
from barewire.conversation import play
from barewire.devices import (
    CanopenSettings,
    Device,
    ModbusAt,
    ObjectAt,
    Parameter,
    load,
    names,
    read_canopen,
    write_canopen,
)
from barewire.devices.sdo_dialects import AZ3, DIALECTS
from barewire.errors import DecodeError, EncodeError, NoAnswer
from tests.helpers import refused

DRIVE = load("az3")
NODE = 5


class Machine:
    """A node that records every received frame as text."""

    def __init__(self, dialect: Any = AZ3) -> None:
        entries = [
            Entry(0x6041, 0, "STATUS WORD", "u16", "ro", 0x0637),
            Entry(0x6060, 0, "MODES OF OPERATION", "i8", "rw", -1),
            Entry(0x607A, 0, "TARGET POSITION", "i32", "rw", -100_000),
            Entry(0x2018, 0, "COIL WORD 0", "u16", "rw", 0b0110),
            Entry(0x2028, 0, "SPIDAC CHANNEL 1 SCALE", "f32", "rw", 1.5),
            Entry(0x2002, 0, "IQRMSX10", "i16", "ro", -5),
        ]
        self.objects = ObjectDictionary(entries)
        self.server = SdoServer(NODE, self.objects, dialect)
        self.received: list[str] = []

    def __call__(self, frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        self.received.append(str(frame))
        return [(now + 0.001, answer) for answer in self.server.feed(frame, now)]


@pytest.fixture
def machine() -> Machine:
    return Machine()


def read(peer: Callable[[CanFrame, float], Any], *names: str, **options: Any) -> list[Value]:
    readings, _ = play(read_canopen(NODE, DRIVE, names, **options), peer)
    return [reading.value for reading in readings]


def write(peer: Callable[[CanFrame, float], Any], wanted: dict[str, Value], **options: Any) -> None:
    play(write_canopen(NODE, DRIVE, wanted, **options), peer)


# Reading


def test_values_have_the_order_of_the_names_in_the_dialect_of_the_az3(machine: Machine) -> None:
    names = ["TARGET POSITION", "status word", "MODES OF OPERATION", "IQRMSX10"]
    assert read(machine, *names, dialect=AZ3) == [-100_000, 0x0637, -1, -5]
    assert [frame[:6] for frame in machine.received] == ["605#43", "605#4B", "605#4F", "605#4B"]


def test_the_standard_dialect(machine: Machine) -> None:
    assert read(machine, "STATUS WORD", dialect=STANDARD) == [0x0637]
    assert machine.received == ["605#4041600000000000"]


def test_bits_of_one_object_are_one_transfer(machine: Machine) -> None:
    names = ["PHASING IN PROGRESS", "START PHASING", "ALIGNMENT REQUEST"]
    assert read(machine, *names) == [False, True, True]
    assert len(machine.received) == 1


@pytest.mark.parametrize(
    ("answer", "name", "value"),
    [
        ("43 41 60 00 37 06 00 00", "STATUS WORD", 0x0637),
        ("43 02 20 00 FB FF FF FF", "IQRMSX10", -5),
        ("43 02 20 00 FB FF 00 00", "IQRMSX10", -5),
        ("42 60 60 00 FF 00 00 00", "MODES OF OPERATION", -1),
        ("43 18 20 00 02 00 00 00", "START PHASING", True),
    ],
)
def test_numbers_in_four_bytes(answer: str, name: str, value: Value) -> None:
    frame = CanFrame(0x580 + NODE, bytes.fromhex(answer))
    assert read(lambda item, now: [(now + 0.001, frame)], name) == [value]


def test_an_answer_wider_than_the_type_is_an_error() -> None:
    frame = CanFrame(0x580 + NODE, bytes.fromhex("43 41 60 00 37 06 01 00"))
    with pytest.raises(DecodeError):
        read(lambda item, now: [(now + 0.001, frame)], "STATUS WORD")


def test_every_readable_object_of_the_drive_can_be_read() -> None:
    names = [parameter.name for parameter in DRIVE.parameters if parameter.readable and parameter.object]

    def zeros(frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        return [(now, CanFrame(0x580 + NODE, b"\x43" + frame.data[1:4] + bytes(4)))]

    readings, _ = play(read_canopen(NODE, DRIVE, names), zeros)
    assert [reading.name for reading in readings] == names
    assert {float(reading.value) for reading in readings} == {0.0}


# Writing


def test_writing_in_the_dialect_of_the_az3_takes_four_bytes(machine: Machine) -> None:
    write(machine, {"TARGET POSITION": 100_000, "MODES OF OPERATION": 3}, dialect=AZ3)
    assert machine.received == ["605#237A6000A0860100", "605#2360600003000000"]
    assert machine.objects.get(0x6060) == 3


def test_writing_by_the_letter_of_the_standard() -> None:
    machine = Machine(STANDARD)
    write(machine, {"MODES OF OPERATION": -1, "SPIDAC CHANNEL 1 SCALE": 1.1}, dialect=STANDARD)
    assert machine.received == ["605#2F606000FF000000", "605#23282000CDCC8C3F"]


@pytest.mark.parametrize("dialect", [STANDARD, AZ3])
def test_writing_one_bit_of_an_object_keeps_the_others(dialect: Any) -> None:
    machine = Machine(dialect)
    write(machine, {"PHASING IN PROGRESS": True, "START PHASING": False}, dialect=dialect)
    assert machine.objects.get(0x2018) == 0b0101
    assert len(machine.received) == 4


def test_a_given_channel_is_used(machine: Machine) -> None:
    channel = Channel(NODE, STANDARD)
    play(read_canopen(channel, DRIVE, ["STATUS WORD"]), machine)
    assert channel.counters.responses == 1
    with refused(EncodeError, "the channel to node 5 has the SDO dialect standard, not az3"):
        read_canopen(channel, DRIVE, ["STATUS WORD"], dialect=AZ3)


def test_the_dialects_of_descriptions() -> None:
    assert DIALECTS == {"standard": STANDARD, "az3": AZ3}


# Refused before anything is sent


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"STATUS WORD": 1}, "STATUS WORD is read only"),
        ({"MODES OF OPERATION": 300}, "MODES OF OPERATION = 300: expected"),
        ({"DIGITAL INPUT STATUS": 1}, "DIGITAL INPUT STATUS is read only"),
    ],
)
def test_refused_before_anything_is_sent(wanted: dict[str, Value], message: str) -> None:
    with refused(EncodeError, message):
        write_canopen(NODE, DRIVE, wanted)


def test_a_parameter_without_an_object() -> None:
    with refused(EncodeError, "DIGITAL INPUT STATUS has no object on CANopen: it is input 27 on Modbus (from 0)"):
        read_canopen(NODE, DRIVE, ["DIGITAL INPUT STATUS"])
    with refused(EncodeError, "Status Word has no object on CANopen: it is holding 1001 on Modbus (from 0)"):
        read_canopen(NODE, load("csd-mt"), ["Status Word"])


def test_force_leaves_range_and_access_to_the_device(machine: Machine) -> None:
    write(machine, {"MODES OF OPERATION": 100}, force=True)
    with pytest.raises(SdoAbort):
        write(machine, {"STATUS WORD": 1}, force=True)
    with refused(EncodeError, "MODES OF OPERATION = 300: 300 does not fit i8"):
        write(machine, {"MODES OF OPERATION": 300}, force=True)


def test_eight_bytes_go_in_segments() -> None:
    device = Device("d", "d", (Parameter("wide", "u64", object=ObjectAt(0x2000)),), canopen=CanopenSettings())
    server = SdoServer(NODE, ObjectDictionary([Entry(0x2000, 0, "wide", "u64", "rw", 0)]))

    def peer(frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        return [(now, answer) for answer in server.feed(frame, now)]

    play(write_canopen(NODE, device, {"wide": 1 << 60}), peer)
    (reading,), _ = play(read_canopen(NODE, device, ["wide"]), peer)
    assert reading.value == 1 << 60


def test_parameters_that_no_object_can_carry() -> None:
    rows = (Parameter("flag", "bool", access="wo", object=ObjectAt(0x2002, 0, 3)),)
    device = Device("d", "d", rows, canopen=CanopenSettings())
    with refused(EncodeError, "flag is one bit of an object that cannot be read"):
        write_canopen(NODE, device, {"flag": True})


# Errors of the other side


def test_what_was_written_before_an_abort_is_noted(machine: Machine) -> None:
    with pytest.raises(SdoAbort) as caught:
        write(machine, {"MODES OF OPERATION": 1, "TARGET POSITION": 5, "SPIDAC CHANNEL 2 SCALE": 1.0})
    before = "written before that: MODES OF OPERATION, TARGET POSITION"
    assert str(caught.value).endswith("; while writing SPIDAC CHANNEL 2 SCALE")
    assert caught.value.__notes__ == [before]
    with pytest.raises(SdoAbort) as caught:
        read(machine, "TARGET POSITION", "SPIDAC CHANNEL 2 SCALE")
    assert str(caught.value).endswith("; while reading SPIDAC CHANNEL 2 SCALE")
    assert not hasattr(caught.value, "__notes__")


def test_no_answer() -> None:
    with pytest.raises(NoAnswer):
        read(lambda item, now: [], "STATUS WORD", timeout=0.5)


def test_a_parameter_may_be_given_in_place_of_its_name(machine: Machine) -> None:
    position = DRIVE.find("TARGET POSITION")
    play(write_canopen(NODE, DRIVE, {position: 7}), machine)
    assert machine.objects.get(0x607A) == 7
    assert position.modbus == ModbusAt("holding", 277, 2, order="CDAB")


def test_an_object_may_be_wider_than_its_value() -> None:
    row = Parameter("code", "u8", maximum=9, object=ObjectAt(0x2068, type="u16"))
    assert (row.object_type, row.object_size) == ("u16", 2)
    assert row.to_object(7) == b"\x07\x00"
    assert (row.from_object(b"\x07\x00"), row.from_object(b"\x07\x00\x00\x00")) == (7, 7)
    with pytest.raises(DecodeError, match="2 bytes"):
        row.from_object(b"\x07")


def test_rows_of_one_object_agree_about_its_width() -> None:
    widths: dict[tuple[str, int, int], set[int | None]] = {}
    for name in names():
        for row in load(name).parameters:
            if row.object is not None and row.object.bit is None:
                widths.setdefault((name, row.object.index, row.object.sub), set()).add(row.object_size)
    assert {place: found for place, found in widths.items() if len(found) > 1} == {}
