"""Pictures of recordings: the messages in them, and the states of a drive."""

from __future__ import annotations

import pytest

from barewire.devices import load
from barewire.devices.parameter import ModbusAt
from barewire.errors import BarewireError, DecodeError, EncodeError
from barewire.modbus import ReadHoldingRegisters, WriteSingleRegister
from barewire.modbus.messages import (
    ReadHoldingRegistersResponse,
    ReadWriteMultipleRegisters,
    ReadWriteMultipleRegistersResponse,
    WriteSingleRegisterResponse,
)
from barewire.rtu import encode
from barewire_workbench.frames.modbus_exchanges import RegisterNames, UnitNames
from barewire_workbench.monitor import of_device
from barewire_workbench.pictures.picture import as_svg
from barewire_workbench.pictures.recordings import RecordingOptions, recording_picture
from barewire_workbench.pictures.sequence import SequencePicture
from barewire_workbench.pictures.states import StatesPicture
from tests.workbench.pictures.checks import check

BUS = b"""\
(1.000000) can0 605#4041600000000000
(1.001000) can0 585#4B41600050020000
(1.100000) can0 605#2B40600006000000
(1.101000) can0 585#6040600000000000
(1.200000) can0 605#4041600000000000
(1.201000) can0 585#4B41600031020000
(1.300000) can0 606#2B40600000000000
(1.301000) can0 586#8040600000000206
"""


def states(data: bytes, **options: object) -> StatesPicture:
    picture = recording_picture("a log", data, "states", **options)  # type: ignore[arg-type]
    assert isinstance(picture, StatesPicture)
    return picture


def sequence(data: bytes, **options: object) -> SequencePicture:
    picture = recording_picture("a log", data, **options)  # type: ignore[arg-type]
    assert isinstance(picture, SequencePicture)
    return picture


def test_the_words_of_sdo_transfers() -> None:
    picture = states(BUS)
    assert picture.title == "State machine of CiA 402 of node 5: ready to switch on"
    assert [(step.word.kind, step.word.word, step.taken) for step in picture.steps] == [
        ("status", 0x0250, ()),
        ("control", 0x0006, ()),
        ("status", 0x0231, (2,)),
    ]
    assert picture.steps[0].word.at == pytest.approx(1.001)
    check(picture)


def test_the_words_of_pdos_of_a_known_node() -> None:
    log = b"(1.0) can0 185#5002000000000000\n(1.1) can0 185#5006000000000000\n(1.2) can0 185#3106000000000000\n"
    picture = states(log, known=[of_device(load("az3"), 5)])
    assert [step.word.word for step in picture.steps] == [0x0250, 0x0631], (
        "a word that shows the same state is left out"
    )
    with pytest.raises(BarewireError, match="no status word and no control word of a CiA 402 drive"):
        states(log)


def test_the_pdos_of_another_bus_are_left_out() -> None:
    log = b"(1.0) can0 185#5002000000000000\n(1.1) can1 185#3102000000000000\n"
    picture = states(log, known=[of_device(load("az3"), 5)], options=RecordingOptions(bus="can0"))
    assert [step.word.word for step in picture.steps] == [0x0250]


def test_a_node_without_words() -> None:
    with pytest.raises(BarewireError, match="no status word and no control word of node 7"):
        states(BUS, number=7)


def test_a_refused_write_is_no_control_word() -> None:
    with pytest.raises(BarewireError, match="of node 6"):
        states(BUS, number=6)


def modbus_log() -> bytes:
    device = load("csd-mt")
    assert device.drive is not None
    places = [device.find(name).modbus for name in (device.drive.status_word, device.drive.control_word)]
    assert isinstance(places[0], ModbusAt)
    assert isinstance(places[1], ModbusAt)
    status, control = places[0].address, places[1].address
    frames = []
    for word, state in ((None, 0x0250), (0x0006, 0x0231), (0x0007, 0x0233)):
        if word is not None:
            frames += [WriteSingleRegister(control, word).encode(), WriteSingleRegisterResponse(control, word).encode()]
        registers = (1, state, 3)
        frames += [ReadHoldingRegisters(status - 1, 3).encode(), ReadHoldingRegistersResponse(registers).encode()]
    lines = [f"{1 + place / 100:.3f} {encode(1, pdu).hex(' ')}" for place, pdu in enumerate(frames)]
    return "\n".join(lines).encode()


