"""Units on one line or connection in virtual time, with every kind of trouble.

    question n  --->  unit        the choices: answered at once, late, with an exception, damaged, lost ...
    answer n    <---  unit        each answer carries the number of its question

Each question has a number, its place in the run. An answer to a read of one register holds that number as its value, a
write writes it; so a value that belongs to another question is visible. The answer of a write only repeats the request
and can be equal for two questions, so the check is stricter: a question may return only after its own answer arrived.

The assumptions where the answers carry no transaction number: a unit answers in the order of the requests; an answer
that comes at all comes within `Setup.window` after its request was sent; it comes once, or all its copies come in one
piece; other masters ask other units only; an echo is configured; the CRC or LRC shows damage. `Fate.DOUBLED_LATER`,
delays beyond the window, `Traffic` of a unit that is asked and `UNKNOWN_ECHO` break them. With transaction numbers
there are none, apart from a number that returns only after 65,536 requests; answers come in any order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Literal, NamedTuple

from barewire.ascii import AsciiLine, decode as decode_ascii, encode as encode_ascii
from barewire.conversation import Heard
from barewire.errors import DecodeError
from barewire.modbus import (
    Bus,
    Diagnostics,
    EchoLine,
    Line,
    ReadHoldingRegisters,
    ReadInputRegisters,
    Request,
    WriteSingleRegister,
)
from barewire.rtu import RtuLine, Timing, encode as encode_rtu
from barewire.rtu.crc import crc16
from barewire.rtu.line import PATIENCE
from barewire.tcp import TcpLine, encode as encode_tcp
from tests.model.choices import Choices

TIMING = Timing.of(19200)
NEVER = float("-inf")
FLOODS = b"\x55" * 600, b"\x01\x03\xff" + b"\x55" * 600
"""Noise longer than any frame; the second one begins like a frame that would be too long."""
APART = 0.003
"""Seconds between two answers: more than t3.5."""


class Fate(Enum):
    """What becomes of an answer, apart from its delay."""

    ARRIVES = "arrives"
    IS_AN_EXCEPTION = "is an exception"
    REQUEST_LOST = "its request is lost"
    LOST = "is lost"
    DAMAGED = "is damaged"
    AFTER_STRAY = "comes behind one byte, as when a transmitter is turned on"
    IN_PIECES = "comes in two pieces"
    FLOODED = "comes behind more noise than any frame is long"
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
IMAGE_REGISTERS, IMAGE_VALUE = 4, 99
READ_IMAGE = Question("read a frame in registers", 2, lambda n: ReadHoldingRegisters(7, IMAGE_REGISTERS))
"""The registers spell the RTU frame of a response with the value `IMAGE_VALUE`."""
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
    delays: Sequence[float] = (0.002, 0.35, 0.8)
    pauses: tuple[float, ...] = (0.0,)
    probing: tuple[Probing, ...] = ("echoes", "declines", "ignores")
    recovery: tuple[Literal["probe", "wait"], ...] = ("probe", "wait")
    cancel_after: tuple[float | None, ...] = (None,)
    retries: tuple[int, ...] = (0,)
    traffic: tuple[tuple[Traffic, ...], ...] = ()
    """What others may send during a question."""
    adapters: tuple[Adapter, ...] = ()
    timeout: float = 0.3
    late_window: float | None = None
    """The option of the client; None: it is not passed, so the default holds."""
    bus: Callable[..., Any] = Bus
    any_transaction: bool = False
    any_damage: bool = False
    """Whether any bit of an answer may be damaged and any bytes missing, or always the same bit."""

    @property
    def numbered(self) -> bool:
        """Whether answers name their request, by its transaction number."""
        return self.framing == "tcp" and not self.any_transaction

    @property
    def window(self) -> float:
        """The time, in seconds after its request, within which an answer comes: that of the default option."""
        return 3 * self.timeout if self.late_window is None else self.late_window

    @property
    def longest(self) -> float:
        """The time that a question may take, in seconds, without its retries.

        While others send, the bus waits for silence up to a time-out before a probe, and again after it.
        """
        return self.window + (4 if self.traffic else 2) * self.timeout + 0.1


@dataclass(order=True)
class Arrival:
    """Bytes under way to the client."""

    at: float
    data: bytes = field(compare=False)
    number: int | None = field(compare=False)
    """The question that these bytes answer; None for a probe, or for damaged bytes."""
    value: int | None = field(compare=False, default=None)
    is_echo: bool = field(compare=False, default=False)
    """They are a request, which an adapter repeats, and nothing else."""


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
        self.unbroken: list[Arrival] = []
        """The bytes of the present question that the client received without a silence between them."""
        self.busy_until = NEVER
        """No unit answers before this time."""
        self.latest = float("inf")
        """An answer that would come after this time is lost, so that the assumption of the window holds."""
        self.log: list[str] = []
        """What passed on the line, one text for each message."""
        self._answered_at: dict[int, float] = {}  # unit -> time of its last answer

    def answered(self) -> int | None:
        """Return the question that the client has taken an answer to, as a number.

        It is that of the last bytes. Only where a silence has divided the bytes, others may follow the answer: then it
        is the first copy of its bytes, so that an older answer that looks the same is not taken for it.
        """
        if self.last is None or self.last.number == self.number:
            return None if self.last is None else self.last.number
        own = [arrival.data for arrival in self.unbroken if arrival.number == self.number]
        copies = [arrival.number for arrival in self.unbroken if arrival.data in own and not arrival.is_echo]
        return copies[0] if copies else self.last.number

    def begin(self, number: int) -> None:
        """Begin a question: others may send during it."""
        self.number = number
        self.last = None
        self.unbroken.clear()
        self.now += self.choices.take(self.setup.pauses)
        for after, unit, pdu in self.choices.take(self.setup.traffic) if self.setup.traffic else ():
            self.coming.append(Arrival(self.now + after, self._frame(unit, pdu, 0), None))
        self.coming.sort()

    def transmit(self, data: bytes) -> None:
        """Send a request: its unit chooses how it answers."""
        self.now += self.duration(data)
        is_probe = self.is_probe(data)
        self.log.append(f"{self.now:7.3f}  -> {data.hex(' ')}  {'probe' if is_probe else f'question {self.number}'}")
        if not is_probe:
            self.sent[self.number] = self.sent.get(self.number, 0) + 1
        echo = Arrival(NEVER, data, None, is_echo=True)
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
        at = max(self.now + self.choices.take(self.setup.delays), echo.at, self.busy_until)
        if not self.setup.numbered:  # in the order of the requests
            at = max(at, self._answered_at.get(unit, 0.0) + APART)
            if at > self.latest - APART:
                return
            self._answered_at[unit] = at
        if fate is Fate.IS_AN_EXCEPTION:
            answer = bytes((pdu[0] | 0x80, 4))
        frame, number = self._frame(unit, answer, transaction), None if is_probe else self.number
        if fate is Fate.DAMAGED:
            frame, number = self._damaged(frame), None
        if fate is Fate.FLOODED:
            frame = self.choices.take(FLOODS) + frame
        if fate is Fate.AFTER_STRAY:
            frame = self.choices.take((b"\x00", b"\xff")) + frame
        if fate is Fate.AFTER_ANOTHER_NUMBER:
            self.coming.append(Arrival(at, self._frame(unit, answer, transaction ^ 0x100), None))
        if fate is Fate.DOUBLED_AT_ONCE:
            frame += frame
        if fate is Fate.IN_PIECES:
            self.coming.append(Arrival(at, frame[:4], None))
            # A pause between t1.5 and t3.5; but on TCP nothing comes between the pieces of a frame.
            pause = 1e-9 if self.setup.framing == "tcp" else self.duration(frame[4:]) + 0.0012
            at, frame = at + pause, frame[4:]
            if not self.setup.numbered:
                self._answered_at[unit] = at
        if at == echo.at:  # in one piece with the echo
            echo.data, echo.number, echo.is_echo = echo.data + frame, number, False
        else:
            self.coming.append(Arrival(at, frame, number))
        if fate is Fate.DOUBLED_LATER:
            self.coming.append(Arrival(at + 0.1, frame, number))
        self.coming.sort()

    def duration(self, data: bytes) -> float:
        """The seconds that bytes take on the wire."""
        return TIMING.duration(len(data))

    def _damaged(self, frame: bytes) -> bytes:
        """Return a frame with one bit inverted, or without some of its bytes."""
        place, bit, take, is_rtu = len(frame) - 3, 1, self.choices.take, self.setup.framing == "rtu"
        if self.setup.any_damage:
            place = take(range(len(frame)))
            bit = take((1, 2, 4, 8, 16, 32, 64, 128, 0) if is_rtu else (1, 1, 0))
        damaged = frame[:place] + bytes((frame[place] ^ bit,)) + frame[place + 1 :]
        if not bit:
            damaged = frame[:place] + frame[take(range(place + 1, len(frame) + 1)) :]
        # The CRC or LRC shows damage, which is an assumption.
        if is_rtu and any(not crc16(damaged[:end]) for end in range(4, len(damaged) + 1)):
            return frame[:-1]
        if self.setup.framing == "ascii":
            with suppress(DecodeError):
                decode_ascii(damaged)
                return frame[:-1]
        return damaged

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
            if pdu[4] == IMAGE_REGISTERS:
                image = encode_rtu(self.choices.take((1, 2)), bytes((3, 2, 0, IMAGE_VALUE)))
                return bytes((function, 2 * IMAGE_REGISTERS)) + image.ljust(2 * IMAGE_REGISTERS, b"\0")
            return bytes((function, 2, 0, self.number))
        if function == 8 and self.probing != "echoes":
            return b"\x88\x01" if self.probing == "declines" else None
        return pdu  # the echo of 06, and of 08

    def receive(self, until: float) -> Heard[bytes]:
        """The next bytes that arrive until then."""
        if self.coming and self.coming[0].at <= max(until, self.now):
            return Heard(self.deliver(), self.now)
        self.now = max(self.now, until)
        return Heard(None, self.now)

    def deliver(self) -> bytes:
        """Return the next bytes that arrive, at the time when they arrive."""
        last = self.coming.pop(0)
        if self.last is not None and last.at - TIMING.duration(len(last.data)) - self.last.at > PATIENCE:
            self.unbroken.clear()
        self.last = last
        self.unbroken.append(last)
        self.now = max(self.now, last.at)
        self.log.append(f"{self.now:7.3f}  <- {last.data.hex(' ')}  answers {last.number or 'no question'}")
        return last.data
