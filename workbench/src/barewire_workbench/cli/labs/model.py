"""A lab, its exercises, what a check says, and how the text of an answer is read.

    LAB 3 -- exercise 3.1 -- check("01 04 0F B1 00 02") -> AnswerCheck(right, text)

A check computes: it decodes the answer, plays it against a simulated machine, or looks it up in a table of the right
value and of those that a usual mistake gives. So every answer that means the right thing is right, in any notation. The
text of a wrong one says what was read and where it departs, not the answer.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from barewire.errors import DecodeError, EncodeError, shown
from barewire.io.endpoint import Endpoint
from barewire_workbench.frames.input import parse_hex

_NUMBER = re.compile(r"([-+\u2212]?(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+))\s*(\S*)")
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "\u00b5s": 1e-6, "\u03bcs": 1e-6}
_LONGEST = 400
"""Characters of an answer; none needs more."""
_LARGEST = 1e18
"""Larger numbers are no answers, and what a check computes with them would overflow."""


class AnswerCheck(NamedTuple):
    """Whether an answer is right, and one sentence or more about it."""

    right: bool
    text: str


class WrongAnswer(ValueError):
    """What was typed is no answer to the exercise, such as letters in place of a number. The text is the hint."""


def right(text: str) -> AnswerCheck:
    """Return the check of a right answer."""
    return AnswerCheck(True, text)


def wrong(text: str) -> AnswerCheck:
    """Return the check of a wrong answer; the text is a hint."""
    return AnswerCheck(False, text)


def check_of_time(seconds: float, checks: Mapping[float, AnswerCheck], otherwise: AnswerCheck) -> AnswerCheck:
    """Return the check of the first time that is within 1 % of the answer: people round."""
    return next((check for time, check in checks.items() if abs(seconds - time) <= 0.01 * time), otherwise)


def check_of_meaning(meanings: set[int], checks: Mapping[int, AnswerCheck], otherwise: AnswerCheck) -> AnswerCheck:
    """Return the check of the first number that the answer can mean: 107 may be decimal or hexadecimal."""
    return next((check for number, check in checks.items() if number in meanings), otherwise)


class LabExercise(NamedTuple):
    """One exercise: its number, the task, the form of the answer, a right answer, and the function that checks one.

    The solution is for the page of the solutions; the command `lab` does not show it.
    """

    number: str
    task: str
    form: str
    solution: str
    check: Callable[[str], AnswerCheck]

    def __repr__(self) -> str:
        return f"<LabExercise {self.number}>"

    def answered(self, answer: str) -> AnswerCheck:
        """Check an answer; one that cannot be read is wrong, and the text says why."""
        try:
            return self.check(answer)
        except WrongAnswer as error:
            return wrong(str(error))
        except DecodeError as error:
            return wrong(f"{error.text}; expected {self.form}")
        except EncodeError as error:
            return wrong(f"{error}; expected {self.form}")

    def as_dict(self) -> dict[str, str]:
        """Return number, task and form, for JSON."""
        return {"exercise": self.number, "task": self.task, "form": self.form}


@dataclass
class Lab:
    """One lab of the course.

    `page` is its page in docs/tutorial. `devices` are the commands that start the simulators it needs, each in a
    terminal of its own.
    """

    number: int
    title: str
    goal: str
    minutes: int
    page: str
    devices: tuple[str, ...] = ()
    exercises: list[LabExercise] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"<Lab {self.number}: {self.title}>"

    def add(self, task: str, form: str, solution: str, check: Callable[[str], AnswerCheck]) -> None:
        """Add the next exercise."""
        self.exercises.append(LabExercise(f"{self.number}.{len(self.exercises) + 1}", task, form, solution, check))

    def ask(
        self, task: str, form: str, solution: str
    ) -> Callable[[Callable[[str], AnswerCheck]], Callable[[str], AnswerCheck]]:
        """Make an exercise of the function below that checks its answers."""

        def decorate(check: Callable[[str], AnswerCheck]) -> Callable[[str], AnswerCheck]:
            self.add(task, form, solution, check)
            return check

        return decorate

    def exercise(self, number: str) -> LabExercise | None:
        """Return the exercise with a number such as 3.1, or None."""
        return next((exercise for exercise in self.exercises if exercise.number == number), None)

    def as_dict(self) -> dict[str, object]:
        """Return everything about the lab, for JSON."""
        exercises = [exercise.as_dict() for exercise in self.exercises]
        return {**vars(self), "devices": list(self.devices), "exercises": exercises}


# Answers as people type them. Each function raises WrongAnswer with what was expected.


def checked_length(text: str) -> str:
    """Return the answer without blanks around it, unless it is too long to be one."""
    if len(text) > _LONGEST:
        raise WrongAnswer(f"an answer of {len(text)} characters: none needs more than {_LONGEST}")
    return text.strip()


def typed_number(text: str, *units: str) -> float:
    """Return a decimal number, with or without one of the units behind it.

    >>> typed_number("24,5 \u00b0C", "\u00b0C"), typed_number("-200")
    (24.5, -200.0)
    """
    typed = _NUMBER.fullmatch(checked_length(text))
    if typed is None or typed[2].lower() not in ("", *(unit.lower() for unit in units)):
        behind = f", or one with {' or '.join(units)} behind it" if units else ""
        raise WrongAnswer(f"{shown(text)} is not a number: expected a decimal number{behind}")
    return _in_range(typed[1], text)


def typed_seconds(text: str, unit: str) -> float:
    """Return a time in seconds; without a unit behind it, it is in `unit`.

    >>> round(typed_seconds("104", "us"), 7), round(typed_seconds("0.104 ms", "us"), 7)
    (0.000104, 0.000104)
    """
    typed = _NUMBER.fullmatch(checked_length(text))
    if typed is None or (typed_unit := typed[2].lower() or unit) not in _SECONDS:
        raise WrongAnswer(f"{shown(text)} is not a time: expected a number, with s, ms or us behind it")
    return _in_range(typed[1], text) * _SECONDS[typed_unit]


def _in_range(digits: str, text: str) -> float:
    value = float(digits.replace(",", ".").replace("\u2212", "-"))
    if abs(value) > _LARGEST:
        raise WrongAnswer(f"{shown(text)} is larger than any answer")
    return value


def hex_number(text: str) -> int:
    """Return a hexadecimal number: 605, 605h, 0x605.

    >>> hex_number("0x605") == hex_number("605h") == 0x605
    True
    """
    digits = checked_length(text).replace(" ", "").lower().removeprefix("0x").removesuffix("h")
    if not re.fullmatch(r"[0-9a-f]{1,16}", digits):
        raise WrongAnswer(f"{shown(text)} is not a hexadecimal number: expected digits 0 to 9 and A to F")
    return int(digits, 16)


def any_number(text: str) -> set[int]:
    """Return the numbers that a text can mean: decimal, or hexadecimal if it has a mark or a digit of that.

    >>> sorted(any_number("107")), sorted(any_number("6Bh")), sorted(any_number("0x6B"))
    ([107, 263], [107], [107])
    """
    typed = checked_length(text).lower()
    meanings = {int(typed)} if re.fullmatch(r"[-+]?[0-9]{1,18}", typed) else set()
    try:
        meanings.add(hex_number(typed))
    except WrongAnswer:
        if not meanings:
            raise WrongAnswer(f"{shown(text)} is not a number: expected one such as 42, 2Ah or 0x2A") from None
    return meanings


def typed_bits(text: str) -> list[int]:
    """Return the bits of a text of zeros and ones; blanks, commas and bars between them are for the eye.

    >>> typed_bits("0 1011 0010 1")
    [0, 1, 0, 1, 1, 0, 0, 1, 0, 1]
    """
    digits = re.sub(r"[\s,;|_.]", "", checked_length(text))
    if not digits or set(digits) - set("01"):
        raise WrongAnswer(f"{shown(text)}: expected bits, only 0 and 1, in the order of time")
    return [int(digit) for digit in digits]


def typed_octets(text: str) -> bytes:
    """Return bytes in any usual notation of hexadecimal."""
    data = parse_hex(checked_length(text))
    if not data:
        raise WrongAnswer("no bytes: expected pairs of hexadecimal digits, such as 01 04 0F B1")
    return data


def typed_words(text: str) -> list[str]:
    """Return the words of an answer with several parts, which blanks, commas or semicolons separate."""
    return [word for word in re.split(r"[\s,;]+", checked_length(text)) if word]


def typed_name(text: str, names: Mapping[str, object]) -> str:
    """Return one of the names, whether it was typed with blanks, dashes or underscores: Switched-On."""
    typed = " ".join(checked_length(text).lower().replace("-", " ").replace("_", " ").split())
    if typed not in names:
        # `names` have blanks where users may type dashes; the one that is written with a dash is shown so.
        raise WrongAnswer(f"expected one of {', '.join(names).replace('pre op', 'pre-op')}")
    return typed


def typed_endpoint(text: str, *schemes: str) -> Endpoint:
    """Return the endpoint of an answer that is a URL. Raises EncodeError for another text or scheme."""
    endpoint = Endpoint.parse(checked_length(text))
    if endpoint.scheme not in schemes:
        raise EncodeError(f"{endpoint.scheme}://: expected {' or '.join(f'{scheme}://' for scheme in schemes)}")
    return endpoint


def in_hex(data: bytes) -> str:
    """Return bytes as hexadecimal pairs."""
    return data.hex(" ").upper()
