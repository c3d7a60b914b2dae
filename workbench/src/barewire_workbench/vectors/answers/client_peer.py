"""The peer of a client, as the cases of kind `client` describe it: units on one line, in virtual time.

    peer.begin(0)                  the user asks the first question
    peer.hear(frame, now)          a request is on the wire: its answer is put among `coming`
    peer.coming                    (time, bytes): what the client receives, and when; times in microseconds

A request that equals an open question (unit and PDU) has the next fate of this question, any other request the next
fate of `probes`. vectors/README.md has the rules in words, vectors/reference/modbus/client_peer.py the same peer
without barewire.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Mapping, Sequence
from typing import Any

from barewire import ascii, rtu, tcp
from barewire.codecs import pack_bits
from barewire_workbench.vectors.answers.texts import bits, octets, words
from barewire_workbench.vectors.questions import Fields

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
        unit, pdu, number = self._decoded(frame)
        fate = self._fate(unit, pdu)
        if fate.get("echo"):
            insort(self.coming, (now, frame))
        if fate.get("lost") == "request":
            return
        if unit == 0 and self.framing != "tcp":
            for one in self._units:
                self._carry_out(one, pdu)
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
            insort(self.coming, (at, self._before(item, number)))
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
                insort(self.coming, (at + later, data))

    def _send(self, data: bytes, at: int, fate: Fields) -> int:
        """Put an answer among what comes, in one or several pieces; return the time of the last one."""
        for size in fate.get("pieces", ()):
            insort(self.coming, (at, data[:size]))
            data, at = data[size:], at + fate["pause"]
        insort(self.coming, (at, data))
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
        if self.framing == "tcp":
            return tcp.encode(unit, pdu, number)
        return rtu.encode(unit, pdu) if self.framing == "rtu" else ascii.encode(unit, pdu)

    def _decoded(self, frame: bytes) -> tuple[int, bytes, int]:
        if self.framing == "tcp":
            return frame[6], frame[7:], int.from_bytes(frame[:2], "big")
        adu = rtu.decode(frame) if self.framing == "rtu" else ascii.decode(frame)
        return adu.unit, adu.pdu, 0

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
        if not set(places) <= table.keys():
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
