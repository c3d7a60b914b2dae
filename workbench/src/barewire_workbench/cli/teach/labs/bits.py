"""Lab 1: a byte as levels in time: start bit, data bits, stop bit, and the baud rate."""

from __future__ import annotations

from barewire_workbench.cli.teach.labs.model import AnswerCheck, Lab, LabExercise, right, wrong
from barewire_workbench.cli.teach.labs.reading import hex_number, typed_bits, typed_number, typed_seconds
from barewire_workbench.wire import CharacterFormat, ReceiverFault, UartLine, character_levels

_8N1 = CharacterFormat(8, "N", 1)
_RATE = 9600
_TO_DRAW = 0x4D
_TO_READ = 0x53
_TO_MISREAD = 0x01


def levels_text(levels: tuple[int, ...]) -> str:
    """Return levels as the tasks print them.

    >>> levels_text((0, 1, 1))
    '0 1 1'
    """
    return " ".join(map(str, levels))


def _bit_time(answer: str) -> AnswerCheck:
    given, expected = typed_seconds(answer, "us"), 1 / _RATE
    if abs(given - expected) <= 0.01 * expected:
        return right(f"one second holds {_RATE} bits, so one bit lasts 1/{_RATE} s = {1e6 * expected:.1f} us")
    if abs(given - _8N1.bits * expected) <= 0.1 * expected:
        return wrong("that is the time of a whole character; the task asks for one of its bits")
    return wrong(f"with bits of {1e6 * given:g} us, one second would hold {_text_of_rate(given)} of them, not {_RATE}")


def _text_of_rate(duration: float) -> str:
    return f"{1 / duration:.0f}" if duration > 0 else "endlessly many"


def _draw(answer: str) -> AnswerCheck:
    given, expected = typed_bits(answer), list(character_levels(_TO_DRAW, _8N1))
    if given == expected:
        return right(f"a receiver reads {_TO_DRAW:02X}h, the letter {chr(_TO_DRAW)}")
    if len(given) != _8N1.bits:
        return wrong(f"{len(given)} levels; a character of 8N1 has {_8N1.bits}: start bit, 8 data bits, stop bit")
    if given[0] != 0:
        return wrong("the first level is 1, as the idle line is: no receiver would see that a character begins")
    if given[-1] != 1:
        return wrong("the last level is 0: a stop bit is 1, so that the next start bit is a change")
    if given[1:-1] == expected[-2:0:-1]:
        return wrong("these are the data bits with the highest one first; on the wire the lowest one goes first")
    byte = sum(level << place for place, level in enumerate(given[1:-1]))
    return wrong(f"a receiver reads these levels as {byte:02X}h = {byte:08b}b; {_TO_DRAW:02X}h is {_TO_DRAW:08b}b")


def _read(answer: str) -> AnswerCheck:
    text = answer.strip()
    given = ord(text) if len(text) == 1 and text.isalpha() else hex_number(text)
    if given == _TO_READ:
        return right(f"{_TO_READ:02X}h, the letter {chr(_TO_READ)}: its levels are {_levels(_TO_READ)}")
    if given == int(f"{_TO_READ:08b}"[::-1], 2):
        return wrong("you read the data bits from left to right; the first one on the wire is the lowest one, bit 0")
    if given > 0xFF and not set(text) - set("01") and len(text) == 8:
        return wrong("these are eight bits: put the first one on the wire last, then write each four as one digit")
    if given > 0xFF:
        return wrong(f"{given:X}h is more than a byte can hold: leave out the start bit and the stop bit")
    return wrong(f"the levels of {given:02X}h would be {_levels(given)}")


def _levels(byte: int) -> str:
    return levels_text(character_levels(byte, _8N1))


def _throughput(answer: str) -> AnswerCheck:
    given, expected = typed_number(answer, "bytes/s", "bytes", "B/s"), _RATE / _8N1.bits
    if given == expected:
        return right(f"{_RATE} bits a second / {_8N1.bits} bits a character = {expected:g} bytes a second")
    if given == _RATE / 8:
        return wrong("that counts the 8 data bits only; the start bit and the stop bit take time too")
    return wrong(f"{given:g} bytes of {_8N1.bits} bits are {given * _8N1.bits:g} bits a second, not {_RATE}")


def _misread(answer: str) -> AnswerCheck:
    given, expected = hex_number(answer), UartLine(_8N1, ReceiverFault(faster=2)).read(bytes([_TO_MISREAD]))[0]
    if given == expected:
        return right("each bit of the sender is sampled twice, and half of the byte is over when the receiver is done")
    doubled = levels_text(tuple(level for bit in character_levels(_TO_MISREAD, _8N1) for level in (bit, bit)))
    return wrong(
        f"not {given:02X}h. The receiver takes a sample every 52 us, two in each bit of the sender: {doubled}. "
        "The first is its start bit, the next eight are its data bits, the lowest first"
    )


BITS_LAB = Lab(
    1,
    "Bits on a wire",
    "Read a byte from the levels of a wire, and draw the levels of a byte.",
    20,
    "01-bits-on-a-wire.md",
    (),
    (
        LabExercise(
            "1.1", f"How long is one bit at {_RATE} baud, in microseconds?", "a time, such as 52 us", _bit_time
        ),
        LabExercise(
            "1.2",
            f"Which levels has the letter {chr(_TO_DRAW)}, {_TO_DRAW:02X}h, on a line with 8N1, from the first one on?",
            f"{_8N1.bits} bits in the order of time",
            _draw,
        ),
        LabExercise(
            "1.3",
            f"A line with 8N1 shows {_levels(_TO_READ)}. Which byte is it?",
            "a byte in hexadecimal, such as 4D",
            _read,
        ),
        LabExercise("1.4", f"How many bytes can a line with {_RATE} 8N1 carry in a second?", "a number", _throughput),
        LabExercise(
            "1.5",
            f"A device sends {_TO_MISREAD:02X}h with {_RATE} 8N1; a receiver is "
            f"set to {2 * _RATE} 8N1. Which byte does "
            "it read first?",
            "a byte in hexadecimal",
            _misread,
        ),
    ),
)
