"""Answers for client: our bus, on a line in virtual time, with the peer that the question describes.

    user     asks ->  Bus  -> frame ->  ClientPeer
             outcome <-    <- bytes <-

On a serial line there is one bus, on TCP one lane for each question that may be open at once. The peer is units on one
line:

    peer.begin(0)                  the user asks the first question
    peer.hear(frame, now)          a request is on the wire: its answer is put among `coming`
    peer.coming                    (time, bytes): what the client receives, and when; times in microseconds

A request that equals an open question (unit and PDU) has the next fate of this question, any other request the next
fate of `probes`. vectors/kinds/client.md has the rules in words, vectors/reference/modbus/client_peer.py the same peer
without barewire.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from barewire.ascii import AsciiLine
from barewire.codecs import pack_bits
from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import BarewireError
from barewire.modbus import Bus, EchoLine, ModbusException
from barewire.modbus.client.line_state import NEVER
from barewire.modbus.framing import Line
from barewire.modbus.messages.registry import decode_request
from barewire.rtu import RtuLine, Timing
from barewire.tcp import FanOut
from barewire_workbench.vectors.answers.modbus import FRAMINGS
from barewire_workbench.vectors.answers.values import MICROSECOND, START, Answers, bits, octets, words
from barewire_workbench.vectors.questions import Fields

_TURNAROUND = 100_000
_BITS = 11
"""Of a character."""


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
        self.now = START + 1.0
        self.baud = self.setup.get("baud", 19200)
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
        line: Line = RtuLine(Timing.of(self.baud)) if self.setup["framing"] == "rtu" else AsciiLine()
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
            turnaround = self.setup.get("turnaround", _TURNAROUND) * MICROSECOND
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
                        self.now += round(_BITS * len(frame) * 1e6 / self.baud) * MICROSECOND
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


# The peer

DELAY = 2_000
"""Microseconds from a request to its answer, if the fate has no other delay."""
APART = 5_000
"""Microseconds between two answers of a unit on a serial line, which answers in the order of the requests."""
BETWEEN = 10_000
"""Microseconds between what comes before an answer and the answer."""


class ClientPeer:
    """The units behind a line, the answers under way, and how often each question was seen."""

    def __init__(self, given: Fields) -> None:
        self.framing = given["line"]["framing"]
        self.coming: list[tuple[int, bytes]] = []
        self.seen = [0] * len(given["ask"])
        self._asks = given["ask"]
        self._open: list[int] = []
        self._probes = list(given.get("probes", ()))
        self._units = {
            unit["unit"]: {
                "diagnostics": unit.get("diagnostics", "echoes"),
                "registers": _table({first: words(text) for first, text in unit["registers"].items()}),
                "coils": _table({first: bits(text) for first, text in unit["coils"].items()}),
            }
            for unit in given["units"]
        }
        self._answered_at: dict[int, int] = {}

    def begin(self, place: int) -> None:
        """Open a question: a request of it may come from now on, and registers may have changed."""
        ask = self._asks[place]
        self._open.append(place)
        changes = {first: words(text) for first, text in ask.get("changes", {}).items()}
        if changes:
            self._units[ask["unit"]]["registers"].update(_table(changes))

    def end(self, place: int) -> None:
        """Close a question: its user has an outcome."""
        self._open.remove(place)

    def hear(self, frame: bytes, now: int) -> None:
        """Take a request that was transmitted completely at `now`."""
        adu = FRAMINGS[self.framing].decode(frame)
        unit, pdu, number = adu.unit, adu.pdu, adu.transaction or 0
        fate = self._fate(unit, pdu)
        if fate.get("echo"):
            self._say(now, frame)
        if fate.get("lost") == "request":
            return
        if unit == 0 and self.framing != "tcp":
            for address in self._units:
                self._carry_out(address, pdu)
            return
        answer = octets(fate["pdu"]) if "pdu" in fate else None
        if unit in self._units and not (answer and answer[0] & 0x80):
            done = self._carry_out(unit, pdu)
            answer = answer or done
        if answer is None or "lost" in fate:
            return
        at = now + fate.get("delay", DELAY)
        if self.framing != "tcp":
            at = max(at, self._answered_at.get(unit, 0) + APART)
        for item in fate.get("before", ()):
            self._say(at, self._before(item, number))
            at += BETWEEN
        data = self._frame(fate.get("unit", unit), answer, number ^ fate.get("number", 0))
        if "damage" in fate:
            place, mask = fate["damage"]
            changed = bytearray(data)
            changed[place] ^= mask
            data = bytes(changed)
        data = data[: fate.get("cut", len(data))]
        again = fate.get("again", ())
        self._answered_at[unit] = self._send(data * (1 + again.count(0) if again else 1), at, fate)
        for later in again:
            if later:
                self._say(at + later, data)

    def _say(self, at: int, data: bytes) -> None:
        """Put bytes among what comes: what the client receives at one time is one piece."""
        place = sum(before < at for before, _ in self.coming)
        same = self.coming[place : place + 1]
        if same and same[0][0] == at:
            self.coming[place] = at, same[0][1] + data
        else:
            self.coming.insert(place, (at, data))

    def _send(self, data: bytes, at: int, fate: Fields) -> int:
        """Put an answer among what comes, in one or several pieces; return the time of the last one."""
        for size in fate.get("pieces", ()):
            self._say(at, data[:size])
            data, at = data[size:], at + fate["pause"]
        self._say(at, data)
        return at

    def _fate(self, unit: int, pdu: bytes) -> Fields:
        for place in self._open:
            ask = self._asks[place]
            if (ask["unit"], octets(ask["pdu"])) == (unit, pdu):
                self.seen[place] += 1
                fates = ask.get("fates", ())
                return fates[self.seen[place] - 1] if self.seen[place] <= len(fates) else {}
        return self._probes.pop(0) if self._probes else {}

    def _before(self, item: Fields, number: int) -> bytes:
        if "bytes" in item:
            return octets(item["bytes"])
        return self._frame(item["unit"], octets(item["pdu"]), number ^ item.get("number", 0))

    def _frame(self, unit: int, pdu: bytes, number: int) -> bytes:
        return FRAMINGS[self.framing].encode(unit, pdu, number)

    def _carry_out(self, unit: int, pdu: bytes) -> bytes | None:
        """Return the response of a unit, None if it keeps silent."""
        tables: dict[str, Any] = self._units[unit]
        function = pdu[0]
        address, second = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
        if function == 8:
            return {"echoes": pdu, "declines": b"\x88\x01"}.get(tables["diagnostics"])
        if function not in (1, 2, 3, 4, 5, 6, 15, 16):
            return bytes((function | 0x80, 1))
        table = tables["coils" if function in (1, 2, 5, 15) else "registers"]
        places = range(address, address + (1 if function in (5, 6) else second))
        if not all(place in table for place in places):
            return bytes((function | 0x80, 2))
        if function in (1, 2):
            packed = pack_bits([table[place] for place in places])
            return bytes((function, len(packed))) + packed
        if function in (3, 4):
            return bytes((function, 2 * second)) + b"".join(table[place].to_bytes(2, "big") for place in places)
        if function in (5, 6):
            table[address] = int(second == 0xFF00) if function == 5 else second
        for n, place in enumerate(places if function in (15, 16) else ()):
            bit = pdu[6 + n // 8] >> n % 8 & 1 if function == 15 else 0
            table[place] = bit if function == 15 else int.from_bytes(pdu[6 + 2 * n : 8 + 2 * n], "big")
        return pdu[:5]


def _table(rows: Mapping[str, Sequence[int]]) -> dict[int, int]:
    """Return address -> value of rows that begin at an address."""
    return {int(first) + n: int(value) for first, row in rows.items() for n, value in enumerate(row)}


ANSWERS: Answers = {"client": {"run": run_client}}
