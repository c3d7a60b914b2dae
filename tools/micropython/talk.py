"""A client or a server on a serial line, for `talks`: lowered with an edition, and run in MicroPython.

The program outside, talk.mjs, has the port and the clock. It calls `hear`, and carries out what that returns, as JSON:

    {"say": "0103006B0001F5D6"}    send these bytes, and call again when they are sent
    {"until": "2592000012000"}     wait for bytes, until that time at the latest
"""

from __future__ import annotations

import json
from typing import Any

from barewire.ports import serving  # type: ignore[import-not-found]  # of the edition

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


class Side:
    """One end of the line: a server, or a client that writes numbers and reads them back without end."""

    def __init__(self, role: str, baudrate: int) -> None:
        self.counts = {"exchanges": 0, "wrong": 0, "failed": 0}
        self.failures: list[str] = []
        self._is_server = role == "server"
        timing, units = Timing.of(baudrate), {UNIT: Table(200)}
        self._server = Server(RtuLine(timing, role="server", units=units), units, serial=True)
        self._bus = Bus(RtuLine(timing))
        self._number = 0
        self._begin()

    def _begin(self) -> None:
        self._conversation: Conversation[bytes, None] = serving(self._server) if self._is_server else self._round()
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

    def hear(self, data: bytes | None, now: int) -> dict[str, str]:
        """Resume the conversation with what arrived, or None."""
        try:
            if self._step is None:
                self._step = next(self._conversation)
            else:
                self._step = self._conversation.send(Heard(data, now))
        except StopIteration:
            self._begin()
            return {"until": str(now)}
        except BarewireError as error:
            self.counts["failed"] += 1
            self.failures = [*self.failures[-4:], str(error)]
            self._begin()
            return {"until": str(now)}
        if isinstance(self._step, Listen):
            return {"until": str(max(self._step.until, 0))}
        return {"say": self._step.items[0].hex()}


_SIDES: list[Side] = []


def begin(role: str, baudrate: int) -> None:
    """Begin to play a role, on a line of this rate."""
    _SIDES.append(Side(role, baudrate))


def hear(text: str, now: str) -> str:
    """Take bytes, as hexadecimal digits, at a time in microseconds; return what is wanted, as JSON."""
    return json.dumps(_SIDES[0].hear(bytes.fromhex(text) if text else None, int(now)))


def result() -> str:
    """Return the counts, and the latest failures, as JSON."""
    return json.dumps([_SIDES[0].counts, _SIDES[0].failures])
