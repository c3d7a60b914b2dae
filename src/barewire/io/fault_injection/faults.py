"""Faults on request: a simulated device whose answers are late, damaged, somebody else's, or missing.

        device --answer--> Faults.pass_on(answer, now) --> [(when, what), ...] --> the wire

    late        the answer comes, but so many seconds later                          bytes, CAN
    noise       something that is no answer comes before it                          bytes, CAN: a frame of a stranger
    wrong-unit  the right answer with another's address                              bytes, CAN
    drop        no answer                                                            bytes, CAN
    flip        one bit is another                                                   bytes
    exception   a refusal in its place: exception 06, abort 0800 0000h               bytes, CAN: answers of SDO
    split       the answer in two parts with a pause between                         bytes, not in datagrams

On a serial line, and behind one in a tunnel, a late answer holds up those after it: a unit there does one thing after
the other. On TCP, UDP and CAN they overtake it.

What happens is decided by dice that are given, and by nothing else: the same seed and the same answers have the same
faults, in virtual time as on a real port.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from random import Random
from types import MappingProxyType
from typing import TYPE_CHECKING, Generic, NamedTuple, Protocol, TypeVar

from barewire.ascii import frame as ascii_frame
from barewire.canopen import CanFrame
from barewire.errors import DecodeError, EncodeError
from barewire.modbus import Adu
from barewire.rtu import frame as rtu_frame
from barewire.tcp import frame as tcp_frame

if TYPE_CHECKING:
    from barewire.io.endpoint import Endpoint

Item = TypeVar("Item")

KINDS = ("exception", "wrong-unit", "flip", "noise", "split", "late", "drop")
"""In the order in which they are applied; one answer can meet several."""

USUAL = 0.1
"""The probability of a fault that is named without one."""

LATE = 1.5
"""Seconds: longer than the time-out that clients have without being told."""

LATEST = 3600.0
"""An answer that is to come later than in an hour is a mistake."""

PAUSE = 0.02
"""Seconds between the two parts of a split answer: what a USB adapter does to a line."""

BUSY = 6
ABORT_GENERAL = 0x0800_0000


def parse_faults(text: str) -> Mapping[str, float]:
    """Kinds and their probabilities; EncodeError for what is none.

    >>> dict(parse_faults("late:0.5,drop"))
    {'late': 0.5, 'drop': 0.1}
    """
    faults: dict[str, float] = {}
    for one in text.split(","):
        kind, colon, chance = one.strip().partition(":")
        try:
            probability = float(chance) if colon else USUAL
        except ValueError:
            probability = -1.0
        if kind not in KINDS:
            raise EncodeError(f"fault {kind!r}: expected some of {', '.join(sorted(KINDS))}")
        if not 0 <= probability <= 1:
            raise EncodeError(f"fault {one.strip()!r}: expected a probability, 0..1, behind the colon")
        faults[kind] = probability
    return MappingProxyType(faults)


class Wire(Protocol[Item]):
    """What each fault looks like on one kind of wire. What cannot be done to an item leaves it as it is."""

    kinds: tuple[str, ...]
    in_order: bool
    """Whether no answer overtakes another."""

    def refusal(self, item: Item) -> Item: ...

    def misdirected(self, item: Item) -> Item: ...

    def flipped(self, item: Item, dice: Random) -> Item: ...

    def noise(self, dice: Random) -> Item: ...

    def parts(self, item: Item, dice: Random) -> list[Item]: ...


class Envelope(NamedTuple):
    """How a frame is read and said again."""

    decode: Callable[[bytes], Adu]
    encode: Callable[[Adu], bytes]


ENVELOPES = {
    "rtu": Envelope(rtu_frame.decode, lambda adu: rtu_frame.encode(adu.unit, adu.pdu)),
    "ascii": Envelope(ascii_frame.decode, lambda adu: ascii_frame.encode(adu.unit, adu.pdu)),
    "tcp": Envelope(tcp_frame.decode, lambda adu: tcp_frame.encode(adu.unit, adu.pdu, adu.transaction or 0)),
}


class Bytes:
    """Modbus in one of its envelopes."""

    kinds: tuple[str, ...] = KINDS

    def __init__(self, envelope: str, *, datagrams: bool = False) -> None:
        self._envelope = ENVELOPES[envelope]
        self.in_order = envelope != "tcp"
        if datagrams:
            self.kinds = tuple(kind for kind in KINDS if kind != "split")  # half a datagram does not arrive

    def _changed(self, item: bytes, change: Callable[[Adu], Adu]) -> bytes:
        try:
            return self._envelope.encode(change(self._envelope.decode(item)))
        except DecodeError:
            return item

    def refusal(self, item: bytes) -> bytes:
        """Exception 06, server device busy."""
        return self._changed(item, lambda adu: adu._replace(pdu=bytes([adu.pdu[0] | 0x80, BUSY])))

    def misdirected(self, item: bytes) -> bytes:
        """The next unit's, with a good check sum."""
        return self._changed(item, lambda adu: adu._replace(unit=adu.unit % 247 + 1))

    def flipped(self, item: bytes, dice: Random) -> bytes:
        """One bit of all."""
        place = dice.randrange(8 * len(item))
        return bytes(byte ^ (1 << place % 8 if at == place // 8 else 0) for at, byte in enumerate(item))

    def noise(self, dice: Random) -> bytes:
        """One to eight bytes."""
        return dice.randbytes(dice.randint(1, 8))

    def parts(self, item: bytes, dice: Random) -> list[bytes]:
        """Cut anywhere."""
        at = dice.randint(1, max(1, len(item) - 1))
        return [part for part in (item[:at], item[at:]) if part]


class Frames:
    """A CAN bus. A controller repeats what was damaged and never delivers half a frame."""

    kinds: tuple[str, ...] = ("exception", "wrong-unit", "noise", "late", "drop")
    in_order = False

    def refusal(self, item: CanFrame) -> CanFrame:
        """An SDO abort in place of the beginning of an answer, which names the object."""
        if _is_sdo_answer(item) and item.data[:1] and item.data[0] >> 5 in (2, 3):
            return item._replace(data=b"\x80" + item.data[1:4] + ABORT_GENERAL.to_bytes(4, "little"))
        return item

    def misdirected(self, item: CanFrame) -> CanFrame:
        """The next node's."""
        return item._replace(id=0x580 + (item.id - 0x580) % 127 + 1) if _is_sdo_answer(item) else item

    def flipped(self, item: CanFrame, dice: Random) -> CanFrame:
        """Not on CAN."""
        return item

    def noise(self, dice: Random) -> CanFrame:
        """An extended frame: somebody else's talk."""
        return CanFrame(dice.randrange(1 << 29), dice.randbytes(8), extended=True)

    def parts(self, item: CanFrame, dice: Random) -> list[CanFrame]:
        """Not on CAN."""
        return [item]


def _is_sdo_answer(frame: CanFrame) -> bool:
    return 0x580 < frame.id < 0x600 and not frame.extended and not frame.remote


class Faults(Generic[Item]):
    """Decides what becomes of each answer. `late` is in seconds; `told(kind)` is called for each fault that strikes."""

    def __init__(
        self,
        wire: Wire[Item],
        faults: Mapping[str, float],
        dice: Random,
        *,
        late: float = LATE,
        told: Callable[[str], None] | None = None,
    ) -> None:
        for kind in faults:
            if kind not in wire.kinds:
                raise EncodeError(f"fault {kind!r} does not happen on this wire: expected {', '.join(wire.kinds)}")
        if not 0 <= late < LATEST:
            raise EncodeError(f"late = {late:g}: expected seconds, from 0 on and below {LATEST:g}")
        self.struck: Counter[str] = Counter()
        """How often each fault has struck."""
        self._wire, self._faults, self._late, self._told = wire, faults, late, told
        self._last = 0.0
        self._dice, self._content = dice, Random(dice.random())  # whether, and what

    def pass_on(self, item: Item, now: float) -> list[tuple[float, Item]]:
        """What goes on the wire in place of `item`, and when; nothing if it is lost."""
        # Thrown for all kinds, whatever falls: so a fault strikes the same answers with and without others.
        thrown = {kind: self._dice.random() < self._faults.get(kind, 0.0) for kind in KINDS}
        for kind in KINDS:
            if thrown[kind]:
                self.struck[kind] += 1
                if self._told is not None:
                    self._told(kind)
        if thrown["drop"]:
            return []
        wire, dice = self._wire, self._content
        if thrown["exception"]:
            item = wire.refusal(item)
        if thrown["wrong-unit"]:
            item = wire.misdirected(item)
        if thrown["flip"]:
            item = wire.flipped(item, dice)
        at = now + (self._late if thrown["late"] else 0.0)
        if wire.in_order:
            at = max(at, self._last)
        parts = wire.parts(item, dice) if thrown["split"] else [item]
        self._last = at + (len(parts) - 1) * PAUSE
        before = [(at, wire.noise(dice))] if thrown["noise"] else []
        return [*before, *((at + place * PAUSE, part) for place, part in enumerate(parts))]


def faults_at(
    endpoint: Endpoint,
    faults: str | Mapping[str, float],
    *,
    seed: int | None = None,
    delay: float | None = None,
    on_fault: Callable[[str], None] | None = None,
) -> Faults[bytes]:
    """The faults of a Modbus server at this endpoint. EncodeError for a kind that its wire does not have."""
    chances = parse_faults(faults) if isinstance(faults, str) else faults
    wire = Bytes(endpoint.envelope, datagrams=endpoint.scheme == "udp")
    return Faults(wire, chances, Random(seed), late=LATE if delay is None else delay, told=on_fault)


def faults_on_can(
    faults: str | Mapping[str, float],
    *,
    seed: int | None = None,
    delay: float | None = None,
    on_fault: Callable[[str], None] | None = None,
) -> Faults[CanFrame]:
    """The faults of a node on a CAN bus. EncodeError for a kind that CAN does not have."""
    chances = parse_faults(faults) if isinstance(faults, str) else faults
    return Faults(Frames(), chances, Random(seed), late=LATE if delay is None else delay, told=on_fault)
