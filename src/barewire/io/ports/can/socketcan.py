"""A CAN bus of the Linux kernel: a raw socket of the standard library, without python-can.   [Linux, can.rst]

        identifier, flags   length   padding   data                          struct can_frame, 16 bytes
        05 06 00 00         08       00 00 00  40 00 10 00 00 00 00 00       605#4000100000000000
                 ^ 80h extended, 40h remote, 20h a report of the controller

The system keeps the time-out of a read (SO_RCVTIMEO), so a frame that arrives in time takes one call. When an interface
goes down the system reports that once to each socket, and is silent until it is up again; `receive` then raises
PortError each time. Frames for which the socket had no room are counted in `lost`: the system has the count
(SO_MEMINFO), which is read when many frames came one after the other.

A filter in a URL, and as the kernel gets it:

    filter=585,00000705      85 05 00 00  FF 07 00 80        (identifier, mask): a frame passes if it agrees in
                             05 07 00 80  FF FF FF 9F        the bits of the mask; bit 31 is that of extended frames
"""

from __future__ import annotations

import errno
import select
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from struct import Struct

from barewire.canopen.frame import BASE_MAX, EXTENDED_MAX, CanFrame, ErrorFrame, FdFrame
from barewire.errors import DecodeError, EncodeError, PortError, shown
from barewire.io.endpoint import CAN_OPTIONS, DEFAULT_BITRATE, Endpoint, unknown_option
from barewire.io.ports.base import send_when_room
from barewire.io.ports.network import UNPLUGGED, reason

SOCKETCAN_OPTIONS = frozenset({"receive_own_messages", "local_loopback", "fd", "filter", "receive_buffer"})
"""The options of can://socketcan endpoints, besides `CAN_OPTIONS`."""

_FRAME = Struct("=IB3x8s")
_FD_FRAME = Struct("=IBB2x")
_LONGEST = 72  # struct canfd_frame
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
_TIME = Struct("@ll")
_MARKS_ROOM = socket.CMSG_SPACE(_TIME.size) if hasattr(socket, "CMSG_SPACE") else 0
_MEMORY = Struct("=9I")  # the last one is SK_MEMINFO_DROPS

_FILTER = Struct("=II")

# Numbers that Python 3.11 has no names for. [Linux, asm-generic/socket.h, linux/can/raw.h]
_SOL_CAN_RAW = 101
_CAN_RAW_FILTER, _CAN_RAW_ERR_FILTER, _CAN_RAW_LOOPBACK, _CAN_RAW_RECV_OWN_MSGS, _CAN_RAW_FD_FRAMES = 1, 2, 3, 4, 5
_SO_RCVBUFFORCE = 33
_SO_TIMESTAMPNS, _SO_MEMINFO = 35, 55
_MSG_CONFIRM = 0x800  # "sent by this socket"; with MSG_DONTROUTE, 4, for all frames of this computer [can.rst 4.1.7]

_ROOM = 1 << 21
"""Bytes of the receive buffer; the system counts some 800 for a frame, and by default has room for 278."""
_FRAME_ROOM = 1024
"""Bytes of the receive buffer that a frame takes at most, in the count of the system."""
_LONGEST_BURST = 64
"""Frames one after the other after which `lost` is brought up to date, if the buffer holds so many."""
_LONGEST_WAIT = 3600.0
_SHORT = 0.02
"""Seconds below which `poll` waits: SO_RCVTIMEO has the resolution of the system's timer."""

_new = tuple.__new__
_pack, _unpack = _FRAME.pack, _FRAME.unpack
_NOW = socket.MSG_DONTWAIT if hasattr(socket, "MSG_DONTWAIT") else 0


