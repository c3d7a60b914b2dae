"""Units on one line or connection in virtual time, with every kind of trouble, and what must be true of a `Bus` on it.

    question n  --->  unit        the choices: answered at once, late, with an exception, damaged, lost ...
    answer n    <---  unit        each answer carries the number of its question

Each question has a number, its place in the run. An answer to a read holds that number as the value of the register, a
write writes it; so a value that belongs to another question is visible. The answer of a write only repeats the request
and can be equal for two questions, so the check is stricter: a question may return only in the moment when its own
answer arrived.

What is checked, in every run:

    own answer      a question returns or raises ModbusException only on its own answer, with its own value
    no repetition   a question is sent once, and `retries` times more only if it is a read or `repeat_writes` is set; a
                    broadcast is sent once
    bounded         a question ends after `Setup.longest` seconds at most
    counters        asked = answered + lost

The assumptions on RTU and ASCII: a unit answers in the order of the requests; an answer that comes at all comes within
`late_window` after its request was sent; it comes once, or all its copies come in one piece; other masters ask other
units only, and an echo is configured. `Fate.DOUBLED_LATER`, delays beyond the window, `Traffic` of a unit that is asked
and `UNKNOWN_ECHO` break them. On TCP there are none, apart from a transaction number that returns only after 65,536
requests; answers come in any order.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Literal, NamedTuple

from barewire.ascii import AsciiLine, decode as decode_ascii, encode as encode_ascii
from barewire.conversation import Abandoned, Heard, Listen
from barewire.errors import NoAnswer
from barewire.modbus import (
    Bus,
    Diagnostics,
    EchoLine,
    Line,
    ModbusException,
    ReadHoldingRegisters,
    ReadInputRegisters,
    Request,
    WriteSingleRegister,
)
from barewire.rtu import RtuLine, Timing, encode as encode_rtu
from barewire.tcp import TcpLine, encode as encode_tcp
from tests.model.choices import Choices

TIMING = Timing.of(19200)
NEVER = float("-inf")
APART = 0.003
"""Seconds between two answers: more than t3.5."""


class Fate(Enum):
    """What becomes of an answer, apart from its delay."""

    ARRIVES = "arrives"
    IS_AN_EXCEPTION = "is an exception"
    REQUEST_LOST = "its request is lost"
    LOST = "is lost"
    DAMAGED = "is damaged"
    DOUBLED_AT_ONCE = "comes twice, in one piece"
    DOUBLED_LATER = "comes twice, with a pause between"
    AFTER_ANOTHER_NUMBER = "comes after a frame with another transaction number"


@dataclass(frozen=True)
class Question:
    """One kind of request. `make(n)` is the request message of question number n."""

    name: str
    unit: int
    make: Callable[[int], Request[Any]]


READ = Question("read", 1, lambda n: ReadHoldingRegisters(7, 1))
READ_INPUT = Question("read input registers", 1, lambda n: ReadInputRegisters(7, 1))
READ_OTHER_UNIT = Question("read unit 2", 2, lambda n: ReadHoldingRegisters(7, 1))
READ_THIRD_UNIT = Question("read unit 3", 3, lambda n: ReadHoldingRegisters(7, 1))
WRITE = Question("write", 1, lambda n: WriteSingleRegister(7, 7))
QUERY = b"\x12\x34"
DIAGNOSE = Question("query data", 1, lambda n: Diagnostics(0, QUERY))
WRITE_ALL = Question("broadcast", 0, lambda n: WriteSingleRegister(7, 7))
TURNAROUND = 0.1
"""Seconds that the bus waits after a broadcast."""


class Traffic(NamedTuple):
    """A frame of others on the line: a request of another master, or what a unit answers to it."""

    after: float
    """Seconds after a question began."""
    unit: int
    pdu: bytes


class Adapter(NamedTuple):
    """Whether the client receives what it sends, and whether its `EchoLine` expects that."""

    echo_after: float | None
    """Seconds after a request was sent; bytes that the adapter received before come before the echo. None: no echo."""
    expects: bool | None
    """The option `echoes` of `EchoLine`; False: there is none."""


PLAIN, ECHO, SLOW_ECHO, UNKNOWN_ECHO = (
    Adapter(None, False),
    Adapter(0.0, True),
    Adapter(0.016, True),
    Adapter(0.0, False),
)
ECHO_TO_DETECT, NO_ECHO_TO_DETECT = Adapter(0.016, None), Adapter(None, None)

Probing = Literal["echoes", "declines", "ignores"]
Framing = Literal["rtu", "ascii", "tcp"]


@dataclass(frozen=True)
class Setup:
    """The alphabet of a scenario: its choices. Times are in seconds."""

    framing: Framing = "rtu"
    length: int = 3
    questions: tuple[Question, ...] = (READ,)
    fates: tuple[Fate, ...] = (Fate.ARRIVES, Fate.LOST)
    delays: tuple[float, ...] = (0.002, 0.35, 0.8)
    pauses: tuple[float, ...] = (0.0,)
    probing: tuple[Probing, ...] = ("echoes", "declines", "ignores")
    recovery: tuple[Literal["probe", "wait"], ...] = ("probe", "wait")
    cancel_after: tuple[float | None, ...] = (None,)
    retries: tuple[int, ...] = (0,)
    traffic: tuple[tuple[Traffic, ...], ...] = ()
    """What others may send during a question."""
    adapters: tuple[Adapter, ...] = ()
    timeout: float = 0.3
    late_window: float = 0.9
    bus: Callable[..., Any] = Bus

    @property
    def longest(self) -> float:
        """The time that a question may take, in seconds, without its retries.

        While others send, the bus waits for silence up to a time-out before a probe, and again after it.
        """
        return self.late_window + (4 if self.traffic else 2) * self.timeout + 0.1


@dataclass(order=True)
class Arrival:
    """Bytes under way to the client."""

    at: float
    data: bytes = field(compare=False)
    number: int | None = field(compare=False)
    """The question that these bytes answer; None for a probe, or for damaged bytes."""
    value: int | None = field(compare=False, default=None)


class UnitsOnLine:
    """The line and its units: time, the answers under way, and what was sent."""

    def __init__(self, choices: Choices, setup: Setup) -> None:
        self.now = 0.0
        self.choices = choices
        self.setup = setup
        self.probing = choices.take(setup.probing)
        self.adapter = choices.take(setup.adapters) if setup.adapters else PLAIN
        self.coming: list[Arrival] = []
        self.number = 0
        """The question being asked."""
        self.sent: dict[int, int] = {}
        """How often each question was sent."""
        self.last: Arrival | None = None
        """The last bytes that the client received."""
        self.log: list[str] = []
        """What passed on the line, one text for each message."""
        self._answered_at: dict[int, float] = {}  # unit -> time of its last answer

    def begin(self, number: int) -> None:
        """Begin a question: others may send during it."""
        self.number = number
        self.now += self.choices.take(self.setup.pauses)
        for after, unit, pdu in self.choices.take(self.setup.traffic) if self.setup.traffic else ():
            self.coming.append(Arrival(self.now + after, self._frame(unit, pdu, 0), None))
        self.coming.sort()

    def transmit(self, data: bytes) -> None:
        """Send a request: its unit chooses how it answers."""
        self.now += TIMING.duration(len(data))
        is_probe = self.is_probe(data)
        self.log.append(f"{self.now:7.3f}  -> {data.hex(' ')}  {'probe' if is_probe else f'question {self.number}'}")
        if not is_probe:
            self.sent[self.number] = self.sent.get(self.number, 0) + 1
        echo = Arrival(NEVER, data, None)
        if self.adapter.echo_after is not None:
            echo.at = self.now + self.adapter.echo_after
            self.coming.append(echo)
            self.coming.sort()
        unit, pdu, transaction = self._decoded(data)
        answer = self._answer(pdu)
        if unit == 0 or answer is None:
            return
        fate = self.choices.take(self.setup.fates)
        if fate in (Fate.LOST, Fate.REQUEST_LOST):
            return
        ready = max(self.now + self.choices.take(self.setup.delays), echo.at)
        at = ready
        if self.setup.framing != "tcp":  # in the order of the requests
            at = self._answered_at[unit] = max(ready, self._answered_at.get(unit, 0.0) + APART)
        if fate is Fate.IS_AN_EXCEPTION:
            answer = bytes((pdu[0] | 0x80, 4))
        frame, number = self._frame(unit, answer, transaction), None if is_probe else self.number
        if fate is Fate.DAMAGED:
            frame, number = frame[:-3] + bytes((frame[-3] ^ 1,)) + frame[-2:], None
        if fate is Fate.AFTER_ANOTHER_NUMBER:
            self.coming.append(Arrival(at, self._frame(unit, answer, transaction ^ 0x100), None))
        if fate is Fate.DOUBLED_AT_ONCE:
            frame += frame
        if at == echo.at:  # in one piece with the echo
            echo.data, echo.number = echo.data + frame, number
        else:
            self.coming.append(Arrival(at, frame, number))
        if fate is Fate.DOUBLED_LATER:
            self.coming.append(Arrival(at + 0.1, frame, number))
        self.coming.sort()

    def client_line(self) -> Line:
        """A new framing state for the client."""
        line, expects = self._client_line(), self.adapter.expects
        return line if expects is False else EchoLine(line, echoes=expects)

    def _client_line(self) -> Line:
        if self.setup.framing == "tcp":
            transaction = [0xFFFF - self.setup.length // 2]  # so that the numbers wrap within the run

            def number() -> int:
                transaction[0] = transaction[0] + 1 & 0xFFFF
                return transaction[0]

            return TcpLine(number=number)
        return RtuLine(TIMING) if self.setup.framing == "rtu" else AsciiLine()

    def _decoded(self, data: bytes) -> tuple[int, bytes, int]:
        """The unit, the PDU and the transaction number (0 if there is none) of a request."""
        if self.setup.framing == "tcp":
            return data[6], data[7:], int.from_bytes(data[:2], "big")
        if self.setup.framing == "rtu":
            return data[0], data[1:-2], 0
        adu = decode_ascii(data)
        return adu.unit, adu.pdu, 0

    def _frame(self, unit: int, pdu: bytes, transaction: int) -> bytes:
        if self.setup.framing == "tcp":
            return encode_tcp(unit, pdu, transaction)
        return (encode_rtu if self.setup.framing == "rtu" else encode_ascii)(unit, pdu)

    def is_probe(self, data: bytes) -> bool:
        """Whether a request was sent by the bus itself."""
        _, pdu, _ = self._decoded(data)
        return pdu[0] == 8 and pdu[3:] != QUERY

    def _answer(self, pdu: bytes) -> bytes | None:
        function = pdu[0]
        if function in (3, 4):
            return bytes((function, 2, 0, self.number))
        if function == 8 and self.probing != "echoes":
            return b"\x88\x01" if self.probing == "declines" else None
        return pdu  # the echo of 06, and of 08

    def receive(self, until: float) -> Heard[bytes]:
        """The next bytes that arrive until then."""
        if self.coming and self.coming[0].at <= max(until, self.now):
            self.last = self.coming.pop(0)
            self.now = max(self.now, self.last.at)
            self.log.append(
                f"{self.now:7.3f}  <- {self.last.data.hex(' ')}  answers {self.last.number or 'no question'}"
            )
            return Heard(self.last.data, self.now)
        self.now = max(self.now, until)
        return Heard(None, self.now)


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
    line.last = None
    try:
        asking: Any = (
            bus.ask(question.unit, request, timeout=setup.timeout, retries=retries)
            if question.unit
            else (bus.broadcast(request, turnaround=TURNAROUND))
        )
        response = run(line, asking, begin + cancel_after if cancel_after is not None else float("inf"))
    except ModbusException:
        tally.exceptions += 1
        if line.last is None or line.last.number != number:
            tally.wrong.append(f"{where()}: an exception that answers question {line.last and line.last.number}")
    except NoAnswer:
        tally.no_answer += 1
    except Abandoned:
        tally.cancelled += 1
    else:
        tally.right += 1
        if not question.unit:
            assert line.sent[number] == 1, where()
        elif line.last is None or line.last.number != number:
            tally.wrong.append(f"{where()}: the answer to question {line.last and line.last.number}")
        elif isinstance(request, ReadHoldingRegisters | ReadInputRegisters) and response.registers != (number,):
            tally.wrong.append(f"{where()}: {response.registers} instead of ({number},)")
    most = 1 + (0 if request.writes else retries)
    assert line.sent.get(number, 0) <= most, f"{where()}: sent {line.sent[number]} times"
    took = line.now - begin
    tally.longest = max(tally.longest, took)
    assert took <= setup.longest * (1 + retries), f"{where()}: took {took:.3f} s"
