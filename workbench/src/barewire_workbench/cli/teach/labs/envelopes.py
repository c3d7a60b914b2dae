"""Lab 5: the same request in two other envelopes: Modbus ASCII with its LRC, and Modbus TCP with its header."""

from __future__ import annotations

from barewire.ascii import decode as decode_ascii, encode as encode_ascii, lrc
from barewire.errors import DecodeError
from barewire.rtu.crc import crc16
from barewire.tcp import decode as decode_tcp, encode as encode_tcp
from barewire_workbench import explain
from barewire_workbench.cli.teach.labs.model import AnswerCheck, Lab, LabExercise, right, wrong
from barewire_workbench.cli.teach.labs.reading import any_number, checked_length, hex_number, in_hex, typed_octets
from barewire_workbench.frames.input import parse_ascii

_UNIT, _PDU = 1, bytes.fromhex("04 0F B1 00 02")
_WRITE = bytes.fromhex("06 00 07 00 2A")
_TRANSACTION = 7
_EXCEPTION = bytes.fromhex("84 02")
_STREAM = [
    encode_tcp(1, bytes.fromhex("04 04 00 00 00 F5"), 7),
    encode_tcp(1, _EXCEPTION, 8),
    encode_tcp(1, bytes.fromhex("03 02 00 2A"), 9),
]


def _lrc(answer: str) -> AnswerCheck:
    data = bytes([_UNIT]) + _PDU
    given, expected = hex_number(answer), lrc(data)
    if given == expected:
        return right(
            f"the bytes add up to {sum(data):X}h; {sum(data) & 0xFF:02X}h + "
            f"{expected:02X}h = 100h, of which a byte keeps 00"
        )
    if given == sum(data) & 0xFF:
        return wrong("that is the sum of the bytes; the LRC is what makes the sum 00h")
    if given == ~sum(data) & 0xFF:
        return wrong("that is what is missing to FFh; the LRC is what is missing to 100h")
    if given == lrc(data.hex().upper().encode()):
        return wrong("that adds the characters; the LRC is computed over the bytes, before they become characters")
    return wrong(f"the sum of the bytes and your LRC is {sum(data) + given:X}h; its last two digits must be 00")


def _ascii(answer: str) -> AnswerCheck:
    typed = checked_length(answer).replace(" ", "")
    if not typed.startswith(":"):
        return wrong("an ASCII frame begins with a colon")
    characters = parse_ascii(typed)
    try:
        adu = decode_ascii(characters if characters.endswith(b"\r\n") else characters + b"\r\n")
    except DecodeError as error:
        reads = explain("ascii", characters).verdict if error.reason != "checksum" else ""
        return wrong(
            reads
            or (
                "the last two characters are read as the LRC, and it does not fit the "
                f"{(len(characters) - 3) // 2} bytes before it"
            )
        )
    if (adu.unit, adu.pdu) == (_UNIT, _WRITE):
        return right(
            f"17 characters with CR LF for {len(_WRITE) + 3} bytes of RTU: unit, PDU and LRC in two characters a byte"
        )
    if adu.pdu[:-2] == _WRITE and adu.pdu[-2:] == crc16(bytes([adu.unit]) + _WRITE).to_bytes(2, "little"):
        return wrong("the CRC of RTU has come along; ASCII has the LRC in its place")
    return wrong(f"a good frame, but it says {explain('ascii', characters).summary}")


def _tcp(answer: str) -> AnswerCheck:
    data = typed_octets(answer)
    if data[-2:] == crc16(bytes([_UNIT]) + _PDU).to_bytes(2, "little"):
        return wrong("the last two bytes are a CRC, which TCP does not have")
    explained = explain("tcp", data, "request")
    if explained.error is not None:
        return wrong(explained.error.text)
    adu = decode_tcp(data)
    if (adu.transaction, adu.unit, adu.pdu) == (_TRANSACTION, _UNIT, _PDU):
        return right(f"{explained.summary}; the length counts the unit and the PDU")
    if (adu.unit, adu.pdu) == (_UNIT, _PDU):
        return wrong(f"the transaction number is {adu.transaction}; the task asks for {_TRANSACTION}")
    return wrong(f"a good frame, but it says {explained.summary}")


def _stream(answer: str) -> AnswerCheck:
    given = any_number(answer)
    for frame in _STREAM:
        adu = decode_tcp(frame)
        if adu.transaction in given:
            text = f"the answer to transaction {adu.transaction} is {in_hex(frame)}"
            return (
                right(f"{text}: bit 7 of its function code is 1")
                if adu.pdu == _EXCEPTION
                else wrong(f"{text}: function code {adu.pdu[0]:02X}")
            )
    return wrong(
        "no frame has this transaction number. Bytes 4 and 5 of a frame say how many "
        "bytes follow them; then the next frame begins"
    )


ENVELOPES_LAB = Lab(
    5,
    "Two other envelopes: ASCII and TCP",
    "Write the same request for a modem line and for a network.",
    25,
    "05-ascii-and-tcp.md",
    ("barewire simulate adxl ascii:///tmp/adxl-ascii tcp://127.0.0.1:1502",),
    (
        LabExercise(
            "5.1", f"Which LRC follows the bytes {in_hex(bytes([_UNIT]) + _PDU)}?", "a byte in hexadecimal", _lrc
        ),
        LabExercise(
            "5.2",
            f"In RTU a frame is {in_hex(bytes([_UNIT]) + _WRITE)} and a CRC. Write it as an ASCII frame.",
            f"{len(encode_ascii(_UNIT, _WRITE)) - 2} characters; CR LF may be left out",
            _ascii,
        ),
        LabExercise(
            "5.3",
            f"Ask unit {_UNIT} over TCP for the same as {in_hex(bytes([_UNIT]) + _PDU)}, "
            f"as transaction {_TRANSACTION}.",
            "the bytes of the frame, header included",
            _tcp,
        ),
        LabExercise(
            "5.4",
            f"A client receives these bytes at once: {in_hex(b''.join(_STREAM))}. Which "
            "transaction was answered with an exception?",
            "a transaction number",
            _stream,
        ),
    ),
)
