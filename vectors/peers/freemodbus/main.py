"""FreeModbus (C) as an adapter: its receivers of RTU and ASCII in virtual time, called by ctypes.

peer.toml builds its receivers with port.c, whose variables are the byte that the line has received, the last event, and
the timer.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from ctypes import POINTER, byref, c_bool, c_int, c_ubyte, c_uint32, c_ushort
from typing import Any

from adapter import NotOffered, checksums, hexed, octets, serve

LIBRARY = ctypes.CDLL(sys.argv[1])
BYTE, EVENT = c_ubyte.in_dll(LIBRARY, "port_byte"), c_int.in_dll(LIBRARY, "port_event")
TIMER, TICKS = c_int.in_dll(LIBRARY, "port_timer"), c_uint32.in_dll(LIBRARY, "port_timer_50us")
LIBRARY.usMBCRC16.restype = c_ushort
READY, RECEIVED = 0, 1
ASCII_TIMEOUT = 1_000_000
"""MB_ASCII_TIMEOUT_SEC."""


class Receiver:
    """A receiver of the library; times are in microseconds."""

    def __init__(self, line: str, baud: int) -> None:
        names = {"rtu": ("RTUTimerT35Expired", "RTUReceiveFSM"), "ascii": ("ASCIITimerT1SExpired", "ASCIIReceiveFSM")}
        self.expired, self.received = (getattr(LIBRARY, f"xMB{name}") for name in names[line])
        for function in (self.expired, self.received):
            function.restype = c_bool
        stem = f"eMB{line.upper()}"
        self.take_frame: Callable[..., int] = getattr(LIBRARY, f"{stem}Receive")
        getattr(LIBRARY, f"{stem}Init")(c_ubyte(1), c_ubyte(0), c_uint32(baud), c_int(0), c_ubyte(1))
        getattr(LIBRARY, f"{stem}Start")()
        self.silence = TICKS.value * 50 if line == "rtu" else ASCII_TIMEOUT
        self.since, self.frames = 0.0, []  # type: ignore[var-annotated]
        if TIMER.value:
            self.expired()  # the silence before the first byte
        EVENT.value = -1

    def wait(self, until: float) -> None:
        """Let the time pass."""
        if TIMER.value and until - self.since >= self.silence:
            self.expired()
            self.look()

    def feed(self, byte: int, end: float) -> None:
        """Take a byte whose last bit was there at `end`."""
        BYTE.value = byte
        self.received()
        self.since = end
        self.look()

    def look(self) -> None:
        """Take a frame if there is one."""
        event, EVENT.value = EVENT.value, -1
        if event != RECEIVED:
            return
        unit, start, length = c_ubyte(), POINTER(c_ubyte)(), c_ushort()
        if self.take_frame(byref(unit), byref(start), byref(length)) == 0:
            self.frames.append({"unit": unit.value, "pdu": hexed(start[: length.value])})


def rtu(question: dict[str, Any]) -> dict[str, Any]:
    line = question["line"]
    character = line["bits"] * 1e6 / line["baud"]
    receiver, last = Receiver("rtu", line["baud"]), 0.0
    for step in question["talk"]:
        data = octets(step.get("hear", ""))
        begin = step["at"] - len(data) * character
        if data and line["patience"] and receiver.silence <= begin - last <= line["patience"] and last:
            raise NotOffered("it is not patient: silence ends a frame")
        if not data:
            receiver.wait(step["at"])
        for at, byte in enumerate(data, 1):
            receiver.wait(begin + (at - 1) * character)
            receiver.feed(byte, begin + at * character)
        last = step["at"] if data else last
    receiver.wait(float("inf"))
    return {"frames": receiver.frames}


def ascii_line(question: dict[str, Any]) -> dict[str, Any]:
    line = question["line"]
    if line["timeout"] != ASCII_TIMEOUT or line["data_bits"] != 8:
        raise NotOffered("its time-out is one second, and its port reads seven data bits")
    receiver = Receiver("ascii", 9600)
    for step in question["talk"]:
        receiver.wait(step["at"])
        for byte in step.get("hear", "").encode("latin-1"):
            receiver.feed(byte, step["at"])
    receiver.wait(float("inf"))
    return {"frames": receiver.frames}


serve(
    "FreeModbus",
    {
        "rtu-talk": {"frames": rtu},
        "ascii-talk": {"frames": ascii_line},
        **checksums(lambda data: int(LIBRARY.usMBCRC16(data, c_ushort(len(data)))).to_bytes(2, "little")),
    },
)
