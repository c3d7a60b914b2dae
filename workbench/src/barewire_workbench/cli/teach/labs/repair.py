"""Lab 10: three recordings of broken lines, and a line to repair."""

from __future__ import annotations

from barewire import ModbusException, connect
from barewire.errors import BarewireError, NoAnswer
from barewire.io.fault_injection.targets import KINDS, parse_faults
from barewire_workbench.cli.teach.labs.drive import checked_endpoint
from barewire_workbench.cli.teach.labs.faulty_line import LIVE_UNIT, RECORDINGS
from barewire_workbench.cli.teach.labs.model import AnswerCheck, Lab, LabExercise, right, wrong
from barewire_workbench.cli.teach.labs.reading import any_number, checked_length

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


def _fault(place: int, answer: str) -> AnswerCheck:
    typed, kind = checked_length(answer).lower(), parse_faults(RECORDINGS[place].fault)[0].kind
    if typed not in KINDS:
        return wrong(f"expected one of {', '.join(KINDS)}")
    if typed == kind:
        return right(f"{typed}: {_SEEN_AS[kind]}")
    return wrong(f"with {typed} one would see {_SEEN_AS[typed]}")


def _rate(answer: str) -> AnswerCheck:
    given, recording = any_number(answer), RECORDINGS[2]
    if recording.rate in given:
        return right(f"the recorder took two samples in each bit: it was set to 19200, the line has {recording.rate}")
    if 19200 in given:
        return wrong("that is the rate of the recorder, with which the bytes make no frame")
    return wrong(
        "explain the first line of the recording: at which rate do the same levels make a frame with a good CRC?"
    )


def _repaired(answer: str) -> AnswerCheck:
    try:
        endpoint = checked_endpoint(answer, "rtu")
        with connect("adxl", str(endpoint)) as starter:
            values = [starter.read(_NAME) for _ in range(_READINGS)]
    except NoAnswer as error:
        if endpoint.integer("unit", 1) != LIVE_UNIT:
            return wrong(
                f"{error}. Is it the right unit? Ask others with `barewire send`: a "
                "unit that is there answers, at times late"
            )
        if endpoint.timeout < 2:
            return wrong(f"{error}. The unit is right; measure how long an answer can take")
        return wrong(
            f"{error}. The unit is right and the time-out long enough; some answers "
            "never come: what can a client do about that?"
        )
    except ModbusException as error:
        return wrong(f"the device answers, but declines: {error}")
    except BarewireError as error:
        return wrong(str(error))
    return right(f"{_READINGS} readings, each one answered: {values[-1]}")


REPAIR_LAB = Lab(
    10,
    "A broken line, repaired",
    "Find out from recordings what is wrong with a line, then read a value over a bad one.",
    25,
    "10-a-broken-line.md",
    ("barewire lab 10 recordings", "barewire lab 10 start rtu:///tmp/line"),
    (
        LabExercise(
            "10.1",
            f"What happens to the answers in {RECORDINGS[0].name}?",
            f"one of {', '.join(KINDS)}",
            lambda answer: _fault(0, answer),
        ),
        LabExercise("10.2", f"And in {RECORDINGS[1].name}?", "one of the same words", lambda answer: _fault(1, answer)),
        LabExercise(
            "10.3",
            f"{RECORDINGS[2].name} was recorded at 19200 baud. Which baud rate has the line?",
            "a baud rate",
            _rate,
        ),
        LabExercise(
            "10.4",
            "`barewire lab 10 start rtu:///tmp/line` is a line with a soft starter, adxl, at a unit between 10 and 20. "
            f"With which URL is its {_NAME} read {_READINGS} times in a row?",
            "a URL, rtu:// with options",
            _repaired,
        ),
    ),
)
