"""Answers for client: our bus, on a line in virtual time, with the peer that the question describes.

    user     asks ->  Bus  -> frame ->  ClientPeer
             outcome <-    <- bytes <-

On a serial line there is one bus, on TCP one lane for each question that may be open at once.
"""

from __future__ import annotations

from typing import Any

from barewire.ascii import AsciiLine
from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import BarewireError
from barewire.modbus import Bus, EchoLine, ModbusException
from barewire.modbus.client.line_state import NEVER
from barewire.modbus.framing import Line
from barewire.modbus.messages.registry import decode_request
from barewire.rtu import RtuLine, Timing
from barewire.tcp import FanOut
from barewire_workbench.vectors.answers.client_peer import ClientPeer
from barewire_workbench.vectors.answers.texts import octets
from barewire_workbench.vectors.questions import Fields

TURNAROUND = 100_000
MICROSECOND = 1e-6


def run_client(given: Fields) -> Fields:
    """Ask all questions; return the outcome of each, and how often the peer has seen it."""
    session = _Session(given)
    session.run()
    outcomes = zip(session.outcomes, session.peer.seen, strict=True)
    return {"ask": [{"outcome": outcome, "seen": seen} for outcome, seen in outcomes]}


class _Lane:
    """The place of one open question: its bus, its conversation, and the time until which it listens."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.place = -1
        self.conversation: Conversation[bytes, Any] | None = None
        self.until = NEVER


class _Session:
    """A client and its peer, and the time in seconds."""

    def __init__(self, given: Fields) -> None:
        self.setup = given["line"]
        self.asks = given["ask"]
        self.peer = ClientPeer(given)
        self.outcomes: list[str] = [""] * len(self.asks)
        self.now = 1.0
        self.timing = Timing.of(self.setup.get("baud", 19200))
        self.fan: FanOut | None = None
        lines = self._lines()
        late_window = self.setup.get("late_window")
        first = Bus(
            lines[0],
            retries=self.setup.get("retries", 0),
            late_window=None if late_window is None else late_window * MICROSECOND,
        )
        self.lanes = [_Lane(first), *(_Lane(first.sibling_bus(line)) for line in lines[1:])]

    def _lines(self) -> list[Line]:
        """Return the framing states of a new connection."""
        if self.setup["framing"] == "tcp":
            self.fan = FanOut(self.setup.get("at_once", 1), first_number=self.setup.get("first_number", 1))
            return list(self.fan.lines)
        line: Line = RtuLine(self.timing) if self.setup["framing"] == "rtu" else AsciiLine()
        return [EchoLine(line)] if self.setup.get("echo") else [line]

    def run(self) -> None:
        """Let time pass until every question has its outcome."""
        begin, next_ask = self.now, 0
        while next_ask < len(self.asks) or any(lane.conversation for lane in self.lanes):
            free = next((lane for lane in self.lanes if lane.conversation is None), None)
            ask_at = float("inf")
            if free is not None and next_ask < len(self.asks):
                ask_at = max(self.now, begin + self.asks[next_ask]["at"] * MICROSECOND)
            busy = [lane for lane in self.lanes if lane.conversation is not None]
            due = max(self.now, min([ask_at, *(lane.until for lane in busy)]))
            if self.peer.coming and self.peer.coming[0][0] * MICROSECOND <= due:
                at, data = self.peer.coming.pop(0)
                self.now = max(self.now, at * MICROSECOND)
                self._receive(data)
            elif free is not None and ask_at <= due:
                self.now = due
                self._ask(free, next_ask)
                next_ask += 1
            else:
                self.now = due
                self._go_on(next(lane for lane in busy if lane.until <= due), None)

    def _receive(self, data: bytes) -> None:
        if self.fan is None:
            self._hear(self.lanes[0], data)
            return
        for place, frame in self.fan.feed(data):
            self._hear(self.lanes[place], frame)

    def _hear(self, lane: _Lane, data: bytes) -> None:
        if lane.conversation is None:
            lane.bus.overhear(data, self.now)
            self._reconnect_if_broken()
        else:
            self._go_on(lane, data)

    def _ask(self, lane: _Lane, place: int) -> None:
        ask, timeout = self.asks[place], self.setup["timeout"] * MICROSECOND
        request = decode_request(octets(ask["pdu"]))
        self.peer.begin(place)
        lane.place = place
        if ask["unit"] == 0 and self.setup["framing"] != "tcp":
            turnaround = self.setup.get("turnaround", TURNAROUND) * MICROSECOND
            lane.conversation = lane.bus.broadcast(request, turnaround=turnaround)
        else:
            lane.conversation = lane.bus.ask(ask["unit"], request, timeout=timeout)
        self._go_on(lane, None, first=True)

    def _go_on(self, lane: _Lane, data: bytes | None, *, first: bool = False) -> None:
        """Resume the conversation of a lane until it listens or ends."""
        conversation = lane.conversation
        assert conversation is not None
        try:
            step = next(conversation) if first else conversation.send(Heard(data, self.now))
            while not isinstance(step, Listen):
                for frame in step.items:
                    if self.fan is None:
                        self.now += self.timing.duration(len(frame))
                    self.peer.hear(frame, round(self.now / MICROSECOND))
                step = conversation.send(Heard(None, self.now))
            lane.until = step.until
            return
        except StopIteration as stop:
            outcome = _outcome(stop.value)
        except ModbusException as error:
            outcome = f"exception {error.code:02X}"
        except BarewireError:
            outcome = "no answer"
        self.outcomes[lane.place] = outcome
        self.peer.end(lane.place)
        lane.conversation, lane.until = None, NEVER
        self._reconnect_if_broken()

    def _reconnect_if_broken(self) -> None:
        """Open a new connection in the place of one that cannot be trusted: what was under way is lost."""
        if any(lane.bus.line.broken for lane in self.lanes) and not any(lane.conversation for lane in self.lanes):
            self.peer.coming.clear()
            for lane, line in zip(self.lanes, self._lines(), strict=True):
                lane.bus.line = line


def _outcome(response: Any) -> str:
    """Return the text of a result: the registers, the bits, or that a write or a broadcast was carried out."""
    if response is None:
        return "sent"
    if hasattr(response, "registers"):
        return "registers " + " ".join(f"{register:04X}" for register in response.registers)
    if hasattr(response, "bits"):
        return "bits " + "".join("1" if bit else "0" for bit in response.bits)
    return "done"
