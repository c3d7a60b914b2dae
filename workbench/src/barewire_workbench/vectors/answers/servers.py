"""Answers for Modbus servers, in virtual time: server, server-conformance and gateway.

server: units with tables in memory behind a line, asked step by step, a second apart:

    {"unit": 1, "ask": "03 00 00 00 01"}     framed, fed to the server of that line; what it sends is the answer
    {"raw": "01 03 00 00 00 01 00 00"}       bytes that are not a frame
    {"stream": "12 34 00 00 00 06 01 ..."}   bytes on a connection: what is sent is compared with its headers
    {"overrun": true}                        the port has lost a character

server-conformance: our server with a table of 100 registers and coils, on a line of its own.

gateway: servers on TCP whose units are on an RTU line (docs/how-to/gateway.md). All clients share it, so requests wait
for each other:

    client 1  ->  Server(TcpLine)  ->  RoutedUnit.handle  ->  Bus(RtuLine)  ->  the line
    client 2  ->  Server(TcpLine)  ->        "                   "
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping
from typing import Any

from barewire.ascii import AsciiLine
from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import DecodeError, NoAnswer, PortError
from barewire.modbus import Bus, ModbusException, Server, Table
from barewire.modbus.adu import Adu
from barewire.modbus.framing import Line
from barewire.modbus.messages.base import Request, Response
from barewire.modbus.messages.diagnostics import Unanswered
from barewire.modbus.messages.identification import ReportServerId, ReportServerIdResponse
from barewire.modbus.server.serial_counters import SerialCounters
from barewire.rtu import RtuLine, Timing
from barewire.tcp import TcpLine
from barewire_workbench.conform.modbus import CLOSED, answer_text, read_step
from barewire_workbench.vectors.answers.modbus import FRAMINGS
from barewire_workbench.vectors.answers.values import START, Answers, bits, bitted, hexed, octets, worded, words
from barewire_workbench.vectors.questions import Fields

_BAUD = 19200


def _server_line(framing: str, units: Collection[int]) -> Line:
    if framing == "rtu":
        return RtuLine(Timing.of(_BAUD), role="server", units=units)
    if framing not in ("ascii", "tcp"):
        raise DecodeError("value", framing.encode(), 0, f"line {framing}: expected rtu, ascii or tcp")
    return AsciiLine() if framing == "ascii" else TcpLine()


def _fed(server: Server, data: bytes, now: float) -> tuple[list[bytes], float]:
    """Feed bytes, then silence until nothing is due; return the frames that the server sends, and the time."""
    replies = server.feed(data, now)
    for _ in range(8):
        if server.deadline is None:
            break
        now = max(now, server.deadline)
        replies += server.feed(None, now)
    return [reply.data for reply in replies], now


# server

_BITS = ("coils", "discrete_inputs")
_REGISTERS = ("holding_registers", "input_registers")
_COUNTERS = {
    "02": "diagnostic_register",
    "0B": "bus_messages",
    "0C": "bus_errors",
    "0D": "exceptions",
    "0E": "server_messages",
    "0F": "no_responses",
    "10": "naks",
    "11": "busy_answers",
    "12": "overruns",
    "events": "event_count",
}
"""The sub-function that reads a counter, and our name for it."""


def _values(name: str, text: str) -> list[int]:
    return list(bits(text) if name in _BITS else words(text))


def _text(name: str, values: Any) -> str:
    return bitted(values) if name in _BITS else worded(values)


class ServedUnit(Table):
    """A table as a case describes it."""

    def __init__(self, given: Mapping[str, Any]) -> None:
        rows: dict[str, Any] = {
            name: {int(first): _values(name, text) for first, text in given.get(name, {}).items()}
            for name in (*_BITS, *_REGISTERS)
        }
        objects: dict[int, str | bytes] = {int(n, 16): octets(t) for n, t in given.get("identification", {}).items()}
        basic = {0: b"", 1: b"", 2: b""}
        super().__init__(
            **rows,
            read_only=given.get("read_only"),
            objects=basic | objects,
            files={int(n): list(words(t)) for n, t in given.get("files", {}).items()},
            on_read=lambda name, first, quantity: self._decline(name, first, quantity),
            on_write=lambda name, first, values: self._decline(name, first, len(values)),
        )
        self._given = given
        self.queues = {int(n): list(words(t)) for n, t in given.get("queues", {}).items()}
        self.exception_status = int(given.get("exception_status", "00"), 16)
        self.diagnostics = "08" in given.get("functions", ("08",))

    def __repr__(self) -> str:
        return f"<ServedUnit: {', '.join(self._given)}>"

    def supports(self, request: type[Request[Any]]) -> bool:  # type: ignore[override]  # a table answers the same ones
        """Whether the unit of the case has this function."""
        mei = "" if request.mei_type is None else f"/{request.mei_type:02X}"
        name = f"{request.function_code:02X}{mei}"
        return Table.supports(request) and name in self._given.get("functions", (name,))

    def handle(self, request: Any, now: float) -> Response | None:
        """Answer a request as a table does, and 11 with the server id of the case."""
        if isinstance(request, ReportServerId):
            return ReportServerIdResponse(octets(self._given["server_id"]))
        return super().handle(request, now)

    def _decline(self, name: str, first: int, quantity: int) -> None:
        for fault in self._given.get("faults", ()):
            if fault["table"] == name and first <= fault["address"] < first + quantity:
                raise ModbusException(fault["exception"])

    def content(self) -> Fields:
        """Return the tables as a case writes them."""
        fields: Fields = {}
        for name in (*_BITS, *_REGISTERS):
            if name in self._given:
                sizes = {first: len(_values(name, text)) for first, text in self._given[name].items()}
                block = getattr(self, name)
                fields[name] = {
                    first: _text(name, block[int(first) : int(first) + size]) for first, size in sizes.items()
                }
        if "files" in self._given:
            fields["files"] = {str(number): _text("", registers) for number, registers in self.files.items()}
        return fields


def _serve(given: Fields) -> Fields:
    """Run the steps, and return what the server said to each, and its tables at the end."""
    setup = given["server"]
    units = {int(number): ServedUnit(unit) for number, unit in setup["units"].items()}
    bench = _Bench(setup["line"], units)
    for number, unit in setup["units"].items():
        bench.set_counters(int(number), unit)
    steps = [{"say": bench.step(step)} for step in given["talk"]]
    return {"talk": steps, "then": {str(number): unit.content() for number, unit in units.items()}}


class _Bench:
    """A server on a line of its own, asked frame by frame in virtual time."""

    def __init__(self, framing: str, units: dict[int, ServedUnit]) -> None:
        self._framing, self._now, self._number = framing, START + 1.0, 0
        self._server = Server(_server_line(framing, units), units, serial=framing != "tcp")
        self._client: Line = RtuLine(Timing.of(_BAUD)) if framing == "rtu" else _server_line(framing, ())

    def set_counters(self, number: int, unit: Fields) -> None:
        counters: SerialCounters = self._server.counters[number]
        for name, value in unit.get("counters", {}).items():
            setattr(counters, _COUNTERS[name], value)
        counters.is_busy = unit.get("busy", False)

    def step(self, step: Fields) -> str | None:
        """Carry out one step, and return the response, or None."""
        self._now += 1.0
        if "overrun" in step:
            self._server.overrun()
            return None
        if "stream" in step:
            sent, self._now = _fed(self._server, octets(step["stream"]), self._now)
            return hexed(b"".join(sent)) if sent else None
        if "raw" in step:
            data = octets(step["raw"])
        else:
            self._number += 1
            data = FRAMINGS[self._framing].encode(step["unit"], octets(step["ask"]), self._number)
        sent, self._now = _fed(self._server, data, self._now)
        if not sent:
            return None
        self._now += 1.0
        if self._server.serial:
            self._server.sent(self._now)
        self._client.request(step["unit"], octets(step["ask"]))
        events = [*self._client.feed(b"".join(sent), self._now), *self._client.feed(None, self._now + 1.0)]
        frames = [event for event in events if isinstance(event, Adu)]
        others = [frame.unit for frame in frames if frame.unit != step["unit"]]
        return "; ".join(hexed(frame.pdu) for frame in frames) + "".join(f" from unit {unit}" for unit in others)


# server-conformance

_UNIT = 1


def _answer_steps(given: Fields) -> Fields:
    """Run the steps, and return what was answered in each: PDUs, nothing, or "closed"."""
    name, units = given["framing"], {_UNIT: Table(100)}
    framing, is_serial = FRAMINGS[name], name != "tcp"
    server = Server(_server_line(name, units), units, serial=is_serial)
    now, answers = 1.0, []
    for step in map(read_step, given["steps"]):
        stimuli = [stimulus.framed(lambda unit, pdu: framing.encode(unit, pdu, 1), _UNIT) for stimulus in step.stimuli]
        sent, now = _fed(server, b"".join(stimuli), now + step.after + 1)
        if name == "ascii":  # function 08 03 may have changed the end of its frames
            sent = [frame[:-1] + b"\n" for frame in sent]
        texts = answer_text([framing.decode(frame) for frame in sent])
        now += 1
        if is_serial:
            server.sent(now)
        if server.line.broken is not None:  # the connection is closed, the next step has a new one
            texts, server = texts or CLOSED, Server(_server_line(name, units), units, serial=is_serial)
        answers.append(texts)
    return {"answers": answers}


# gateway


def _route(given: Fields) -> Fields:
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


ANSWERS: Answers = {
    "server": {"run": _serve},
    "server-conformance": {"run": _answer_steps},
    "gateway": {"run": _route},
}
