"""Lely CANopen by ctypes: a device from the text of a DCF, frames, and time that is an argument.

node = Node(rows, 5)          objects as a case has them, node-ID
node.feed("605#40..."); node.run_to(1000)
node.said()                   the frames that it sent since the last call
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterable
from typing import Any

from adapter import NotOffered, octets
from adapter_canopen import placed

LELY = ctypes.CDLL(sys.argv[1])


class Msg(ctypes.Structure):
    """A frame; flags: 1 an extended identifier, 2 remote."""

    _fields_ = [
        ("id", ctypes.c_uint32),
        ("flags", ctypes.c_uint8),
        ("len", ctypes.c_uint8),
        ("data", ctypes.c_uint8 * 64),
    ]


class Timespec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


POINTERS = "can_net_create co_dev_create_from_dcf_text co_nmt_create co_nmt_get_lss co_nmt_get_emcy"
POINTERS += " co_nmt_get_tpdo co_dev_get_val"
for name in POINTERS.split():
    getattr(LELY, name).restype = ctypes.c_void_p
SEND = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(Msg), ctypes.c_void_p)
NEXT = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(Timespec), ctypes.c_void_p)

_NAMES = (
    "BOOLEAN INTEGER8 INTEGER16 INTEGER32 UNSIGNED8 UNSIGNED16 UNSIGNED32 REAL32 VISIBLE_STRING "
    "OCTET_STRING UNICODE_STRING TIME_OF_DAY TIME_DIFFERENCE - DOMAIN INTEGER24 REAL64 INTEGER40 "
    "INTEGER48 INTEGER56 INTEGER64 UNSIGNED24 - UNSIGNED40 UNSIGNED48 UNSIGNED56 UNSIGNED64 "
)
TYPES = _NAMES.split()
"""The types of CiA 301, from 0001h on."""

RESET_NODE = 0x81


def section(name: str, row: dict[str, Any]) -> list[str]:
    """Return the lines of a DCF for a variable."""
    lines = [f"[{name}]", f"ParameterName={name}", "ObjectType=0x07", f"DataType=0x{TYPES.index(row['type']) + 1:04X}"]
    lines.append(f"AccessType={row['access']}")
    if "value" in row and row["type"] != "DOMAIN":
        value = row["value"]
        lines.append(f"DefaultValue={value.replace(' ', '') if row['type'] == 'OCTET_STRING' else value}")
    lines += [f"{key}={row[field]}" for key, field in (("LowLimit", "low"), ("HighLimit", "high")) if field in row]
    lines.append(f"PDOMapping={int(row.get('mapped', 'no') != 'no')}")
    return lines


def dcf(rows: Iterable[dict[str, Any]], *, lss: bool) -> str:
    """Return the text of a DCF with these objects."""
    objects = placed(rows)
    records = {index for index, sub in objects if sub}
    lines = [
        "[DeviceInfo]",
        f"LSS_Supported={int(lss)}",
        *(f"BaudRate_{rate}=1" for rate in (10, 20, 50, 125, 250, 500, 800, 1000)),
    ]
    lines += ["[DummyUsage]", *(f"Dummy{number:04X}=1" for number in range(1, 8))]
    indices = sorted({index for index, _ in objects})
    lines += ["[OptionalObjects]", f"SupportedObjects={len(indices)}"]
    lines += [f"{at}=0x{index:04X}" for at, index in enumerate(indices, 1)]
    for index in indices:
        subs = sorted(sub for one, sub in objects if one == index)
        if index not in records:
            lines += section(f"{index:04X}", objects[index, 0])
            continue
        kind = "0x08" if index in (0x1003, 0x1010, 0x1011, 0x1016) else "0x09"
        lines += [f"[{index:04X}]", f"ParameterName={index:04X}", f"ObjectType={kind}", f"SubNumber={len(subs)}"]
        for sub in subs:
            lines += section(f"{index:04X}sub{sub:X}", objects[index, sub])
    return "\n".join(lines) + "\n"


class Node:
    """A network with one node, at time 0."""

    def __init__(self, rows: Iterable[dict[str, Any]], node: int | None, *, lss: bool = False) -> None:
        self.sent: list[str] = []
        self.next: int | None = None
        self.now = 0
        self.callbacks: list[Any] = [SEND(self._send), NEXT(self._next)]
        self.net = ctypes.c_void_p(LELY.can_net_create())
        self.set_time(0)
        LELY.can_net_set_send_func(self.net, self.callbacks[0], None)
        LELY.can_net_set_next_func(self.net, self.callbacks[1], None)
        text = dcf(rows, lss=lss).encode("latin-1")
        self.dev = ctypes.c_void_p(LELY.co_dev_create_from_dcf_text(text, None, None))
        if not self.dev.value:
            raise NotOffered("it takes no device with these objects")
        LELY.co_dev_set_id(self.dev, node or 255)
        LELY.co_dev_set_lss(self.dev, int(lss))
        self.nmt = ctypes.c_void_p(LELY.co_nmt_create(self.net, self.dev))

    def _send(self, msg: Any, _data: Any) -> int:
        one = msg.contents
        ident = f"{one.id:08X}" if one.flags & 1 else f"{one.id:03X}"
        self.sent.append(
            f"{ident}#R{one.len}" if one.flags & 2 else f"{ident}#{bytes(one.data[: one.len]).hex().upper()}"
        )
        return 0

    def _next(self, when: Any, _data: Any) -> int:
        self.next = when.contents.seconds * 1_000_000 + when.contents.nanoseconds // 1000
        return 0

    def start(self) -> None:
        """Switch it on."""
        if LELY.co_nmt_cs_ind(self.nmt, RESET_NODE):
            raise NotOffered("it does not start with these objects")

    def set_time(self, microseconds: int) -> None:
        self.now = microseconds
        when = Timespec(*divmod(microseconds, 1_000_000))
        when.nanoseconds *= 1000
        LELY.can_net_set_time(self.net, ctypes.byref(when))

    def run_to(self, microseconds: int) -> None:
        """Let time pass, from timer to timer."""
        while self.next is not None and self.next <= microseconds:
            due, self.next = self.next, None
            self.set_time(max(due, self.now))
        self.set_time(microseconds)

    def feed(self, line: str) -> None:
        """Let a frame arrive."""
        ident, _, text = line.partition("#")
        remote, data = text.startswith("R"), b"" if text.startswith("R") else octets(text)
        msg = Msg(int(ident, 16), (1 if len(ident) > 3 else 0) | (2 if remote else 0))
        msg.len = int(text[1:] or 0) if remote else len(data)
        msg.data[: len(data)] = list(data)
        LELY.can_net_recv(self.net, ctypes.byref(msg))

    def said(self) -> list[str]:
        lines, self.sent = self.sent, []
        return lines

    def close(self) -> None:
        LELY.co_nmt_destroy(self.nmt)
        LELY.co_dev_destroy(self.dev)
        LELY.can_net_destroy(self.net)
