"""The fault model: answers of a server that are late, damaged, misdirected or missing.

        device --answer--> Faults.pass_on(answer, now) --> [(when, what), ...] --> the wire

    late        the answer comes a number of seconds later                           bytes, CAN
    noise       something other than an answer comes before it                       bytes, CAN: another node's frame
    wrong-unit  the right answer with another unit or node address                   bytes, CAN
    drop        no answer                                                            bytes, CAN
    flip        one bit is inverted                                                  bytes
    exception   exception 06 or abort 0800 0000h instead of the answer               bytes, CAN: answers of SDO
    split       the answer in two parts with a pause between                         bytes, not in datagrams

On a serial line, also in a tunnel, a late answer delays the following ones, because a unit there answers one request
after the other. On TCP, UDP and CAN they overtake it.

The faults depend only on the random numbers passed in: the same seed and the same answers have the same faults, in
virtual time as on a real port.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from random import Random
from types import MappingProxyType
from typing import TYPE_CHECKING, Generic, NamedTuple, Protocol, TypeVar

from barewire.ascii import frame as ascii_frame
from barewire.canopen import CanFrame
from barewire.errors import DecodeError, EncodeError, shown
from barewire.modbus import Adu
from barewire.rtu import frame as rtu_frame
from barewire.tcp import frame as tcp_frame

if TYPE_CHECKING:
    from barewire.io.endpoint import Endpoint

Item = TypeVar("Item")

KINDS = ("exception", "wrong-unit", "flip", "noise", "split", "late", "drop")
"""All kinds of faults, in the order in which they are applied; one answer can have several."""

_DEFAULT_PROBABILITY = 0.1
"""The probability of a kind of fault that is given without one."""

LATE = 1.5
"""The delay of late answers in seconds: longer than the default time-out of clients."""

_LONGEST_DELAY = 3600.0
"""The longest delay in seconds: more is probably a mistake."""

PAUSE = 0.02
"""Seconds between the two parts of a split answer, as with a USB adapter."""

_SERVER_DEVICE_BUSY = 6
_GENERAL_ABORT = 0x0800_0000


def parse_faults(text: str) -> Mapping[str, float]:
    """Return the kinds of faults in a text, with their probabilities. Raises EncodeError for an unknown kind or a wrong
    probability.

    >>> dict(parse_faults("late:0.5,drop"))
    {'late': 0.5, 'drop': 0.1}
    """
    faults: dict[str, float] = {}
    for item in text.split(","):
        kind, colon, number = item.strip().partition(":")
        try:
            probability = float(number) if colon else _DEFAULT_PROBABILITY
        except ValueError:
            probability = -1.0
        if kind not in KINDS:
            raise EncodeError(f"fault {kind!r}: expected some of {', '.join(sorted(KINDS))}")
        if not 0 <= probability <= 1:
            raise EncodeError(f"fault {item.strip()!r}: expected a probability, 0..1, after the colon")
        faults[kind] = probability
    return MappingProxyType(faults)


class FaultyWire(Protocol[Item]):
    """The faults of one kind of wire. A fault that is not possible for an item leaves it unchanged."""

    kinds: tuple[str, ...]
    in_order: bool
    """Whether no answer overtakes another."""

    def refused(self, item: Item) -> Item: ...

    def misdirected(self, item: Item) -> Item: ...

    def flipped(self, item: Item, random: Random) -> Item: ...

    def noise(self, random: Random) -> Item: ...

    def parts(self, item: Item, random: Random) -> list[Item]: ...


class Framing(NamedTuple):
    """How a frame is decoded and encoded."""

    decode: Callable[[bytes], Adu]
    encode: Callable[[Adu], bytes]


_FRAMINGS = {
    "rtu": Framing(rtu_frame.decode, lambda adu: rtu_frame.encode(adu.unit, adu.pdu)),
    "ascii": Framing(ascii_frame.decode, lambda adu: ascii_frame.encode(adu.unit, adu.pdu)),
    "tcp": Framing(tcp_frame.decode, lambda adu: tcp_frame.encode(adu.unit, adu.pdu, adu.transaction or 0)),
}


class ModbusWire:
    """Modbus frames: rtu, ascii or tcp."""

    kinds: tuple[str, ...] = KINDS

    def __init__(self, framing: str, *, datagrams: bool = False) -> None:
        self._framing = _FRAMINGS[framing]
        self.in_order = framing != "tcp"
        if datagrams:
            self.kinds = tuple(kind for kind in KINDS if kind != "split")  # half a datagram does not arrive

    def _changed(self, item: bytes, change: Callable[[Adu], Adu]) -> bytes:
        try:
            return self._framing.encode(change(self._framing.decode(item)))
        except DecodeError:
            return item

    def refused(self, item: bytes) -> bytes:
        """Return exception 06, server device busy."""
        return self._changed(item, lambda adu: adu._replace(pdu=bytes([adu.pdu[0] | 0x80, _SERVER_DEVICE_BUSY])))

    def misdirected(self, item: bytes) -> bytes:
        """Return the frame with the address of the next unit, and a correct check sum."""
        return self._changed(item, lambda adu: adu._replace(unit=adu.unit % 247 + 1))

    def flipped(self, item: bytes, random: Random) -> bytes:
        """Return the frame with one bit inverted."""
        place = random.randrange(8 * len(item))
        changed = bytearray(item)
        changed[place // 8] ^= 1 << place % 8
        return bytes(changed)

    def noise(self, random: Random) -> bytes:
        """Return one to eight bytes."""
        return random.randbytes(random.randint(1, 8))

    def parts(self, item: bytes, random: Random) -> list[bytes]:
        """Return the frame in two parts, cut anywhere."""
        cut = random.randint(1, max(1, len(item) - 1))
        return [part for part in (item[:cut], item[cut:]) if part]


class CanWire:
    """A CAN bus. A controller repeats damaged frames and never delivers parts of one."""

    kinds: tuple[str, ...] = ("exception", "wrong-unit", "noise", "late", "drop")
    in_order = False

    def refused(self, item: CanFrame) -> CanFrame:
        """Return an SDO abort instead of the first frame of an SDO response, which has the object."""
        if _is_sdo_answer(item) and item.data[:1] and item.data[0] >> 5 in (2, 3):
            return item._replace(data=b"\x80" + item.data[1:4] + _GENERAL_ABORT.to_bytes(4, "little"))
        return item

    def misdirected(self, item: CanFrame) -> CanFrame:
        """Return the frame with the COB-ID of the next node."""
        return item._replace(id=0x580 + (item.id - 0x580) % 127 + 1) if _is_sdo_answer(item) else item

    def flipped(self, item: CanFrame, random: Random) -> CanFrame:
        """Return the frame: a controller never delivers a damaged one."""
        return item

    def noise(self, random: Random) -> CanFrame:
        """Return an extended frame, which CANopen does not use."""
        return CanFrame(random.randrange(1 << 29), random.randbytes(8), extended=True)

    def parts(self, item: CanFrame, random: Random) -> list[CanFrame]:
        """Return the frame: it has no parts on CAN."""
        return [item]


def _is_sdo_answer(frame: CanFrame) -> bool:
    return 0x580 < frame.id < 0x600 and not frame.extended and not frame.remote


class Faults(Generic[Item]):
    """Puts faults into answers.

    faults      the probability of each kind, 0..1
    delay       the delay of late answers in seconds
    on_fault    called as on_fault(kind) for each fault
    """

    def __init__(
        self,
        wire: FaultyWire[Item],
        faults: Mapping[str, float],
        random: Random,
        *,
        delay: float = LATE,
        on_fault: Callable[[str], None] | None = None,
    ) -> None:
        if not isinstance(faults, Mapping):
            raise EncodeError(f"faults {shown(faults)}: expected a text such as 'late:0.5,drop', or a dict", "faults")
        for kind, probability in faults.items():
            if kind not in wire.kinds:
                raise EncodeError(f"fault {kind!r} is not possible on this wire: expected {', '.join(wire.kinds)}")
            if not (isinstance(probability, (int, float)) and 0 <= probability <= 1):
                raise EncodeError(f"fault {kind!r}: {shown(probability)}: expected a probability, 0..1", "faults")
        if not (isinstance(delay, (int, float)) and 0 <= delay < _LONGEST_DELAY):
            raise EncodeError(f"late = {shown(delay)}: expected seconds, from 0 on and below {_LONGEST_DELAY:g}")
        self.counts: Counter[str] = Counter()
        """The number of faults of each kind."""
        self._wire, self._faults, self._delay, self._on_fault = wire, faults, delay, on_fault
        self._last = 0.0
        self._random, self._content = random, Random(random.random())  # whether there is a fault, and its content

    def pass_on(self, item: Item, now: float) -> list[tuple[float, Item]]:
        """Return what is sent instead of `item`, with the times; an empty list if it is lost."""
        # One random number for each kind in any case, so that a fault hits the same answers with and without others.
        hits = {kind: self._random.random() < self._faults.get(kind, 0.0) for kind in KINDS}
        for kind in KINDS:
            if hits[kind]:
                self.counts[kind] += 1
                if self._on_fault is not None:
                    self._on_fault(kind)
        if hits["drop"]:
            return []
        wire, random = self._wire, self._content
        if hits["exception"]:
            item = wire.refused(item)
        if hits["wrong-unit"]:
            item = wire.misdirected(item)
        if hits["flip"]:
            item = wire.flipped(item, random)
        send_at = now + (self._delay if hits["late"] else 0.0)
        if wire.in_order:
            send_at = max(send_at, self._last)
        parts = wire.parts(item, random) if hits["split"] else [item]
        self._last = send_at + (len(parts) - 1) * PAUSE
        noise = [(send_at, wire.noise(random))] if hits["noise"] else []
        return [*noise, *((send_at + place * PAUSE, part) for place, part in enumerate(parts))]


def faults_at(
    endpoint: Endpoint,
    faults: str | Mapping[str, float],
    *,
    seed: int | None = None,
    delay: float | None = None,
    on_fault: Callable[[str], None] | None = None,
) -> Faults[bytes]:
    """Return the faults of a Modbus server. Raises EncodeError for a kind that its wire does not have."""
    probabilities = parse_faults(faults) if isinstance(faults, str) else faults
    wire = ModbusWire(endpoint.framing, datagrams=endpoint.is_datagram)
    return Faults(wire, probabilities, Random(seed), delay=LATE if delay is None else delay, on_fault=on_fault)


def faults_on_can(
    faults: str | Mapping[str, float],
    *,
    seed: int | None = None,
    delay: float | None = None,
    on_fault: Callable[[str], None] | None = None,
) -> Faults[CanFrame]:
    """Return the faults of a node on a CAN bus. Raises EncodeError for a kind that CAN does not have."""
    probabilities = parse_faults(faults) if isinstance(faults, str) else faults
    return Faults(CanWire(), probabilities, Random(seed), delay=LATE if delay is None else delay, on_fault=on_fault)
