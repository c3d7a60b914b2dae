"""Lab 10: three recordings of broken lines, and a line to repair.

A master asks a soft starter for three values, again and again. What is wrong is made by the fault injection of the
simulators, with a seed, so a recording is the same whenever it is written.

    line-1.log  line-2.log  line-3.log     bytes with times, as `sniff` and `explain` read them
    the live line                          another unit, answers that are late or lost
"""

from __future__ import annotations

from functools import partial
from random import Random
from typing import NamedTuple

from barewire import ModbusException, connect
from barewire.errors import BarewireError, NoAnswer
from barewire.io.fault_injection.faults import KINDS, Faults, ModbusWire, parse_faults
from barewire.modbus import ReadInputRegisters
from barewire.rtu import encode
from barewire.rtu.frame import Timing
from barewire_workbench.cli.labs.modbus import rtu_answer
from barewire_workbench.cli.labs.model import (
    AnswerCheck,
    Lab,
    any_number,
    check_of_meaning,
    checked_length,
    right,
    typed_endpoint,
    wrong,
)
from barewire_workbench.wire import CharacterFormat, ReceiverFault, UartLine

POLLED_ADDRESSES = (4017, 5, 7)
"""The registers that the master reads: a temperature, a voltage, a current; each value has two."""

_EXCHANGES = 12
_PERIOD = 0.25
_TURNAROUND = 0.012
_TIMING = Timing.of(19200)


class Recording(NamedTuple):
    """A recording of the line: the fault in it, as `--fault` of `simulate` has it, or a wrong baud rate."""

    name: str
    fault: str
    seed: int = 0
    rate: int = 19200
    """The baud rate of the line. The recorder was set to 19200."""


RECORDINGS = (
    Recording("line-1.log", "flip:0.4", seed=3),
    Recording("line-2.log", "late=0.26@every=3"),
    Recording("line-3.log", "", rate=9600),
)

LIVE_UNIT = 17
LIVE_FAULTS = "late=1.4@every=2,drop@every=3"
LIVE_SEED = 10


def recording_text(recording: Recording) -> str:
    """Return a recording as text, a line for each piece of bytes with its time.

    >>> print("\\n".join(recording_text(RECORDINGS[0]).splitlines()[1:3]))
    0.000000 01 04 0F B1 00 02 22 F8
    0.016583 01 04 04 00 00 00 F5 3B C3
    """
    faults = Faults(ModbusWire("rtu"), recording.fault, Random(recording.seed)) if recording.fault else None
    receiver = UartLine(CharacterFormat(8, "E", 1), ReceiverFault(faster=19200 // recording.rate))
    pieces: list[tuple[float, bytes]] = []
    for number in range(_EXCHANGES):
        asked_at = number * _PERIOD
        request = encode(1, ReadInputRegisters(POLLED_ADDRESSES[number % len(POLLED_ADDRESSES)], 2).encode())
        answer, answered_at = rtu_answer(request), asked_at + _TIMING.duration(len(request)) + _TURNAROUND
        pieces.append((asked_at, request))
        pieces += [(answered_at, answer)] if faults is None else faults.pass_on(answer, answered_at, request[1:-2])
    lines = [f"{at:.6f} {receiver.read(data).hex(' ').upper()}" for at, data in sorted(pieces)]
    return "\n".join([f"# {recording.name}: seconds and bytes, recorded at 19200 8E1", *lines]) + "\n"


# The exercises

REPAIR_LAB = Lab(
    *(10, "A broken line, repaired"),
    "Find out from recordings what is wrong with a line, then read a value over a bad one.",
    *(25, "10-a-broken-line.md"),
    devices=("barewire lab 10 recordings", "barewire lab 10 start rtu:///tmp/line"),
)
_NAME = "Thyristors temperature"
_READINGS = 5
_SEEN_AS = {
    "late": "answers that come after their master has sent the next request",
    "noise": "bytes in front of answers that belong to no frame",
    "wrong-unit": "answers with another unit than their requests",
    "wrong-transaction": "another transaction number; there is none on a serial line",
    "drop": "requests without any answer",
    "flip": "answers as long as they should be, with a CRC that does not fit",
    "exception": "answers whose function code has bit 7 set",
    "split": "answers in two pieces, with a pause between",
    "paced": "answers byte by byte, with pauses between",
}


def _fault(recording: Recording, answer: str) -> AnswerCheck:
    typed = checked_length(answer).lower()
    if typed not in KINDS:
        return wrong(f"expected one of {', '.join(KINDS)}")
    if typed == parse_faults(recording.fault)[0].kind:
        return right(f"{typed}: {_SEEN_AS[typed]}")
    return wrong(f"with {typed} one would see {_SEEN_AS[typed]}")


_FLIPPED, _LATE, _OTHER_RATE = RECORDINGS
REPAIR_LAB.add(
    f"What happens to the answers in {_FLIPPED.name}?", f"one of {', '.join(KINDS)}", "flip", partial(_fault, _FLIPPED)
)
REPAIR_LAB.add(f"And in {_LATE.name}?", "one of the same words", "late", partial(_fault, _LATE))


@REPAIR_LAB.ask(f"{_OTHER_RATE.name} was recorded at 19200 baud. Which baud rate has the line?", "a baud rate", "9600")
def _rate(answer: str) -> AnswerCheck:
    rate = _OTHER_RATE.rate
    hint = "explain the first line of the recording: at which rate do the same levels make a frame with a good CRC?"
    return check_of_meaning(
        any_number(answer),
        {
            rate: right(f"the recorder took two samples in each bit: it was set to 19200, the line has {rate}"),
            19200: wrong("that is the rate of the recorder, with which the bytes make no frame"),
        },
        wrong(hint),
    )


@REPAIR_LAB.ask(
    "`barewire lab 10 start rtu:///tmp/line` is a line with a soft starter, adxl, at a unit between 10 and 20. "
    f"With which URL is its {_NAME} read {_READINGS} times in a row?",
    "a URL, rtu:// with options",
    "rtu:///tmp/line?unit=17&timeout=3&retries=3",
)
def _repaired(answer: str) -> AnswerCheck:
    try:
        endpoint = typed_endpoint(answer, "rtu")
        with connect("adxl", str(endpoint)) as starter:
            values = [starter.read(_NAME) for _ in range(_READINGS)]
    except NoAnswer as error:
        if endpoint.integer("unit", 1) != LIVE_UNIT:
            others = "Ask others with `barewire send`: a unit that is there answers, at times late"
            return wrong(f"{error}. Is it the right unit? {others}")
        if endpoint.timeout < 2:
            return wrong(f"{error}. The unit is right; measure how long an answer can take")
        lost = "some answers never come: what can a client do about that?"
        return wrong(f"{error}. The unit is right and the time-out long enough; {lost}")
    except ModbusException as error:
        return wrong(f"the device answers, but declines: {error}")
    except BarewireError as error:
        return wrong(str(error))
    return right(f"{_READINGS} readings, each one answered: {values[-1]}")
