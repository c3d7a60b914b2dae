"""Answers for gateway: servers on TCP whose units are on an RTU line, in virtual time (docs/how-to/gateway.md).

    client 1  ->  Server(TcpLine)  ->  RoutedUnit.handle  ->  Bus(RtuLine)  ->  the line
    client 2  ->  Server(TcpLine)  ->        "                   "

All clients share one line, so requests wait for each other.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import NoAnswer, PortError
from barewire.modbus import Bus, ModbusException, Server
from barewire.modbus.messages.base import Response
from barewire.modbus.messages.diagnostics import Unanswered
from barewire.rtu import RtuLine, Timing
from barewire.tcp import TcpLine
from barewire_workbench.vectors.answers.texts import hexed, octets
from barewire_workbench.vectors.questions import Fields

_BAUD = 19200


def route(given: Fields) -> Fields:
    """Run the steps, and return what the gateway sends in each."""
    setup, steps = given["gateway"], given["talk"]
    line = _ScriptedLine(steps, setup["timeout"] / 1e6)
    units = {unit: RoutedUnit(line, unit) for unit in setup["units"]}
    if setup.get("broadcast"):
        units[0] = RoutedUnit(line, 0)
    clients: dict[str, Server] = {}
    for step in steps:
        if step.get("from", "line") == "line":
            continue
        line.wait_until(step["at"] / 1e6)
        server = clients.setdefault(step["from"], Server(TcpLine(), units, serial=False))
        for reply in server.feed(octets(step["bytes"]), line.now):
            line.said.append((line.answered_at.popleft() if line.answered_at else line.now, step["from"], reply.data))
    line.wait_until(steps[-1]["at"] / 1e6)
    return {"talk": [{"say": said} for said in _by_step(steps, line.said)]}


def _by_step(steps: list[Fields], said: list[tuple[float, str, bytes]]) -> list[list[Fields]]:
    """Return what was sent at which step: the first one that is not before it."""
    rows: list[list[Fields]] = [[] for _ in steps]
    for at, to, data in sorted(said, key=lambda row: row[0]):
        place = next((n for n, step in enumerate(steps) if step["at"] >= round(at * 1e6)), len(steps) - 1)
        rows[place].append({"to": to, "bytes": hexed(data)})
    return rows


class _ScriptedLine:
    """The RTU line of the gateway: what arrives, and when, is in the steps."""

    def __init__(self, steps: list[Fields], timeout: float) -> None:
        self.now = 0.0
        self.said: list[tuple[float, str, bytes]] = []
        self.answered_at: deque[float] = deque()
        """When the requests of the present bytes were answered, in their order."""
        self._heard = deque((step["at"] / 1e6, step) for step in steps if step.get("from") == "line" or "port" in step)
        self._bus = Bus(RtuLine(Timing.of(_BAUD)))
        self._timeout = timeout
        self._is_up = True

    def __repr__(self) -> str:
        return f"<_ScriptedLine at {self.now:g} s, {len(self._heard)} steps to come>"

    def wait_until(self, until: float) -> None:
        """Let time pass while no request is under way."""
        while (data := self._next(until)) is not None:
            self._bus.overhear(data, self.now)
        self.now = max(self.now, until)

    def ask(self, unit: int, request: Any) -> Response:
        """Send a request on the line and return the response. Raises what `Bus.ask` raises, and PortError."""
        conversation: Conversation[bytes, Any]
        if unit:
            conversation = self._bus.ask(unit, request, timeout=self._timeout)
        else:
            conversation = self._bus.broadcast(request)
        if not self._is_up:
            raise PortError("the line is down")
        command = next(conversation)
        try:
            while True:
                if isinstance(command, Listen):
                    data = self._next(command.until)
                    if data is None:
                        self.now = max(self.now, command.until)
                    if not self._is_up:
                        raise PortError("the line is down")
                else:
                    data = None
                    self.said += [(self.now, "line", item) for item in command.items]
                command = conversation.send(Heard(data, self.now))
        except StopIteration as end:
            response: Response = end.value
            return response

    def _next(self, until: float) -> bytes | None:
        """Return the bytes that arrive next, not after `until`; None if there are none."""
        while self._heard and self._heard[0][0] <= max(until, self.now):
            at, step = self._heard.popleft()
            self.now = max(self.now, at)
            if "port" in step:
                self._is_up = step["port"] == "up"
                return b""
            if self._is_up:
                return octets(step["bytes"])
        return None


class RoutedUnit:
    """A unit on the line behind the gateway; 0 is all of them."""

    def __init__(self, line: _ScriptedLine, unit: int) -> None:
        self._line, self._unit = line, unit

    def __repr__(self) -> str:
        return f"<RoutedUnit {self._unit}>"

    def handle(self, request: Any, now: float) -> Response | None:
        """Ask the unit on the line: 0B if it does not respond, 0A if there is no line."""
        answer = None
        try:
            answer = self._line.ask(self._unit, request)
        except NoAnswer:
            raise ModbusException(0x0B) from None
        except PortError:
            raise ModbusException(0x0A) from None
        finally:
            if self._unit:
                self._line.answered_at.append(self._line.now)
        return None if isinstance(answer, Unanswered) else answer
