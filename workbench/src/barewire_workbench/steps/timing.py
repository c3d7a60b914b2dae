"""The times of a serial line: a bit, a character, the silences t1.5 and t3.5, and whole exchanges.

    8E1 at 19200     11 bits, 572.9 us a character; t1.5 859.4 us, t3.5 2.005 ms

`rtu.frame` computes the times that the package uses; the steps here do not use it.
"""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

from barewire import ascii as ascii_framing, rtu
from barewire.errors import EncodeError
from barewire.modbus.messages.registers import (
    ReadHoldingRegisters,
    ReadHoldingRegistersResponse,
    WriteMultipleRegisters,
    WriteMultipleRegistersResponse,
    WriteSingleRegister,
    WriteSingleRegisterResponse,
)
from barewire.rtu.frame import FIXED_ABOVE, Timing
from barewire.rtu.line import PATIENCE
from barewire_workbench.steps.model import Steps, StepSection, StepTable
from barewire_workbench.wire import CharacterFormat

BAUDRATE_MAX = 100_000_000

_MESSAGES = (
    ("read 1 register", ReadHoldingRegisters(0, 1), ReadHoldingRegistersResponse((0,))),
    ("read 10 registers", ReadHoldingRegisters(0, 10), ReadHoldingRegistersResponse((0,) * 10)),
    ("read 125 registers, the most", ReadHoldingRegisters(0, 125), ReadHoldingRegistersResponse((0,) * 125)),
    ("write 1 register", WriteSingleRegister(0, 1), WriteSingleRegisterResponse(0, 1)),
    (
        "write 123 registers, the most",
        WriteMultipleRegisters(0, (0,) * 123),
        WriteMultipleRegistersResponse(0, 123),
    ),
)
"""Common exchanges: name, request, response."""


class _Times(NamedTuple):
    """Exact times in seconds."""

    bit: Fraction
    character: Fraction
    t15: Fraction
    t35: Fraction


def timing_steps(baudrate: int, form: CharacterFormat) -> Steps:
    """Work out the times of a line. A form with 7 data bits is that of Modbus ASCII, one with 8 that of RTU.

    >>> timing_steps(19200, CharacterFormat(8, "E", 1))
    <Steps timing: 8E1 at 19200 bit/s: a character lasts 572.9 us, t1.5 859.4 us, t3.5 2.005 ms>

    Raises EncodeError for a rate outside 1..100000000 bit/s and for 5 or 6 data bits.
    """
    if not 1 <= baudrate <= BAUDRATE_MAX:
        raise EncodeError(f"baudrate {baudrate}: expected 1..{BAUDRATE_MAX} bits per second", "baudrate")
    if form.data_bits < 7:  # a UART has them, Modbus has no use for them
        raise EncodeError(f"{form.data_bits} data bits ({form}): Modbus RTU needs 8, Modbus ASCII 7 or 8", "format")
    times = _times(baudrate, form)
    is_rtu = form.data_bits == 8
    sections = [*_character(baudrate, form, times), *(_silences(baudrate, form, times) if is_rtu else _pauses(form))]
    sections += _exchanges(times, is_rtu=is_rtu)
    character = f"a character lasts {shown_time(times.character)}"
    silences = f", t1.5 {shown_time(times.t15)}, t3.5 {shown_time(times.t35)}" if is_rtu else ""
    timing = Timing.of(baudrate, form.bits)
    values: dict[str, object] = {"bits": form.bits, "bit": 1 / baudrate, "character": timing.character}
    return Steps(
        "timing",
        f"Times of a serial line, {form} at {baudrate} bit/s",
        "Modbus over Serial Line 1.02, 2.5.1 and 2.5.1.1" if is_rtu else "Modbus over Serial Line 1.02, 2.5.2",
        tuple(sections),
        f"{form} at {baudrate} bit/s: {character}{silences}",
        values | ({"t1.5": timing.t15, "t3.5": timing.t35} if is_rtu else {}),
    )


def shown_time(seconds: Fraction | float) -> str:
    """Return a time with four digits, in us, ms or s.

    >>> shown_time(0.00175), shown_time(0.0005729), shown_time(2)
    ('1.75 ms', '572.9 us', '2 s')
    """
    value = float(seconds)
    for unit, scale in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if value >= 0.9999995 * scale or unit == "us":
            return f"{value / scale:.4g} {unit}" if value / scale < 9999.5 else f"{value / scale:.0f} {unit}"
    raise AssertionError("the last unit returns")  # pragma: no cover


def _times(baudrate: int, form: CharacterFormat) -> _Times:
    bit = Fraction(1, baudrate)
    character = form.bits * bit
    if baudrate > FIXED_ABOVE:
        return _Times(bit, character, Fraction(750, 1_000_000), Fraction(1750, 1_000_000))
    return _Times(bit, character, Fraction(3, 2) * character, Fraction(7, 2) * character)


