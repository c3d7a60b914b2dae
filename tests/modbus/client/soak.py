"""Thousands of exchanges in virtual time, on a wire with every kind of fault.

    python -m tests.modbus.client.soak 100000            on RTU, ASCII and TCP; prints what happened

Each exchange ends in its own answer or in a clear error: `soak` raises AssertionError otherwise. Every register holds
its own address and every write has another value, so that the answer to another request is detected.

The faults of a serial wire: a message lost, a byte lost, a byte doubled, a message doubled, a bit flipped, pieces with
pauses between them, a slow answer, an answer after the time-out. TCP changes no bytes, so its faults are answers that
are lost, doubled, slow, late or cut in pieces, and invalid headers, after which the client connects again.

One damage is invisible to a CRC-16: if its last byte is 00 and is lost, the rest has a good CRC too. The line detects
it by the byte count: such a request is noise, and never declined. `soak` counts these.
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
        """Return the framing state of a new connection."""
        if self.carrier == "tcp":
            return TcpLine()
        if self.carrier == "ascii":
            return AsciiLine()
        return RtuLine(TIMING, role="server" if role == "server" else "client", units=(1,))

    def connect(self) -> None:
        """Begin a new connection on the side of the server."""
        self.server = Server(self.line("server"), {1: self.table}, serial=self.carrier != "tcp")
        self.free_at = self.now
        self.coming.clear()

    def fault(self) -> str | None:
        """Choose the fault of the next message; None, mostly."""
        if self.dice.randrange(self.rarity):
            return None
        fault = self.dice.choice(TCP if self.carrier == "tcp" else SERIAL)
        self.faults[fault] += 1
        return fault

    def damage(self, fault: str | None, data: bytes) -> bytes:
        """Return the bytes after this fault, if it changes bytes."""
        place = self.dice.randrange(len(data))
        match fault:
            case "lost":
                return b""
            case "byte lost":
                return data[:place] + data[place + 1 :]
            case "byte doubled":
                return data[: place + 1] + data[place:]
            case "doubled":
                return data + data
            case "flipped":
                return data[:place] + bytes([data[place] ^ 1 << self.dice.randrange(7)]) + data[place + 1 :]
            case "broken":
                return data[:2] + b"\x12\x34" + data[4:]
        return data

    def carry(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        """Carry a request to the server, and return the answers with their times of arrival."""
        fault = self.fault() if self.carrier != "tcp" else None
        if fault not in ("slow", "late", "pieces", "doubled"):
            whole, data = data, self.damage(fault, data)
            self.unseen += self.carrier == "rtu" and data != whole and crc16(data) == 0
        replies = self.server.feed(data, now) if data else []
        while not replies and (deadline := self.server.deadline) is not None:
            replies = self.server.feed(None, deadline)
        return [part for reply in replies for part in self.answer(reply.data, now)]

    def answer(self, data: bytes, now: float) -> Iterator[tuple[float, bytes]]:
        """Carry an answer back, in order, with the next fault."""
        fault = self.fault()
        data = self.damage(fault, data)
        delay = {"slow": 0.9 * TIMEOUT, "late": TIMEOUT * self.dice.uniform(1.01, 2.5)}.get(fault or "", 0.005)
        start = self.free_at = max(self.free_at, now) + delay
        self.server.sent(start)
        cuts = sorted(self.dice.sample(range(1, len(data)), 2)) if fault == "pieces" and len(data) > 3 else []
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
        address, quantity, function = dice.randrange(SIZE - 10), dice.randint(1, 5), dice.randrange(4)
        retries = dice.randrange(3)
        try:
            if function == 0:
                value = number & 0xFFFF
                written = wire.play(bus.ask(1, WriteSingleRegister(SIZE - 1, value), timeout=TIMEOUT, retries=retries))
                assert (SIZE - 1, value) == (written.address, written.value), number
                assert wire.table.holding_registers[SIZE - 1] == value, number
            else:
                request = (ReadInputRegisters if function == 1 else ReadHoldingRegisters)(address, quantity)
                response = wire.play(bus.ask(1, request, timeout=TIMEOUT, retries=retries))
                assert response.registers == tuple(range(address, address + quantity)), number
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
            ends["connected again"] += 1
    assert ends.total() - ends["connected again"] == count
    ends.update({f"fault: {fault}": times for fault, times in wire.faults.items()})
    ends["late answers recognised"] = bus.counters.late
    ends["damages that no CRC shows"] = wire.unseen
    return ends


def main() -> None:
    """Run the number of exchanges given on the command line, on each carrier."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    for carrier in CARRIERS:
        begin = time.perf_counter()
        ends = soak(carrier, count)
        print(f"{carrier}: {count} exchanges in {time.perf_counter() - begin:.1f} s, none with the answer of another")
        for result, times in sorted(ends.items()):
            print(f"    {times:7}  {result}")


if __name__ == "__main__":
    main()
