"""Lab 4: the CRC of an RTU frame, and the silences that separate frames."""

from __future__ import annotations

from barewire.ascii import lrc
from barewire.errors import DecodeError
from barewire.rtu import decode, encode
from barewire.rtu.crc import crc16
from barewire.rtu.timing import Timing
from barewire_workbench import explain
from barewire_workbench.cli.teach.labs.model import AnswerCheck, Lab, LabExercise, right, wrong
from barewire_workbench.cli.teach.labs.reading import in_hex, typed_octets, typed_seconds, typed_words

_DATA = bytes.fromhex("05 0A")
_GOOD = encode(1, bytes.fromhex("04 0F B1 00 02"))
_FLIPPED_BYTE, _FLIPPED_BIT = 3, 0x20
_DAMAGED = bytes(byte ^ (_FLIPPED_BIT if place == _FLIPPED_BYTE else 0) for place, byte in enumerate(_GOOD))
_SLOW, _FAST, _BITS = 9600, 115200, 11
_LINE = Timing.of(19200, _BITS)
_PAUSES = (0.5e-3, 1.2e-3, 2.5e-3)


def _shifted_crc(data: bytes, value: int, polynomial: int = 0xA001) -> int:
    """Return what the shift register of the CRC holds when it begins with `value`.

    >>> f"{_shifted_crc(bytes.fromhex('02 07'), 0xFFFF):04X}"
    '1241'
    """
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ polynomial if value & 1 else value >> 1
    return value


def _crc(answer: str) -> AnswerCheck:
    given, expected = typed_octets(answer), crc16(_DATA).to_bytes(2, "little")
    if given == expected or given == _DATA + expected:
        return right(
            f"the register ends with {crc16(_DATA):04X}h, and its low byte is sent first: {in_hex(_DATA + expected)}"
        )
    if given == expected[::-1]:
        return wrong("that is the number in the register; on the wire its low byte goes first")
    if len(given) != 2:
        return wrong(f"{len(given)} bytes; a CRC has 2")
    known = {
        _shifted_crc(_DATA, 0): "that comes out if the register begins with 0000h; it begins with FFFFh",
        crc16(_DATA[:1]): "that is the CRC of the first byte alone",
        _shifted_crc(
            _DATA, 0xFFFF, 0x8005
        ): "that comes out with the polynomial 8005h in a register that shifts to the right; mirrored it is A001h",
        lrc(_DATA): "that is the LRC of Modbus ASCII",
    }
    for order in ("little", "big"):
        if text := known.get(int.from_bytes(given, order)):
            return wrong(text)
    return wrong(
        f"{in_hex(given)} is not the CRC of {in_hex(_DATA)}; `barewire steps crc` shows each step for other bytes"
    )


def _repair(answer: str) -> AnswerCheck:
    given = typed_octets(answer)
    changed = int.from_bytes(given, "big") ^ int.from_bytes(_DAMAGED, "big")
    if len(given) != len(_DAMAGED):
        return wrong(f"{len(given)} bytes; the damaged frame has {len(_DAMAGED)}")
    try:
        decode(given)
    except DecodeError as error:
        return wrong(f"that is not valid either: {error.text}")
    if changed.bit_count() != 1:
        return wrong(
            f"that is a valid frame, but it differs from the damaged one in {changed.bit_count()} bits; one was flipped"
        )
    return right(f"{explain('rtu', given).summary}. One bit in {8 * len(given)} was wrong, and the CRC says which")


def _silence(rate: int, answer: str) -> AnswerCheck:
    given, timing = typed_seconds(answer, "ms"), Timing.of(rate, _BITS)
    if abs(given - timing.t35) <= 0.01 * timing.t35:
        fixed = timing.t35 != 3.5 * timing.character
        rule = "fixed above 19200 bit/s" if fixed else f"3.5 characters of {_BITS} bits"
        return right(f"{1e3 * timing.t35:.2f} ms: {rule}")
    for time, text in (
        (timing.character, "that is one character"),
        (timing.t15, "that is t1.5, the longest pause inside a frame"),
        (3.5 * timing.character, "that is 3.5 characters; above 19200 bit/s the standard fixes another time"),
        (35 / rate, "that counts 10 bits a character; with parity there are 11"),
    ):
        if abs(given - time) <= 0.01 * time:
            return wrong(text)
    return wrong(
        f"a character of {_BITS} bits lasts {1e3 * timing.character:.3f} ms; {1e3 * given:g} "
        f"ms are {given / timing.character:.1f} characters"
    )


def _pauses(answer: str) -> AnswerCheck:
    given = [typed_seconds(word, "ms") for word in typed_words(answer) if word.lower() not in ("ms", "and")]
    if len(given) != 2:
        return wrong(
            f"{len(given)} pauses; the task asks for two: the one that ends a frame, then the one that breaks it"
        )
    ends, breaks = given
    for pause in given:
        if not any(abs(pause - known) < 1e-9 for known in _PAUSES):
            return wrong(f"{1e3 * pause:g} ms is none of the pauses of the task")
    if ends < _LINE.t35:
        return wrong(
            f"{1e3 * ends:g} ms is shorter than 3.5 characters of {1e3 * _LINE.character:.3f} ms: it ends no frame"
        )
    if not _LINE.t15 < breaks < _LINE.t35:
        which = (
            "not longer than 1.5 characters: it is allowed inside a frame"
            if breaks <= _LINE.t15
            else "long enough to end a frame"
        )
        return wrong(f"{1e3 * breaks:g} ms is {which}")
    return right(
        f"t1.5 is {1e3 * _LINE.t15:.2f} ms and t3.5 is {1e3 * _LINE.t35:.2f} ms; between the two a frame is broken"
    )


CRC_LAB = Lab(
    4,
    "CRC and silence",
    "Compute the check of a frame by hand, repair a frame with it, and find where frames begin and end.",
    25,
    "04-crc-and-silence.md",
    (),
    (
        LabExercise(
            "4.1",
            f"Which CRC follows the bytes {in_hex(_DATA)} on the wire?",
            "two bytes in the order of the wire",
            _crc,
        ),
        LabExercise(
            "4.2",
            f"One bit of this frame was flipped on its way: {in_hex(_DAMAGED)}. Which frame was sent?",
            f"{len(_DAMAGED)} bytes",
            _repair,
        ),
        LabExercise("4.3", f"How long is t3.5 at {_SLOW} 8E1?", "a time in ms", lambda answer: _silence(_SLOW, answer)),
        LabExercise("4.4", f"And at {_FAST} 8E1?", "a time in ms", lambda answer: _silence(_FAST, answer)),
        LabExercise(
            "4.5",
            f"At 19200 8E1 a recording shows pauses of {', '.join(f'{1e3 * pause:g}' for pause in _PAUSES)} "
            "ms. Which one ends a "
            "frame, and which one breaks it?",
            "two times: the one that ends it, the one that breaks it",
            _pauses,
        ),
    ),
)
