"""Ask the units of a Modbus line one after the other, and record every sign of life.

    unit 1   01 03 00 00 00 01 84 0A  ->            read holding register 0: a request that changes nothing
                                                    nothing within the time-out: no unit
    unit 2   02 03 00 00 00 01 84 39  ->
                                      <-  02 83 02  an exception: a unit is there
    unit 3   03 03 00 00 00 01 85 E8  ->
                                      <-  03 03 02 00 2A ..   03 03 02 01 07 ..     two answers to one request:
                                                    two devices are unit 3
    unit 4   04 03 00 00 00 01 84 5F  ->
                                      <-  84 00 F8  bytes that are no frame: asked again, three times at most
    unit 5   05 03 00 00 00 01 85 8E  ->
                                      <-  04 03 02 ..         unit 4 is there, and slow

Behind a gateway the exceptions 0A and 0B say that there is no unit. They are the gateway's own.   [MB-APP 7]

On a serial line a device that answers late cannot be mistaken for another, because its address is in the answer. So
there is no waiting for late answers: a scan takes one time-out for each unit.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.errors import PortError
from barewire.modbus.adu import Adu, Noise
from barewire.modbus.framing import Line, LineEvent
from barewire.modbus.messages.registers import ReadHoldingRegisters
from barewire.tcp.frame import other_protocol

_REQUEST = ReadHoldingRegisters(0, 1).encode()
_EXCEPTION = 0x80
_GATEWAY_EXCEPTIONS = (0x0A, 0x0B)
"""Gateway Path Unavailable, Gateway Target Device Failed To Respond."""

_ATTEMPTS = 3
"""How often a unit is asked whose answer is damaged."""

_NEVER_SILENT = 1.0
"""Seconds after a time-out in which the line must become silent. On one that does not, another station sends."""

_ECHOES = 3
"""Requests in a row that must come back as they are until the adapter is said to echo."""


@dataclass(slots=True)
class ScannedUnit:
    """A unit that gave a sign of life.

    answers          the PDUs of its answers, each once
    answered_after   the seconds from the end of the request to its first answer
    is_late          that answer came after the time-out, so this is a lower bound
    is_doubled       one request had two answers: two devices have this address
    damaged          how many requests were answered with bytes that are no frame
    """

    unit: int
    answers: list[bytes] = field(default_factory=list)
    answered_after: float | None = None
    is_late: bool = False
    is_doubled: bool = False
    damaged: int = 0

    @property
    def exception(self) -> int | None:
        """The code of the exception that it answered with; None if it sent a value, or nothing that can be read."""
        pdu = self.answers[0] if self.answers else b""
        return pdu[1] if len(pdu) == 2 and pdu[0] & _EXCEPTION else None

    @property
    def why(self) -> str:
        """The evidence in words.

        >>> ScannedUnit(5, [bytes([0x83, 2])], 0.012).why
        'answered with exception 02 after 12 ms'
        >>> ScannedUnit(5, damaged=3).why
        'damaged answers only: two devices with this address, other settings, or a disturbed line'
        """
        if not self.answers:
            return "damaged answers only: two devices with this address, other settings, or a disturbed line"
        parts = ["answered" if self.exception is None else f"answered with exception {self.exception:02X}"]
        if self.answered_after is not None:
            parts.append(f"after {'more than ' if self.is_late else ''}{1e3 * self.answered_after:.0f} ms")
        text = " ".join(parts)
        if self.is_doubled:
            text += f"; two devices answer as unit {self.unit}"
        return text + (f"; {self.damaged} damaged answers" if self.damaged and not self.is_doubled else "")


@dataclass(slots=True)
class UnitScan:
    """The result of a scan, which grows while it runs.

    units         the units with a sign of life, by address
    asked         the units asked so far, each with the time when its request was sent
    unreachable   the units of which a gateway said that they do not answer
    stray         the number of frames and pieces of noise that no request explains
    protocol      what the other side of a TCP connection speaks in place of Modbus: HTTP, SSH or TLS
    """

    units: dict[int, ScannedUnit] = field(default_factory=dict)
    asked: dict[int, float] = field(default_factory=dict)
    unreachable: set[int] = field(default_factory=set)
    stray: int = 0
    protocol: str = ""

    @property
    def answered(self) -> list[ScannedUnit]:
        """The units of which at least one answer can be read, in the order of their addresses."""
        return [unit for _, unit in sorted(self.units.items()) if unit.answers]

    def unit(self, number: int) -> ScannedUnit:
        """Return the entry of a unit, a new one if it had no sign of life yet."""
        return self.units.setdefault(number, ScannedUnit(number))


class UnitScanner:
    """Asks one unit after the other, and adds what comes to `result`.

    Each request is a conversation of its own, on the line that the connection has by then: a connection that breaks
    costs one unit. Call `ask` for each unit, `listen` once at the end, for late answers of the last ones, and `add`
    with what the line delivered in between.
    """

    def __init__(self, timeout: float) -> None:
        self.result = UnitScan()
        self._timeout = timeout
        self._echoes = 0

    def ask(self, line: Line, number: int) -> Conversation[bytes, None]:
        """Ask a unit, up to three times if what comes is damaged. Raises PortError if the adapter sends back what it is
        told to send, or if another station never stops sending."""
        for _ in range(_ATTEMPTS):
            if not (yield from self._ask_once(line, number)):
                return

    def _ask_once(self, line: Line, number: int) -> Conversation[bytes, bool]:
        """Ask a unit, and return whether what came was damaged.

        On a serial line it listens during the whole time-out, since a second device may answer too. A numbered line has
        one answer, with the number of the request.
        """
        yield from self.listen(line, 0.0)
        frame = line.request(number, _REQUEST)
        heard: Heard[bytes] = yield Send(frame)
        line.sent(heard.now)
        sent_at = self.result.asked[number] = heard.now
        until = heard.now + self._timeout
        answers, is_damaged, beginning = 0, False, b""
        while heard.now < until and line.broken is None and not (answers and line.numbered):
            heard = yield Listen(until if line.deadline is None else min(until, line.deadline))
            beginning += (heard.item or b"")[: len(frame) - len(beginning)]
            for event in line.feed(heard.item, heard.now):
                if isinstance(event, Noise):
                    is_damaged = is_damaged or not line.numbered  # on TCP it is another protocol, not a damaged answer
                    self.result.stray += line.numbered
                    self._note_protocol(event)
                elif event.unit == number and _is_answer(event) and line.answers(event):
                    answers += 1
                    self._add(event, heard.now - sent_at)
                else:
                    self.add(event, heard.now)
        self._check_echo(beginning == frame and not answers)
        if answers > 1:
            self.result.unit(number).is_doubled = True
        if is_damaged:
            self.result.unit(number).damaged += 1
        return is_damaged

    def listen(self, line: Line, seconds: float) -> Conversation[bytes, None]:
        """Listen for `seconds`, and then until the line may be used."""
        heard: Heard[bytes] = yield Listen(float("-inf"))
        until = heard.now + seconds
        give_up = until + _NEVER_SILENT
        while True:
            for event in line.feed(heard.item, heard.now):
                self.add(event, heard.now)
            idle_at = max(until, line.quiet_at, line.deadline or until)
            if line.broken is not None or (heard.item is None and heard.now >= idle_at):
                return
            if heard.now >= give_up:
                raise PortError("the line is never silent: another station sends; a scan needs the line for itself")
            heard = yield Listen(max(idle_at, heard.now))

    def add(self, event: LineEvent, now: float) -> None:
        """Add an event that does not answer an open request: the late answer of a unit that was asked before, or a
        frame, or noise, that nothing explains."""
        if isinstance(event, Adu) and event.unit in self.result.asked and _is_answer(event):
            self._add(event, now - self.result.asked[event.unit], is_late=True)
        else:
            self.result.stray += 1
            self._note_protocol(event)

    def _note_protocol(self, event: LineEvent) -> None:
        if isinstance(event, Noise):
            self.result.protocol = self.result.protocol or other_protocol(event.data)

    def _add(self, answer: Adu, after: float, *, is_late: bool = False) -> None:
        if answer.pdu[0] & _EXCEPTION and answer.pdu[1] in _GATEWAY_EXCEPTIONS:
            self.result.unreachable.add(answer.unit)
            return
        scanned = self.result.unit(answer.unit)
        if scanned.answered_after is None:
            scanned.answered_after, scanned.is_late = after, is_late
        if answer.pdu not in scanned.answers:
            scanned.answers.append(answer.pdu)

    def _check_echo(self, is_echo: bool) -> None:
        self._echoes = self._echoes + 1 if is_echo else 0
        if self._echoes == _ECHOES:
            raise PortError("the adapter sends back every request: add echo=1 to the endpoint")


def _is_answer(frame: Adu) -> bool:
    """Whether a frame can be the answer to the request of a scan: registers, or an exception of two bytes."""
    is_exception = frame.pdu[0] == _REQUEST[0] | _EXCEPTION and len(frame.pdu) == 2
    return is_exception or (frame.pdu[0] == _REQUEST[0] and frame.pdu != _REQUEST)


def unit_numbers(text: str) -> list[int]:
    """Return the addresses of a text such as "1-10,247", each once, in their order.

    >>> unit_numbers("1-3, 247")
    [1, 2, 3, 247]

    Raises ValueError with what was expected.
    """
    numbers: dict[int, None] = {}
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not (first.isdecimal() and (last.isdecimal() if dash else True)) or len(first + last) > 6:
            raise ValueError(f"{part.strip()!r}: expected numbers and ranges, such as 1-10,247")
        numbers |= dict.fromkeys(range(int(first), int(last or first) + 1))
        if dash and int(last) < int(first):
            raise ValueError(f"{part.strip()!r}: a range goes from the smaller number to the larger one")
    if max(numbers) > 255:
        raise ValueError(f"{max(numbers)}: expected units in 0..255")
    return list(numbers)


def likely_first(units: Iterable[int]) -> tuple[list[int], list[int]]:
    """Return the units that devices are usually delivered with, 1 to 10 and 247, and the others.

    >>> likely_first([1, 5, 11, 247])
    ([1, 5, 247], [11])
    """
    likely: list[int] = []
    others: list[int] = []
    for unit in units:
        (likely if 1 <= unit <= 10 or unit == 247 else others).append(unit)
    return likely, others
