"""The EMCY producer: the active errors of a device as emergencies, error register and error history.   [CiA 301, EMCY]

                 error(8130h)         error(3210h)         error_gone(8130h)     error_gone(3210h)
        080h+n   30 81 | 11           10 32 | 15           00 00 | 05            00 00 | 00
        1001h    generic, commun.     + voltage            generic, voltage      no bits
        1003h    8130h                3210h, 8130h         (a cleared error stays in the history)

An emergency is sent once when an error occurs and once when it is cleared; the same error from two sources (two PDOs
that are too short) counts as two errors. Two messages are at least the inhibit time 1015h apart; waiting messages keep
their order and the register that they were made with. In NMT states without EMCY (STOPPED) nothing is sent, but
register and history are kept up to date.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import replace
from functools import partial

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import CobEntry, cob_id
from barewire.canopen.communication_objects import integer_value, replace_entry, validate_cob_id_writes, validate_writes
from barewire.canopen.emcy.message import Emergency, register_of
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.errors import EncodeError, shown

_REGISTER, _HISTORY, _COB_ID, _INHIBIT = 0x1001, 0x1003, 0x1014, 0x1015
_COMMUNICATION_ERRORS = range(0x8000, 0x9000)
WAITING_MAX = 32
"""How many emergencies may wait for the inhibit time. If there are more, the oldest are dropped and counted."""


class EmcyProducer:
    """The active errors of one device. A machine: `feed` returns the messages that had to wait.

    If the dictionary has them, 1001h and 1003h show register and history, and 1014h and 1015h configure the messages.
    An error register with an `on_read` of its own, computed by the application, is sent as it is.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> errors = EmcyProducer(5, ObjectDictionary([Entry(0x1001, 0, "error register", "u8", "ro")]))
    >>> [str(frame) for frame in errors.error(0x8130, 0.0, info=b"\\x02") + errors.error_gone(0x8130, 1.0)]
    ['085#3081110200000000', '085#0000000000000000']
    """

    __slots__ = ("_active", "_free_at", "_history", "_own_register", "_waiting", "allowed", "dropped", "node",
                 "objects")  # fmt: skip

    def __init__(self, node: int, objects: ObjectDictionary) -> None:
        self.node = node
        self.objects = objects
        self.allowed = True  # whether the NMT state allows emergencies
        self.dropped = 0
        self._active: dict[tuple[int, Hashable], int] = {}  # (code, source) -> register bits
        self._history: deque[int] = deque(maxlen=max(objects.subs(_HISTORY), default=8) or 8)
        self._waiting: deque[CanFrame] = deque()
        self._free_at = float("-inf")
        self._own_register = (_REGISTER, 0) in objects and objects.entry(_REGISTER).on_read is not None
        self._attach()

    def _attach(self) -> None:
        """Connect the objects with this producer."""
        objects = self.objects
        if (_REGISTER, 0) in objects and not self._own_register:
            replace_entry(objects, replace(objects.entry(_REGISTER), on_read=lambda: self.register))
        for sub in objects.subs(_HISTORY):
            entry = objects.entry(_HISTORY, sub)
            if sub == 0:
                replace_entry(objects, replace(entry, access="rw", on_read=lambda: len(self._history)))
                validate_writes(objects, _HISTORY, 0, self._clear)
            else:
                replace_entry(objects, replace(entry, on_read=partial(self._past, sub)))
        validate_cob_id_writes(objects, _COB_ID, lambda entry: not entry.bit31)
        self.renumber(self.node)

    def renumber(self, node: int) -> None:
        """Change the node-ID. A 1014h that is 80h, or the default for the previous node-ID, becomes the new default."""
        if integer_value(self.objects, _COB_ID) in (cob_id("SYNC"), cob_id("EMCY", self.node)):
            self.objects.replace(replace(self.objects.entry(_COB_ID), default=cob_id("EMCY", node)))
        self.node = node

    def _past(self, sub: int) -> int:
        if sub > len(self._history):
            raise SdoAbort(AbortCode.NO_DATA, _HISTORY, sub)
        return self._history[sub - 1]

    def _clear(self, value: int) -> None:
        if value:
            raise SdoAbort(AbortCode.INVALID_VALUE, _HISTORY, 0)
        self._history.clear()

    @property
    def active(self) -> tuple[int, ...]:
        """The codes of the active errors."""
        return tuple(code for code, _ in self._active)

    @property
    def history(self) -> tuple[int, ...]:
        """The past errors, the newest first: code in bits 0 to 15, the first two bytes of `info` above."""
        return tuple(self._history)

    @property
    def register(self) -> int:
        """The error register: the bits of all active errors, and bit 0 whenever there is one."""
        if self._own_register:
            return integer_value(self.objects, _REGISTER) & 0xFF
        bits = 0
        for error_bits in self._active.values():
            bits |= error_bits | 1
        return bits

    @property
    def deadline(self) -> float | None:
        """When the inhibit time ends for a waiting message."""
        return self._free_at if self._waiting else None

    def error(
        self, code: int, now: float, *, source: Hashable = None, info: bytes = b"", register: int | None = None
    ) -> list[CanFrame]:
        """Record an error and return its emergency. `register` are its bits of 1001h; default: those of its class.

        Raises EncodeError, and records nothing, for a code or register that is not a whole number of 16 or 8 bits.
        """
        for name, number, limit in (("code", code, 0xFFFF), ("register", register, 0xFF)):
            whole = isinstance(number, int) and 0 <= number <= limit
            if not whole and not (number is None and name == "register"):
                raise EncodeError(f"{name} = {shown(number)}: expected a whole number in 0..{limit:X}h")
        if (code, source) in self._active:
            return []
        self._active[code, source] = register_of(code) if register is None else register
        self._history.appendleft(code | int.from_bytes(info[:2], "little") << 16)
        return self._send(code, info, now)

    def error_gone(self, code: int, now: float, *, source: Hashable = None, info: bytes = b"") -> list[CanFrame]:
        """Clear an error and return the message 0000h with the remaining register."""
        if self._active.pop((code, source), None) is None:
            return []
        return self._send(0, info, now)

    def reset(self, communication_only: bool) -> None:
        """Clear the errors without messages, because of a reset; with `communication_only` those of the class 8xxxh."""
        self._waiting.clear()
        if communication_only:
            self._active = {key: bits for key, bits in self._active.items() if key[0] not in _COMMUNICATION_ERRORS}
        else:
            self._active.clear()
            self._history.clear()

    def feed(self, item: None, now: float) -> list[CanFrame]:
        """Return the waiting messages that may be sent now: one in each inhibit time."""
        if not self.allowed:
            self._waiting.clear()
        if not self._waiting or now < self._free_at:
            return []
        inhibit = integer_value(self.objects, _INHIBIT) / 10_000
        if inhibit:
            self._free_at = now + inhibit
            return [self._waiting.popleft()]
        frames = list(self._waiting)
        self._waiting.clear()
        return frames

    def _send(self, code: int, info: bytes, now: float) -> list[CanFrame]:
        if not self.allowed:
            return []
        entry = CobEntry.unpack(integer_value(self.objects, _COB_ID, default=cob_id("EMCY", self.node)))
        if entry.bit31:
            return []
        frame = Emergency(self.node, code, self.register, info).encode()
        if len(self._waiting) >= WAITING_MAX:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(frame._replace(id=entry.identifier, extended=entry.extended))
        return self.feed(None, now)
