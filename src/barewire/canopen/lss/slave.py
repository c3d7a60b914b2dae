"""A device's side of LSS.   [CiA 305]

                          switch global 1
        WAITING  ----------------------------------->  CONFIGURATION
           ^       40 41 42 43 with my address: 44h        |   11 node-ID   13 bit timing   17 store
           |       fastscan down to my last bit: 4Fh       |   15 activate  5A..5E inquire
           +-----------------------------------------------+
                          switch global 0

Two node-IDs are kept: the one that is in use and the *pending* one, which 11h sets. A device without a node-ID takes
the pending one over when it returns to WAITING and boots; one that has a node-ID does so at its next reset. Nothing is
answered but what is asked in the right state: all devices hear every question, and silence is the usual answer.

I know: LSS messages, one address, two node-IDs.  I never know: NMT, the object dictionary, how a bit rate is set.
"""

from __future__ import annotations

from collections.abc import Callable

from barewire.canopen.cob_ids import NODE_MAX, NODE_MIN
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import (
    AUTOMATIC_BIT_RATE,
    BEGIN,
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

OK, OUT_OF_RANGE, NO_STORAGE = 0, 1, 2
_PARTS = (0x40, 0x41, 0x42, 0x43)
_LIMITS = (0x46, 0x47, 0x48, 0x49, 0x4A, 0x4B)

StoreConfiguration = Callable[[int | None, int | None], bool]
"""Keeps (node-ID, entry of the bit rate table) for the next power-on; False if that fails."""


class LssSlave:
    """A machine. `node` None: no node-ID yet.

    `store` keeps the configuration; without one, the device answers that it cannot. `rates` are the entries of the
    bit rate table that it can do. `on_bit_timing(entry, delay)` is called for "activate": the device changes over
    `delay` seconds later and is silent until as many seconds have passed once more.

    >>> slave = LssSlave(LssAddress(0x360, 1, 2, 3))
    >>> for text in ("7E5#4060030000000000", "7E5#4101000000000000", "7E5#4202000000000000", "7E5#4303000000000000"):
    ...     said = slave.feed(CanFrame.parse(text), 0.0)
    >>> str(said[0]), slave.state.name
    ('7E4#4400000000000000', 'CONFIGURATION')
    """

    __slots__ = ("_at", "_limits", "_matched", "address", "bit_timing", "node", "on_bit_timing", "pending", "rates",
                 "silence", "state", "store")  # fmt: skip

    def __init__(
        self,
        address: LssAddress,
        node: int | None = None,
        *,
        store: StoreConfiguration | None = None,
        rates: frozenset[int] = frozenset({*LSS_BIT_RATES, AUTOMATIC_BIT_RATE}),
        on_bit_timing: Callable[[int | None, float], None] | None = None,
    ) -> None:
        self.address = address
        self.node = node
        self.pending = node
        self.bit_timing: int | None = None
        self.store = store
        self.rates = rates
        self.on_bit_timing = on_bit_timing
        self.silence: Callable[[float], None] | None = None  # the device: say nothing until then
        self.state = LssState.WAITING
        self._matched = 0  # how many parts of switch selective have matched, in order
        self._limits = 0  # the same for identify
        self._at = 0  # the part of the address that a fastscan is at

    @property
    def deadline(self) -> float | None:
        """None: it waits for nothing but questions."""
        return None

    @property
    def wants_to_boot(self) -> bool:
        """A node-ID was given to a device that had none, and the master has let go of it."""
        return self.state is LssState.WAITING and self.node is None and self.pending is not None

    def take_over(self) -> int | None:
        """A reset: the pending node-ID is the one in use from now on."""
        self.state = LssState.WAITING
        self.node = self.pending
        return self.node

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """The answer, if the question is for this device in this state."""
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
        if service in _LIMITS:
            return self._identify(service - _LIMITS[0], message.number)
        if service == LssService.IDENTIFY_UNCONFIGURED:
            return (LssService.UNCONFIGURED_IDENTIFIED, b"") if self._is_bare else None
        if service == LssService.FASTSCAN:
            return (LssService.IDENTIFIED, b"") if self._scanned(message.body) else None
        return self._configure(service, message.body, now) if self.state is LssState.CONFIGURATION else None

    @property
    def _is_bare(self) -> bool:
        return self.node is None and self.pending is None

    def _select(self, part: int, number: int) -> tuple[int, bytes] | None:
        """40h to 43h, one after the other; the last one is answered."""
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
        """46h to 4Bh: vendor and product as they are, revision and serial number within limits."""
        vendor, product, revision, serial = self.address
        fits = (vendor == number, product == number, number <= revision, revision <= number, number <= serial,
                serial <= number)[step]  # fmt: skip
        self._limits = step + 1 if fits and (step == 0 or self._limits == step) else 0
        if self._limits != len(_LIMITS):
            return None
        self._limits = 0
        return LssService.IDENTIFIED, b""

    def _scanned(self, body: bytes) -> bool:
        """Whether to say yes to a fastscan."""
        if not self._is_bare or self.state is not LssState.WAITING:
            return False
        try:
            question = Fastscan.of_body(body)
        except DecodeError:
            return False
        if question.bit == BEGIN:
            self._at = 0
            return True
        mine = self.address[question.sub]
        if self._at != question.sub or mine >> question.bit != question.number >> question.bit:
            return False
        self._at = question.next
        if question.bit == 0 and question.next < question.sub:
            self.state = LssState.CONFIGURATION
        return True

    def _configure(self, service: int, body: bytes, now: float) -> tuple[int, bytes] | None:
        """What is done in the state CONFIGURATION only."""
        if service == LssService.CONFIGURE_NODE:
            return service, bytes([self._set_node(body[0])])
        if service == LssService.CONFIGURE_BIT_TIMING:
            if body[0] or body[1] not in self.rates:
                return service, bytes([OUT_OF_RANGE])
            self.bit_timing = body[1]
            return service, bytes([OK])
        if service == LssService.ACTIVATE_BIT_TIMING:
            delay = int.from_bytes(body[:2], "little") / 1000
            if self.silence is not None:
                self.silence(now + 2 * delay)
            if self.on_bit_timing is not None:
                self.on_bit_timing(self.bit_timing, delay)
            return None
        if service == LssService.STORE:
            if self.store is None:
                return service, bytes([OUT_OF_RANGE])
            return service, bytes([OK if self.store(self.pending, self.bit_timing) else NO_STORAGE])
        if service == LssService.INQUIRE_NODE:
            return service, bytes([UNCONFIGURED if self.node is None else self.node])
        return service, self.address[service - LssService.INQUIRE_VENDOR].to_bytes(4, "little")

    def _set_node(self, node: int) -> int:
        if node == UNCONFIGURED:
            self.pending = None
        elif NODE_MIN <= node <= NODE_MAX:
            self.pending = node
        else:
            return OUT_OF_RANGE
        return OK
