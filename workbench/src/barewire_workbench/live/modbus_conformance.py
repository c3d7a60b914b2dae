"""Runs the conformance cases of the vectors, kind `server-conformance`, against a server on a real port of any carrier.

    for result in conform(Endpoint.parse("tcp://127.0.0.1:502?unit=1")): ...

On TCP every case has a connection of its own; a serial line is the same for all. The stimuli are sent as they are,
without a client, and everything received is collected until the server has been silent for a while.

The cases read and write the server's registers and coils 0 to 9. A case whose requests the server refuses because it
does not have these (exception 02) or the function (01) is not judged: a valid request is refused in the same way.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from typing import NamedTuple, Self

from barewire.ascii import encode as ascii_frame
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.endpoint import CARRIERS, DEFAULT_BAUDRATE, Endpoint
from barewire.io.modbus.carriers import dialer, modbus_line
from barewire.io.ports.base import Port
from barewire.modbus import EchoLine
from barewire.modbus.adu import Adu, Noise
from barewire.rtu import encode as rtu_frame
from barewire.tcp import encode as tcp_frame
from barewire_workbench.conform.modbus import (
    CLOSED,
    SILENCE,
    ServerCase,
    ServerStep,
    StepAnswer,
    Stimulus,
    accepted_apart_from,
    accepted_sequence,
    answer_text,
    difference,
    read_case,
    refusals,
)
from barewire_workbench.live.results import Unfinished, case_line
from barewire_workbench.vectors.files import load_vectors
from barewire_workbench.vectors.judge import Answer
from barewire_workbench.vectors.questions import Question
from barewire_workbench.vectors.run import AdapterFailure

KIND = "server-conformance"
"""The kind of the vectors that these cases are."""

ANSWER_TIMEOUT = 1.0
"""Seconds without an answer after which none is expected, unless the endpoint has a time-out. libmodbus takes half a
second for an exception."""

_TOO_MANY = 4096
"""Bytes of one step after which the server is taken to send without end."""

RESTART = 3.0
"""Seconds after which a server that answered before must accept connections again: it may be restarted."""

_CASES_IN_A_ROW, _KEPT = 3, 8
_READ_ONE_REGISTER = ServerCase("read one register", "", (ServerStep((Stimulus(bytes.fromhex("0300000001")),)),), ())


_VALID_REQUESTS = {
    function[0]: ServerCase("a valid request", "", (ServerStep((Stimulus(function),)),), ())
    for function in map(
        bytes.fromhex,
        (
            "01 0000 0001",
            "03 0000 0001",
            "05 0000 FF00",
            "06 0000 1234",
            "0F 0000 0001 01 01",
            "10 0000 0001 02 1234",
            "16 0000 FFFF 0000",
            "17 0000 0001 0000 0001 02 1234",
        ),
    )
}
"""By function that the cases use on register or coil 0, a request that a server with these must carry out."""


class CaseResult(NamedTuple):
    """The result of a case.

    `failure` is None, or the difference from what is accepted, as a sentence. `not_judged` is empty, or the reason why
    the answers are neither right nor wrong: the server refuses a function or an address that the case needs.
    """

    case: ServerCase
    received: tuple[StepAnswer, ...]
    failure: str | None
    not_judged: str = ""

    @property
    def verdict(self) -> str:
        """One of ok, failed, not judged."""
        return "failed" if self.failure else "not judged" if self.not_judged else "ok"

    @property
    def line(self) -> str:
        """The result as a line of text."""
        remark = f"not judged: {self.not_judged}" if self.not_judged else ""
        return case_line(self.verdict, f"{self.case.clause:18}", self.failure or self.case.name, remark)

    def as_dict(self) -> dict[str, object]:
        """Return the result for JSON."""
        return {
            "case": self.case.name,
            "clause": self.case.clause,
            "ok": None if self.not_judged else self.failure is None,
            "not_judged": self.not_judged or None,
            "received": [answer_text(answer) for answer in self.received],
            "failure": self.failure,
        }


def battery(endpoint: Endpoint) -> tuple[ServerCase, ...]:
    """Return the cases for the framing of an endpoint. Raises EncodeError for a CAN bus."""
    if endpoint.scheme not in CARRIERS:
        known = ", ".join(f"{name}://" for name in CARRIERS)
        raise EncodeError(f"endpoint {str(endpoint)!r}: there are cases for {known}")
    return cases_of(endpoint.framing)


@cache
def cases_of(framing: str) -> tuple[ServerCase, ...]:
    """Return the cases for tcp, rtu or ascii, in the order of their file."""
    cases = [case for file in load_vectors().files if file.kind == KIND for case in file.cases]
    return tuple(read_case(case) for case in cases if framing in case["framings"])


class LiveServer:
    """A server behind an endpoint, as a function from a question of the vectors to its answer.

    Only questions of the kind `server-conformance` for the framing of the endpoint are put to it. Raises EncodeError
    for a CAN bus, and PortError if no server is there.
    """

    def __init__(self, endpoint: Endpoint) -> None:
        battery(endpoint)
        self._endpoint = endpoint
        self._unit = endpoint.integer("unit", 1)
        self._tester = _Tester(endpoint, self._unit, endpoint.seconds("timeout", ANSWER_TIMEOUT))
        self._tester.run(_READ_ONE_REGISTER)
        self._gone = ""

    def __repr__(self) -> str:
        return f"<LiveServer: {self._endpoint}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._tester.close()

    def __call__(self, question: Question) -> Answer:
        """Return what the server answers. Raises AdapterFailure if it is not there, or sends without end."""
        framing = self._endpoint.framing
        if question.kind != KIND:
            return {"not_offered": f"a running server cannot be asked for {question.kind}"}
        if question.given["framing"] != framing:
            return {"not_offered": f"the endpoint has {framing} frames, and this case {question.given['framing']}"}
        if self._gone:
            raise AdapterFailure(f"not asked: {self._gone}")
        case = read_case(question.case)
        try:
            received = self._tester.run(case)
            answers = [answer_text(answer) for answer in received]
            if not any(answers) and _must_answer(case) and not self._tester.still_answers():
                self._gone = f"the server has stopped answering, by the case {case.name!r}"
                raise AdapterFailure(self._gone)
        except PortError as error:
            self._gone = f"{error}, in the case {case.name!r}"
            raise AdapterFailure(self._gone) from None
        if self._tester.endless:
            raise AdapterFailure(self._tester.endless)
        failure = difference(case, received, self._unit)
        if failure and (lacking := self._tester.lacking(case, received)):
            return {"not_offered": lacking}
        if failure and accepted_sequence(case, received) is not None:
            raise AdapterFailure(failure)  # the answer of another unit
        return {"is": {"answers": answers}}


def conform(endpoint: Endpoint) -> Iterator[CaseResult]:
    """Run every case, and yield its result.

    Raises EncodeError for an endpoint without cases, PortError if no server is there, and Unfinished

    - if the server sends without end in three cases in a row,
    - if it answered neither in three cases in a row that require an answer, nor a plain read after them, nor another
      read `RESTART` seconds later,
    - if it answered before and cannot be reached any more.
    """
    cases = battery(endpoint)
    unit, timeout = endpoint.integer("unit", 1), endpoint.seconds("timeout", ANSWER_TIMEOUT)
    tester = _Tester(endpoint, unit, timeout)
    name, silent = repr(str(endpoint)), 0
    nothing = f"nothing was answered in any case: is there a unit {unit} behind {name}?"
    try:
        for place, case in enumerate(cases):
            not_run = len(cases) - place - 1
            try:
                received = tester.run(case)
            except PortError as error:
                if not place:
                    raise
                raise Unfinished(f"{error}, in the case {case.name!r}", not_run + 1) from None
            failure = f"{case.name}: {tester.endless}" if tester.endless else difference(case, received, unit)
            not_judged = tester.lacking(case, received) if failure and not tester.endless else ""
            yield CaseResult(case, tuple(received), None if not_judged else failure, not_judged)
            if tester.endless_cases >= _CASES_IN_A_ROW:
                raise Unfinished(f"{name} never stops sending: {tester.endless}", not_run)
            silent = 0 if any(received) else silent + _must_answer(case)
            if silent >= _CASES_IN_A_ROW:
                was_answered = tester.was_answered
                if not tester.still_answers():
                    stopped = f"{name} has stopped answering, by the case {case.name!r}"
                    raise Unfinished(stopped if was_answered else nothing, not_run)
                silent = 0
        if not tester.was_answered:
            raise NoAnswer(nothing)
    finally:
        tester.close()


def _must_answer(case: ServerCase) -> bool:
    """Return whether every accepted sequence of this case has an answer."""
    return all(any(answer not in (SILENCE, CLOSED) for answer in sequence) for sequence in case.accepts)


class _Tester:
    """Carries out the steps of cases. `endless` is the failure of the latest case if the server sent without end."""

    def __init__(self, endpoint: Endpoint, unit: int, timeout: float) -> None:
        self._endpoint = endpoint
        self._unit = unit
        self._timeout = timeout
        self._dial = dialer(endpoint)
        self._is_tcp = endpoint.framing == "tcp"
        self._slow = 600 * 11 / endpoint.integer("baudrate", DEFAULT_BAUDRATE) if endpoint.is_serial_port else 0.0
        self.endless = ""
        self.endless_cases = 0
        self.was_answered = False
        self._number = 0
        self._last = float("-inf")  # when the last byte was on the wire, in either direction
        self._port: Port[bytes] | None = None
        self._line = modbus_line(endpoint, "client")
        self._valid_answers: dict[int, Sequence[StepAnswer]] = {}

    def close(self) -> None:
        """Close the port."""
        if self._port is not None:
            self._port.close()
        self._port = None

    def still_answers(self) -> bool:
        """Return whether a plain read is answered, now or `RESTART` seconds later."""
        for pause in (0.0, RESTART):
            time.sleep(pause)
            self.close()
            with suppress(PortError):
                if any(self.run(_READ_ONE_REGISTER)):
                    return True
        return False

    def lacking(self, case: ServerCase, answers: Sequence[StepAnswer]) -> str:
        """Describe the refusals of a case, if nothing else is wrong and valid requests are refused in the same way."""
        refused = {place: pdu for place, pdu in refusals(case, answers).items() if self._always_refused(pdu)}
        if not refused or not accepted_apart_from(case, answers, refused):
            return ""
        functions = ", ".join(dict.fromkeys(f"{pdu[0] & 0x7F:02X}" for pdu in refused.values()))
        codes = ", ".join(dict.fromkeys(f"{pdu[1]:02X}" for pdu in refused.values()))
        return f"valid requests of {functions} are refused with {codes}"

    def _always_refused(self, pdu: bytes) -> bool:
        """Return whether a valid request of the same function is answered by this exception, too."""
        function = pdu[0] & 0x7F
        if function not in _VALID_REQUESTS:
            return False
        if function not in self._valid_answers:
            with suppress(PortError):
                self._valid_answers[function] = self.run(_VALID_REQUESTS[function])
        return [adu.pdu for answer in self._valid_answers.get(function, ()) for adu in answer or ()] == [pdu]

    def run(self, case: ServerCase) -> Sequence[StepAnswer]:
        """Carry out every step; return the answers of each."""
        if self._is_tcp:
            self.close()
        self.endless = ""
        answers = []
        for place, step in enumerate(case.steps):
            following = case.steps[place + 1].after if place + 1 < len(case.steps) else 0.0
            is_silent = bool(case.accepts) and all(sequence[place] == SILENCE for sequence in case.accepts)
            # If the next step is due soon, do not wait longer than that for an answer that must not come.
            answers.append(self._step(step, following if following and is_silent else self._timeout))
        self.was_answered |= any(answers)
        self.endless_cases = self.endless_cases + 1 if self.endless else 0
        return answers

    def _step(self, step: ServerStep, timeout: float) -> StepAnswer:
        if self._port is None:
            self._port, self._line = self._opened(), modbus_line(self._endpoint, "client")
        quiet_at = max(self._last + step.after, self._line.quiet_at)
        time.sleep(max(0.0, quiet_at - time.monotonic()))
        received: list[Adu] = []
        try:
            self._send([self._bytes(stimulus) for stimulus in step.stimuli])
            self._last = time.monotonic()
            self._line.sent(self._last)
            until = self._last + timeout
            started, count = self._last, 0
            limit = (4 + len(step.stimuli)) * self._timeout + self._slow
            while (now := time.monotonic()) < until:
                wake = until if self._line.deadline is None else min(until, self._line.deadline)
                data = self._port.receive(max(0.0, wake - now))
                if data:
                    self._last = time.monotonic()
                    until = self._last + timeout
                    count += len(data)
                received += self._frames(data)
                if count > _TOO_MANY or now > started + limit:
                    self.endless = f"it did not stop sending, {count} bytes in {now - started:.1f} s"
                    self.close()
                    return received[:_KEPT]
                if len(received) >= len(step.stimuli) and not self._line.held:
                    # All answers are there: one short wait for an extra one is enough.
                    until = min(until, time.monotonic() + timeout / 10)
        except PortError:
            self.close()
            return received or None
        return received

    def _opened(self) -> Port[bytes]:
        """Open the port. If the server answered before, try again for `RESTART` seconds."""
        until = time.monotonic() + (RESTART if self.was_answered else 0.0)
        while True:
            try:
                return self._dial()
            except PortError:
                if time.monotonic() > until:
                    raise
                time.sleep(0.05)

    def _send(self, frames: list[bytes]) -> None:
        """Send all frames at once, in one segment, or each in a datagram of its own."""
        assert self._port is not None
        if isinstance(self._line, EchoLine):
            self._line.expect_echo(b"".join(frames))
        for data in frames if self._endpoint.is_datagram else [b"".join(frames)]:
            self._port.send(data)

    def _frames(self, data: bytes | None) -> Iterator[Adu]:
        """Yield the frames in the data. Noise becomes an answer that no case accepts."""
        for event in self._line.feed(data, time.monotonic()):
            yield Adu(self._unit, event.data) if isinstance(event, Noise) else event

    def _bytes(self, stimulus: Stimulus) -> bytes:
        self._number = self._number + 1 & 0xFFFF
        frame: dict[str, Callable[[int, bytes], bytes]] = {
            "tcp": lambda unit, pdu: tcp_frame(unit, pdu, self._number),
            "rtu": rtu_frame,
            "ascii": ascii_frame,
        }
        return stimulus.framed(frame[self._endpoint.framing], self._unit)
