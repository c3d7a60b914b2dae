"""Lab 3: a request in bytes, its response, and an exception."""

from __future__ import annotations

from barewire.devices import load
from barewire.devices.parameter import ModbusAt
from barewire.errors import DecodeError
from barewire.modbus import ReadInputRegisters, decode_request
from barewire.rtu import decode, encode
from barewire.rtu.crc import crc16
from barewire_workbench import explain
from barewire_workbench.cli.teach.labs.model import AnswerCheck, Lab, LabExercise, right, wrong
from barewire_workbench.cli.teach.labs.played import rtu_answer
from barewire_workbench.cli.teach.labs.reading import in_hex, typed_number, typed_octets

_NAME = "Thyristors temperature"


def _place() -> ModbusAt:
    place = load("adxl").find(_NAME).modbus
    assert place is not None
    return place


def whole_frame(answer: str) -> bytes:
    """Return an RTU frame that was typed with or without its CRC.

    >>> whole_frame("01 04 0F B1 00 02") == whole_frame("01 04 0F B1 00 02 22 F8")
    True
    """
    data = typed_octets(answer)
    return data if len(data) > 3 and crc16(data[:-2]).to_bytes(2, "little") == data[-2:] else encode(data[0], data[1:])


def typed_request(answer: str) -> tuple[bytes, AnswerCheck | None]:
    """Return the frame of a request; with a hint if it is not one to unit 1."""
    frame = whole_frame(answer)
    explained = explain("rtu", frame, "request")
    if explained.error is not None:
        typed = len(frame) - 2
        return frame, wrong(
            f"read as unit {frame[0]:02X}, then function and data "
            f"{in_hex(frame[1:-2]) or 'none'} ({typed} bytes; a CRC is "
            f"recognized if it fits): {explained.error.text}"
        )
    if frame[0] != 1:
        return frame, wrong(f"the first byte is the unit: this is a request to unit {frame[0]}, the device is unit 1")
    return frame, None


def _request(answer: str) -> AnswerCheck:
    frame, hint = typed_request(answer)
    if hint is not None:
        return hint
    request, place = decode_request(frame[1:-2]), _place()
    if type(request) is not ReadInputRegisters:
        return wrong(
            f"function code {frame[1]:02X} is {explain('rtu', frame, 'request').fields[1].meaning[3:]}: "
            "the table says input"
        )
    if not request.address <= place.address < place.address + place.words <= request.address + request.quantity:
        return wrong(
            f"this reads {request.quantity} from {request.address:04X}h "
            f"({request.address}); the value has {place.words} "
            f"registers, the first is {place.address}"
        )
    response = rtu_answer(frame)
    if response[1:2] != frame[1:2]:
        return wrong(f"the device answers {in_hex(response)}: {explain('rtu', response, 'response').summary}")
    return right(f"the device answers {in_hex(response)}: {explain('rtu', response, 'response').summary}")


def _value(answer: str) -> AnswerCheck:
    given, parameter, place = typed_number(answer, "\u00b0C", "C", "degrees"), load("adxl").find(_NAME), _place()
    response = decode(rtu_answer(encode(1, ReadInputRegisters(place.address, place.words).encode())))
    raw = int.from_bytes(response.pdu[2:], "big")
    value = parameter.from_raw(raw)
    assert isinstance(value, (int, float))
    if abs(given - value) < 1e-9:
        return right(f"{raw:X}h is {raw}, and the table says x 1/10: {parameter.text(value)}")
    if given == raw:
        return wrong(f"{raw} is the raw value; the table of the device says by what it is multiplied")
    return wrong(
        f"the data of the response are {in_hex(response.pdu[2:])}, one number of 4 "
        f"bytes, the highest byte first; not {given:g}"
    )


def _exception(answer: str) -> AnswerCheck:
    frame, hint = typed_request(answer)
    if hint is not None:
        return hint
    response = rtu_answer(frame)
    if not response:
        return wrong("the device is silent: only a request that it understands gets an exception")
    text = f"the device answers {in_hex(response)}: {explain('rtu', response, 'response').summary}"
    return right(text) if response[1] & 0x80 and response[2] == 2 else wrong(text)


def _silence(answer: str) -> AnswerCheck:
    frame = typed_octets(answer)
    if response := rtu_answer(frame):
        return wrong(f"unit 1 answers {in_hex(response)}: {explain('rtu', response, 'response').summary}")
    try:
        unit = decode(frame).unit
    except DecodeError as error:
        return right(f"no answer: {error.text}. A device that answered a damaged frame might answer for another one")
    return right(
        "no answer: unit 0 is a broadcast, all devices obey and none answers"
        if unit == 0
        else f"no answer: unit {unit} is not on this line"
    )


REGISTER_LAB = Lab(
    3,
    "A register, read by hand",
    "Write a request byte by byte, send it, and read the value from the bytes of the response.",
    25,
    "03-a-register-read-by-hand.md",
    ("barewire simulate adxl rtu:///tmp/adxl",),
    (
        LabExercise(
            "3.1",
            f"Which bytes ask unit 1 for its {_NAME}, input registers {_place().address} and {_place().address + 1}?",
            "the bytes of the request in hexadecimal; the CRC may be left out",
            _request,
        ),
        LabExercise("3.2", "Send them. How warm are the thyristors?", "a temperature in \u00b0C", _value),
        LabExercise(
            "3.3",
            "Which request gets exception 02, illegal data address, from unit 1?",
            "the bytes of a request",
            _exception,
        ),
        LabExercise(
            "3.4", "Which bytes get no answer at all from unit 1?", "the bytes of a frame, with its CRC", _silence
        ),
    ),
)