class SocketCanPort:
    """An open SocketCAN interface.

    `others` counts error frames and CAN FD frames, which CANopen has not; `strange` keeps the latest. `lost` counts
    frames for which the buffer of the socket had no room. With `stamps`, or after `keep_times`, `received_at` is when
    the last frame arrived, in seconds since 1970, as the system recorded it. With the option `receive_own_messages`
    `is_own` is whether the last frame was sent here; `receive_others` leaves those out.
    """

    keeps_frames = True
    """The system holds a limited number of frames while nothing reads."""

    def __init__(self, endpoint: Endpoint, *, stamps: bool = False, opened: socket.socket | None = None) -> None:
        """`opened` is used in place of a raw CAN socket: any socket of datagrams, each of which is a frame."""
        channel = endpoint.place.partition("/")[2]
        check_socketcan_options(endpoint)
        self.name = endpoint.place
        self.others = self.garbled = self.lost = 0
        self.strange: deque[ErrorFrame | FdFrame] = deque(maxlen=64)
        self.received_at: float | None = None
        self.own_frames = flag(endpoint, "receive_own_messages")
        """Whether `receive` returns the frames that were sent here too."""
        self._in_a_row = 0
        self._dropped = 0
        self._waits = 0.0  # SO_RCVTIMEO of the socket, in seconds
        self._gone: str | None = None
        self._bring_up = f"ip link set {channel} up"
        if not channel.startswith("vcan"):
            self._bring_up += f" type can bitrate {endpoint.integer('bitrate', DEFAULT_BITRATE)}"
        try:
            self._socket = raw_socket(endpoint, channel) if opened is None else opened
        except OSError as error:
            raise PortError(f"can://{self.name}: {reason(error)}{self._how_to_make(channel, error)}") from None
        # Frames are lost while the buffer is full; after that at least half of it is read without a pause.
        half = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // (2 * _FRAME_ROOM)
        self._burst = max(1, min(_LONGEST_BURST, half))
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)
        self._send = self._socket.send
        self.is_own = False
        self._recv: Callable[..., bytes] = self._receive_with_marks if self.own_frames else self._socket.recv
        if stamps:
            self.keep_times()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} can://{self.name}>"

    def fileno(self) -> int:
        """Return the descriptor of the socket, which is readable when a frame has arrived."""
        return self._socket.fileno()

    def keep_times(self) -> None:
        """Set `received_at` from now on."""
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._recv = self._receive_with_marks

    # Frames out

    def send(self, item: CanFrame) -> None:
        """Hand the frame to the controller. If it has no room, try again for a second at most."""
        if item[2] or item[3]:
            self._send_patiently(item, self.try_send(item))
            return
        data = item[1]
        try:  # most frames: the quickest way
            self._send(_pack(item[0], len(data), data), _NOW)
        except (OSError, struct.error) as error:
            self._send_patiently(item, self._refused(item, error))

    def _send_patiently(self, item: CanFrame, is_sent: bool) -> None:
        if not is_sent:  # a function of its own, because `send` would be slower with the function in it
            send_when_room(lambda: self.try_send(item), f"can://{self.name}")

    def try_send(self, item: CanFrame) -> bool:
        """Hand the frame to the controller; False if it has no room for it now. Raises PortError."""
        identifier, data, extended, remote, requested = item
        if extended:
            identifier |= _EXTENDED
        try:
            if remote:
                self._send(_pack(identifier | _REMOTE, requested, data), _NOW)
            else:
                self._send(_pack(identifier, len(data), data), _NOW)
        except (OSError, struct.error) as error:
            return self._refused(item, error)
        return True

    def try_send_all(self, items: Sequence[CanFrame]) -> int:
        """Hand frames to the controller until it has no room. Return how many it took. Raises PortError."""
        send, sent = self._send, 0
        try:
            for item in items:
                identifier, data, extended, remote, _ = item
                if extended or remote:
                    break  # `try_send` has the bits
                send(_pack(identifier, len(data), data), _NOW)
                sent += 1
        except (OSError, struct.error) as error:
            self._refused(item, error)
        return sent

    def _refused(self, item: CanFrame, error: Exception) -> bool:
        """Return False for a frame for which the controller has no room now. Raises PortError for any other."""
        if not isinstance(error, OSError):
            raise PortError(f"can://{self.name}: {item} is no frame that CAN can carry") from None
        if error.errno in (errno.ENOBUFS, errno.EAGAIN):
            return False
        raise PortError(self._failure(error)) from None

    # Frames in

    def has_frames(self) -> bool:
        """Return whether a frame waits to be read, or the interface failed."""
        return bool(self._poll.poll(0))

    def receive(self, timeout: float) -> CanFrame | None:
        """Return the next frame, or None after `timeout` seconds. Raises PortError."""
        item = self.receive_any(timeout)
        if item is None or item.__class__ is CanFrame:  # quicker than `isinstance`
            return item
        until = time.monotonic() + timeout
        while item is not None and not isinstance(item, CanFrame):
            self.others += 1
            self.strange.append(item)
            item = self.receive_any(until - time.monotonic())
        return item

    def receive_any(self, timeout: float) -> CanFrame | ErrorFrame | FdFrame | None:
        """The same as `receive`, but error frames and CAN FD frames are returned too."""
        if self._gone is not None:
            raise PortError(self._gone)
        waits = self._waits
        try:
            if waits <= timeout < 2 * waits:  # the system keeps this time-out already
                try:
                    data: bytes | None = self._recv(_LONGEST)
                except BlockingIOError:
                    data = self._poll_for(timeout - waits)
            else:
                data = self._read(timeout)
        except (OSError, ValueError) as error:
            raise PortError(self._failure(error)) from None
        if data is None:
            if self._in_a_row:
                self._count_losses()
            return None
        self._in_a_row += 1
        if self._in_a_row >= self._burst:
            self._count_losses()
        if len(data) == 16:
            identifier, length, body = _unpack(data)
            if identifier <= BASE_MAX:  # most frames: the quickest way
                return _new(CanFrame, (identifier, body if length == 8 else body[:length], False, False, 0))
        return self._item(data)

    def receive_others(self, timeout: float) -> CanFrame | ErrorFrame | FdFrame | None:
        """The same as `receive_any`, without the frames that were sent here."""
        until = time.monotonic() + timeout
        while (item := self.receive_any(timeout)) is not None and self.is_own:
            timeout = max(0.0, until - time.monotonic())
        return item

    def _read(self, timeout: float) -> bytes | None:
        """Return the bytes of the next frame, or None after `timeout` seconds, of which the system may not know yet."""
        if timeout > 0.0:
            self._set_wait(timeout)
            if not self._waits:
                return self._poll_for(timeout)
        try:
            return self._recv(_LONGEST) if timeout > 0.0 else self._receive_now()
        except BlockingIOError:
            return self._poll_for(timeout - self._waits) if timeout > 0.0 else None

    def _poll_for(self, timeout: float) -> bytes | None:
        """Return the bytes of the next frame, or None after `timeout` seconds, whatever time-out the system keeps."""
        try:
            return self._receive_now() if self._poll.poll(max(0.0, timeout) * 1000.0) else None
        except BlockingIOError:
            return None

    def _set_wait(self, timeout: float) -> None:
        """Set the time-out that the system keeps. It is shorter than `timeout`, so that it serves for the next reads,
        whose time-outs differ a little; `poll` waits for the rest."""
        self._waits = 0.0 if timeout < _SHORT else 0.75 * min(timeout, _LONGEST_WAIT)
        seconds = int(self._waits)
        option = _TIME.pack(seconds, int((self._waits - seconds) * 1e6))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, option)

    def _receive_now(self) -> bytes:
        return self._recv(_LONGEST, _NOW)

    def _receive_with_marks(self, size: int, flags: int = 0) -> bytes:
        """Do the same as `recv`, and record when the frame arrived, and whether this socket sent it."""
        data, extra, marks, _ = self._socket.recvmsg(size, _MARKS_ROOM, flags)
        self.is_own = marks & _MSG_CONFIRM != 0
        for level, kind, content in extra:
            if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS):
                seconds, nanoseconds = _TIME.unpack_from(content)
                self.received_at = seconds + nanoseconds * 1e-9
        return data

    def _count_losses(self) -> None:
        """After many frames one after the other, add those that the system has dropped since to `lost`."""
        if self._in_a_row < self._burst:
            self._in_a_row = 0
            return
        self._in_a_row = 0
        with suppress(OSError):  # Linux before 4.12
            numbers = self._socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMORY.size)
            dropped = _MEMORY.unpack(numbers)[-1]
            self.lost += dropped - self._dropped & 0xFFFF_FFFF
            self._dropped = dropped

    def _item(self, data: bytes) -> CanFrame | ErrorFrame | FdFrame | None:
        """Return what the bytes from the socket are, if not a base data frame."""
        if len(data) != _FRAME.size:
            return self._other_item(data)
        identifier, length, body = _unpack(data)
        body = body[:length]
        extended = identifier >= _EXTENDED
        if identifier & _ERROR:
            return ErrorFrame(identifier & EXTENDED_MAX, body)
        if identifier & _REMOTE:
            return CanFrame(identifier & EXTENDED_MAX, b"", extended, True, length)
        return CanFrame(identifier & EXTENDED_MAX, body, extended)

    def _other_item(self, data: bytes) -> FdFrame | None:
        """Return a CAN FD frame; None for bytes that are no frame, which are counted as garbled."""
        if not data:
            raise PortError(f"can://{self.name}: the socket was closed")
        if len(data) != _LONGEST:
            self.garbled += 1
            return None
        identifier, length, flags = _FD_FRAME.unpack_from(data)
        body = data[_FD_FRAME.size : _FD_FRAME.size + length]
        return FdFrame(identifier & EXTENDED_MAX, body, identifier >= _EXTENDED, flags & 3)

    # Errors, and the end

    def _failure(self, error: Exception) -> str:
        """Return why an open interface failed. The system reports once that it is down or gone, so that is kept."""
        number = getattr(error, "errno", None)
        if number == errno.ENETDOWN:
            why = self._gone = f"can://{self.name}: the interface is down: {self._bring_up}"
            return why
        if number in UNPLUGGED:
            why = self._gone = f"can://{self.name}: the interface is gone: was the adapter unplugged?"
            return why
        return f"can://{self.name}: {reason(error)}"

    def _how_to_make(self, channel: str, error: OSError) -> str:
        """Return what to do about an interface that does not exist, for the end of the error."""
        if error.errno == errno.EAFNOSUPPORT:
            return "; the kernel has no SocketCAN: modprobe can_raw"
        if error.errno != errno.ENODEV:
            return ""
        virtual = f"ip link add dev {channel} type vcan && ip link set {channel} up"
        return (
            f"; {virtual}"
            if channel.startswith("vcan")
            else (f"; plug the adapter in, then {self._bring_up}; a virtual one: {virtual}")
        )

    def close(self) -> None:
        """Leave the bus."""
        self._socket.close()


