"""The fault model: answers of a server that are late, damaged, misdirected or missing.

        device --answer--> Faults.pass_on(answer, now, request) --> [(when, what), ...] --> the wire

    late               the answer comes a number of seconds later                    bytes, CAN
    noise              something other than an answer comes before it                bytes, CAN: another node's frame
    wrong-unit         the right answer with another unit or node address            bytes, CAN
    wrong-transaction  the right answer with the next transaction number             bytes, framing of Modbus TCP
    drop               no answer                                                     bytes, CAN
    flip               one bit is inverted                                           bytes
    exception          an exception or abort 0800 0000h instead of the answer        bytes, CAN: answers of SDO
    split              the answer in two parts with a pause between                  bytes, not in datagrams
    paced              the answer byte by byte with a pause between                  bytes, not in datagrams

`targets` selects the answers: by dice, by number, by the addresses of their requests.

On a serial line, also in a tunnel, a late answer delays the following ones, because a unit there answers one request
after the other. On TCP, UDP and CAN they overtake it.

The faults depend only on the random numbers passed in: the same seed and the same answers have the same faults, in
virtual time as on a real port.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from random import Random
from typing import TYPE_CHECKING, Generic, NamedTuple, Protocol, TypeVar

from barewire.ascii import frame as ascii_frame
from barewire.canopen import CanFrame
from barewire.errors import DecodeError, EncodeError, shown
from barewire.io.fault_injection.targets import KINDS, LONGEST_DELAY, Fault, GivenFaults, checked_faults
from barewire.modbus import Adu
from barewire.rtu import frame as rtu_frame
from barewire.tcp import frame as tcp_frame

if TYPE_CHECKING:
    from barewire.io.endpoint import Endpoint

Item = TypeVar("Item")

LATE = 1.5
"""The delay of late answers in seconds: longer than the default time-out of clients."""

PAUSE = 0.02
"""Seconds between the two parts of a split answer, as with a USB adapter."""

_PACE = 0.005
"""Seconds between two bytes of a paced answer. RTU at 19200 baud allows 0.9 ms inside a frame [MB-SER 2.5.1.1]."""

_SERVER_DEVICE_BUSY = 6
_GENERAL_ABORT = 0x0800_0000


class FaultyWire(Protocol[Item]):
    """The faults of one kind of wire. A fault that is not possible for an item leaves it unchanged."""

    kinds: tuple[str, ...]
    in_order: bool
    """Whether no answer overtakes another."""
    has_addresses: bool
    """Whether requests touch addresses."""

    def refused(self, item: Item, code: int) -> Item: ...

    def misdirected(self, item: Item) -> Item: ...

    def misnumbered(self, item: Item) -> Item: ...

    def flipped(self, item: Item, random: Random) -> Item: ...

    def noise(self, random: Random) -> Item: ...

    def parts(self, item: Item, random: Random) -> list[Item]: ...

    def bytewise(self, item: Item) -> list[Item]: ...


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

    has_addresses = True

    def __init__(self, framing: str, *, datagrams: bool = False) -> None:
        self._framing = _FRAMINGS[framing]
        self.in_order = framing != "tcp"
        excluded = {"split", "paced"} if datagrams else set()  # half a datagram does not arrive
        if framing != "tcp":
            excluded.add("wrong-transaction")
        self.kinds: tuple[str, ...] = tuple(kind for kind in KINDS if kind not in excluded)

    def _changed(self, item: bytes, change: Callable[[Adu], Adu]) -> bytes:
        try:
            return self._framing.encode(change(self._framing.decode(item)))
        except DecodeError:
            return item

    def refused(self, item: bytes, code: int) -> bytes:
        """Return an exception response with this code."""
        return self._changed(item, lambda adu: adu._replace(pdu=bytes([adu.pdu[0] | 0x80, code])))

    def misdirected(self, item: bytes) -> bytes:
        """Return the frame with the address of the next unit, and a correct check sum."""
        return self._changed(item, lambda adu: adu._replace(unit=adu.unit % 247 + 1))

    def misnumbered(self, item: bytes) -> bytes:
        """Return the frame with the next transaction number."""
        return self._changed(item, lambda adu: adu._replace(transaction=(adu.transaction or 0) + 1 & 0xFFFF))

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

    def bytewise(self, item: bytes) -> list[bytes]:
        """Return the bytes of the frame, one by one."""
        return [item[place : place + 1] for place in range(len(item))]


class CanWire:
    """A CAN bus. A controller repeats damaged frames and never delivers parts of one."""

    kinds: tuple[str, ...] = ("exception", "wrong-unit", "noise", "late", "drop")
    in_order = False
    has_addresses = False

    def refused(self, item: CanFrame, code: int) -> CanFrame:
        """Return an SDO abort, 0800 0000h, instead of the first frame of an SDO response, which has the object."""
        if _is_sdo_answer(item) and item.data[:1] and item.data[0] >> 5 in (2, 3):
            return item._replace(data=b"\x80" + item.data[1:4] + _GENERAL_ABORT.to_bytes(4, "little"))
        return item

    def misdirected(self, item: CanFrame) -> CanFrame:
        """Return the frame with the COB-ID of the next node."""
        return item._replace(id=0x580 + (item.id - 0x580) % 127 + 1) if _is_sdo_answer(item) else item

    def misnumbered(self, item: CanFrame) -> CanFrame:
        """Return the frame: frames of CAN have no number."""
        return item

    def flipped(self, item: CanFrame, random: Random) -> CanFrame:
        """Return the frame: a controller never delivers a damaged one."""
        return item

    def noise(self, random: Random) -> CanFrame:
        """Return an extended frame, which CANopen does not use."""
        return CanFrame(random.randrange(1 << 29), random.randbytes(8), extended=True)

    def parts(self, item: CanFrame, random: Random) -> list[CanFrame]:
        """Return the frame: it has no parts on CAN."""
        return [item]

    def bytewise(self, item: CanFrame) -> list[CanFrame]:
        """Return the frame: it has no parts on CAN."""
        return [item]


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
        self._faults = checked_faults(faults)
        for fault in self._faults:
            if fault.kind not in wire.kinds:
                expected = ", ".join(wire.kinds)
                raise EncodeError(f"fault {fault.kind!r} is not possible on this wire: expected {expected}", "faults")
            if fault.addresses is not None and not wire.has_addresses:
                raise EncodeError(f"fault {fault.kind!r}: an address selects requests of Modbus, not of CAN", "faults")
            if fault.kind == "exception" and fault.value is not None and not wire.has_addresses:
                raise EncodeError("fault 'exception': CAN has SDO aborts and no exception codes", "faults")
        if not (isinstance(delay, (int, float)) and 0 <= delay < LONGEST_DELAY):
            raise EncodeError(f"late = {shown(delay)}: expected seconds, from 0 on and below {LONGEST_DELAY:g}")
        self.counts: Counter[str] = Counter()
        """The number of faults of each kind."""
        self._wire, self._delay, self._on_fault = wire, delay, on_fault
        self._fitting = [0] * len(self._faults)
        """By fault: the answers so far that fit its addresses."""
        self._last = 0.0
        self._random, self._content = random, Random(random.random())  # whether there is a fault, and its content

    def _chosen(self, request: bytes) -> dict[str, Fault]:
        """Return the faults for the next answer, by kind."""
        # One random number for each kind in any case, so that a fault hits the same answers with and without others.
        dice = {kind: self._random.random() for kind in KINDS}
        chosen: dict[str, Fault] = {}
        for place, fault in enumerate(self._faults):
            if fault.fits(request):
                self._fitting[place] += 1
                if fault.hits(self._fitting[place]) and dice[fault.kind] < fault.probability:
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
        wire, random = self._wire, self._content
        if (fault := chosen.get("exception")) is not None:
            item = wire.refused(item, _SERVER_DEVICE_BUSY if fault.value is None else int(fault.value))
        if "wrong-unit" in chosen:
            item = wire.misdirected(item)
        if "wrong-transaction" in chosen:
            item = wire.misnumbered(item)
        if "flip" in chosen:
            item = wire.flipped(item, random)
        send_at = now
        if (fault := chosen.get("late")) is not None:
            send_at += self._delay if fault.value is None else fault.value
        if wire.in_order:
            send_at = max(send_at, self._last)
        parts, pause = [item], 0.0
        if (fault := chosen.get("paced")) is not None:
            parts, pause = wire.bytewise(item), _PACE if fault.value is None else fault.value
        elif "split" in chosen:
            parts, pause = wire.parts(item, random), PAUSE
        self._last = send_at + (len(parts) - 1) * pause
        noise = [(send_at, wire.noise(random))] if "noise" in chosen else []
        return [*noise, *((send_at + place * pause, part) for place, part in enumerate(parts))]


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
