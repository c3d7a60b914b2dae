"""The fault model: answers of a server that are late, damaged, misdirected or missing.

        device --answer--> Faults.pass_on(answer, now, request) --> [(when, what), ...] --> the wire

On a serial line, also in a tunnel, a late answer delays the following ones, because a unit there answers one request
after the other. On TCP, UDP and CAN they overtake it.

The faults depend only on the random numbers passed in: the same seed and the same answers have the same faults, in
virtual time as on a real port.

One fault as a text, KIND[=VALUE][:P][@ADDRESS][@every=N or @nth=N]:

    drop                        one answer in ten, by dice                  late:0.5          one in two
    drop@every=3                the third, the sixth ...                    drop@nth=5        the fifth only
    exception=04@20             each answer to a request that touches address 20 of any table
    paced=0.005@holding:20-29   ... that touches holding registers 20 to 29; coil:, discrete:, input:
    wrong-unit@20@every=2       the second, the fourth ... of those that touch address 20
    drop:0.5@every=2            half of the second, the fourth ...: a probability holds for the selected answers

An address is decimal, or hexadecimal as 0x14 or 14h.

The value is that of `VALUED`: a code in hexadecimal (01..FF), the delay or the pause in seconds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from random import Random
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeAlias, TypeVar

from barewire.ascii import frame as ascii_frame
from barewire.canopen import CanFrame
from barewire.errors import DecodeError, EncodeError, shown, suggest
from barewire.modbus import Adu
from barewire.rtu import frame as rtu_frame
from barewire.tcp import frame as tcp_frame

if TYPE_CHECKING:
    from barewire.io.endpoint import Endpoint

Item = TypeVar("Item")

KINDS = {
    "exception": "an exception, or an SDO abort, instead of the answer",
    "wrong-unit": "the right answer with another unit or node address",
    "flip": "one bit is inverted",
    "noise": "something other than an answer comes before it",
    "split": "the answer in two parts with a pause between",
    "late": "the answer comes a number of seconds later",
    "drop": "no answer",
    "wrong-transaction": "the right answer with the next transaction number",
    "paced": "the answer byte by byte with a pause between",
}
"""All kinds of faults, and what each does; one answer can have several. `FaultyWire.kinds`: those of a wire."""

_DEFAULT_PROBABILITY = 0.1
"""The probability of a kind of fault that is given without one, and without the answers that it hits."""

LONGEST_DELAY = 3600.0
"""The longest delay in seconds: more is probably a mistake."""
_EXPECTED_DELAY = f"expected seconds, from 0 on and below {LONGEST_DELAY:g}"

_EXAMPLES = "drop:0.5, exception=04@20, paced@holding:20-29, late=2@every=3 or drop@nth=5"
_TABLES = ("coil", "discrete", "holding", "input")
_BY_FUNCTION = {
    0x01: "coil",
    0x02: "discrete",
    0x03: "holding",
    0x04: "input",
    0x05: "coil",
    0x06: "holding",
    0x0F: "coil",
    0x10: "holding",
    0x16: "holding",
    0x17: "holding",
    0x18: "holding",
}
_ONE_VALUE = (0x05, 0x06, 0x16, 0x18)
"""Functions whose second field is not a quantity."""

LATE = 1.5
"""The delay of late answers in seconds: longer than the default time-out of clients."""

PAUSE = 0.02
"""Seconds between the two parts of a split answer, as with a USB adapter."""

_PACE = 0.005
"""Seconds between two bytes of a paced answer. RTU at 19200 baud allows 0.9 ms inside a frame [MB-SER 2.5.1.1]."""

VALUED = {"exception": 6, "late": LATE, "paced": _PACE}
"""The kinds that have a value, and the default; that of `late` is an argument of the server."""
_GENERAL_ABORT = 0x0800_0000


@dataclass(frozen=True, slots=True)
class Fault:
    """A kind of fault, and the answers that it hits: those that fit all that is given.

        kind            one of KINDS
        probability     of each answer that fits, 0..1
        value           the code of an exception, the delay of late answers, the pause of paced ones; None: the default
        addresses       the request touches one of these addresses; None: any request
        table           ... of this table: "coil", "discrete", "holding" or "input"; None: of any table
        every, nth      of the answers that fit so far, each n-th one; only the n-th one

    >>> Fault("exception", value=4, addresses=range(20, 30), every=3)
    Fault(kind='exception', probability=1.0, value=4, addresses=range(20, 30), table=None, every=3, nth=None)

    Raises EncodeError for a wrong value.
    """

    kind: str
    probability: float = 1.0
    value: float | None = None
    addresses: range | None = None
    table: str | None = None
    every: int | None = None
    nth: int | None = None

    def __post_init__(self) -> None:
        kind, value, addresses = self.kind, self.value, self.addresses
        if kind not in KINDS:
            raise EncodeError(f"fault {shown(kind)}: expected some of {', '.join(sorted(KINDS))}{_near(kind, KINDS)}")
        self._expect(_is_number(self.probability, 0, 1), shown(self.probability), "expected a probability, 0..1")
        if value is not None:
            match kind:
                case "exception":
                    fits, expected = isinstance(value, int) and 1 <= value <= 255, "expected an exception code, 1..255"
                case "late" | "paced":
                    fits, expected = _is_number(value, 0, LONGEST_DELAY) and value < LONGEST_DELAY, _EXPECTED_DELAY
                case _:
                    fits, expected = False, "only exception, late and paced have a value"
            self._expect(fits, shown(value), expected)
        if addresses is not None:
            fits = isinstance(addresses, range) and bool(addresses) and addresses[0] >= 0 and addresses[-1] <= 0xFFFF
            self._expect(fits, f"addresses {shown(addresses)}", "expected a range of addresses in 0..65535")
        if self.table is not None:
            expected = f"expected one of {', '.join(_TABLES)}, and addresses"
            self._expect(self.table in _TABLES and addresses is not None, f"table {shown(self.table)}", expected)
        for name, number in (("every", self.every), ("nth", self.nth)):
            fits = number is None or (isinstance(number, int) and number >= 1)
            self._expect(fits, f"{name} = {shown(number)}", "expected a whole number, from 1 on")

    def _expect(self, fits: bool, given: str, expected: str) -> None:
        if not fits:
            raise EncodeError(f"fault {self.kind!r}: {given}: {expected}", "faults")

    def fits(self, request: bytes) -> bool:
        """Whether the PDU of a request touches the addresses of this fault."""
        if self.addresses is None:
            return True
        return any(
            self.table in (None, table) and any(address in self.addresses for address in row)
            for table, row in _touched(request)
        )

    def hits(self, count: int) -> bool:
        """Whether the fault hits the answer with this number among those that fit; they are counted from 1."""
        return (self.every is None or count % self.every == 0) and (self.nth is None or count == self.nth)


GivenFaults: TypeAlias = str | Mapping[str, float] | Iterable[Fault]
"""A text as above with commas, probabilities by kind, or faults."""


def parse_faults(text: str) -> tuple[Fault, ...]:
    """Return the faults of a text, with commas between them. Raises EncodeError.

    >>> [(fault.kind, fault.probability) for fault in parse_faults("late:0.5,drop,flip@nth=2")]
    [('late', 0.5), ('drop', 0.1), ('flip', 1.0)]
    """
    return tuple(_parsed(item.strip()) for item in text.split(","))


def checked_faults(faults: GivenFaults) -> tuple[Fault, ...]:
    """Return the faults in any of their forms. Raises EncodeError."""
    if isinstance(faults, str):
        return parse_faults(faults)
    if isinstance(faults, Mapping):
        return tuple(Fault(kind, probability) for kind, probability in faults.items())
    listed = tuple(faults) if isinstance(faults, Iterable) else (None,)
    if all(isinstance(fault, Fault) for fault in listed):
        return listed
    raise EncodeError(f"faults {shown(faults)}: expected a text such as 'late:0.5,drop', or a dict", "faults")


def _parsed(text: str) -> Fault:
    """Return the fault of KIND[=VALUE][:P][@WHICH]... Raises EncodeError."""
    what, *which = text.split("@")
    head, colon, chance = what.partition(":")
    kind, equals, value = head.partition("=")
    given: dict[str, object] = {}
    if colon:
        expected = f"fault {shown(text)}: expected a probability, 0..1, after the colon"
        given["probability"] = probability = _number(chance, expected)
        if not 0 <= probability <= 1:
            raise EncodeError(expected)
    elif not which:
        given["probability"] = _DEFAULT_PROBABILITY
    if equals and kind == "exception":
        expected = f"fault {shown(text)}: expected an exception code in hexadecimal, 01..FF, such as exception=0B"
        given["value"] = _whole(value, expected, base=16)
    elif equals:
        expected = f"fault {shown(text)}: expected a number after the equals sign, such as {_EXAMPLES}"
        given["value"] = _number(value, expected)
    for part in which if kind in KINDS else ():  # `Fault` reports an unknown kind, before what follows it
        selection = _selection(part, text)
        if given.keys() & selection.keys() or {*selection, *given} >= {"every", "nth"}:
            why = f"{shown(part)} is one selection too many, expected such as {_EXAMPLES}"
            raise EncodeError(f"fault {shown(text)}: {why}")
        given |= selection
    return Fault(kind, **given)  # type: ignore[arg-type]  # `Fault` checks them


def _selection(part: str, text: str) -> dict[str, object]:
    """Return the fields of what follows an at sign: every=3, nth=5, 20, 20-29, holding:20."""
    name, equals, number = part.partition("=")
    if equals:
        if name not in ("every", "nth"):
            hint = _near(name, ("every", "nth"))
            raise EncodeError(f"fault {shown(text)}: {shown(name)}: expected every=N or nth=N after the at sign{hint}")
        return {name: _whole(number, f"fault {shown(text)}: {shown(part)}: expected a whole number, such as {name}=3")}
    table, colon, addresses = part.rpartition(":")
    if colon and table not in _TABLES:
        expected = f"expected {', '.join(_TABLES)} before the address{_near(table, _TABLES)}"
        raise EncodeError(f"fault {shown(text)}: {shown(table)}: {expected}")
    first, dash, last = addresses.partition("-")
    forms = "an address, such as 20, 20-29, 14h or holding:20, every=N or nth=N"
    expected = f"fault {shown(text)}: {shown(part)}: expected {forms}"
    start = _whole(first, expected)
    return {"addresses": range(start, (_whole(last, expected) if dash else start) + 1), "table": table or None}


def _number(text: str, expected: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise EncodeError(expected) from None


def _is_number(value: object, lowest: float, highest: float) -> bool:
    return isinstance(value, (int, float)) and lowest <= value <= highest


def _whole(text: str, expected: str, base: int = 10) -> int:
    """Return a number in decimal (04 is four) or, as 0x14, 14h or with base 16, in hexadecimal."""
    digits = text.lower()
    if digits.endswith("h"):
        digits, base = digits[:-1], 16
    elif digits.startswith("0x"):
        base = 16
    try:
        return int(digits, base)
    except ValueError:
        raise EncodeError(expected) from None


def _near(name: object, known: Iterable[str]) -> str:
    return suggest(str(name), dict.fromkeys(known))


def _touched(pdu: bytes) -> Iterator[tuple[str, range]]:
    """Yield the table and the addresses that a request touches; nothing for functions without addresses."""
    table = _BY_FUNCTION.get(pdu[0]) if pdu else None
    if table is None or len(pdu) < 3:
        return
    for at in (1, 5) if pdu[0] == 0x17 else (1,):
        first, quantity = (int.from_bytes(pdu[place : place + 2], "big") for place in (at, at + 2))
        yield table, range(first, first + (1 if pdu[0] in _ONE_VALUE else quantity))


class FaultyWire(Generic[Item]):
    """The faults of one kind of wire. A fault that is not possible for an item leaves it unchanged."""

    kinds: tuple[str, ...]
    in_order = False
    """Whether no answer overtakes another."""
    has_addresses = False
    """Whether requests touch addresses."""

    def refused(self, item: Item, code: int) -> Item:
        """Return an exception response with this code, or an SDO abort."""
        return item

    def misdirected(self, item: Item) -> Item:
        """Return the answer with the address of the next unit or node."""
        return item

    def misnumbered(self, item: Item) -> Item:
        """Return the answer with the next transaction number."""
        return item

    def flipped(self, item: Item, random: Random) -> Item:
        """Return the answer with one bit inverted."""
        return item

    def noise(self, random: Random) -> Item:
        """Return something that is not an answer."""
        raise NotImplementedError

    def parts(self, item: Item, random: Random) -> list[Item]:
        """Return the answer in two parts, cut anywhere."""
        return [item]

    def bytewise(self, item: Item) -> list[Item]:
        """Return the bytes of the answer, one by one."""
        return [item]


class Framing(NamedTuple):
    """How a frame is decoded and encoded."""

    decode: Callable[[bytes], Adu]
    encode: Callable[[Adu], bytes]


_FRAMINGS = {
    "rtu": Framing(rtu_frame.decode, lambda adu: rtu_frame.encode(adu.unit, adu.pdu)),
    "ascii": Framing(ascii_frame.decode, lambda adu: ascii_frame.encode(adu.unit, adu.pdu)),
    "tcp": Framing(tcp_frame.decode, lambda adu: tcp_frame.encode(adu.unit, adu.pdu, adu.transaction or 0)),
}


class ModbusWire(FaultyWire[bytes]):
    """Modbus frames: rtu, ascii or tcp."""

    has_addresses = True

    def __init__(self, framing: str, *, datagrams: bool = False) -> None:
        self._framing = _FRAMINGS[framing]
        self.in_order = framing != "tcp"
        excluded = {"split", "paced"} if datagrams else set()  # half a datagram does not arrive
        if framing != "tcp":
            excluded.add("wrong-transaction")
        self.kinds = tuple(kind for kind in KINDS if kind not in excluded)

    def _changed(self, item: bytes, change: Callable[[Adu], Adu]) -> bytes:
        """Return the frame with another content, and a check sum that is right for it."""
        try:
            return self._framing.encode(change(self._framing.decode(item)))
        except DecodeError:
            return item

    def refused(self, item: bytes, code: int) -> bytes:
        return self._changed(item, lambda adu: adu._replace(pdu=bytes([adu.pdu[0] | 0x80, code])))

    def misdirected(self, item: bytes) -> bytes:
        return self._changed(item, lambda adu: adu._replace(unit=adu.unit % 247 + 1))

    def misnumbered(self, item: bytes) -> bytes:
        return self._changed(item, lambda adu: adu._replace(transaction=(adu.transaction or 0) + 1 & 0xFFFF))

    def flipped(self, item: bytes, random: Random) -> bytes:
        place = random.randrange(8 * len(item))
        changed = bytearray(item)
        changed[place // 8] ^= 1 << place % 8
        return bytes(changed)

    def noise(self, random: Random) -> bytes:
        return random.randbytes(random.randint(1, 8))

    def parts(self, item: bytes, random: Random) -> list[bytes]:
        cut = random.randint(1, max(1, len(item) - 1))
        return [part for part in (item[:cut], item[cut:]) if part]

    def bytewise(self, item: bytes) -> list[bytes]:
        return [item[place : place + 1] for place in range(len(item))]


class CanWire(FaultyWire[CanFrame]):
    """A CAN bus. A controller repeats damaged frames and never delivers parts of one."""

    kinds = ("exception", "wrong-unit", "noise", "late", "drop")

    def refused(self, item: CanFrame, code: int) -> CanFrame:
        # Only the first frame of an SDO response has the object, which an abort names as well.
        if _is_sdo_answer(item) and item.data[:1] and item.data[0] >> 5 in (2, 3):
            return item._replace(data=b"\x80" + item.data[1:4] + _GENERAL_ABORT.to_bytes(4, "little"))
        return item

    def misdirected(self, item: CanFrame) -> CanFrame:
        return item._replace(id=0x580 + (item.id - 0x580) % 127 + 1) if _is_sdo_answer(item) else item

    def noise(self, random: Random) -> CanFrame:
        return CanFrame(random.randrange(1 << 29), random.randbytes(8), extended=True)  # CANopen does not use these


def _is_sdo_answer(frame: CanFrame) -> bool:
    return 0x580 < frame.id < 0x600 and not frame.extended and not frame.remote


class Faults(Generic[Item]):
    """Puts faults into answers.

    faults      the faults in one of their forms: a text, probabilities by kind, or objects of `Fault`
    delay       the delay of late answers in seconds, where the fault has none
    on_fault    called as on_fault(kind) for each fault
    """

    def __init__(
        self,
        wire: FaultyWire[Item],
        faults: GivenFaults,
        random: Random,
        *,
        delay: float = LATE,
        on_fault: Callable[[str], None] | None = None,
    ) -> None:
        self.wire = wire
        if not (_is_number(delay, 0, LONGEST_DELAY) and delay < LONGEST_DELAY):
            raise EncodeError(f"late = {shown(delay)}: {_EXPECTED_DELAY}")
        self.counts: Counter[str] = Counter()
        """The number of faults of each kind."""
        self.delay, self._on_fault = delay, on_fault
        self._last = 0.0
        self._random, self._content = random, Random(random.random())  # whether there is a fault, and its content
        self.replace(faults)

    def replace(self, faults: GivenFaults) -> None:
        """Have other faults from the next answer on, also while a server uses them. Raises EncodeError."""
        wire, checked = self.wire, checked_faults(faults)
        for fault in checked:
            if fault.kind not in wire.kinds:
                expected = ", ".join(wire.kinds)
                raise EncodeError(f"fault {fault.kind!r} is not possible on this wire: expected {expected}", "faults")
            if fault.addresses is not None and not wire.has_addresses:
                raise EncodeError(f"fault {fault.kind!r}: an address selects requests of Modbus, not of CAN", "faults")
            if fault.kind == "exception" and fault.value is not None and not wire.has_addresses:
                raise EncodeError("fault 'exception': CAN has SDO aborts and no exception codes", "faults")
        # The present list stays as it is: the thread of a server may be reading it.
        self._counted = [(fault, count(1)) for fault in checked]

    @property
    def present(self) -> tuple[Fault, ...]:
        """The faults that answers may have now."""
        return tuple(fault for fault, _ in self._counted)

    def _chosen(self, request: bytes) -> dict[str, Fault]:
        """Return the faults for the next answer, by kind."""
        # One random number for each kind in any case, so that a fault hits the same answers with and without others.
        dice = {kind: self._random.random() for kind in KINDS}
        chosen: dict[str, Fault] = {}
        for fault, numbers in self._counted:
            if fault.fits(request) and fault.hits(next(numbers)) and dice[fault.kind] < fault.probability:
                chosen.setdefault(fault.kind, fault)
        return chosen

    def pass_on(self, item: Item, now: float, request: bytes = b"") -> list[tuple[float, Item]]:
        """Return what is sent instead of `item`, with the times; an empty list if it is lost.

        `request` is the PDU of the request that `item` answers; on CAN it is empty.
        """
        chosen = self._chosen(request)
        for kind in KINDS:
            if kind in chosen:
                self.counts[kind] += 1
                if self._on_fault is not None:
                    self._on_fault(kind)
        if "drop" in chosen:
            return []
        wire, random = self.wire, self._content
        item = self._damaged(item, chosen)
        send_at = now
        if (late := chosen.get("late")) is not None:
            send_at += self.delay if late.value is None else late.value
        if wire.in_order:
            send_at = max(send_at, self._last)
        parts, pause = [item], 0.0
        if (paced := chosen.get("paced")) is not None:
            parts, pause = wire.bytewise(item), VALUED["paced"] if paced.value is None else paced.value
        elif "split" in chosen:
            parts, pause = wire.parts(item, random), PAUSE
        self._last = send_at + (len(parts) - 1) * pause
        noise = [(send_at, wire.noise(random))] if "noise" in chosen else []
        return [*noise, *((send_at + place * pause, part) for place, part in enumerate(parts))]

    def _damaged(self, item: Item, chosen: Mapping[str, Fault]) -> Item:
        """Return the item with the faults of its content."""
        if (refusal := chosen.get("exception")) is not None:
            item = self.wire.refused(item, int(VALUED["exception"] if refusal.value is None else refusal.value))
        if "wrong-unit" in chosen:
            item = self.wire.misdirected(item)
        if "wrong-transaction" in chosen:
            item = self.wire.misnumbered(item)
        if "flip" in chosen:  # last: the changes before it compute a new check sum
            item = self.wire.flipped(item, self._content)
        return item


def faults_at(
    endpoint: Endpoint,
    faults: GivenFaults,
    *,
    seed: int | None = None,
    delay: float | None = None,
    on_fault: Callable[[str], None] | None = None,
) -> Faults[bytes]:
    """Return the faults of a Modbus server. Raises EncodeError for a kind that its wire does not have."""
    wire = ModbusWire(endpoint.framing, datagrams=endpoint.is_datagram)
    return Faults(wire, faults, Random(seed), delay=LATE if delay is None else delay, on_fault=on_fault)


def faults_on_can(
    faults: GivenFaults,
    *,
    seed: int | None = None,
    delay: float | None = None,
    on_fault: Callable[[str], None] | None = None,
) -> Faults[CanFrame]:
    """Return the faults of a node on a CAN bus. Raises EncodeError for a kind that CAN does not have."""
    return Faults(CanWire(), faults, Random(seed), delay=LATE if delay is None else delay, on_fault=on_fault)
