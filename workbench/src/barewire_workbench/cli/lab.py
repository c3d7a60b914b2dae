"""`barewire lab`: the labs of the course "from one byte to a moving motor", and the checks of their answers."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from pathlib import Path
from textwrap import wrap
from typing import Any

import click

from barewire.errors import EncodeError, PortError, shown
from barewire_workbench.cli.arguments import Choice, ended_by_signals, json_option, print_json
from barewire_workbench.cli.labs import LABS
from barewire_workbench.cli.labs.model import Lab, LabExercise
from barewire_workbench.cli.labs.repair import LIVE_FAULTS, LIVE_SEED, LIVE_UNIT, RECORDINGS, recording_text

_WIDTH = 100


class LabNumber(click.ParamType[str]):
    """The number of a lab, such as 3, or of one of its exercises, 3.1."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the number as text."""
        lab = LABS.get(int(first) if (first := str(value).partition(".")[0]).isdecimal() and len(first) < 4 else 0)
        if lab is None:
            self.fail(f"{shown(value)}: expected the number of a lab, 1 to {len(LABS)}", param, ctx)
        if "." in str(value) and lab.exercise(value) is None:
            numbers = ", ".join(exercise.number for exercise in lab.exercises)
            self.fail(f"{shown(value)}: lab {lab.number} has the exercises {numbers}", param, ctx)
        return str(value)


@click.command("lab", context_settings={"ignore_unknown_options": True})
@click.argument("number", type=LabNumber(), required=False, metavar="[N]")
@click.argument(
    "action", type=Choice(["check", "start", "recordings"]), required=False, metavar="[check|start|recordings]"
)
@click.argument("words", nargs=-1, metavar="[ANSWER]...")
@json_option
def lab_command(number: str | None, action: str | None, words: tuple[str, ...], as_json: bool) -> int:
    """Show the labs of the course, and check answers to their exercises.

    The course, in docs/tutorial, goes from one byte to a moving motor in ten labs. Without N, the labs are listed;
    `lab N` shows the goal and the exercises of one.

    `check` takes the number of an exercise and an answer. Without that number, the answer is tried on every exercise of
    the lab. An answer that means the right thing is right: 605, 605h and 0x605; a frame with or without blanks. The
    exit status is 0 for a right answer and 1 for a wrong one, which gets a hint.

    \b
    barewire lab
    barewire lab 3
    barewire lab 3 check 3.1 "01 04 0F B1 00 02"
    barewire lab 10 recordings                      write the recordings of lab 10 into this folder
    barewire lab 10 start rtu:///tmp/line           the line of lab 10, until Ctrl-C
    """
    if (unknown := next((word for word in words if word.startswith("--")), None)) is not None:
        raise click.NoSuchOption(unknown)
    if number is None:
        _list(as_json)
        return 0
    lab = LABS[int(number.partition(".")[0])]
    if "." in number and action == "check":
        words = (number, *words)
    if action is None:
        _show(lab, as_json)
    elif action == "check":
        return _check(lab, words, as_json)
    elif lab.number != len(LABS):
        commands = f": {'; '.join(lab.devices)}" if lab.devices else f"; lab {lab.number} needs no device"
        raise click.UsageError(f"{action} is for lab {len(LABS)}{commands}")
    elif action == "recordings":
        _write_recordings(as_json)
    else:
        _start(words)
    return 0


def _list(as_json: bool) -> None:
    for lab in LABS.values():
        if as_json:
            print_json(lab.as_dict())
        else:
            print(f"{lab.number:>2}  {lab.title:<36}  {lab.minutes} min  docs/tutorial/{lab.page}")
    if not as_json:
        print(f"{sum(lab.minutes for lab in LABS.values()) // 60} hours in all; `barewire lab 1` shows the first one")


