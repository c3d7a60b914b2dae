"""Labs 3, 5 and 6: a request by hand, the same one in ASCII and on TCP, and registers as numbers."""

from __future__ import annotations

from barewire.ascii import decode as decode_ascii, encode as encode_ascii, lrc
from barewire.codecs import ORDERS, codec
from barewire.codecs.order import Order
from barewire.devices import load
from barewire.devices.parameter import ModbusAt
from barewire.devices.sim import simulator
from barewire.errors import DecodeError
from barewire.modbus import ReadInputRegisters, decode_request
from barewire.modbus.server.server import Server
from barewire.rtu import decode, encode
from barewire.rtu.crc import crc16
from barewire.rtu.frame import Timing
from barewire.rtu.line import RtuLine
from barewire.tcp import decode as decode_tcp, encode as encode_tcp
from barewire_workbench import explain
from barewire_workbench.cli.labs.model import (
    AnswerCheck,
    Lab,
    WrongAnswer,
    any_number,
    check_of_meaning,
    checked_length,
    hex_number,
    in_hex,
    right,
    typed_number,
    typed_octets,
    wrong,
)
from barewire_workbench.frames.input import parse_ascii


def rtu_answer(request: bytes) -> bytes:
    """Return what a simulated ADXL at unit 1 answers on RTU, in virtual time; nothing if it stays silent.

    >>> rtu_answer(bytes.fromhex("01 04 0F B1 00 02 22 F8")).hex(" ")
    '01 04 04 00 00 00 f5 3b c3'
    """
    units = {1: simulator("adxl").modbus}
    server = Server(RtuLine(Timing.of(19200), role="server", units=units), units, serial=True)
    replies = server.feed(request, 1.0)
    while not replies and server.deadline is not None:
        replies = server.feed(None, server.deadline)
    return b"".join(reply.data for reply in replies)


def _ends_with_crc(data: bytes) -> bool:
    return crc16(data[:-2]).to_bytes(2, "little") == data[-2:]


def typed_request(answer: str) -> bytes:
    """Return the RTU frame of a request, typed with or without its CRC. Raises WrongAnswer if unit 1 would not get it.

    >>> typed_request("01 04 0F B1 00 02") == typed_request("01 04 0F B1 00 02 22 F8")
    True
    """
    data = typed_octets(answer)
    frame = data if len(data) > 3 and _ends_with_crc(data) else encode(data[0], data[1:])
    error = explain("rtu", frame, "request").error
    if error is not None:
        raise WrongAnswer(
            f"read as unit {frame[0]:02X}, then function and data {in_hex(frame[1:-2]) or 'none'} "
            f"({len(frame) - 2} bytes; a CRC is recognized if it fits): {error.text}"
        )
    if frame[0] != 1:
        raise WrongAnswer(f"the first byte is the unit: this is a request to unit {frame[0]}, the device is unit 1")
    return frame


def _response_text(response: bytes) -> str:
    return f"{in_hex(response)}: {explain('rtu', response, 'response').summary}"


# Lab 3

REGISTER_LAB = Lab(
    *(3, "A register, read by hand"),
    "Write a request byte by byte, send it, and read the value from the bytes of the response.",
    *(25, "03-a-register-read-by-hand.md"),
    devices=("barewire simulate adxl rtu:///tmp/adxl",),
)
_NAME = "Thyristors temperature"


def _place() -> ModbusAt:
    place = load("adxl").find(_NAME).modbus
    assert place is not None
    return place


