"""A unit with a delay for each answer, and a wire in virtual time that carries requests to it."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from barewire.conversation import Conversation, Wire
from barewire.modbus import Line, ReadHoldingRegisters, Server, Table
from barewire.modbus.client.bus import Bus
from barewire.rtu import RtuLine, Timing

Peer = Callable[[bytes, float], Iterable[tuple[float, bytes]]]
TIMING = Timing.of(19200)


def table() -> Table:
    """Every register holds its own address, so a wrong value is visible."""
    full = Table(size=256)
    for address in range(256):
        full.holding_registers[address] = full.input_registers[address] = address
    return full


class Slow:
    """A unit that answers in order, each answer after its own delay; None loses the answer."""

    def __init__(self, delays: Iterable[float | None], line: Line | None = None, answers_08: bool = True) -> None:
        server_line = line or RtuLine(TIMING, role="server", units=(1, 2))
        unit = table()
        self.server = Server(server_line, {1: unit, 2: unit}, serial=True)
        self.delays = iter(delays)
        self.free_at = 0.0
        self.asked: list[bytes] = []
        self.answers_08 = answers_08

    def __call__(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        self.asked.append(data)
        delay = next(self.delays, 0.01)
        replies = self.server.feed(data, now)
        if delay is None or (not self.answers_08 and data[1:2] == b"\x08"):
            return []
        self.free_at = max(self.free_at, now) + delay
        return [(self.free_at, reply.data) for reply in replies]


def rtu_bus(**options: object) -> Bus:
    return Bus(RtuLine(TIMING), **options)  # type: ignore[arg-type]


class Clock(Wire[bytes]):
    """A wire on which sending takes time."""

    def __init__(self, peer: Peer) -> None:
        super().__init__(peer, sending_takes=lambda data: TIMING.duration(len(data)))


def read(bus: Bus, address: int, unit: int = 1, timeout: float = 1.0) -> Conversation[bytes, object]:
    return bus.ask(unit, ReadHoldingRegisters(address, 1), timeout=timeout)