# The socket, and the options of can://socketcan URLs ------------------------------------------------------------


def raw_socket(endpoint: Endpoint, channel: str) -> socket.socket:
    """Return an open raw CAN socket on an interface. Raises OSError."""
    if not hasattr(socket, "AF_CAN"):
        raise OSError(errno.ENOSYS, "SocketCAN is a part of Linux, and this is another system")
    opened = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    try:
        room = endpoint.integer("receive_buffer", _ROOM)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, room)
        with suppress(OSError):  # above the limit of the system: only with CAP_NET_ADMIN
            opened.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, room)
        opened.setsockopt(_SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, struct.pack("=I", EXTENDED_MAX))
        opened.setsockopt(_SOL_CAN_RAW, _CAN_RAW_LOOPBACK, flag(endpoint, "local_loopback", True))
        opened.setsockopt(_SOL_CAN_RAW, _CAN_RAW_RECV_OWN_MSGS, flag(endpoint, "receive_own_messages"))
        if flag(endpoint, "fd"):
            opened.setsockopt(_SOL_CAN_RAW, _CAN_RAW_FD_FRAMES, 1)
        if filters := filters_of(endpoint):
            opened.setsockopt(_SOL_CAN_RAW, _CAN_RAW_FILTER, filters)
        opened.bind((channel,))
    except BaseException:
        opened.close()
        raise
    return opened