def _show(lab: Lab, as_json: bool) -> None:
    if as_json:
        print_json(lab.as_dict())
        return
    print(f"Lab {lab.number}: {lab.title}")
    print(lab.goal)
    print(f"page: docs/tutorial/{lab.page}, about {lab.minutes} minutes")
    for command in lab.devices:
        print(f"in a terminal of its own: {command}")
    for exercise in lab.exercises:
        print()
        print("\n".join(wrap(f"{exercise.number}  {exercise.task}", _WIDTH, subsequent_indent=" " * 5)))
        print(f"     answer: {exercise.form}")
    print()
    print(f"barewire lab {lab.number} check {lab.exercises[0].number} ANSWER")


def _check(lab: Lab, words: tuple[str, ...], as_json: bool) -> int:
    """Check an answer, and return the exit status."""
    exercise = lab.exercise(words[0]) if len(words) > 1 else None
    answer = " ".join(words if exercise is None else words[1:])
    if not answer.strip():
        numbers = ", ".join(exercise.number for exercise in lab.exercises)
        raise click.UsageError(
            f"no answer: expected barewire lab {lab.number} check {lab.exercises[0].number} "
            f"ANSWER; exercises: {numbers}"
        )
    if exercise is not None:
        return _report(exercise, answer, as_json)
    if lab.exercise(answer) is not None:
        raise click.UsageError(f"no answer behind {answer}: expected barewire lab {lab.number} check {answer} ANSWER")
    for exercise in lab.exercises:
        if exercise.answered(answer).right:
            return _report(exercise, answer, as_json)
    if len(words) > 1 and words[0].partition(".")[0].isdecimal() and "." in words[0]:
        numbers = ", ".join(exercise.number for exercise in lab.exercises)
        text = f"lab {lab.number} has no exercise {words[0]}: expected one of {numbers}"
    else:
        text = (
            f"this solves no exercise of lab {lab.number}; for a hint, name one: barewire lab "
            f"{lab.number} check {lab.exercises[0].number} ANSWER"
        )
    if as_json:
        print_json({"exercise": None, "right": False, "text": text})
    else:
        print(f"wrong: {text}")
    return 1


def _report(exercise: LabExercise, answer: str, as_json: bool) -> int:
    is_right, text = exercise.answered(answer)
    if as_json:
        print_json({"exercise": exercise.number, "right": is_right, "text": text})
    else:
        print(
            "\n".join(
                wrap(f"{exercise.number} {'right' if is_right else 'wrong'}: {text}", _WIDTH, subsequent_indent="    ")
            )
        )
    return 0 if is_right else 1


def _write_recordings(as_json: bool) -> None:
    for recording in RECORDINGS:
        path, text = Path(recording.name), recording_text(recording)
        try:
            if path.exists() and path.read_bytes() != text.encode():
                raise EncodeError(f"{path}: there is another file of this name, which would be overwritten")
            path.write_text(text, "utf-8", newline="\n")
        except OSError as error:
            raise PortError(f"{path}: {error.strerror or error}") from None
        if as_json:
            print_json({"wrote": str(path), "lines": text.count("\n") - 1})
        else:
            print(f"wrote {path}: {text.count(chr(10)) - 1} pieces of bytes with their times")


def _start(words: tuple[str, ...]) -> None:
    """Serve the faulty line until Ctrl-C or SIGTERM. Neither its unit nor its faults are printed."""
    from barewire.devices.sim import simulator
    from barewire.io.endpoint import Endpoint
    from barewire_workbench.cli.simulate import machine_server

    if len(words) != 1:
        raise click.UsageError(f"expected barewire lab {len(LABS)} start ENDPOINT, such as rtu:///tmp/line")
    endpoint = Endpoint.parse(words[0])
    if endpoint.scheme != "rtu" or "unit" in endpoint.options:
        raise EncodeError(f"{shown(words[0], 200)}: expected rtu:// without a unit: to find it out is part of the lab")
    machine = simulator("adxl", time.monotonic(), unit=LIVE_UNIT)
    server = machine_server(str(endpoint), machine=machine, faults=LIVE_FAULTS, fault_seed=LIVE_SEED)
    with ended_by_signals(), suppress(KeyboardInterrupt):
        print(f"ready {server.url}", flush=True)
        server.run(threading.Event())
    server.close()
