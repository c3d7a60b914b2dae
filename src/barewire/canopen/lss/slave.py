"""The LSS slave: the LSS state of a device.   [CiA 305]

                          switch global 1
        WAITING  ----------------------------------->  CONFIGURATION
           ^       40 41 42 43 match its address: 44h      |   11 node-ID   13 bit timing   17 store
           |       fastscan matches its last bit: 4Fh      |   15 activate  5A..5E inquire
           +-----------------------------------------------+
                          switch global 0

There are two node-IDs: the active one, and the *pending* one that 11h sets. A device without a node-ID activates the
pending one and boots when it returns to WAITING; a device with a node-ID activates it at its next reset. All devices
receive every request, so a request that does not match the device or its state is not answered.
"""

from __future__ import annotations

from collections.abc import Callable

from barewire._callbacks import check_callbacks
from barewire.canopen.cob_ids import NODE_MAX, NODE_MIN
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import (
    AUTOMATIC_BIT_RATE,
    BEGIN,
    IDENTIFY_SERVICES,
    LSS_BIT_RATES,
    REQUEST_KEY,
    UNCONFIGURED,
    Fastscan,
    LssAddress,
    LssMessage,
    LssService,
    LssState,
)
from barewire.errors import DecodeError

_OK, _OUT_OF_RANGE, _NO_STORAGE = 0, 1, 2
_PARTS = range(LssService.SELECT_VENDOR, LssService.SELECT_SERIAL + 1)

StoreConfiguration = Callable[[int | None, int | None], bool]
"""Stores (node-ID, entry of the bit rate table) for the next power-on, and returns whether that succeeded."""


