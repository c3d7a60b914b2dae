"""The CAN broadcast manager of the Linux kernel: cyclic frames that the kernel sends.   [Linux, can.rst, CAN_BCM]

        opcode   flags    count      interval 1   interval 2          identifier   frames       struct bcm_msg_head,
        01000000 03000000 00000000   0 s 0 us     0 s 10000 us        80000000     01000000     56 bytes on 64 bits
        80000000 00 000000 0000000000000000                                           struct can_frame, 16 bytes
         |
         1 TX_SETUP: send these frames in turn, one each interval 2, the first one at once
         2 TX_DELETE: send them no longer

A timer of the kernel keeps the interval, also while the program computes, waits or stands still. It ends with the
socket, and so with the program. Raw sockets of the same computer receive these frames as if another node had sent them.
The kernel does not report a frame for which the controller had no room.
"""

from __future__ import annotations

import errno
import socket
from collections.abc import Sequence
from struct import Struct

from barewire.canopen.frame import CanFrame
from barewire.errors import EncodeError, PortError
from barewire.io.ports.network import reason

MOST_FRAMES = 256
SHORTEST_PERIOD = 0.0001
"""Seconds: less than two frames take at 1 Mbit/s, and a timer that is much faster occupies the processor."""

_HEAD = Struct("@IIIllllII")  # opcode, flags, count, twice (seconds, microseconds), identifier, number of frames
_PADDING = bytes(-_HEAD.size % 8)  # the frames behind it are aligned to 8 bytes
_FRAME = Struct("=IB3x8s")
_TX_SETUP, _TX_DELETE = 1, 2
_SET_TIMER, _START_TIMER = 1, 2
_EXTENDED, _REMOTE = 0x8000_0000, 0x4000_0000
_GONE = (errno.ENODEV, errno.ENXIO, errno.ENOTCONN)
"""The interface was removed; the socket cannot be used again."""


def setup_message(frames: Sequence[CanFrame], period: float | None) -> bytes:
    """Return the message that starts to send frames in turn, every `period` seconds; without a period, the one that
    replaces frames that are sent already. Below: 10,000 us, identifier 80h, 1 frame, and the frame.

    >>> setup_message([CanFrame.parse("080#01")], 0.01)[-32:].hex(" ", 4)
    '10270000 00000000 80000000 01000000 80000000 01000000 01000000 00000000'
    """
    microseconds = 0 if period is None else round(period * 1e6)
    flags = 0 if period is None else _SET_TIMER | _START_TIMER
    interval = divmod(microseconds, 1_000_000)
    head = _HEAD.pack(_TX_SETUP, flags, 0, 0, 0, *interval, _identifier(frames[0]), len(frames))
    return head + _PADDING + b"".join(map(_packed, frames))


def delete_message(frame: CanFrame) -> bytes:
    """Return the message that ends the sending of frames the first of which is this one."""
    return _HEAD.pack(_TX_DELETE, 0, 0, 0, 0, 0, 0, _identifier(frame), 0) + _PADDING


def _identifier(frame: CanFrame) -> int:
    return frame.id | (_EXTENDED if frame.extended else 0)


def _packed(frame: CanFrame) -> bytes:
    if frame.remote:
        return _FRAME.pack(_identifier(frame) | _REMOTE, frame.requested, b"")
    return _FRAME.pack(_identifier(frame), len(frame.data), frame.data)


def check_cycle(frames: Sequence[CanFrame], period: float) -> None:
    """Raise EncodeError for frames or a period that the kernel does not take."""
    if not period >= SHORTEST_PERIOD:
        raise EncodeError(f"period {period:g} s: expected {SHORTEST_PERIOD:g} or more, for the kernel", "period")
    if len(frames) > MOST_FRAMES:
        raise EncodeError(f"{len(frames)} frames: expected {MOST_FRAMES} or fewer, for the kernel", "frames")


class BroadcastManager:
    """The frames that the kernel sends for one producer, on one interface."""

    def __init__(self, channel: str, *, opened: socket.socket | None = None) -> None:
        """Connect to an interface, such as can0. `opened` is used in place of a CAN_BCM socket.

        Raises PortError; NoBroadcastManager if the system has none.
        """
        self.place = f"can://socketcan/{channel}"
        self._channel = channel
        self._sent: tuple[tuple[CanFrame, ...], float] | None = None  # the frames that the kernel sends, their period
        self._socket = self._open() if opened is None else opened
        self._socket.setblocking(False)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.place}>"

    def _open(self) -> socket.socket:
        if not hasattr(socket, "CAN_BCM"):
            raise NoBroadcastManager("CAN_BCM is a part of Linux, and this is another system")
        try:
            opened = socket.socket(socket.AF_CAN, socket.SOCK_DGRAM, socket.CAN_BCM)
        except OSError as error:
            raise NoBroadcastManager(f"the kernel has no CAN_BCM: modprobe can_bcm ({reason(error)})") from None
        try:
            opened.connect((self._channel,))
        except OSError as error:
            opened.close()
            raise PortError(self._failure(error)) from None
        return opened

    def send(self, frames: tuple[CanFrame, ...], period: float) -> None:
        """Have the kernel send these frames, in place of those before. Raises EncodeError, PortError.

        If only the data differ, the interval goes on, and the new data are sent at its end.
        """
        if (frames, period) == self._sent:
            return
        check_cycle(frames, period)
        sent, self._sent = self._sent, None  # unknown, if an error comes between two messages
        sent_frames, sent_period = sent or ((), None)
        try:
            if sent_period == period and [frame.key for frame in sent_frames] == [frame.key for frame in frames]:
                self._socket.send(setup_message(frames, None))
            else:
                if sent_frames:
                    self._socket.send(delete_message(sent_frames[0]))
                self._socket.send(setup_message(frames, period))
        except OSError as error:
            raise PortError(self._failure(error)) from None
        self._sent = frames, period

    def check(self) -> None:
        """Raise PortError if the interface went down since the last call, or is gone: then `reopen`."""
        try:
            self._socket.recv(128)
        except BlockingIOError:
            pass
        except OSError as error:
            if error.errno in _GONE:
                self._sent = None
            raise PortError(self._failure(error)) from None

    @property
    def is_sending(self) -> bool:
        """Whether the kernel has frames to send. It has none after the interface was removed."""
        return self._sent is not None

    def reopen(self) -> None:
        """Connect to the interface again, after it was removed. Raises PortError."""
        opened = self._open()
        opened.setblocking(False)
        self._socket.close()
        self._socket = opened

    def _failure(self, error: OSError) -> str:
        """Return what went wrong, and what to do."""
        if error.errno == errno.ENETDOWN:
            return f"{self.place}: the interface is down; the kernel sends on when it is up"
        if error.errno in _GONE:
            return f"{self.place}: the interface is gone: was the adapter unplugged?"
        if error.errno in (errno.ENOBUFS, errno.ENOMEM):
            return f"{self.place}: the kernel has no room for cyclic frames ({reason(error)})"
        return f"{self.place}: cyclic frames: {reason(error)}"

    def close(self) -> None:
        """Have the kernel send no further frame. The message ends it also if a forked process has the socket too."""
        frames, _ = self._sent or ((), None)
        self._sent = None
        try:
            if frames:
                self._socket.send(delete_message(frames[0]))
        except OSError:
            pass  # the interface is gone
        finally:
            self._socket.close()


class NoBroadcastManager(PortError):
    """The system has no broadcast manager."""
