"""Answers for server: units with tables in memory behind a line, asked step by step.

    {"unit": 1, "ask": "03 00 00 00 01"}     framed, fed to the server of that line; what it sends is the answer
    {"raw": "01 03 00 00 00 01 00 00"}       bytes that are not a frame
    {"overrun": true}                        the port has lost a character

A second passes between two steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from barewire.ascii import AsciiLine, encode as ascii_frame
from barewire.errors import DecodeError
from barewire.modbus import ModbusException, Server, Table
from barewire.modbus.adu import Adu
from barewire.modbus.framing import Line
from barewire.modbus.messages.base import Request, Response
from barewire.modbus.messages.identification import ReportServerId, ReportServerIdResponse
from barewire.modbus.server.serial_counters import SerialCounters
from barewire.rtu import RtuLine, Timing, encode as rtu_frame
from barewire.tcp import TcpLine, encode as tcp_frame
from barewire_workbench.vectors.answers.texts import bits, bitted, hexed, octets, worded, words
from barewire_workbench.vectors.questions import Fields

BITS = ("coils", "discrete_inputs")
REGISTERS = ("holding_registers", "input_registers")
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


class ServedUnit(Table):
    """A table as a case describes it."""

    def __init__(self, given: Mapping[str, Any]) -> None:
        rows: dict[str, Any] = {
            name: {int(first): _values(name, text) for first, text in given.get(name, {}).items()}
            for name in (*BITS, *REGISTERS)
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
        for name in (*BITS, *REGISTERS):
            if name in self._given:
                found = {first: len(_values(name, text)) for first, text in self._given[name].items()}
                block = getattr(self, name)
                fields[name] = {
                    first: _text(name, block.stored(slice(int(first), int(first) + size)))
                    for first, size in found.items()
                }
        if "files" in self._given:
            fields["files"] = {str(number): _text("", registers) for number, registers in self.files.items()}
        return fields


def serve(given: Fields) -> Fields:
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

    def __init__(self, kind: str, units: dict[int, ServedUnit]) -> None:
        self._kind, self._now, self._number = kind, 1.0, 0
        line: Line
        if kind == "rtu":
            line = RtuLine(Timing.of(19200), role="server", units=units)
            self._client: Line = RtuLine(Timing.of(19200))
        elif kind == "ascii":
            line, self._client = AsciiLine(), AsciiLine()
        elif kind == "tcp":
            line, self._client = TcpLine(), TcpLine()
        else:
            raise DecodeError("value", kind.encode(), 0, f"line {kind}: expected rtu, ascii or tcp")
        self._server = Server(line, units, serial=kind != "tcp")

    def set_counters(self, number: int, unit: Fields) -> None:
        counters: SerialCounters = self._server.counters[number]
        for name, value in unit.get("counters", {}).items():
            setattr(counters, _COUNTERS[name], value)
        counters.is_busy = unit.get("busy", False)

    def step(self, step: Fields) -> str | None:
        """Carry out one step, and return the response, or None."""
        self._now += 1
        if "overrun" in step:
            self._server.overrun()
            return None
        data = octets(step["raw"]) if "raw" in step else self._framed(step["unit"], octets(step["ask"]))
        replies = self._server.feed(data, self._now)
        for _ in range(8):
            if self._server.deadline is None:
                break
            self._now = max(self._now, self._server.deadline)
            replies += self._server.feed(None, self._now)
        sent = b"".join(reply.data for reply in replies)
        if not sent:
            return None
        self._now += 1
        self._server.line.sent(self._now)
        self._client.request(step["unit"], octets(step["ask"]))
        events = [*self._client.feed(sent, self._now), *self._client.feed(None, self._now + 1)]
        frames = [event for event in events if isinstance(event, Adu)]
        others = [frame.unit for frame in frames if frame.unit != step["unit"]]
        return "; ".join(hexed(frame.pdu) for frame in frames) + "".join(f" from unit {unit}" for unit in others)

    def _framed(self, unit: int, pdu: bytes) -> bytes:
        self._number += 1
        if self._kind == "tcp":
            return tcp_frame(unit, pdu, self._number)
        return rtu_frame(unit, pdu) if self._kind == "rtu" else ascii_frame(unit, pdu)


def _values(name: str, text: str) -> list[int]:
    return list(bits(text) if name in BITS else words(text))


def _text(name: str, values: Any) -> str:
    return bitted(values) if name in BITS else worded(values)
