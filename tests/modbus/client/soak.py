"""Thousands of exchanges in virtual time, on a wire with every kind of fault.

    python -m tests.modbus.client.soak 100000            on RTU, ASCII and TCP; prints what happened

Each exchange ends in its own answer or in a clear error: `soak` raises AssertionError otherwise. Every register holds
its own address and every write writes another number, so an answer that is somebody else's shows.

The faults of a serial wire: a message lost, a byte lost, a byte doubled, a message doubled, a bit flipped, pieces with
pauses between them, an answer that is slow, an answer that comes after its time. TCP changes no bytes, so there:
answers lost, doubled, slow, late, cut in pieces; and headers that cannot be right: the connection is made anew then.

One damage no CRC-16 can see: where its last byte is 00 and that byte is lost, the rest has a good CRC too. The line
sees it by the count: such a request is noise, never declined, and `soak` says how often it came.
"""

from __future__ import annotations

import random
import sys
import time
from collections import Counter
from collections.abc import Iterator

from barewire.ascii import AsciiLine
from barewire.conversation import Wire
from barewire.errors import NoAnswer
from barewire.modbus import (
    Bus,
    Line,
    ModbusException,
    ReadHoldingRegisters,
    ReadInputRegisters,
    Server,
    Table,
    WriteOutcomeUnknown,
    WriteSingleRegister,
)
from barewire.rtu import RtuLine, Timing, crc16
from barewire.tcp import TcpLine

TIMING = Timing.of(19200)
TIMEOUT = 0.5
SIZE = 200
SERIAL = ("lost", "byte lost", "byte doubled", "doubled", "flipped", "pieces", "slow", "late")
TCP = ("lost", "doubled", "pieces", "slow", "late", "broken")
CARRIERS = ("rtu", "ascii", "tcp")


class BadWire(Wire[bytes]):
    """A unit behind a faulty wire, in virtual time. One message in `rarity` meets a fault."""

    def __init__(self, carrier: str, dice: random.Random, rarity: int) -> None:
        self.carrier, self.dice, self.rarity = carrier, dice, rarity
        self.table = Table(size=SIZE)
        for address in range(SIZE):
            self.table.holding_registers[address] = self.table.input_registers[address] = address
        super().__init__(self.carry, sending_takes=lambda data: TIMING.duration(len(data)))
        self.faults: Counter[str] = Counter()
        self.unseen = 0
        self.connect()

    def line(self, role: str) -> Line:
        """A new connection's framing state."""
        if self.carrier == "tcp":
            return TcpLine()
        if self.carrier == "ascii":
            return AsciiLine()
        return RtuLine(TIMING, role="server" if role == "server" else "client", units=(1,))

    def connect(self) -> None:
        """The server's side of a new connection."""
        self.server = Server(self.line("server"), {1: self.table}, serial=self.carrier != "tcp")
        self.free_at = self.now
        self.coming.clear()

    def fault(self) -> str | None:
        """What happens to the next message; mostly nothing."""
        if self.dice.randrange(self.rarity):
            return None
        kind = self.dice.choice(TCP if self.carrier == "tcp" else SERIAL)
        self.faults[kind] += 1
        return kind

    def damage(self, kind: str | None, data: bytes) -> bytes:
        """The bytes, after a fault that changes bytes."""
        at = self.dice.randrange(len(data))
        match kind:
            case "lost":
                return b""
            case "byte lost":
                return data[:at] + data[at + 1 :]
            case "byte doubled":
                return data[: at + 1] + data[at:]
            case "doubled":
                return data + data
            case "flipped":
                return data[:at] + bytes([data[at] ^ 1 << self.dice.randrange(7)]) + data[at + 1 :]
            case "broken":
                return data[:2] + b"\x12\x34" + data[4:]
        return data

    def carry(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        """A request goes out; what is answered is under way from here on."""
        kind = self.fault() if self.carrier != "tcp" else None
        if kind not in ("slow", "late", "pieces", "doubled"):
            whole, data = data, self.damage(kind, data)
            self.unseen += self.carrier == "rtu" and data != whole and crc16(data) == 0
        replies = self.server.feed(data, now) if data else []
        while not replies and (deadline := self.server.deadline) is not None:
            replies = self.server.feed(None, deadline)
        return [part for reply in replies for part in self.answer(reply.data, now)]

    def answer(self, data: bytes, now: float) -> Iterator[tuple[float, bytes]]:
        """An answer comes back: in order, whatever happens to it."""
        kind = self.fault()
        data = self.damage(kind, data)
        delay = {"slow": 0.9 * TIMEOUT, "late": TIMEOUT * self.dice.uniform(1.01, 2.5)}.get(kind or "", 0.005)
        start = self.free_at = max(self.free_at, now) + delay
        self.server.line.sent(start)
        cuts = sorted(self.dice.sample(range(1, len(data)), 2)) if kind == "pieces" and len(data) > 3 else []
        for step, (low, high) in enumerate(zip([0, *cuts], [*cuts, len(data)])):
            if high > low:
                self.free_at = start + 0.01 * step
                yield self.free_at, data[low:high]


def soak(carrier: str, count: int, *, seed: int = 1, rarity: int = 6) -> Counter[str]:
    """Run `count` exchanges and count their results and faults. AssertionError for a wrong answer."""
    dice = random.Random(f"{carrier} {seed}")
    wire = BadWire(carrier, dice, rarity)
    bus = Bus(wire.line("client"), late_window=60.0)
    ends: Counter[str] = Counter()
    for number in range(count):
        at, quantity, kind = dice.randrange(SIZE - 10), dice.randint(1, 5), dice.randrange(4)
        retries = dice.randrange(3)
        try:
            if kind == 0:
                value = number & 0xFFFF
                written = wire.play(bus.ask(1, WriteSingleRegister(SIZE - 1, value), timeout=TIMEOUT, retries=retries))
                assert (SIZE - 1, value) == (written.address, written.value), number
                assert wire.table.holding_registers[SIZE - 1] == value, number
            else:
                request = (ReadInputRegisters if kind == 1 else ReadHoldingRegisters)(at, quantity)
                response = wire.play(bus.ask(1, request, timeout=TIMEOUT, retries=retries))
                assert response.registers == tuple(range(at, at + quantity)), number
            ends["its own answer"] += 1
        except ModbusException as declined:
            raise AssertionError(f"exchange {number}: {declined}") from declined
        except WriteOutcomeUnknown:
            ends["outcome unknown"] += 1
        except NoAnswer:
            ends["no answer"] += 1
        if bus.line.broken is not None:
            wire.connect()
            bus.line = wire.line("client")
            ends["connected anew"] += 1
    assert ends.total() - ends["connected anew"] == count
    ends.update({f"fault: {kind}": times for kind, times in wire.faults.items()})
    ends["late answers recognised"] = bus.counters.late
    ends["damages that no CRC shows"] = wire.unseen
    assert len(bus.state.pending) <= 16
    return ends


def main() -> None:
    """Run the number of exchanges given on the command line, on each carrier."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    for carrier in CARRIERS:
        begin = time.perf_counter()
        ends = soak(carrier, count)
        print(f"{carrier}: {count} exchanges in {time.perf_counter() - begin:.1f} s, none in another's answer")
        for what, times in sorted(ends.items()):
            print(f"    {times:7}  {what}")


if __name__ == "__main__":
    main()
