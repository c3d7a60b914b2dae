"""`barewire lab`: the labs of the course "from one byte to a moving motor", and the checks of their answers."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from pathlib import Path
from textwrap import wrap

import click

from barewire.errors import EncodeError, shown
from barewire_workbench.cli.arguments import Choice
from barewire_workbench.cli.ending import ended_by_signals
from barewire_workbench.cli.labs import LABS
from barewire_workbench.cli.labs.model import Lab
from barewire_workbench.cli.labs.real_line import HEAT_PUMP_FILE, HEAT_PUMP_LOG, REAL_LINE_LAB
from barewire_workbench.cli.labs.repair import (
    LIVE_FAULTS,
    LIVE_SEED,
    LIVE_UNIT,
    RECORDINGS,
    REPAIR_LAB,
    recording_text,
)
from barewire_workbench.cli.output import Output, output_option, port_error, replace_file

_WIDTH = 100
_RECORDED = (REPAIR_LAB, REAL_LINE_LAB)
"""The labs with recordings."""


def _lab_number(value: str) -> str:
    """The type of the number of a lab, such as 3, or of one of its exercises, 3.1."""
    number = value.partition(".")[0]
    lab = LABS.get(int(number)) if number.isdecimal() and len(number) < 4 else None
    if lab is None:
        raise click.BadParameter(f"{shown(value)}: expected the number of a lab, 1 to {len(LABS)}")
    if "." in value and lab.exercise(value) is None:
        raise click.BadParameter(f"{shown(value)}: lab {lab.number} has the exercises {_numbers(lab)}")
    return value


def _numbers(lab: Lab) -> str:
    return ", ".join(exercise.number for exercise in lab.exercises)


@click.command("lab", context_settings={"ignore_unknown_options": True})
@click.argument("number", type=_lab_number, required=False, metavar="[N]")
@click.argument(
    "action", type=Choice(["check", "start", "recordings"]), required=False, metavar="[check|start|recordings]"
)
@click.argument("words", nargs=-1, metavar="[ANSWER]...")
@output_option
def lab_command(number: str | None, action: str | None, words: tuple[str, ...], output: Output) -> int:
    """Show the labs of the course, and check answers to their exercises.

    The course, in docs/tutorial, goes from one byte to a moving motor in eleven labs. Without N, the labs are listed;
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
        _list(output)
        return 0
    lab = LABS[int(number.partition(".")[0])]
    if "." in number and action == "check":
        words = (number, *words)
    if action is None:
        output.show(_text_of(lab), lab.as_dict)
    elif action == "check":
        return _check(lab, words, output)
    elif action == "recordings" and lab in _RECORDED:
        _write_recordings(lab, output)
    elif action == "start" and lab is REPAIR_LAB:
        _start(words)
    else:
        commands = f": {'; '.join(lab.devices)}" if lab.devices else f"; lab {lab.number} needs no device"
        labs = (
            f"lab {REPAIR_LAB.number}" if action == "start" else f"labs {_RECORDED[0].number} and {_RECORDED[1].number}"
        )
        raise click.UsageError(f"{action} is for {labs}{commands}")
    return 0


def _list(output: Output) -> None:
    for lab in LABS.values():
        output.show(f"{lab.number:>2}  {lab.title:<36}  {lab.minutes} min  docs/tutorial/{lab.page}", lab.as_dict)
    hours, minutes = divmod(sum(lab.minutes for lab in LABS.values()), 60)
    output.text(f"{hours} h {minutes} min in all; `barewire lab 1` shows the first one")


def _text_of(lab: Lab) -> str:
    lines = [f"Lab {lab.number}: {lab.title}", lab.goal, f"page: docs/tutorial/{lab.page}, about {lab.minutes} minutes"]
    lines += [f"in a terminal of its own: {command}" for command in lab.devices]
    for exercise in lab.exercises:
        lines += ["", *wrap(f"{exercise.number}  {exercise.task}", _WIDTH, subsequent_indent=" " * 5)]
        lines.append(f"     answer: {exercise.form}")
    return "\n".join([*lines, "", f"barewire lab {lab.number} check {lab.exercises[0].number} ANSWER"])


def _check(lab: Lab, words: tuple[str, ...], output: Output) -> int:
    """Check an answer, and return the exit status."""
    exercise = lab.exercise(words[0]) if len(words) > 1 else None
    answer = " ".join(words if exercise is None else words[1:])
    usage = f"barewire lab {lab.number} check {lab.exercises[0].number} ANSWER"
    if not answer.strip():
        raise click.UsageError(f"no answer: expected {usage}; exercises: {_numbers(lab)}")
    if exercise is None and lab.exercise(answer) is not None:
        raise click.UsageError(f"no answer behind {answer}: expected barewire lab {lab.number} check {answer} ANSWER")
    # Without the number of an exercise, the answer is tried on all.
    for candidate in lab.exercises if exercise is None else [exercise]:
        is_right, text = candidate.answered(answer)
        if is_right or exercise is not None:
            line = f"{candidate.number} {'right' if is_right else 'wrong'}: {text}"
            fields = {"exercise": candidate.number, "right": is_right, "text": text}
            output.show("\n".join(wrap(line, _WIDTH, subsequent_indent="    ")), fields)
            return 0 if is_right else 1
    if len(words) > 1 and words[0].partition(".")[0].isdecimal() and "." in words[0]:
        text = f"lab {lab.number} has no exercise {words[0]}: expected one of {_numbers(lab)}"
    else:
        text = f"this solves no exercise of lab {lab.number}; for a hint, name one: {usage}"
    output.show(f"wrong: {text}", {"exercise": None, "right": False, "text": text})
    return 1


def _recordings(lab: Lab) -> dict[str, str]:
    """Return the recordings of a lab by the names of their files."""
    if lab is REAL_LINE_LAB:
        return {HEAT_PUMP_FILE: HEAT_PUMP_LOG}
    return {recording.name: recording_text(recording) for recording in RECORDINGS}


def _write_recordings(lab: Lab, output: Output) -> None:
    for name, text in _recordings(lab).items():
        path = Path(name)
        with port_error(path):
            if path.exists() and path.read_bytes() != text.encode():
                raise EncodeError(f"{path}: there is another file of this name, which would be overwritten")
        replace_file(path, text.encode())
        count = text.count("\n") - 1
        output.show(f"wrote {path}: {count} lines", {"wrote": str(path), "lines": count})


def _start(words: tuple[str, ...]) -> None:
    """Serve the faulty line until Ctrl-C or SIGTERM. Neither its unit nor its faults are printed."""
    from barewire.devices.sim import simulator
    from barewire.io.endpoint import Endpoint
    from barewire_workbench.cli.simulate import machine_server

    if len(words) != 1:
        raise click.UsageError(f"expected barewire lab {REPAIR_LAB.number} start ENDPOINT, such as rtu:///tmp/line")
    endpoint = Endpoint.parse(words[0])
    if endpoint.scheme != "rtu" or "unit" in endpoint.options:
        raise EncodeError(f"{shown(words[0], 200)}: expected rtu:// without a unit: to find it out is part of the lab")
    machine = simulator("adxl", time.monotonic(), unit=LIVE_UNIT)
    server = machine_server(str(endpoint), machine=machine, faults=LIVE_FAULTS, fault_seed=LIVE_SEED)
    with ended_by_signals(), suppress(KeyboardInterrupt):
        print(f"ready {server.url}", flush=True)
        server.run(threading.Event())
    server.close()