@REGISTER_LAB.ask(
    f"Which bytes ask unit 1 for its {_NAME}, input registers {_place().address} and {_place().address + 1}?",
    "the bytes of the request in hexadecimal; the CRC may be left out",
    "01 04 0F B1 00 02",
)
def _request(answer: str) -> AnswerCheck:
    frame = typed_request(answer)
    request, place = decode_request(frame[1:-2]), _place()
    if type(request) is not ReadInputRegisters:
        name = explain("rtu", frame, "request").fields[1].meaning[3:]
        return wrong(f"function code {frame[1]:02X} is {name}: the table says input")
    if not request.address <= place.address < place.address + place.words <= request.address + request.quantity:
        return wrong(
            f"this reads {request.quantity} from {request.address:04X}h ({request.address}); "
            f"the value has {place.words} registers, the first is {place.address}"
        )
    response = rtu_answer(frame)
    text = f"the device answers {_response_text(response)}"
    return right(text) if response[1:2] == frame[1:2] else wrong(text)


@REGISTER_LAB.ask("Send them. How warm are the thyristors?", "a temperature in \u00b0C", "24.5")
def _temperature(answer: str) -> AnswerCheck:
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
        f"the data of the response are {in_hex(response.pdu[2:])}, one number of 4 bytes, the highest byte first; "
        f"not {given:g}"
    )


@REGISTER_LAB.ask(
    "Which request gets exception 02, illegal data address, from unit 1?", "the bytes of a request", "01 04 FF FF 00 02"
)
def _exception(answer: str) -> AnswerCheck:
    response = rtu_answer(typed_request(answer))
    if not response:
        return wrong("the device is silent: only a request that it understands gets an exception")
    text = f"the device answers {_response_text(response)}"
    return right(text) if response[1] & 0x80 and response[2] == 2 else wrong(text)


@REGISTER_LAB.ask(
    "Which bytes get no answer at all from unit 1?", "the bytes of a frame, with its CRC", "02 04 0F B1 00 02 22 CB"
)
def _unanswered(answer: str) -> AnswerCheck:
    frame = typed_octets(answer)
    if response := rtu_answer(frame):
        return wrong(f"unit 1 answers {_response_text(response)}")
    try:
        unit = decode(frame).unit
    except DecodeError as error:
        return right(f"no answer: {error.text}. A device that answered a damaged frame might answer for another one")
    if unit == 0:
        return right("no answer: unit 0 is a broadcast, all devices obey and none answers")
    return right(f"no answer: unit {unit} is not on this line")


# Lab 5

ENVELOPES_LAB = Lab(
    *(5, "Two other envelopes: ASCII and TCP", "Write the same request for a modem line and for a network."),
    *(25, "05-ascii-and-tcp.md"),
    devices=("barewire simulate adxl ascii:///tmp/adxl-ascii tcp://127.0.0.1:1502",),
)
_UNIT, _PDU, _TRANSACTION = 1, bytes.fromhex("04 0F B1 00 02"), 7
_READ_BYTES = bytes([_UNIT]) + _PDU
_WRITE = bytes.fromhex("06 00 07 00 2A")
_EXCEPTION = bytes.fromhex("84 02")
_STREAM = [
    encode_tcp(1, bytes.fromhex("04 04 00 00 00 F5"), 7),
    encode_tcp(1, _EXCEPTION, 8),
    encode_tcp(1, bytes.fromhex("03 02 00 2A"), 9),
]


@ENVELOPES_LAB.ask(f"Which LRC follows the bytes {in_hex(_READ_BYTES)}?", "a byte in hexadecimal", "39")
def _lrc(answer: str) -> AnswerCheck:
    given, expected, total = hex_number(answer), lrc(_READ_BYTES), sum(_READ_BYTES)
    added_up = f"the bytes add up to {total:X}h; {total & 0xFF:02X}h + {expected:02X}h = 100h, of which a byte keeps 00"
    of_characters = "that adds the characters; the LRC is computed over the bytes, before they become characters"
    return {
        expected: right(added_up),
        total & 0xFF: wrong("that is the sum of the bytes; the LRC is what makes the sum 00h"),
        ~total & 0xFF: wrong("that is what is missing to FFh; the LRC is what is missing to 100h"),
        lrc(_READ_BYTES.hex().upper().encode()): wrong(of_characters),
    }.get(given, wrong(f"the sum of the bytes and your LRC is {total + given:X}h; its last two digits must be 00"))


