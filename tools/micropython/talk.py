"""A client and a server on a serial line, for the talks of `talks`: lowered with an edition, and run in MicroPython.

The program outside, talk.mjs, has the port and the clock. It calls `hear`, and carries out what that returns, as JSON:

    {"say": "0103006B0001F5D6"}    send these bytes, and call again when they are sent
    {"until": "2592000012000"}     wait for bytes, until that time at the latest
"""

from __future__ import annotations

import json
from typing import Any

from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import BarewireError
from barewire.modbus.client.bus import Bus
from barewire.modbus.messages.coils import ReadCoils, WriteMultipleCoils
from barewire.modbus.messages.registers import ReadHoldingRegisters, WriteMultipleRegisters
from barewire.modbus.server.server import Server
from barewire.modbus.server.table import Table
from barewire.rtu.frame import Timing
from barewire.rtu.line import RtuLine

UNIT = 1
TIMEOUT = 5.0
"""Seconds: a busy machine answers within them."""


class ServerSide:
    """A table of registers and coils behind an RTU line."""

    def __init__(self, baudrate: int) -> None:
        units = {UNIT: Table(200)}
        self._server = Server(RtuLine(Timing.of(baudrate), role="server", units=units), units, serial=True)
        self._due: list[Any] = []
        self.counts: dict[str, int] = {}
        self.failures: list[str] = []

    def hear(self, data: bytes | None, now: int) -> dict[str, Any]:
        """Take what arrived, or None if bytes were sent or time has passed."""
        if data is not None or not self._due:
            self._due = []  # bytes in the silence before a response: it is not sent
            self._due += self._server.feed(data, now)
        if self._due and now >= self._due[0].at:
            reply = self._due.pop(0)
            return {"say": reply.data.hex()}
        due = [reply.at for reply in self._due] + [self._server.deadline or now + TIMEOUT]
        return {"until": str(min(due))}

    def sent(self, now: int) -> None:
        """Record that the bytes of `say` were transmitted."""
        self._server.line.sent(now)


class ClientSide:
    """Writes numbers and reads them back, without end; counts what is wrong."""

    def __init__(self, baudrate: int) -> None:
        self._bus = Bus(RtuLine(Timing.of(baudrate)))
        self._number = 0
        self.failures: list[str] = []
        self.counts = {"exchanges": 0, "wrong": 0, "failed": 0}
        self._next()

    def _next(self) -> None:
        self._conversation = self._round()
        self._step: Any = None

    def _round(self) -> Conversation[bytes, None]:
        self._number = (self._number * 75 + 74) % 65537
        row = tuple((self._number * place) & 0xFFFF for place in range(1, 2 + self._number % 60))
        bits = tuple(bool(value & 1) for value in row)
        bus = self._bus
        yield from bus.ask(UNIT, WriteMultipleRegisters(10, row), timeout=TIMEOUT)
        read = yield from bus.ask(UNIT, ReadHoldingRegisters(10, len(row)), timeout=TIMEOUT)
        self.counts["wrong"] += read.registers != row
        yield from bus.ask(UNIT, WriteMultipleCoils(3, bits), timeout=TIMEOUT)
        coils = yield from bus.ask(UNIT, ReadCoils(3, len(bits)), timeout=TIMEOUT)
        self.counts["wrong"] += coils.bits != bits
        self.counts["exchanges"] += 4

    def hear(self, data: bytes | None, now: int) -> dict[str, Any]:
        """Resume the conversation with what arrived, or None."""
        try:
            if self._step is None:
                self._step = next(self._conversation)
            else:
                self._step = self._conversation.send(Heard(data, now))
        except StopIteration:
            self._next()
            return {"until": str(now)}
        except BarewireError as error:
            self.counts["failed"] += 1
            self.failures = [*self.failures[-4:], str(error)]
            self._next()
            return {"until": str(now)}
        if isinstance(self._step, Listen):
            return {"until": str(max(self._step.until, 0))}
        return {"say": self._step.items[0].hex()}

    def sent(self, now: int) -> None:
        """Do nothing: the conversation records it."""


_SIDES: list[Any] = []


def begin(role: str, baudrate: int) -> None:
    """Begin to play a role, with a line of this rate."""
    _SIDES.append(ServerSide(baudrate) if role == "server" else ClientSide(baudrate))


def hear(text: str, now: str) -> str:
    """Take bytes, as hexadecimal digits, at a time in microseconds; return what is wanted, as JSON."""
    return json.dumps(_SIDES[0].hear(bytes.fromhex(text) if text else None, int(now)))


def sent(now: str) -> None:
    """Record that the bytes of `say` were transmitted."""
    _SIDES[0].sent(int(now))


def result() -> str:
    """Return the counts, and the latest failures, as JSON."""
    return json.dumps([_SIDES[0].counts, _SIDES[0].failures])