def test_the_words_of_a_drive_on_modbus() -> None:
    picture = states(modbus_log(), device=load("csd-mt"))
    assert [(step.word.kind, step.word.word) for step in picture.steps] == [
        ("status", 0x0250),
        ("control", 0x0006),
        ("status", 0x0231),
        ("control", 0x0007),
        ("status", 0x0233),
    ]
    assert picture.name == "unit 1"


def test_one_request_can_write_a_control_word_and_read_the_status_word() -> None:
    device = load("csd-mt")
    assert device.drive is not None
    places = [device.find(name).modbus for name in (device.drive.status_word, device.drive.control_word)]
    status, control = (place.address for place in places if place is not None)
    request = ReadWriteMultipleRegisters(status, 1, control, [0x0006])
    answer = ReadWriteMultipleRegistersResponse((0x0231,))
    log = "\n".join(f"{at} {encode(1, pdu.encode()).hex(' ')}" for at, pdu in ((1.0, request), (1.01, answer)))
    picture = states(log.encode(), device=device)
    assert [(step.word.kind, step.word.word) for step in picture.steps] == [("control", 6), ("status", 0x0231)]


def test_modbus_needs_the_description_of_a_drive() -> None:
    with pytest.raises(BarewireError, match="--device NAME"):
        states(modbus_log())
    with pytest.raises(EncodeError, match="adxl is not a drive"):
        states(modbus_log(), device=load("adxl"))


def test_messages_of_both_protocols() -> None:
    for data, station in ((BUS, "master"), (modbus_log(), "client")):
        picture = recording_picture("a log", data)
        assert isinstance(picture, SequencePicture)
        assert picture.stations[0] == station
        assert picture.messages[0].at is not None
        check(picture)


def test_values_have_the_names_of_a_description() -> None:
    names = UnitNames({1: RegisterNames(load("csd-mt"))})
    texts = [message.text for message in sequence(modbus_log(), names=names).messages]
    assert any("Status Word" in text and "ready to switch on" in text for text in texts)
    log = b"(1.0) can0 185#3706000000000000\n"
    (message,) = sequence(log, known=[of_device(load("az3"), 5)]).messages
    assert message.text.startswith("TPDO1 from node 5: STATUS WORD = 1591")


def test_time_never_runs_backwards() -> None:
    picture = sequence(b"1.0 01 03 00 00 00 02 C4 0B\n1.01 01 03 04 00 17 00 07 0B 00\n")
    times = [message.at for message in picture.messages]
    assert len(times) == 3
    assert times == sorted(time for time in times if time is not None)


def test_the_recording_ends_before_the_answer() -> None:
    picture = sequence(b"1.0 01 03 00 00 00 02 C4 0B\n")
    assert [(message.text, message.wrong) for message in picture.messages][-1] == ("the recording ends here", False)
    check(picture)


def test_a_log_without_times() -> None:
    for data in (b"  can0  705   [1]  05\n", b"01 03 00 00 00 02 C4 0B\n01 03 04 00 17 00 07 7B F5\n"):
        picture = recording_picture("a log", data)
        assert isinstance(picture, SequencePicture)
        assert {message.at for message in picture.messages} == {None}
        assert not any("after" in message.text for message in picture.messages)


def test_what_is_no_recording() -> None:
    with pytest.raises(DecodeError):
        recording_picture("a log", b"\xff\xfe\x00")


def test_a_log_of_many_frames_is_bounded() -> None:
    line = b"".join(b"(%d.%06d) can0 705#05\n" % divmod(place, 1000) for place in range(5_000))
    picture = recording_picture("long", line)
    assert len(as_svg(picture)) < 120_000
    assert "4900 are left out" in picture.lines()[-1]