def _wrong(endpoint: Endpoint, key: str, expected: str) -> EncodeError:
    text = f"{key}={shown(endpoint.options[key])}: expected {expected}"
    return EncodeError(f"endpoint {shown(str(endpoint), 200)}: {text}", key)


def flag(endpoint: Endpoint, key: str, default: bool = False) -> bool:
    """Return an option that is true or false."""
    value = {"1": True, "true": True, "0": False, "false": False}.get(endpoint.options.get(key, str(default)).lower())
    if value is None:
        raise _wrong(endpoint, key, "0 or 1")
    return value


def filters_of(endpoint: Endpoint) -> bytes:
    """Return the option `filter` as the system takes it: (identifier, mask) for each identifier.

    A filter compares the identifier and its kind, so 585 does not pass 00000585; remote frames pass too.

    >>> filters_of(Endpoint.parse("can://socketcan/can0?filter=585,00000705")).hex(" ", 8)
    '85050000ff070080 05070080ffffff9f'
    """
    filters = b""
    for text in endpoint.options.get("filter", "").split(",") if "filter" in endpoint.options else ():
        try:
            identifier = CanFrame.parse(f"{text}#")
        except DecodeError:
            raise _wrong(endpoint, "filter", "identifiers such as 585,705: 3 hex digits, or 8 if extended") from None
        if identifier.extended:
            filters += _FILTER.pack(identifier.id | _EXTENDED, EXTENDED_MAX | _EXTENDED)
        else:
            filters += _FILTER.pack(identifier.id, BASE_MAX | _EXTENDED)
    return filters


def check_socketcan_options(endpoint: Endpoint) -> None:
    """Raise EncodeError for an option that a SocketCAN endpoint does not have, or for a wrong value."""
    for option in sorted(endpoint.options.keys() - CAN_OPTIONS - SOCKETCAN_OPTIONS):
        raise unknown_option(str(endpoint), option, CAN_OPTIONS | SOCKETCAN_OPTIONS)
    for key in ("receive_own_messages", "local_loopback", "fd"):
        flag(endpoint, key)
    filters_of(endpoint)