class LssSlave:
    """The LSS state of one device. A machine.

        address         the four numbers of 1018h
        node            the node-ID, None if the device has none yet
        store           stores the configuration; without it the answer is "not supported"
        rates           the entries of the bit rate table that the device supports
        on_bit_timing   called with (entry, delay) at "activate": the device must change its bit rate after `delay`
                        seconds; it sends nothing until `delay` more seconds have passed

    >>> slave = LssSlave(LssAddress(0x360, 1, 2, 3))
    >>> for text in ("7E5#4060030000000000", "7E5#4101000000000000", "7E5#4202000000000000", "7E5#4303000000000000"):
    ...     answer = slave.feed(CanFrame.parse(text), 0.0)
    >>> str(answer[0]), slave.state.name
    ('7E4#4400000000000000', 'CONFIGURATION')
    """

    __slots__ = ("_limits", "_matched", "_part", "address", "bit_timing", "node", "on_bit_timing", "pending", "rates",
                 "silence", "state", "store")  # fmt: skip
    deadline = None  # nothing is timed

    def __init__(
        self,
        address: LssAddress,
        node: int | None = None,
        *,
        store: StoreConfiguration | None = None,
        rates: frozenset[int] = frozenset({*LSS_BIT_RATES, AUTOMATIC_BIT_RATE}),
        on_bit_timing: Callable[[int | None, float], None] | None = None,
    ) -> None:
        check_callbacks("LssSlave", store=store, on_bit_timing=on_bit_timing)
        self.address = address
        self.node = node
        self.pending = node
        self.bit_timing: int | None = None
        self.store = store
        self.rates = rates
        self.on_bit_timing = on_bit_timing
        self.silence: Callable[[float], None] | None = None  # set by the device: send nothing until that time
        self.state = LssState.WAITING
        self._matched = 0  # how many parts of "switch selective" have matched, in order
        self._limits = 0  # the same for "identify"
        self._part = 0  # the part of the address that a fastscan has reached

    @property
    def must_boot(self) -> bool:
        """Whether a device without a node-ID was given one, and the master has switched it back to WAITING."""
        return self.state is LssState.WAITING and self.node is None and self.pending is not None

    def take_over(self) -> int | None:
        """Activate the pending node-ID, because of a reset, and return it."""
        self.state = LssState.WAITING
        self.node = self.pending
        return self.node

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Return the answer, if the request concerns this device in its present state."""
        if frame is None or frame.key != REQUEST_KEY:
            return []
        try:
            message = LssMessage.decode(frame)
        except DecodeError:
            return []
        answer = self._answer(message.service, message, now)
        return [] if answer is None else [LssMessage(*answer, answer=True).encode()]

    def _answer(self, service: int, message: LssMessage, now: float) -> tuple[int, bytes] | None:
        if service == LssService.SWITCH_GLOBAL:
            self._matched = 0
            if message.body[0] in (0, 1):
                self.state = LssState(message.body[0])
            return None
        if service in _PARTS:
            return self._select(service - _PARTS[0], message.number)
        if service in IDENTIFY_SERVICES:
            return self._identify(service - IDENTIFY_SERVICES[0], message.number)
        if service == LssService.IDENTIFY_UNCONFIGURED:
            return (LssService.UNCONFIGURED_IDENTIFIED, b"") if self._is_unconfigured else None
        if service == LssService.FASTSCAN:
            return (LssService.IDENTIFIED, b"") if self._matches_scan(message.body) else None
        return self._configure(service, message.body, now) if self.state is LssState.CONFIGURATION else None

    @property
    def _is_unconfigured(self) -> bool:
        return self.node is None and self.pending is None

    def _select(self, part: int, number: int) -> tuple[int, bytes] | None:
        """Compare a part of 40h to 43h, in order. The last part is answered if all match."""
        if self.state is not LssState.WAITING:
            return None
        expected = part == 0 or self._matched == part
        self._matched = part + 1 if expected and number == self.address[part] else 0
        if self._matched != len(self.address):
            return None
        self._matched = 0
        self.state = LssState.CONFIGURATION
        return LssService.SELECTED, b""

    def _identify(self, step: int, number: int) -> tuple[int, bytes] | None:
        """Compare a number of 46h to 4Bh, in order: vendor and product must be equal, the others are limits."""
        vendor, product, revision, serial = self.address
        fits = (vendor == number, product == number, number <= revision, revision <= number, number <= serial,
                serial <= number)[step]  # fmt: skip
        self._limits = step + 1 if fits and (step == 0 or self._limits == step) else 0
        if self._limits != len(IDENTIFY_SERVICES):
            return None
        self._limits = 0
        return LssService.IDENTIFIED, b""

    def _matches_scan(self, body: bytes) -> bool:
        if not self._is_unconfigured or self.state is not LssState.WAITING:
            return False
        try:
            request = Fastscan.of_body(body)
        except DecodeError:
            return False
        if request.bit == BEGIN:
            self._part = 0
            return True
        number = self.address[request.sub]
        if self._part != request.sub or number >> request.bit != request.number >> request.bit:
            return False
        self._part = request.next
        if request.bit == 0 and request.next < request.sub:
            self.state = LssState.CONFIGURATION
        return True

    def _configure(self, service: int, body: bytes, now: float) -> tuple[int, bytes] | None:
        if service == LssService.CONFIGURE_NODE:
            return service, bytes([self._set_node(body[0])])
        if service == LssService.CONFIGURE_BIT_TIMING:
            if body[0] or body[1] not in self.rates:
                return service, bytes([_OUT_OF_RANGE])
            self.bit_timing = body[1]
            return service, bytes([_OK])
        if service == LssService.ACTIVATE_BIT_TIMING:
            delay = int.from_bytes(body[:2], "little") / 1000
            if self.silence is not None:
                self.silence(now + 2 * delay)
            if self.on_bit_timing is not None:
                self.on_bit_timing(self.bit_timing, delay)
            return None
        if service == LssService.STORE:
            if self.store is None:
                return service, bytes([_OUT_OF_RANGE])
            return service, bytes([_OK if self.store(self.pending, self.bit_timing) else _NO_STORAGE])
        if service == LssService.INQUIRE_NODE:
            return service, bytes([UNCONFIGURED if self.node is None else self.node])
        return service, self.address[service - LssService.INQUIRE_VENDOR].to_bytes(4, "little")

    def _set_node(self, node: int) -> int:
        if node == UNCONFIGURED:
            self.pending = None
        elif NODE_MIN <= node <= NODE_MAX:
            self.pending = node
        else:
            return _OUT_OF_RANGE
        return _OK
