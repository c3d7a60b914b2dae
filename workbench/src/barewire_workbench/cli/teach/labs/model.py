"""A lab, its exercises, and what a check says.

    LAB 3 -- exercise 3.1 -- check("01 04 0F B1 00 02") -> AnswerCheck(right, text)

A check computes: it decodes the answer, plays it against a simulated machine, or compares it with what the codecs of
this package give. So every answer that means the right thing is right, in any notation. The text of a wrong one says
what was read and where it departs, not the answer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from barewire.errors import DecodeError, EncodeError


class AnswerCheck(NamedTuple):
    """Whether an answer is right, and one sentence or more about it."""

    right: bool
    text: str


class UnreadableAnswer(ValueError):
    """An answer that has not the form of one, such as letters in place of a number. The text says what to type."""


def right(text: str) -> AnswerCheck:
    """Return the check of a right answer."""
    return AnswerCheck(True, text)


def wrong(text: str) -> AnswerCheck:
    """Return the check of a wrong answer; the text is a hint."""
    return AnswerCheck(False, text)


class LabExercise(NamedTuple):
    """One exercise: its number, the task, the form of the answer, and the function that checks it."""

    number: str
    task: str
    form: str
    check: Callable[[str], AnswerCheck]

    def __repr__(self) -> str:
        return f"<LabExercise {self.number}>"

    def answered(self, answer: str) -> AnswerCheck:
        """Check an answer; one that cannot be read is wrong, and the text says why."""
        try:
            return self.check(answer)
        except UnreadableAnswer as error:
            return wrong(str(error))
        except DecodeError as error:
            return wrong(f"{error.text}; expected {self.form}")
        except EncodeError as error:
            return wrong(f"{error}; expected {self.form}")

    def as_dict(self) -> dict[str, str]:
        """Return number, task and form, for JSON."""
        return {"exercise": self.number, "task": self.task, "form": self.form}


class Lab(NamedTuple):
    """One lab of the course.

    `page` is its page in docs/tutorial. `devices` are the commands that start the simulators it needs, each in a
    terminal of its own.
    """

    number: int
    title: str
    goal: str
    minutes: int
    page: str
    devices: tuple[str, ...]
    exercises: tuple[LabExercise, ...]

    def __repr__(self) -> str:
        return f"<Lab {self.number}: {self.title}>"

    def exercise(self, number: str) -> LabExercise | None:
        """Return the exercise with a number such as 3.1, or None."""
        return next((exercise for exercise in self.exercises if exercise.number == number), None)

    def as_dict(self) -> dict[str, object]:
        """Return everything about the lab, for JSON."""
        exercises = [exercise.as_dict() for exercise in self.exercises]
        return {**self._asdict(), "devices": list(self.devices), "exercises": exercises}
