"""A CAN bus of Linux (SocketCAN) by the standard library alone.                                [Linux, can.rst]

identifier, flags   length   padding   data                          struct can_frame, 16 bytes
05 06 00 00         08       00 00 00  40 00 10 00 00 00 00 00       605#4000100000000000
         ^ 80h extended, 40h remote, 20h a report of the controller
"""

from __future__ import annotations

import errno
import socket
import struct
import time

from barewire.canopen.frame import CanFrame
from barewire.errors import PortError
from barewire.io.ports.network import LONGEST_WAIT, reason

_FRAME = struct.Struct("=IB3x8s")
_EXTENDED, _REMOTE, _REPORT = 0x8000_0000, 0x4000_0000, 0x2000_0000
_NUMBER = 0x1FFF_FFFF
_SEND_TIMEOUT = 1.0
"""Seconds that a frame waits for room in the controller: a full bus empties the longest queue sooner."""


class CanPort:
    """An interface such as "can0", which `ip link set can0 up type can bitrate 500000` has started."""

    def __init__(self, interface: str) -> None:
        self.name = interface
        if not hasattr(socket, "AF_CAN"):
            raise PortError(f"{interface}: this system has no SocketCAN")
        try:
            self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        except OSError as error:
            raise PortError(f"{interface}: {reason(error)}") from None
        try:
            self._socket.bind((interface,))
        except OSError as error:
            self.close()
            raise PortError(f"{interface}: {reason(error)}") from None

    def send(self, item: CanFrame) -> None:
        """Hand a frame to the controller."""
        identifier = item.id | (_EXTENDED if item.extended else 0) | (_REMOTE if item.remote else 0)
        data = _FRAME.pack(identifier, item.requested if item.remote else len(item.data), item.data)
        until = time.monotonic() + _SEND_TIMEOUT
        while True:
            try:
                self._socket.send(data)
                return
            except OSError as error:
                if error.errno != errno.ENOBUFS or time.monotonic() >= until:
                    raise PortError(f"{self.name}: {reason(error)}") from None
            time.sleep(0.001)

    def receive(self, timeout: float) -> CanFrame | None:
        """Return the next frame, or None after `timeout` seconds. Reports of the controller are passed over."""
        until = time.monotonic() + timeout
        while True:
            try:
                self._socket.settimeout(min(max(0.0, until - time.monotonic()), LONGEST_WAIT))
                data = self._socket.recv(_FRAME.size)
            except (TimeoutError, BlockingIOError):
                return None
            except OSError as error:
                raise PortError(f"{self.name}: {reason(error)}") from None
            identifier, length, body = _FRAME.unpack(data)
            if not identifier & _REPORT:
                remote = bool(identifier & _REMOTE)
                content = b"" if remote else body[:length]
                return CanFrame(identifier & _NUMBER, content, identifier >= _EXTENDED, remote, length if remote else 0)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