@ENVELOPES_LAB.ask(
    f"In RTU a frame is {in_hex(bytes([_UNIT]) + _WRITE)} and a CRC. Write it as an ASCII frame.",
    f"{len(encode_ascii(_UNIT, _WRITE)) - 2} characters; CR LF may be left out",
    ":01060007002AC8",
)
def _ascii(answer: str) -> AnswerCheck:
    typed = checked_length(answer).replace(" ", "")
    if not typed.startswith(":"):
        return wrong("an ASCII frame begins with a colon")
    characters = parse_ascii(typed)
    try:
        adu = decode_ascii(characters if characters.endswith(b"\r\n") else characters + b"\r\n")
    except DecodeError as error:
        if error.reason != "checksum":
            return wrong(explain("ascii", characters).verdict)
        count = (len(characters) - 3) // 2
        return wrong(f"the last two characters are read as the LRC, and it does not fit the {count} bytes before it")
    if (adu.unit, adu.pdu) == (_UNIT, _WRITE):
        return right(
            f"17 characters with CR LF for {len(_WRITE) + 3} bytes of RTU: unit, PDU and LRC in two characters a byte"
        )
    if adu.pdu[:-2] == _WRITE and _ends_with_crc(bytes([adu.unit]) + adu.pdu):
        return wrong("the CRC of RTU has come along; ASCII has the LRC in its place")
    return wrong(f"a good frame, but it says {explain('ascii', characters).summary}")


@ENVELOPES_LAB.ask(
    f"Ask unit {_UNIT} over TCP for the same as {in_hex(_READ_BYTES)}, as transaction {_TRANSACTION}.",
    "the bytes of the frame, header included",
    "00 07 00 00 00 06 01 04 0F B1 00 02",
)
def _tcp(answer: str) -> AnswerCheck:
    data = typed_octets(answer)
    if data[-2:] == crc16(_READ_BYTES).to_bytes(2, "little"):
        return wrong("the last two bytes are a CRC, which TCP does not have")
    explained = explain("tcp", data, "request")
    if explained.error is not None:
        return wrong(explained.error.text)
    adu = decode_tcp(data)
    if (adu.unit, adu.pdu) != (_UNIT, _PDU):
        return wrong(f"a good frame, but it says {explained.summary}")
    if adu.transaction != _TRANSACTION:
        return wrong(f"the transaction number is {adu.transaction}; the task asks for {_TRANSACTION}")
    return right(f"{explained.summary}; the length counts the unit and the PDU")


@ENVELOPES_LAB.ask(
    f"A client receives these bytes at once: {in_hex(b''.join(_STREAM))}. "
    "Which transaction was answered with an exception?",
    "a transaction number",
    "8",
)
def _stream(answer: str) -> AnswerCheck:
    given = any_number(answer)
    for frame in _STREAM:
        adu = decode_tcp(frame)
        if adu.transaction in given:
            text = f"the answer to transaction {adu.transaction} is {in_hex(frame)}"
            if adu.pdu == _EXCEPTION:
                return right(f"{text}: bit 7 of its function code is 1")
            return wrong(f"{text}: function code {adu.pdu[0]:02X}")
    return wrong(
        "no frame has this transaction number. Bytes 4 and 5 of a frame say how many bytes follow them; "
        "then the next frame begins"
    )


# Lab 6

VALUES_LAB = Lab(
    *(6, "Values and word order"),
    "Get numbers with a sign, long numbers and floats out of 16-bit registers, in the order that the device has.",
    *(20, "06-values-and-word-order.md"),
    devices=("barewire simulate table tcp://127.0.0.1:1503",),
)
_SIGNED = bytes.fromhex("FF 38")
_COUNTER, _FLOAT, _PRINTED = 100_000, 19.25, 40108
_ORDER: Order = "CDAB"
_MIXED_ORDERS = [order for order in ORDERS if order != "ABCD"]


