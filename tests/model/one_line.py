"""What must be true of a `Bus` on a line of `units`, in every order of events.

What is checked, in every run:

    own answer      a question returns or raises ModbusException only on its own answer, with its own value
    no repetition   a question is sent once, and `retries` times more only if it is a read or `repeat_writes` is set; a
                    broadcast is sent once
    bounded         a question ends after `Setup.longest` seconds at most
    counters        asked = answered + lost
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Any

from barewire.conversation import Abandoned, Heard, Listen
from barewire.errors import NoAnswer
from barewire.modbus import Bus, ModbusException, ReadHoldingRegisters, ReadInputRegisters
from tests.model.choices import Choices
from tests.model.units import TURNAROUND, Question, Setup, UnitsOnLine


def run(line: UnitsOnLine, conversation: Generator[Any, Heard[bytes], Any], cancel_at: float) -> Any:
    """Carry out a conversation on the line. It is abandoned at `cancel_at`, as a cancelled task is."""
    step = next(conversation)
    try:
        while True:
            if not isinstance(step, Listen):
                line.transmit(step.item)
                heard: Heard[bytes] = Heard(None, line.now)
            elif step.until > cancel_at and not (line.coming and line.coming[0].at <= cancel_at):
                line.now = max(line.now, cancel_at)
                line.log.append(f"{line.now:7.3f}  cancelled")
                conversation.throw(Abandoned("cancelled"))
                raise AssertionError("a conversation continued after it was abandoned")
            else:
                heard = line.receive(step.until)
            step = conversation.send(heard)
    except StopIteration as stop:
        return stop.value


@dataclass
class Tally:
    """What happened in all runs of a scenario."""

    questions: int = 0
    right: int = 0
    exceptions: int = 0
    no_answer: int = 0
    cancelled: int = 0
    longest: float = 0.0
    wrong: list[str] = field(default_factory=list)
    """A description of each question that got another question's answer."""


def scenario(setup: Setup, tally: Tally) -> Callable[[Choices], UnitsOnLine]:
    """The scenario of one setup: `setup.length` questions on one line."""

    def play(choices: Choices) -> UnitsOnLine:
        line = UnitsOnLine(choices, setup)
        recovery = choices.take(setup.recovery)
        bus = setup.bus(line.client_line(), recovery=recovery, late_window=setup.late_window)
        for number in range(1, setup.length + 1):
            line.begin(number)
            _ask(line, bus, choices.take(setup.questions), setup, tally)
        counters = bus.counters
        assert counters.asked == counters.answered + counters.lost, (choices.script, counters)
        return line

    return play


def _ask(line: UnitsOnLine, bus: Bus, question: Question, setup: Setup, tally: Tally) -> None:
    choices, number = line.choices, line.number
    begin = line.now
    cancel_after = choices.take(setup.cancel_after)
    retries = choices.take(setup.retries)
    request = question.make(number)

    def where() -> str:
        return f"question {number} ({question.name}) of {choices.script}"

    tally.questions += 1
    try:
        asking: Any = (
            bus.ask(question.unit, request, timeout=setup.timeout, retries=retries)
            if question.unit
            else (bus.broadcast(request, turnaround=TURNAROUND))
        )
        response = run(line, asking, begin + cancel_after if cancel_after is not None else float("inf"))
    except ModbusException:
        tally.exceptions += 1
        if line.answered() != number:
            tally.wrong.append(f"{where()}: an exception that answers question {line.answered()}")
    except NoAnswer:
        tally.no_answer += 1
    except Abandoned:
        tally.cancelled += 1
    else:
        tally.right += 1
        if not question.unit:
            assert line.sent[number] == 1, where()
        elif line.answered() != number:
            tally.wrong.append(f"{where()}: the answer to question {line.answered()}")
        elif isinstance(request, ReadHoldingRegisters | ReadInputRegisters) and response.registers != (number,):
            tally.wrong.append(f"{where()}: {response.registers} instead of ({number},)")
    most = 1 + (0 if request.writes else retries)
    assert line.sent.get(number, 0) <= most, f"{where()}: sent {line.sent[number]} times"
    took = line.now - begin
    tally.longest = max(tally.longest, took)
    assert took <= setup.longest * (1 + retries), f"{where()}: took {took:.3f} s"
