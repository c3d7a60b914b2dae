"""Labs 1, 2 and 4, what is on a serial line: levels and baud rate, parity, the CRC and the silences of RTU."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from barewire.ascii import lrc
from barewire.errors import DecodeError
from barewire.rtu import decode, encode
from barewire.rtu.crc import crc16
from barewire.rtu.frame import Timing
from barewire_workbench import explain
from barewire_workbench.cli.labs.model import (
    AnswerCheck,
    Lab,
    check_of_time,
    hex_number,
    in_hex,
    right,
    typed_bits,
    typed_number,
    typed_octets,
    typed_seconds,
    typed_words,
    wrong,
)
from barewire_workbench.wire import CharacterFormat, ReceiverFault, UartLine, character_levels

_8N1, _8E1, _7E1 = CharacterFormat(8, "N", 1), CharacterFormat(8, "E", 1), CharacterFormat(7, "E", 1)


def _levels(byte: int, character: CharacterFormat = _8N1, separator: str = " ") -> str:
    return separator.join(map(str, character_levels(byte, character)))


def _byte_of(levels: Iterable[int]) -> int:
    return sum(level << place for place, level in enumerate(levels))


# Lab 1

BITS_LAB = Lab(
    *(1, "Bits on a wire", "Read a byte from the levels of a wire, and draw the levels of a byte."),
    *(20, "01-bits-on-a-wire.md"),
)
_RATE = 9600
_DRAWN, _SHOWN, _MISREAD = 0x4D, 0x53, 0x01


@BITS_LAB.ask(f"How long is one bit at {_RATE} baud, in microseconds?", "a time, such as 52 us", "104.2 us")
def _bit_time(answer: str) -> AnswerCheck:
    given, bit = typed_seconds(answer, "us"), 1 / _RATE
    rate = f"{1 / given:.0f}" if given > 0 else "endlessly many"
    return check_of_time(
        given,
        {
            bit: right(f"one second holds {_RATE} bits, so one bit lasts 1/{_RATE} s = {1e6 * bit:.1f} us"),
            _8N1.bits * bit: wrong("that is the time of a whole character; the task asks for one of its bits"),
        },
        wrong(f"with bits of {1e6 * given:g} us, one second would hold {rate} of them, not {_RATE}"),
    )


@BITS_LAB.ask(
    f"Which levels has the letter {chr(_DRAWN)}, {_DRAWN:02X}h, on a line with 8N1, from the first one on?",
    f"{_8N1.bits} bits in the order of time",
    "0101100101",
)
def _draw(answer: str) -> AnswerCheck:
    given, expected = typed_bits(answer), list(character_levels(_DRAWN, _8N1))
    if given == expected:
        return right(f"a receiver reads {_DRAWN:02X}h, the letter {chr(_DRAWN)}")
    if len(given) != _8N1.bits:
        return wrong(f"{len(given)} levels; a character of 8N1 has {_8N1.bits}: start bit, 8 data bits, stop bit")
    if given[0] != 0:
        return wrong("the first level is 1, as the idle line is: no receiver would see that a character begins")
    if given[-1] != 1:
        return wrong("the last level is 0: a stop bit is 1, so that the next start bit is a change")
    if given[1:-1] == expected[-2:0:-1]:
        return wrong("these are the data bits with the highest one first; on the wire the lowest one goes first")
    byte = _byte_of(given[1:-1])
    return wrong(f"a receiver reads these levels as {byte:02X}h = {byte:08b}b; {_DRAWN:02X}h is {_DRAWN:08b}b")


@BITS_LAB.ask(f"A line with 8N1 shows {_levels(_SHOWN)}. Which byte is it?", "a byte in hexadecimal, such as 4D", "53")
def _read(answer: str) -> AnswerCheck:
    text = answer.strip()
    given = ord(text) if len(text) == 1 and text.isalpha() else hex_number(text)
    if given == _SHOWN:
        return right(f"{_SHOWN:02X}h, the letter {chr(_SHOWN)}: its levels are {_levels(_SHOWN)}")
    if given == int(f"{_SHOWN:08b}"[::-1], 2):
        return wrong("you read the data bits from left to right; the first one on the wire is the lowest one, bit 0")
    if given > 0xFF and not set(text) - set("01") and len(text) == 8:
        return wrong("these are eight bits: put the first one on the wire last, then write each four as one digit")
    if given > 0xFF:
        return wrong(f"{given:X}h is more than a byte can hold: leave out the start bit and the stop bit")
    return wrong(f"the levels of {given:02X}h would be {_levels(given)}")


@BITS_LAB.ask(f"How many bytes can a line with {_RATE} 8N1 carry in a second?", "a number", "960")
def _throughput(answer: str) -> AnswerCheck:
    given, expected = typed_number(answer, "bytes/s", "bytes", "B/s"), _RATE / _8N1.bits
    return {
        expected: right(f"{_RATE} bits a second / {_8N1.bits} bits a character = {expected:g} bytes a second"),
        _RATE / 8: wrong("that counts the 8 data bits only; the start bit and the stop bit take time too"),
    }.get(given, wrong(f"{given:g} bytes of {_8N1.bits} bits are {given * _8N1.bits:g} bits a second, not {_RATE}"))


@BITS_LAB.ask(
    f"A device sends {_MISREAD:02X}h with {_RATE} 8N1; a receiver is set to {2 * _RATE} 8N1. "
    "Which byte does it read first?",
    "a byte in hexadecimal",
    "06",
)
def _misread(answer: str) -> AnswerCheck:
    given, expected = hex_number(answer), UartLine(_8N1, ReceiverFault(faster=2)).read(bytes([_MISREAD]))[0]
    if given == expected:
        return right("each bit of the sender is sampled twice, and half of the byte is over when the receiver is done")
    samples = " ".join(f"{level} {level}" for level in character_levels(_MISREAD, _8N1))
    return wrong(
        f"not {given:02X}h. The receiver takes a sample every 52 us, two in each bit of the sender: {samples}. "
        "The first is its start bit, the next eight are its data bits, the lowest first"
    )


# Lab 2

PARITY_LAB = Lab(
    *(2, "A byte and its parity", "Add the bit that shows damage, and see what it cannot show."),
    *(20, "02-a-byte-and-its-parity.md"),
)
_BYTES = (0x01, 0x07, 0x0F, 0x80)
_PARITY_RATE = 19200
_FOOLED, _LETTER = 0x03, 0x43


def _received() -> list[tuple[int, ...]]:
    """Return the levels of four characters; level 6 of the third one, a data bit, is inverted."""
    characters = [list(character_levels(byte, _8E1)) for byte in (0x01, 0x04, 0x0F, 0xB1)]
    characters[2][6] ^= 1
    return [tuple(levels) for levels in characters]


def _ones_text(ones: int) -> str:
    return "1 one" if ones == 1 else f"{ones} ones"


@PARITY_LAB.ask(
    f"Which parity bits have the bytes {in_hex(bytes(_BYTES))} with 8E1?", "4 bits in the order of the bytes", "1101"
)
def _parity_bits(answer: str) -> AnswerCheck:
    given, expected = typed_bits(answer), [character_levels(byte, _8E1)[-2] for byte in _BYTES]
    if given == expected:
        return right("with its parity bit, each of these bytes has an even number of ones")
    if len(given) != len(expected):
        return wrong(f"{len(given)} bits; there are {len(expected)} bytes, each with one parity bit")
    if given == [1 - bit for bit in expected]:
        return wrong("with these bits each byte has an odd number of ones: that is odd parity, 8O1")
    byte, bit = next((byte, bit) for byte, bit, even in zip(_BYTES, given, expected) if bit != even)
    ones = byte.bit_count()
    return wrong(
        f"{byte:02X}h = {byte:08b}b has {_ones_text(ones)}; with the parity bit {bit} that makes {ones + bit}, "
        "which is odd"
    )


@PARITY_LAB.ask(
    "Four characters with 8E1 arrive: "
    + ";  ".join(f"({place}) {''.join(map(str, levels))}" for place, levels in enumerate(_received(), 1))
    + ". Which one was damaged?",
    "its number, 1 to 4",
    "3",
)
def _damaged_character(answer: str) -> AnswerCheck:
    given, received = int(typed_number(answer)), _received()
    if not 1 <= given <= len(received):
        return wrong(f"expected the number of a character, 1 to {len(received)}")
    ones = sum(received[given - 1][1:-1])
    if ones % 2:
        return right(
            f"its data bits and its parity bit have {_ones_text(ones)}, an odd number; "
            "which bit is wrong, parity cannot tell"
        )
    return wrong(
        f"data bits and parity bit of character {given} have {_ones_text(ones)}, an even number: nothing to see there"
    )


@PARITY_LAB.ask(
    f"How long is a character at {_PARITY_RATE} 8E1, in milliseconds?", "a time, such as 1.04 ms", "0.573 ms"
)
def _character_time(answer: str) -> AnswerCheck:
    given, expected = typed_seconds(answer, "ms"), Timing.of(_PARITY_RATE, _8E1.bits).character
    checks = {expected: right(f"{_8E1.bits} bits / {_PARITY_RATE} bit/s = {1e3 * expected:.3f} ms")}
    for count, text in ((8, "the data bits alone"), (9, "data and parity"), (10, "a character without parity")):
        hint = f"that is the time of {count} bits, {text}; which bits has a character of 8E1?"
        checks[count / _PARITY_RATE] = wrong(hint)
    bits = f"{given * _PARITY_RATE:.1f} bits"
    otherwise = f"{1e3 * given:g} ms at {_PARITY_RATE} bit/s are {bits}; a character of 8E1 has another number"
    return check_of_time(given, checks, wrong(otherwise))


@PARITY_LAB.ask(
    f"{_FOOLED:02X}h was sent with 8E1. Name a byte that can arrive in its place without a parity error.",
    "a byte in hexadecimal",
    "00",
)
def _undetected(answer: str) -> AnswerCheck:
    given = hex_number(answer)
    if given > 0xFF:
        return wrong(f"{given:X}h is no byte: expected 00 to FF")
    changed = (given ^ _FOOLED).bit_count()
    if changed == 0:
        return wrong("that is the byte itself: nothing was damaged")
    if changed % 2:
        return wrong(
            f"{given:02X}h differs in {changed} bit{'s' * (changed > 1)}: the number of ones "
            "changes from even to odd, and parity finds that"
        )
    return right(f"{given:02X}h differs in {changed} bits and has an even number of ones again: parity does not see it")


@PARITY_LAB.ask(
    f"A device sends the letter {chr(_LETTER)}, {_LETTER:02X}h, with 7E1; the receiver is set to 8N1. "
    "Which byte does it read?",
    "a byte in hexadecimal",
    "C3",
)
def _seven_bits(answer: str) -> AnswerCheck:
    given = hex_number(answer)
    misread = _byte_of(character_levels(_LETTER, _7E1)[1:9])
    return {
        misread: right(
            "the parity bit of the sender stands where the receiver has bit 7. 7E1 and 8N1 have equally many bits"
        ),
        _LETTER: wrong(
            "that is what was sent. Write down its 10 levels with 7E1, and read levels 2 to 9 as 8 data bits"
        ),
    }.get(
        given,
        wrong(
            f"the levels are {_levels(_LETTER, _7E1)}; an 8N1 receiver reads levels 2 to 9 as data, "
            f"the lowest bit first: not {given:02X}h"
        ),
    )


# Lab 4

CRC_LAB = Lab(
    *(4, "CRC and silence"),
    "Compute the check of a frame by hand, repair a frame with it, and find where frames begin and end.",
    *(25, "04-crc-and-silence.md"),
)
_DATA = bytes.fromhex("05 0A")
_GOOD = encode(1, bytes.fromhex("04 0F B1 00 02"))
_DAMAGED = _GOOD[:3] + bytes([_GOOD[3] ^ 0x20]) + _GOOD[4:]
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


@CRC_LAB.ask(f"Which CRC follows the bytes {in_hex(_DATA)} on the wire?", "two bytes in the order of the wire", "82 E7")
def _crc(answer: str) -> AnswerCheck:
    given, expected = typed_octets(answer), crc16(_DATA).to_bytes(2, "little")
    if given in (expected, _DATA + expected):
        return right(
            f"the register ends with {crc16(_DATA):04X}h, and its low byte is sent first: {in_hex(_DATA + expected)}"
        )
    if given == expected[::-1]:
        return wrong("that is the number in the register; on the wire its low byte goes first")
    if len(given) != 2:
        return wrong(f"{len(given)} bytes; a CRC has 2")
    mirrored = "that comes out with the polynomial 8005h in a register that shifts to the right; mirrored it is A001h"
    mistakes = {
        _shifted_crc(_DATA, 0): "that comes out if the register begins with 0000h; it begins with FFFFh",
        crc16(_DATA[:1]): "that is the CRC of the first byte alone",
        _shifted_crc(_DATA, 0xFFFF, 0x8005): mirrored,
        lrc(_DATA): "that is the LRC of Modbus ASCII",
    }
    for order in ("little", "big"):
        if hint := mistakes.get(int.from_bytes(given, order)):
            return wrong(hint)
    return wrong(
        f"{in_hex(given)} is not the CRC of {in_hex(_DATA)}; `barewire steps crc` shows each step for other bytes"
    )


@CRC_LAB.ask(
    f"One bit of this frame was flipped on its way: {in_hex(_DAMAGED)}. Which frame was sent?",
    f"{len(_DAMAGED)} bytes",
    "01 04 0F B1 00 02 22 F8",
)
def _repair(answer: str) -> AnswerCheck:
    given = typed_octets(answer)
    if len(given) != len(_DAMAGED):
        return wrong(f"{len(given)} bytes; the damaged frame has {len(_DAMAGED)}")
    try:
        decode(given)
    except DecodeError as error:
        return wrong(f"that is not valid either: {error.text}")
    changed = (int.from_bytes(given, "big") ^ int.from_bytes(_DAMAGED, "big")).bit_count()
    if changed != 1:
        return wrong(f"that is a valid frame, but it differs from the damaged one in {changed} bits; one was flipped")
    return right(f"{explain('rtu', given).summary}. One bit in {8 * len(given)} was wrong, and the CRC says which")


def _silence(rate: int, answer: str) -> AnswerCheck:
    given, timing = typed_seconds(answer, "ms"), Timing.of(rate, _BITS)
    fixed = timing.t35 != 3.5 * timing.character
    rule = "fixed above 19200 bit/s" if fixed else f"3.5 characters of {_BITS} bits"
    checks = {timing.t35: right(f"{1e3 * timing.t35:.2f} ms: {rule}")}
    for time, hint in (
        (timing.character, "that is one character"),
        (timing.t15, "that is t1.5, the longest pause inside a frame"),
        (3.5 * timing.character, "that is 3.5 characters; above 19200 bit/s the standard fixes another time"),
        (35 / rate, "that counts 10 bits a character; with parity there are 11"),
    ):
        checks.setdefault(time, wrong(hint))  # up to 19200 bit/s, 3.5 characters are right
    lasts = f"a character of {_BITS} bits lasts {1e3 * timing.character:.3f} ms"
    return check_of_time(
        given, checks, wrong(f"{lasts}; {1e3 * given:g} ms are {given / timing.character:.1f} characters")
    )


CRC_LAB.add(f"How long is t3.5 at {_SLOW} 8E1?", "a time in ms", "4.01 ms", partial(_silence, _SLOW))
CRC_LAB.add(f"And at {_FAST} 8E1?", "a time in ms", "1.75 ms", partial(_silence, _FAST))


@CRC_LAB.ask(
    f"At 19200 8E1 a recording shows pauses of {', '.join(f'{1e3 * pause:g}' for pause in _PAUSES)} ms. "
    "Which one ends a frame, and which one breaks it?",
    "two times: the one that ends it, the one that breaks it",
    "2.5 1.2",
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
    if breaks <= _LINE.t15:
        return wrong(f"{1e3 * breaks:g} ms is not longer than 1.5 characters: it is allowed inside a frame")
    if breaks >= _LINE.t35:
        return wrong(f"{1e3 * breaks:g} ms is long enough to end a frame")
    return right(
        f"t1.5 is {1e3 * _LINE.t15:.2f} ms and t3.5 is {1e3 * _LINE.t35:.2f} ms; between the two a frame is broken"
    )
