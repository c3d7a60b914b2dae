"""A unit that answers when it likes, and what plays questions to it in virtual time, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from barewire.conversation import Conversation, Heard, Send
from barewire.modbus import Line, ReadHoldingRegisters, Server, Table
from barewire.modbus.bus import Bus
from barewire.rtu import RtuLine, Timing

Peer = Callable[[bytes, float], Iterable[tuple[float, bytes]]]
TIMING = Timing.of(19200)


def table() -> Table:
    """Every register holds its own address: a wrong value shows."""
    full = Table(size=256)
    for address in range(256):
        full.holding_registers[address] = full.input_registers[address] = address
    return full


class Slow:
    """A unit that answers in order, each answer after a delay of its own; None loses the answer on the way."""

    def __init__(self, delays: Iterable[float | None], line: Line | None = None, knows_08: bool = True) -> None:
        server_line = line or RtuLine(TIMING, role="server", units=(1, 2))
        unit = table()
        self.server = Server(server_line, {1: unit, 2: unit}, serial=True)
        self.delays = iter(delays)
        self.free_at = 0.0
        self.asked: list[bytes] = []
        self.knows_08 = knows_08

    def __call__(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        self.asked.append(data)
        delay = next(self.delays, 0.01)
        replies = self.server.feed(data, now)
        if delay is None or (not self.knows_08 and data[1:2] == b"\x08"):
            return []
        self.free_at = max(self.free_at, now) + delay
        return [(self.free_at, reply.data) for reply in replies]


def rtu_bus(**options: object) -> Bus:
    return Bus(RtuLine(TIMING), **options)  # type: ignore[arg-type]


class Clock:
    """Plays one conversation after the other on the same bus, keeping the time and what is still under way."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.now = 0.0
        self.coming: list[tuple[float, bytes]] = []

    def play(self, conversation: Conversation[bytes, object]) -> object:
        def peer(data: bytes, now: float) -> list[tuple[float, bytes]]:
            return list(self.peer(data, now))

        now = self.now
        try:
            step = next(conversation)
            while True:
                if isinstance(step, Send):
                    now += TIMING.duration(len(step.item))
                    self.coming = sorted([*self.coming, *peer(step.item, now)])
                    heard: Heard[bytes] = Heard(None, now)
                elif self.coming and self.coming[0][0] <= max(step.until, now):
                    when, item = self.coming.pop(0)
                    now = max(now, when)
                    heard = Heard(item, now)
                else:
                    now = max(now, step.until)
                    heard = Heard(None, now)
                self.now = now
                step = conversation.send(heard)
        except StopIteration as stop:
            return stop.value


def read(bus: Bus, address: int, unit: int = 1, timeout: float = 1.0) -> Conversation[bytes, object]:
    return bus.ask(unit, ReadHoldingRegisters(address, 1), timeout=timeout)