def _character(baudrate: int, form: CharacterFormat, times: _Times) -> list[StepSection]:
    parity = {"N": "none", "E": "even", "O": "odd"}[form.parity]
    counts = (
        ("start bit", 1),
        ("data bits, the lowest first", form.data_bits),
        (f"parity bit ({parity})", int(form.parity != "N")),
        ("stop bit" if form.stop_bits == 1 else "stop bits", form.stop_bits),
    )
    rows = [(name, str(count), shown_time(count * times.bit)) for name, count in counts]
    rows.append(("a character", str(form.bits), shown_time(times.character)))
    sections: list[StepSection] = [
        f"One bit lasts 1 s / {baudrate} = {shown_time(times.bit)}. A character is one byte of the frame with the bits "
        "that frame it:"
        if form.data_bits == 8
        else f"One bit lasts 1 s / {baudrate} = {shown_time(times.bit)}. A character of Modbus ASCII is one "
        "hexadecimal digit with the bits that frame it; a byte of the message takes two:",
        StepTable("", ("part", "bits", "time"), tuple(rows)),
    ]
    standard = 11 if form.data_bits == 8 else 10
    if form.bits != standard:
        sections.append(
            f"The standard has {standard} bits in a character: without parity a second stop bit takes the place of the "
            f"parity bit. {form} has {form.bits}. Many devices use it all the same; all on a line have to agree."
        )
    return sections


def _silences(baudrate: int, form: CharacterFormat, times: _Times) -> list[StepSection]:
    one = shown_time(times.character)
    if baudrate > FIXED_ABOVE:
        text = (
            f"Above {FIXED_ABOVE} bit/s both silences are fixed, because 3.5 characters would be shorter than the "
            "timers of small devices can measure."
        )
        rows = [
            ("t1.5", "fixed", shown_time(times.t15), f"1.5 x {one} = {shown_time(Fraction(3, 2) * times.character)}"),
            ("t3.5", "fixed", shown_time(times.t35), f"3.5 x {one} = {shown_time(Fraction(7, 2) * times.character)}"),
        ]
        header: tuple[str, ...] = ("silence", "rule", "time", "in characters it would be")
    else:
        text = f"Up to {FIXED_ABOVE} bit/s both silences are multiples of the character:"
        rows = [
            ("t1.5", f"1.5 x {one}", shown_time(times.t15), ""),
            ("t3.5", f"3.5 x {one}", shown_time(times.t35), ""),
        ]
        header = ("silence", "rule", "time", "")
    width = 4 if baudrate > FIXED_ABOVE else 3
    return [
        text,
        StepTable("", header[:width], tuple(row[:width] for row in rows)),
        "t3.5 is two numbers. For a sender it is the silence that it must keep in front of its frame "
        f"({shown_time(times.t35)}), so that each receiver sees the frame before as ended. For a receiver it is the "
        "silence after which a frame has ended, and t1.5 the longest pause that it accepts inside one. A program "
        "behind a USB adapter or an operating system cannot measure that: bytes reach it in batches, with pauses "
        f"that were never on the wire. So barewire keeps {shown_time(times.t35)} when it sends, and accepts pauses of "
        f"{shown_time(PATIENCE)} inside a frame when it receives, unless the option `patience` says another time.",
    ]


def _pauses(form: CharacterFormat) -> list[StepSection]:
    return [
        f"{form.data_bits} data bits cannot carry the bytes of RTU, so this is a line of Modbus ASCII. There are no "
        "t1.5 and t3.5: the colon begins a frame, CR LF ends it, and up to 1 s may pass between two characters."
    ]


def _exchanges(times: _Times, *, is_rtu: bool) -> list[StepSection]:
    framing = rtu.encode if is_rtu else ascii_framing.encode
    silence = times.t35 if is_rtu else Fraction(0)
    rows = []
    for name, request, response in _MESSAGES:
        lengths = [len(framing(1, message.encode())) for message in (request, response)]
        durations = [length * times.character for length in lengths]
        whole = sum(durations, 2 * silence)
        rows.append(
            (
                name,
                *(text for pair in zip(map(str, lengths), map(shown_time, durations)) for text in pair),
                shown_time(whole),
                f"{float(1 / whole):.4g}",
            )
        )
    header = ("exchange", "request", "lasts", "response", "lasts", "in all", "a second")
    both = f", each after a silence of {shown_time(times.t35)}" if is_rtu else ""
    return [
        f"Exchanges, in characters and time: the request and the response{both}. The time that the unit needs to "
        "answer comes on top, so a real line carries fewer.",
        StepTable("", header, tuple(rows)),
    ]
