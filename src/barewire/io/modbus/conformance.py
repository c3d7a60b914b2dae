"""The batteries of `modbus.conform_cases` held against a server on a real port, of whatever carrier.

    for result in conform(Endpoint.parse("tcp://127.0.0.1:502?unit=1")): ...

Every case has a connection of its own on TCP; a serial line is the same for all. What is said is written as it is and
what comes back is collected until the server has been silent for a while: no client of ours stands between.
The server's registers and coils 0 to 9 are written to.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple

from barewire.ascii import encode as ascii_frame
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.endpoint import MODBUS, Endpoint
from barewire.io.engine.blocking import Port
from barewire.io.modbus.carriers import dialer, modbus_line
from barewire.modbus import EchoLine
from barewire.modbus.adu import Adu, Noise
from barewire.modbus.conformance.cases import CASES_ASCII, CASES_RTU, CASES_TCP
from barewire.modbus.conformance.model import CLOSED, SILENCE, ServerCase, Step, StepAnswer, Stimulus, difference
from barewire.rtu import encode as rtu_frame
from barewire.tcp import encode as tcp_frame

PATIENCE = 1.0
"""Seconds after which a server that has not spoken will not: the time-out of an endpoint that names none. libmodbus
takes half a second for an exception."""

LOUD = 4096
"""Bytes: no step has as many in its answers."""

RESTART = 3.0
"""Seconds in which a server that was there may come back: some are restarted by whoever looks after them."""

_PATIENT, _KEPT = 3, 8
_PLAIN = ServerCase("a plain question", "", (Step((Stimulus(bytes.fromhex("0300000001")),)),), ())


class Result(NamedTuple):
    """How a case went: `failure` is None, or the difference as a sentence."""

    case: ServerCase
    heard: tuple[StepAnswer, ...]
    failure: str | None


class Unfinished(NoAnswer):
    """The battery was ended early: `not_run` cases were not held against the device, which the text says too."""

    def __init__(self, why: str, not_run: int) -> None:
        super().__init__(f"{why} ({not_run} case{'' if not_run == 1 else 's'} not run)" if not_run else why)
        self.not_run = not_run


def battery(endpoint: Endpoint) -> tuple[ServerCase, ...]:
    """The cases for what the endpoint is."""
    if endpoint.scheme not in MODBUS:
        known = ", ".join(f"{name}://" for name in MODBUS)
        raise EncodeError(f"endpoint {str(endpoint)!r}: there are cases for {known}")
    return {"tcp": CASES_TCP, "rtu": CASES_RTU, "ascii": CASES_ASCII}[endpoint.envelope]


def conform(endpoint: Endpoint) -> Iterator[Result]:
    """Run every case. EncodeError for an endpoint without cases, PortError where nobody is.

    Unfinished where holding on makes no sense: the server talks without end, three cases in a row; or it has not said a
    word in three that have to be answered, nor to a plain question, nor to another one `RESTART` seconds later; or it
    was there and cannot be reached any more.
    """
    cases = battery(endpoint)
    unit, patience = endpoint.integer("unit", 1), endpoint.seconds("timeout", PATIENCE)
    tester = _Tester(endpoint, unit, patience)
    name, mute = repr(str(endpoint)), 0
    try:
        for place, case in enumerate(cases):
            left = len(cases) - place - 1
            try:
                heard = tester.run(case)
            except PortError as error:
                if not place:
                    raise
                raise Unfinished(f"{error}, in the case {case.name!r}", left + 1) from None
            failure = f"{case.name}: {tester.loud}" if tester.loud else difference(case, heard, unit)
            yield Result(case, tuple(heard), failure)
            if tester.loud_cases >= _PATIENT:
                raise Unfinished(f"{name} never stops talking: {tester.loud}", left)
            mute = 0 if any(heard) else mute + _must_answer(case)
            if mute >= _PATIENT:
                was_answered = tester.was_answered
                if not tester.comes_back():
                    if was_answered:
                        raise Unfinished(f"{name} has stopped answering, by the case {case.name!r}", left)
                    raise Unfinished(f"nothing was answered in any case: is there a unit {unit} behind {name}?", left)
                mute = 0
        if not tester.was_answered:
            raise NoAnswer(f"nothing was answered in any case: is there a unit {unit} behind {name}?")
    finally:
        tester.close()


def _must_answer(case: ServerCase) -> bool:
    """Whether something has to be said in this case, whichever way it goes."""
    return all(any(one not in (SILENCE, CLOSED) for one in way) for way in case.ways)


class _Tester:
    """Says the steps of cases. `loud` is what is wrong with the latest case if the server never stopped talking."""

    def __init__(self, endpoint: Endpoint, unit: int, patience: float) -> None:
        self._endpoint = endpoint
        self._unit = unit
        self._patience = patience
        self._dial = dialer(endpoint)
        self._is_tcp = endpoint.envelope == "tcp"
        self._slow = 600 * 11 / endpoint.integer("baudrate", 19200) if endpoint.is_serial_port else 0.0
        self.loud = ""
        self.loud_cases = 0
        self.was_answered = False
        self._number = 0
        self._last = float("-inf")  # when the last byte was on the wire, ours or theirs
        self._port: Port[bytes] | None = None
        self._line = modbus_line(endpoint, "client")

    def close(self) -> None:
        """Give the port back."""
        if self._port is not None:
            self._port.close()
        self._port = None

    def comes_back(self) -> bool:
        """Whether anything is said to a plain question, now or a while later."""
        for pause in (0.0, RESTART):
            time.sleep(pause)
            self.close()
            with suppress(PortError):
                if any(self.run(_PLAIN)):
                    return True
        return False

    def run(self, case: ServerCase) -> Sequence[StepAnswer]:
        """Say every step; what came back in each."""
        if self._is_tcp:
            self.close()
        self.loud = ""
        heard = []
        for place, step in enumerate(case.steps):
            following = case.steps[place + 1].after if place + 1 < len(case.steps) else 0.0
            is_silent = bool(case.ways) and all(way[place] == SILENCE for way in case.ways)
            # Where the next thing is to be said soon, nobody waits longer for an answer that must not come.
            heard.append(self._turn(step, following if following and is_silent else self._patience))
        self.was_answered |= any(heard)
        self.loud_cases = self.loud_cases + 1 if self.loud else 0
        return heard

    def _turn(self, step: Step, patience: float) -> StepAnswer:
        if self._port is None:
            self._port, self._line = self._reached(), modbus_line(self._endpoint, "client")
        quiet_at = max(self._last + step.after, self._line.quiet_at)
        time.sleep(max(0.0, quiet_at - time.monotonic()))
        heard: list[Adu] = []
        try:
            self._say([self._bytes(stimulus) for stimulus in step.stimuli])
            self._last = time.monotonic()
            self._line.sent(self._last)
            until = self._last + patience
            started, count = self._last, 0
            limit = (4 + len(step.stimuli)) * self._patience + self._slow
            while (now := time.monotonic()) < until:
                wake = until if self._line.deadline is None else min(until, self._line.deadline)
                data = self._port.receive(max(0.0, wake - now))
                if data:
                    self._last = time.monotonic()
                    until = self._last + patience
                    count += len(data)
                heard += self._frames(data)
                if count > LOUD or now > started + limit:
                    self.loud = f"it did not stop talking, {count} bytes in {now - started:.1f} s"
                    self.close()
                    return heard[:_KEPT]
                if len(heard) >= len(step.stimuli) and not self._line.held:
                    # Nobody answers twice; a last look is enough.
                    until = min(until, time.monotonic() + patience / 10)
        except PortError:
            self.close()
            return heard or None
        return heard

    def _reached(self) -> Port[bytes]:
        """A port; one that was there before may need a moment to be there again."""
        until = time.monotonic() + (RESTART if self.was_answered else 0.0)
        while True:
            try:
                return self._dial()
            except PortError:
                if time.monotonic() > until:
                    raise
                time.sleep(0.05)

    def _say(self, frames: list[bytes]) -> None:
        """All at once, in one segment; in datagrams of their own where each has to be one."""
        assert self._port is not None
        if isinstance(self._line, EchoLine):
            self._line.expect_echo(b"".join(frames))
        for data in frames if self._endpoint.scheme == "udp" else [b"".join(frames)]:
            self._port.send(data)

    def _frames(self, data: bytes | None) -> Iterator[Adu]:
        """Noise is told as an answer that fits no case."""
        for event in self._line.feed(data, time.monotonic()):
            yield Adu(self._unit, event.data) if isinstance(event, Noise) else event

    def _bytes(self, stimulus: Stimulus) -> bytes:
        self._number = self._number + 1 & 0xFFFF
        frame: dict[str, Callable[[int, bytes], bytes]] = {
            "tcp": lambda unit, pdu: tcp_frame(unit, pdu, self._number),
            "rtu": rtu_frame,
            "ascii": ascii_frame,
        }
        return stimulus.framed(frame[self._endpoint.envelope], self._unit)
