"""A unit with a delay for each answer, and a wire in virtual time that carries requests to it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Literal

from barewire.conversation import Conversation, Heard, Send, Wire
from barewire.modbus import Line, ReadHoldingRegisters, Server, Table
from barewire.modbus.client.bus import Bus
from barewire.rtu import RtuLine, Timing

Function08 = Literal["echoed", "declined", "ignored"]
Peer = Callable[[bytes, float], Iterable[tuple[float, bytes]]]
TIMING = Timing.of(19200)


class WithoutDiagnostics(Table):
    """A table that declines functions 08, 0B and 0C."""

    diagnostics = False


def table(kind: type[Table] = Table) -> Table:
    """Every register holds its own address, so a wrong value is visible."""
    full = kind(size=256)
    for address in range(256):
        full.holding_registers[address] = full.input_registers[address] = address
    return full


class Slow:
    """A unit that answers in order, each answer after its own delay; None loses the answer."""

    def __init__(
        self, delays: Iterable[float | None], line: Line | None = None, function_08: Function08 = "echoed"
    ) -> None:
        server_line = line or RtuLine(TIMING, role="server", units=(1, 2))
        unit = table() if function_08 == "echoed" else table(WithoutDiagnostics)
        self.server = Server(server_line, {1: unit, 2: unit}, serial=True)
        self.delays = iter(delays)
        self.free_at = 0.0
        self.asked: list[bytes] = []
        self.ignores_08 = function_08 == "ignored"

    def __call__(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        self.asked.append(data)
        delay = next(self.delays, 0.01)
        replies = self.server.feed(data, now)
        if delay is None or (self.ignores_08 and data[1:2] == b"\x08"):
            return []
        self.free_at = max(self.free_at, now) + delay
        return [(self.free_at, reply.data) for reply in replies]


class InTime(Slow):
    """The same, but each delay counts from its request, and two answers are at least 3 ms apart."""

    def __call__(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        last, self.free_at = self.free_at, now
        answers = super().__call__(data, now)
        self.free_at = max(self.free_at, last + 0.003)
        return [(self.free_at, answer) for _, answer in answers]


def rtu_bus(**options: object) -> Bus:
    return Bus(RtuLine(TIMING), **options)  # type: ignore[arg-type]


class Clock(Wire[bytes]):
    """A wire on which sending takes time."""

    def __init__(self, peer: Peer) -> None:
        super().__init__(peer, sending_takes=lambda data: TIMING.duration(len(data)))


def read(bus: Bus, address: int, unit: int = 1, timeout: float = 1.0) -> Conversation[bytes, object]:
    return bus.ask(unit, ReadHoldingRegisters(address, 1), timeout=timeout)


def sending(conversation: Conversation[bytes, object], now: float) -> Send[bytes]:
    """Run a conversation to the point where it sends, in which no time passes, and return this step."""
    step = next(conversation)
    for _ in range(10):
        if isinstance(step, Send):
            return step
        step = conversation.send(Heard(None, now))
    raise AssertionError("it waits before it sends")
