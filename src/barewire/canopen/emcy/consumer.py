"""The EMCY consumer: the active errors of other nodes.   [CiA 301, EMCY]

        80h+n   30 81 | 11 | ...     8130h occurred                        {8130h}
        80h+n   10 32 | 15 | ...     3210h occurred                        {8130h, 3210h}
        80h+n   00 00 | 05 | ...     one cleared, bit "voltage" remains    {3210h}
        80h+n   00 00 | 00 | ...     none is left                          {}

A message 0000h does not name the error that is cleared. It clears the errors whose bit is no longer set in its
register; register 00h clears all errors.
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
"""How many errors of one node are kept. It limits the memory for a node that never clears an error."""
_GENERIC = 0x01  # set with every error, so it identifies an error only if no other bit is set


class EmcyEvent(NamedTuple):
    """A received emergency: the message, the error codes that it cleared, and the codes that are active now."""

    message: Emergency
    gone: tuple[int, ...]
    active: tuple[int, ...]
    at: float


class EmcyConsumer:
    """The active errors of all nodes. A machine.

        cob_ids       (identifier, extended) -> node, for emergencies on other identifiers than 80h + node
        history       how many messages of all nodes `history` keeps
        listed_only   ignore emergencies that are not in `cob_ids`, as in a device with 1028h

    `unreadable` counts frames too short for an error code.

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
        self._active: dict[
            int, dict[int, int]
        ] = {}  # node -> code -> the register bit that is set while the error is active
        self._registers: dict[int, int] = {}

    @property
    def deadline(self) -> float | None:
        """None: nothing is timed."""
        return None

    def active(self, node: int) -> tuple[int, ...]:
        """Return the active error codes of a node, the oldest first."""
        return tuple(self._active.get(node, ()))

    def register(self, node: int) -> int | None:
        """Return the last error register that a node reported, None before the first."""
        return self._registers.get(node)

    def feed(self, frame: CanFrame | None, now: float) -> list[EmcyEvent]:
        """Return the event of an emergency. A boot-up message clears the errors of its node, without an event."""
        if frame is None or frame.remote:
            return []
        node = self.cob_ids.get(frame.key)
        if node is not None:
            frame = frame._replace(id=0x80 + node, extended=False)
        elif self.listed_only or frame.extended or not 0x80 < frame.id < 0x100:
            self._clear_on_boot_up(frame)
            return []
        try:
            message = Emergency.decode(frame)
        except DecodeError:
            self.unreadable += 1
            return []
        event = self._apply(message, now)
        self.history.append(event)
        return [event]

    def _apply(self, message: Emergency, now: float) -> EmcyEvent:
        errors = self._active.setdefault(message.node, {})
        gone: list[int] = []
        if message.code:
            errors.pop(message.code, None)
            errors[message.code] = register_of(message.code) & ~_GENERIC or _GENERIC
            if len(errors) > ERRORS_MAX:
                del errors[next(iter(errors))]
        else:
            gone = [code for code, bits in errors.items() if not bits & message.register]
        for code in gone:
            del errors[code]
        if not (message.padded and not message.register):
            self._registers[message.node] = message.register
        return EmcyEvent(message, tuple(gone), tuple(errors), now)

    def _clear_on_boot_up(self, frame: CanFrame) -> None:
        if frame.extended or frame.id >> 7 != 0x700 >> 7:
            return
        try:
            received = NodeState.decode(frame)
        except DecodeError:
            return
        if received.is_boot_up:
            self._active.pop(received.node, None)
            self._registers.pop(received.node, None)
