"""Which errors the other nodes have: what their emergencies add up to.   [CiA 301, EMCY]

        80h+n   30 81 | 11 | ...     8130h has come                        {8130h}
        80h+n   10 32 | 15 | ...     3210h has come                        {8130h, 3210h}
        80h+n   00 00 | 05 | ...     one is gone; voltage is still set     {3210h}
        80h+n   00 00 | 00 | ...     all is well                           {}

A message 0000h does not say which error is gone, and clears only what it says: the errors whose bit is no longer set
in the register that it carries. With register 00h that is all of them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

from barewire.canopen.emcy.message import Emergency, register_of
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.heartbeat import NodeState
from barewire.errors import DecodeError

ERRORS_MAX = 64
"""How many errors of one node are kept; a node that never takes one back does not fill the memory."""
GENERIC = 0x01  # set with every error, so it tells one from another only where nothing else is set


class EmcyEvent(NamedTuple):
    """One emergency: the message, the codes that are gone with it, and those that the node has now."""

    message: Emergency
    gone: tuple[int, ...]
    active: tuple[int, ...]
    at: float


class EmcyConsumer:
    """The errors of all nodes. A machine.

    `cob_ids` tells whose emergencies have another identifier than 80h + node: (identifier, extended) -> node. With
    `listed_only` no other emergencies are taken: that is the device whose 1028h says whom it listens to.
    `history` holds the last messages of all nodes, `unreadable` counts frames too short to hold a code.

    >>> consumer = EmcyConsumer()
    >>> for text in ("085#3081110200000000", "085#1032150000000000", "085#0000050000000000"):
    ...     events = consumer.feed(CanFrame.parse(text), 0.0)
    >>> [f"{code:04X}h" for code in events[0].gone], [f"{code:04X}h" for code in consumer.active(5)]
    (['8130h'], ['3210h'])
    """

    __slots__ = ("_active", "_registers", "cob_ids", "history", "listed_only", "unreadable")

    def __init__(
        self,
        cob_ids: Mapping[tuple[int, bool], int] | None = None,
        *,
        history: int = 256,
        listed_only: bool = False,
    ) -> None:
        self.cob_ids = dict(cob_ids or {})
        self.listed_only = listed_only
        self.history: deque[EmcyEvent] = deque(maxlen=history)
        self.unreadable = 0
        self._active: dict[int, dict[int, int]] = {}  # node -> code -> the bit that stays as long as it does
        self._registers: dict[int, int] = {}

    @property
    def deadline(self) -> float | None:
        """None: it waits for nothing but messages."""
        return None

    def active(self, node: int) -> tuple[int, ...]:
        """The errors that a node has, in the order in which they came."""
        return tuple(self._active.get(node, ()))

    def register(self, node: int) -> int | None:
        """The last error register that a node told, None if it never told one."""
        return self._registers.get(node)

    def feed(self, frame: CanFrame | None, now: float) -> list[EmcyEvent]:
        """What the frame tells about errors. A boot-up message of a node clears all of its errors."""
        if frame is None or frame.remote:
            return []
        node = self.cob_ids.get(frame.key)
        if node is not None:
            frame = frame._replace(id=0x80 + node, extended=False)
        elif self.listed_only or frame.extended or not 0x80 < frame.id < 0x100:
            self._boots(frame)
            return []
        try:
            message = Emergency.decode(frame)
        except DecodeError:
            self.unreadable += 1
            return []
        event = self._take(message, now)
        self.history.append(event)
        return [event]

    def _take(self, message: Emergency, now: float) -> EmcyEvent:
        errors = self._active.setdefault(message.node, {})
        gone: list[int] = []
        if message.code:
            errors.pop(message.code, None)
            errors[message.code] = register_of(message.code) & ~GENERIC or GENERIC
            if len(errors) > ERRORS_MAX:
                del errors[next(iter(errors))]
        else:
            gone = [code for code, bits in errors.items() if not bits & message.register]
        for code in gone:
            del errors[code]
        if not (message.padded and not message.register):
            self._registers[message.node] = message.register
        return EmcyEvent(message, tuple(gone), tuple(errors), now)

    def _boots(self, frame: CanFrame) -> None:
        if frame.extended or frame.id >> 7 != 0x700 >> 7:
            return
        try:
            told = NodeState.decode(frame)
        except DecodeError:
            return
        if told.is_boot_up:
            self._active.pop(told.node, None)
            self._registers.pop(told.node, None)