@VALUES_LAB.ask(f"A register holds {in_hex(_SIGNED)}, type i16. Which number is it?", "a number", "-200")
def _i16(answer: str) -> AnswerCheck:
    given, signed, unsigned = typed_number(answer), codec("i16").decode(_SIGNED), codec("u16").decode(_SIGNED)
    return {
        signed: right(f"{in_hex(_SIGNED)} is {unsigned} without a sign; minus 65536 that is {signed}"),
        unsigned: wrong("that is the number without a sign; in an i16 the highest bit counts -32768"),
    }.get(given, wrong(f"as i16, {given:g} is not {in_hex(_SIGNED)}"))


@VALUES_LAB.ask(
    f"Registers 10 and 11 hold {_COUNTER >> 16} and {_COUNTER & 0xFFFF}, type u32, the high half first. "
    "Which number is it?",
    "a number",
    "100000",
)
def _u32(answer: str) -> AnswerCheck:
    data = codec("u32").encode(_COUNTER)
    in_order = f"{data.hex().upper()}h: the register with the lower address has the high half, order ABCD"
    checks = {_COUNTER: right(in_order)}
    for order in _MIXED_ORDERS:
        hint = f"that is the number in order {order}; the task says that the high half is in the first register"
        checks[int(codec("u32", order).decode(data))] = wrong(hint)
    halves = f"the registers are {in_hex(data)} in hexadecimal"
    otherwise = wrong(f"the first register counts 65536, the second one 1: {halves}")
    return check_of_meaning(any_number(answer), checks, otherwise)


@VALUES_LAB.ask(
    f"Two registers with a room temperature, type f32, hold {in_hex(codec('f32', _ORDER).encode(_FLOAT))}. "
    "Which order has the device?",
    f"one of {', '.join(ORDERS)}",
    "CDAB",
)
def _word_order(answer: str) -> AnswerCheck:
    typed, registers = answer.strip().upper(), codec("f32", _ORDER).encode(_FLOAT)
    order = next((order for order in ORDERS if order == typed), None)
    if order is None:
        return wrong(f"expected one of {', '.join(ORDERS)}")
    value = codec("f32", order).decode(registers)
    if value == _FLOAT:
        return right(f"{in_hex(registers)} in order {typed} is {value} \u00b0C; A is the highest byte of the number")
    return wrong(f"in order {typed} these registers are {value:.6g}, hardly a temperature")


@VALUES_LAB.ask("Which two registers hold -1.5 as f32 in order ABCD?", "four bytes in hexadecimal", "BF C0 00 00")
def _to_registers(answer: str) -> AnswerCheck:
    data = typed_octets(answer)
    if len(data) != 4:
        return wrong(f"{len(data)} bytes; two registers have 4")
    value = codec("f32").decode(data)
    if value == -1.5:
        return right(f"1.5 = 1.5 x 2^0: sign 1, exponent 0 + 127, fraction 0.5: {in_hex(data)}")
    for order in _MIXED_ORDERS:
        if codec("f32", order).decode(data) == -1.5:
            return wrong(f"that is -1.5 in order {order}; the task asks for ABCD")
    return wrong(f"as f32 in order ABCD that is {value:.6g}")


@VALUES_LAB.ask(
    f"A manual prints holding register {_PRINTED}. Which address goes into the request?",
    "a number, decimal or hexadecimal with h",
    "107",
)
def _address(answer: str) -> AnswerCheck:
    number = _PRINTED - 40000
    address = number - 1
    counted = f"{_PRINTED} is holding register number {number}, counted from 1"
    digit = "its first digit, 4, names the table, which the function code says on the wire"
    return check_of_meaning(
        any_number(answer),
        {
            address: right(f"{counted}; on the wire {address}, {address:04X}h"),
            _PRINTED: wrong(f"that is the printed number; {digit}"),
            number: wrong("that is its number counted from 1; on the wire addresses are counted from 0"),
        },
        wrong("the first digit names the table, the other four the number in it, counted from 1"),
    )
