"""A raw CAN socket of the Linux kernel, and the options of can://socketcan URLs.   [Linux, can.rst]

A filter in a URL, and as the kernel gets it:

    filter=585,00000705      85 05 00 00  FF 07 00 80        (identifier, mask): a frame passes if it agrees in
                             05 07 00 80  FF FF FF 9F        the bits of the mask; bit 31 is that of extended frames
"""

from __future__ import annotations

import errno
import socket
import struct
from contextlib import suppress
from struct import Struct

from barewire.canopen.frame import BASE_MAX, EXTENDED_MAX, CanFrame
from barewire.errors import DecodeError, EncodeError, shown
from barewire.io.endpoint import CAN_OPTIONS, Endpoint, unknown_option

SOCKETCAN_OPTIONS = frozenset({"receive_own_messages", "local_loopback", "fd", "filter", "receive_buffer"})
"""The options of can://socketcan endpoints, besides `CAN_OPTIONS`."""

_EXTENDED = 0x8000_0000
_FILTER = Struct("=II")

# Numbers that Python 3.11 has no names for. [Linux, asm-generic/socket.h, linux/can/raw.h]
_SOL_CAN_RAW = 101
_CAN_RAW_FILTER, _CAN_RAW_ERR_FILTER, _CAN_RAW_LOOPBACK, _CAN_RAW_RECV_OWN_MSGS, _CAN_RAW_FD_FRAMES = 1, 2, 3, 4, 5
_SO_RCVBUFFORCE = 33

_ROOM = 1 << 21
"""Bytes of the receive buffer; the system counts some 800 for a frame, and by default has room for 278."""


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
    found = {"1": True, "true": True, "0": False, "false": False}.get(endpoint.options.get(key, str(default)).lower())
    if found is None:
        raise _wrong(endpoint, key, "0 or 1")
    return found


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
    if endpoint.integer("receive_buffer", _ROOM) < 1:
        raise _wrong(endpoint, "receive_buffer", "1 or more bytes")
    filters_of(endpoint)
