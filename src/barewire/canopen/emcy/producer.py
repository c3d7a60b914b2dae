"""The errors that a device has now: from here come its emergencies, its error register and its history.   [CiA 301]

                 come(8130h)          come(3210h)          gone(8130h)           gone(3210h)
        080h+n   30 81 | 11           10 32 | 15           00 00 | 05            00 00 | 00
        1001h    generic, commun.     + voltage            generic, voltage      nothing
        1003h    8130h                3210h, 8130h         (what came stays in the history)

An error is said once when it comes and once when it goes; the same error from two sources (two PDOs that are too
short) is two errors. Between two messages lies the inhibit time 1015h; what waits keeps its turn and its register.
Where emergencies are not allowed (STOPPED) nothing is said, but register and history go on.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import replace
from functools import partial

from barewire.canopen.cob_ids import CobEntry, cob_id
from barewire.canopen.communication_objects import integer_value, replace_entry, validate_cob_id_writes, validate_writes
from barewire.canopen.emcy.message import Emergency, register_of
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.sdo.aborts import AbortCode, SdoAbort

REGISTER, HISTORY, COB_ID, INHIBIT = 0x1001, 0x1003, 0x1014, 0x1015
COMMUNICATION_ERRORS = range(0x8000, 0x9000)
_WAITING_MAX = 32
"""How many emergencies may wait for the inhibit time; then the oldest are dropped and counted."""


class EmcyProducer:
    """The errors of one device. A machine: `feed` says what had to wait.

    If the dictionary has them, 1001h and 1003h show what is here, 1014h and 1015h are obeyed. An error register that
    the application computes itself (an `on_read` of its own) is left to it, and sent as it is.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> errors = EmcyProducer(5, ObjectDictionary([Entry(0x1001, 0, "error register", "u8", "ro")]))
    >>> [str(frame) for frame in errors.come(0x8130, 0.0, info=b"\\x02") + errors.gone(0x8130, 1.0)]
    ['085#3081110200000000', '085#0000000000000000']
    """

    __slots__ = ("_active", "_free_at", "_history", "_own_register", "_waiting", "allowed", "dropped", "node",
                 "objects")  # fmt: skip

    def __init__(self, node: int, objects: ObjectDictionary) -> None:
        self.node = node
        self.objects = objects
        self.allowed = True  # whether the NMT state lets emergencies out
        self.dropped = 0
        self._active: dict[tuple[int, Hashable], int] = {}  # (code, source) -> register bits
        self._history: deque[int] = deque(maxlen=max(objects.subs(HISTORY), default=8) or 8)
        self._waiting: deque[CanFrame] = deque()
        self._free_at = float("-inf")
        self._own_register = (REGISTER, 0) in objects and objects.entry(REGISTER).on_read is not None
        self._settle()

    def _settle(self) -> None:
        """Let the objects show what is here."""
        objects = self.objects
        if (REGISTER, 0) in objects and not self._own_register:
            replace_entry(objects, replace(objects.entry(REGISTER), on_read=lambda: self.register))
        for sub in objects.subs(HISTORY):
            entry = objects.entry(HISTORY, sub)
            if sub == 0:
                replace_entry(objects, replace(entry, access="rw", on_read=lambda: len(self._history)))
                validate_writes(objects, HISTORY, 0, self._clear)
            else:
                replace_entry(objects, replace(entry, on_read=partial(self._past, sub)))
        validate_cob_id_writes(objects, COB_ID, lambda entry: not entry.bit31)
        self.renumber(self.node)

    def renumber(self, node: int) -> None:
        """The device has another node-ID. A 1014h of 80h, or of the node-ID before, stands for the default."""
        if integer_value(self.objects, COB_ID) in (cob_id("SYNC"), cob_id("EMCY", self.node)):
            self.objects.replace(replace(self.objects.entry(COB_ID), default=cob_id("EMCY", node)))
        self.node = node

    def _past(self, sub: int) -> int:
        if sub > len(self._history):
            raise SdoAbort(AbortCode.NO_DATA, HISTORY, sub)
        return self._history[sub - 1]

    def _clear(self, value: int) -> None:
        if value:
            raise SdoAbort(AbortCode.INVALID_VALUE, HISTORY, 0)
        self._history.clear()

    @property
    def active(self) -> tuple[int, ...]:
        """The codes of the errors that there are now."""
        return tuple(code for code, _ in self._active)

    @property
    def history(self) -> tuple[int, ...]:
        """The errors that came, the newest first: code, and the first two bytes of the information above it."""
        return tuple(self._history)

    @property
    def register(self) -> int:
        """The error register: the bits of all errors; bit 0 whenever there is one."""
        if self._own_register:
            return integer_value(self.objects, REGISTER)
        bits = 0
        for more in self._active.values():
            bits |= more | 1
        return bits

    @property
    def deadline(self) -> float | None:
        """When the inhibit time is over for what waits."""
        return self._free_at if self._waiting else None

    def come(
        self, code: int, now: float, *, source: Hashable = None, info: bytes = b"", register: int | None = None
    ) -> list[CanFrame]:
        """An error has come. `register` are its bits of 1001h, by default those of the class of its code."""
        if (code, source) in self._active:
            return []
        self._active[code, source] = register_of(code) if register is None else register
        self._history.appendleft(code | int.from_bytes(info[:2], "little") << 16)
        return self._say(code, info, now)

    def gone(self, code: int, now: float, *, source: Hashable = None, info: bytes = b"") -> list[CanFrame]:
        """An error is gone: code 0000h, with the register that is left."""
        if self._active.pop((code, source), None) is None:
            return []
        return self._say(0, info, now)

    def reset(self, communication_only: bool) -> None:
        """A reset: nothing is said. Reset communication forgets the errors of the communication only."""
        self._waiting.clear()
        if communication_only:
            self._active = {key: bits for key, bits in self._active.items() if key[0] not in COMMUNICATION_ERRORS}
        else:
            self._active.clear()
            self._history.clear()

    def feed(self, item: None, now: float) -> list[CanFrame]:
        """What had to wait, one message for each inhibit time."""
        if not self.allowed:
            self._waiting.clear()
        if not self._waiting or now < self._free_at:
            return []
        inhibit = integer_value(self.objects, INHIBIT) / 10_000
        if inhibit:
            self._free_at = now + inhibit
            return [self._waiting.popleft()]
        said = list(self._waiting)
        self._waiting.clear()
        return said

    def _say(self, code: int, info: bytes, now: float) -> list[CanFrame]:
        if not self.allowed:
            return []
        entry = CobEntry.unpack(integer_value(self.objects, COB_ID, default=cob_id("EMCY", self.node)))
        if entry.bit31:
            return []
        frame = Emergency(self.node, code, self.register, info).encode()
        if len(self._waiting) >= _WAITING_MAX:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(frame._replace(id=entry.identifier, extended=entry.extended))
        return self.feed(None, now)
