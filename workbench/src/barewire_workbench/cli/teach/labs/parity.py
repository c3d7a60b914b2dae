"""Lab 2: the parity bit: what it finds, and what it misses."""

from __future__ import annotations

from barewire.rtu.timing import Timing
from barewire_workbench.cli.teach.labs.bits import levels_text
from barewire_workbench.cli.teach.labs.model import AnswerCheck, Lab, LabExercise, right, wrong
from barewire_workbench.cli.teach.labs.reading import hex_number, typed_bits, typed_number, typed_seconds
from barewire_workbench.wire import CharacterFormat, character_levels

_8E1, _7E1 = CharacterFormat(8, "E", 1), CharacterFormat(7, "E", 1)
_BYTES = (0x01, 0x07, 0x0F, 0x80)
_RATE = 19200
_SENT = (0x01, 0x04, 0x0F, 0xB1)
_DAMAGED, _BIT = 2, 6
"""Which of `_SENT` was damaged, from 0, and the place of its wrong level."""
_FOOLED = 0x03
_LETTER = 0x43


def _received() -> list[tuple[int, ...]]:
    """Return the levels of `_SENT` as they arrive, one of them damaged."""
    characters = [character_levels(byte, _8E1) for byte in _SENT]
    levels = list(characters[_DAMAGED])
    levels[_BIT] ^= 1
    characters[_DAMAGED] = tuple(levels)
    return characters


def _parity_bits(answer: str) -> AnswerCheck:
    given, expected = typed_bits(answer), [character_levels(byte, _8E1)[-2] for byte in _BYTES]
    if given == expected:
        return right("with its parity bit, each of these bytes has an even number of ones")
    if len(given) != len(expected):
        return wrong(f"{len(given)} bits; there are {len(expected)} bytes, each with one parity bit")
    if given == [1 - bit for bit in expected]:
        return wrong("with these bits each byte has an odd number of ones: that is odd parity, 8O1")
    place = next(place for place, (one, other) in enumerate(zip(given, expected)) if one != other)
    ones = _BYTES[place].bit_count()
    return wrong(
        f"{_BYTES[place]:02X}h = {_BYTES[place]:08b}b has {_counted(ones)}; with "
        f"the parity bit {given[place]} that makes "
        f"{ones + given[place]}, which is odd"
    )


def _counted(ones: int) -> str:
    return "1 one" if ones == 1 else f"{ones} ones"


def _damaged(answer: str) -> AnswerCheck:
    given, received = int(typed_number(answer)), _received()
    if not 1 <= given <= len(received):
        return wrong(f"expected the number of a character, 1 to {len(received)}")
    ones = sum(received[given - 1][1:-1])
    if ones % 2:
        return right(
            f"its data bits and its parity bit have {_counted(ones)}, an odd number; "
            "which bit is wrong, parity cannot tell"
        )
    return wrong(
        f"data bits and parity bit of character {given} have {_counted(ones)}, an even number: nothing to see there"
    )


def _character_time(answer: str) -> AnswerCheck:
    given, expected = typed_seconds(answer, "ms"), Timing.of(_RATE, _8E1.bits).character
    if abs(given - expected) <= 0.01 * expected:
        return right(f"{_8E1.bits} bits / {_RATE} bit/s = {1e3 * expected:.3f} ms")
    for count, text in ((8, "the data bits alone"), (9, "data and parity"), (10, "a character without parity")):
        if abs(given - count / _RATE) <= 0.01 * expected:
            return wrong(f"that is the time of {count} bits, {text}; which bits has a character of 8E1?")
    return wrong(
        f"{1e3 * given:g} ms at {_RATE} bit/s are {given * _RATE:.1f} bits; a character of 8E1 has another number"
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


def _seven_bits(answer: str) -> AnswerCheck:
    given = hex_number(answer)
    levels = character_levels(_LETTER, _7E1)
    if given == sum(level << place for place, level in enumerate(levels[1:9])):
        return right(
            "the parity bit of the sender stands where the receiver has bit 7. 7E1 and 8N1 have equally many bits"
        )
    if given == _LETTER:
        return wrong("that is what was sent. Write down its 10 levels with 7E1, and read levels 2 to 9 as 8 data bits")
    return wrong(
        f"the levels are {levels_text(levels)}; an 8N1 receiver reads levels 2 to 9 "
        f"as data, the lowest bit first: not {given:02X}h"
    )


PARITY_LAB = Lab(
    2,
    "A byte and its parity",
    "Add the bit that shows damage, and see what it cannot show.",
    20,
    "02-a-byte-and-its-parity.md",
    (),
    (
        LabExercise(
            "2.1",
            f"Which parity bits have the bytes {' '.join(f'{byte:02X}' for byte in _BYTES)} with 8E1?",
            "4 bits in the order of the bytes",
            _parity_bits,
        ),
        LabExercise(
            "2.2",
            "Four characters with 8E1 arrive: "
            + ";  ".join(
                f"({place}) {levels_text(levels).replace(' ', '')}" for place, levels in enumerate(_received(), 1)
            )
            + ". Which one was damaged?",
            "its number, 1 to 4",
            _damaged,
        ),
        LabExercise(
            "2.3",
            f"How long is a character at {_RATE} 8E1, in milliseconds?",
            "a time, such as 1.04 ms",
            _character_time,
        ),
        LabExercise(
            "2.4",
            f"{_FOOLED:02X}h was sent with 8E1. Name a byte that can arrive in its place without a parity error.",
            "a byte in hexadecimal",
            _undetected,
        ),
        LabExercise(
            "2.5",
            f"A device sends the letter {chr(_LETTER)}, {_LETTER:02X}h, with 7E1; the "
            "receiver is set to 8N1. Which byte does it read?",
            "a byte in hexadecimal",
            _seven_bits,
        ),
    ),
)
