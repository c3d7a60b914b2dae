"""EMCY: emergency messages, sent once when an error occurs and once when it is cleared.   [CiA 301, EMCY]

        080h+n | error code 2 | error register 1 | manufacturer 5 |      8 bytes, numbers little-endian

        30 81 11 02 00 00 00 00      8130h heartbeat lost, register 11h (generic, communication), node 2 in byte 3

The *producer* keeps the active errors of a device, its error register and its error history:

                 error(8130h)         error(3210h)         error_gone(8130h)     error_gone(3210h)
        080h+n   30 81 | 11           10 32 | 15           00 00 | 05            00 00 | 00
        1001h    generic, commun.     + voltage            generic, voltage      no bits
        1003h    8130h                3210h, 8130h         (a cleared error stays in the history)
        active   {8130h}              {8130h, 3210h}       {3210h}               {}

The *consumer* has the same set of each other node. A message 0000h does not name the error that is cleared: it clears
those whose bit is no longer set in its register; register 00h clears all errors.

The same error from two sources (two PDOs that are too short) counts as two errors. Two messages are at least the
inhibit time 1015h apart; waiting messages keep their order and the register that they were made with. In NMT states
without EMCY (STOPPED) nothing is sent, but register and history are kept up to date.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import classify, cob_id
from barewire.canopen.communication_objects import (
    integer_value,
    replace_entry,
    service_cob_id,
    validate_cob_id_writes,
    validate_writes,
)
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import reported_state
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.codecs import Layout
from barewire.errors import DecodeError, EncodeError, shown

# Keys are four digits, or the first two: 3210h is found as 32, a voltage inside the device.
ERROR_CODES: dict[str, str] = {
    "00": "no error, or an error is gone",
    "10": "generic error",
    "20": "current",
    "21": "current, on the input side of the device",
    "22": "current, inside the device",
    "23": "current, on the output side of the device",
    "30": "voltage",
    "31": "mains voltage",
    "32": "voltage inside the device",
    "33": "output voltage",
    "40": "temperature",
    "41": "ambient temperature",
    "42": "device temperature",
    "50": "hardware of the device",
    "60": "software of the device",
    "61": "internal software",
    "62": "user software",
    "63": "data set",
    "70": "additional modules",
    "80": "monitoring",
    "81": "communication",
    "8110": "CAN overrun, objects lost",
    "8120": "CAN error passive",
    "8130": "life guarding or heartbeat error",
    "8140": "recovered from bus-off",
    "8150": "CAN-ID collision",
    "82": "protocol error",
    "8210": "PDO not processed: too short",
    "8220": "PDO longer than mapped",
    "8230": "destination of a DAM MPDO not available",
    "8240": "unexpected length of SYNC",
    "8250": "RPDO timeout",
    "90": "external error",
    "F0": "additional functions",
    "FF": "device specific",
}

REGISTER_BITS = ("generic", "current", "voltage", "temperature", "communication", "device profile", "", "manufacturer")
"""The bits of the error register 1001h, bit 0 first. Bit 6 is reserved."""


def error_text(code: int) -> str:
    """Return the meaning of an error code: the most specific entry of the table.

    >>> error_text(0x8130)
    'life guarding or heartbeat error'
    >>> error_text(0x3210)
    'voltage inside the device'
    """
    digits = f"{code:04X}"
    group = f"{digits[0]}0" if digits[0] in "2345678" else ""
    for beginning in (digits, digits[:2], group):
        if beginning in ERROR_CODES:
            return ERROR_CODES[beginning]
    return "unknown error code"


def register_names(register: int) -> tuple[str, ...]:
    """Return the set bits of an error register in words.

    >>> register_names(0x11)
    ('generic', 'communication')
    """
    return tuple(name or "reserved" for bit, name in enumerate(REGISTER_BITS) if register >> bit & 1)


_CLASS_BITS = {2: 1, 3: 2, 4: 3, 8: 4}
"""First digit of a code -> bit of the register; all other classes have only the generic bit."""


def register_of(code: int) -> int:
    """Return the bits of the error register that an error of this code sets: the bit of its class, and the generic bit.

    >>> register_names(register_of(0x3210)), register_names(register_of(0xFF01)), register_names(register_of(0x6100))
    (('generic', 'voltage'), ('generic', 'manufacturer'), ('generic',))
    """
    if code >> 8 == 0xFF:
        return 0x81
    bit = _CLASS_BITS.get(code >> 12)
    return 1 if bit is None or code >> 8 == 0x80 else 1 | 1 << bit


@dataclass(frozen=True, slots=True)
class Emergency:
    """One emergency message of one node.

        080h+n | code 2 | register 1 | info 5

    >>> str(Emergency(5, 0x8130, 0x11, b"\\x02").encode())
    '085#3081110200000000'
    """

    node: int
    code: int
    register: int = 0
    info: bytes = b"\0\0\0\0\0"
    padded: bool = False  # received with fewer than 8 bytes

    layout = Layout("<HB", "code", "register", tail="info")

    @property
    def text(self) -> str:
        """The meaning of the code."""
        return error_text(self.code)

    def encode(self) -> CanFrame:
        """Return the frame on 080h+n. Raise EncodeError for more than 5 bytes of manufacturer information."""
        _check_info(self.info)
        return CanFrame(
            cob_id("EMCY", self.node), self.layout.pack(self.code, self.register, tail=self.info.ljust(5, b"\0"))
        )

    @classmethod
    def decode(cls, frame: CanFrame) -> Emergency:
        """Decode a frame. A short message, as some devices send it, is filled with zeros and marked `padded`.

        Raise DecodeError for another identifier and for a frame without a whole error code.
        """
        service_and_node = classify(frame)
        if service_and_node is None or service_and_node[0].name != "EMCY" or frame.remote:
            raise DecodeError("mismatch", frame.data, 0, f"{frame} is not an emergency message")
        if len(frame.data) < 2:
            raise DecodeError("short", frame.data, len(frame.data), "the error code needs bytes 0..1")
        code, register, info = cls.layout.unpack(frame.data.ljust(8, b"\0"))
        return cls(service_and_node[1], code, register, info, padded=len(frame.data) < 8)


def _check_info(info: bytes) -> None:
    if len(info) > 5:
        raise EncodeError(f"{len(info)} bytes of manufacturer information: expected at most 5")


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
    deadline = None  # nothing is timed

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
        # node -> code -> the register bits that are set while the error is active
        self._active: dict[int, dict[int, int]] = {}
        self._registers: dict[int, int] = {}

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
            errors.pop(message.code, None)  # then it is the newest again
            errors[message.code] = register_of(message.code) & ~_GENERIC or _GENERIC
            if len(errors) > ERRORS_MAX:
                del errors[next(iter(errors))]
        else:
            gone = [code for code, bits in errors.items() if not bits & message.register]
        for code in gone:
            del errors[code]
        # A register that a short message leaves out is not 00h.
        if message.register or not message.padded:
            self._registers[message.node] = message.register
        return EmcyEvent(message, tuple(gone), tuple(errors), now)

    def _clear_on_boot_up(self, frame: CanFrame) -> None:
        received = reported_state(frame)
        if received is not None and received.is_boot_up:
            self._active.pop(received.node, None)
            self._registers.pop(received.node, None)


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

        Raises EncodeError, and records nothing, for a code or register that is not a whole number of 16 or 8 bits, and
        for more than 5 bytes of `info`.
        """
        _check_info(info)
        for name, number, limit in (("code", code, 0xFFFF), ("register", register, 0xFF)):
            is_default = number is None and name == "register"
            if not is_default and not (isinstance(number, int) and 0 <= number <= limit):
                raise EncodeError(f"{name} = {shown(number)}: expected a whole number in 0..{limit:X}h")
        if (code, source) in self._active:
            return []
        self._active[code, source] = register_of(code) if register is None else register
        self._history.appendleft(code | int.from_bytes(info[:2], "little") << 16)
        return self._send(code, info, now)

    def error_gone(self, code: int, now: float, *, source: Hashable = None, info: bytes = b"") -> list[CanFrame]:
        """Clear an error and return the message 0000h with the remaining register. Raises EncodeError, and clears
        nothing, for more than 5 bytes of `info`."""
        _check_info(info)
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
        entry = service_cob_id(self.objects, _COB_ID, cob_id("EMCY", self.node))
        if entry.bit31:
            return []
        frame = Emergency(self.node, code, self.register, info).encode()
        if len(self._waiting) >= WAITING_MAX:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(frame._replace(id=entry.identifier, extended=entry.extended))
        return self.feed(None, now)
