"""A CAN bus through python-can: its messages become CanFrame, ErrorFrame and FdFrame; its errors become PortError.

SocketCAN needs no python-can: see `socketcan`.

Special treatment of single interfaces of python-can is in the last part of this file.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import time
from collections import deque
from importlib import import_module
from inspect import signature
from typing import Any

from barewire.canopen.frame import BASE_MAX, DATA_MAX, EXTENDED_MAX, CanFrame, ErrorFrame, FdFrame
from barewire.errors import EncodeError, PortError, shown, suggest
from barewire.io.endpoint import CAN_OPTIONS, DEFAULT_BITRATE, Endpoint, unknown_option
from barewire.io.ports.base import send_when_room
from barewire.io.ports.network import UNPLUGGED, reason

try:
    import can

    from barewire.io.ports.can.socketcand import SocketcandBus
except ModuleNotFoundError as missing:  # pragma: no cover - tried by CI in an environment without it
    raise PortError("CAN buses need python-can: pip install 'barewire[can]'") from missing

# python-can logs what it then raises; here each error is reported once, as a PortError.
logging.getLogger("can").setLevel(logging.CRITICAL)

GARBLED_LIMIT = 256
"""Undecodable inputs in a row after which the port has failed."""

_FD_DATA_MAX = 64


class CanPort:
    """An open bus.

    CANopen has no error frames and no CAN FD frames: `others` counts them, `strange` keeps the latest. `garbled` counts
    bytes from a serial line or network that are no frame: noise, after which the port goes on.
    """

    def __init__(self, endpoint: Endpoint) -> None:
        interface, _, channel = endpoint.place.partition("/")
        self.name = f"{interface}/{channel}"
        self.others = 0
        self.garbled = 0
        self._garbled_in_a_row = 0
        self.strange: deque[ErrorFrame | FdFrame] = deque(maxlen=64)
        extra: dict[str, Any] = {
            key: _plain(value) for key, value in endpoint.options.items() if key not in CAN_OPTIONS
        }
        check_python_can_options(endpoint)
        self.own_frames: bool | None = None if interface not in _CHECKED_INTERFACES or interface == "slcan" else False
        """Whether `receive` returns the frames that were sent here too. Of an adapter it is not known."""
        if interface == "udp_multicast" or extra.get("receive_own_messages"):
            self.own_frames = True
        if interface == "slcan":
            channel = _slcan_options(channel, extra)
        try:
            self._bus: can.BusABC
            if interface == "socketcand":
                self._bus = SocketcandBus(channel, extra)
            else:
                self._bus = can.Bus(
                    channel=channel, interface=interface, bitrate=endpoint.integer("bitrate", DEFAULT_BITRATE), **extra
                )
        except Exception as error:
            # Each interface of python-can has its own errors; all of them mean that the bus cannot be opened.
            raise PortError(f"can://{self.name}: {_first_line(error)}") from None

    def send(self, item: CanFrame) -> None:
        """Hand the frame to the controller. If it has no room, try again for a second at most."""
        if not self.try_send(item):
            send_when_room(lambda: self.try_send(item), f"can://{self.name}")

    def try_send(self, item: CanFrame) -> bool:
        """Hand the frame to the controller; False if it has no room for it now."""
        if item.remote and self.name.startswith("socketcand/"):
            raise PortError(f"can://{self.name}: socketcand carries no remote frames")
        try:
            self._bus.send(_message(item))
        except (can.CanError, OSError, ValueError) as error:
            if _is_full(error):
                return False
            raise PortError(f"can://{self.name}: {self._failure(error)}") from None
        return True

    def receive(self, timeout: float) -> CanFrame | None:
        """The next frame within `timeout` seconds, or None."""
        until = time.monotonic() + min(timeout, 3600.0)
        while True:
            item = self.receive_any(until - time.monotonic())
            if item is None or isinstance(item, CanFrame):
                return item
            self.others += 1
            self.strange.append(item)

    def receive_any(self, timeout: float) -> CanFrame | ErrorFrame | FdFrame | None:
        """The same as `receive`, but error frames and CAN FD frames are returned too."""
        begin = time.monotonic()
        while True:
            try:
                message = self._bus.recv(timeout if timeout > 0.0 else 0.0)
                if message is None:
                    return None
                _check(message)
                break
            except Exception as error:
                # Each interface has its own errors, for a port that failed and for bytes that are no frame.
                cause = error if error.__cause__ is None else error.__cause__
                begin, before = time.monotonic(), begin
                timeout -= begin - before
                if _errors(cause) & {errno.EAGAIN}:
                    if timeout <= 0.0:
                        return None
                    continue
                if isinstance(cause, (can.CanError, OSError)) or self._garbled_in_a_row >= GARBLED_LIMIT:
                    raise PortError(f"can://{self.name}: {self._failure(error)}") from None
                self.garbled += 1
                self._garbled_in_a_row += 1
                _drop_slcan_line(self._bus)
        self._garbled_in_a_row = 0
        if message.is_error_frame or message.is_fd:
            return _strange(message)
        if message.is_remote_frame:
            return CanFrame(message.arbitration_id, b"", message.is_extended_id, True, message.dlc)
        return CanFrame(message.arbitration_id, bytes(message.data), message.is_extended_id)

    def _failure(self, error: Exception) -> str:
        """Why an open bus failed: the interface is down, gone, or the first line of the error."""
        numbers = _errors(error) | (_errors(error.__cause__) if error.__cause__ is not None else set())
        if errno.ENETDOWN in numbers:
            return "the interface is down"
        if numbers & UNPLUGGED or "readiness to read" in str(error):
            return "the device is gone: was the adapter unplugged?"
        return _first_line(error)

    def close(self) -> None:
        """Leave the bus."""
        with contextlib.suppress(can.CanError, OSError):
            self._bus.shutdown()


def _message(item: CanFrame) -> can.Message:
    """A frame as python-can has it."""
    if item.remote:
        return can.Message(
            arbitration_id=item.id, is_extended_id=item.extended, is_remote_frame=True, dlc=item.requested
        )
    return can.Message(arbitration_id=item.id, is_extended_id=item.extended, data=item.data)


def _check(message: can.Message) -> None:
    """Raise ValueError for a message that CAN cannot carry: an adapter or a server passes on what it reads."""
    limit = EXTENDED_MAX if message.is_extended_id else BASE_MAX
    size = len(message.data) if message.is_fd else max(len(message.data), message.dlc)
    if not message.is_error_frame and (
        not 0 <= message.arbitration_id <= limit or size > (_FD_DATA_MAX if message.is_fd else DATA_MAX)
    ):
        raise ValueError(f"{message} is no CAN frame")


def _is_full(error: Exception) -> bool:
    """Whether the controller's buffer is full, which does not last."""
    return bool(_errors(error) & {errno.ENOBUFS, errno.EAGAIN}) or "buffer full" in str(error).lower()


def _errors(error: BaseException) -> set[int]:
    """The number of the system's error, in the attributes of python-can and of Python."""
    return {getattr(error, name, None) or 0 for name in ("error_code", "errno")}


def _strange(message: Any) -> ErrorFrame | FdFrame:
    """An error frame or a CAN FD frame."""
    if message.is_error_frame:
        return ErrorFrame(message.arbitration_id & EXTENDED_MAX, bytes(message.data))
    flags = bool(message.bitrate_switch) | bool(message.error_state_indicator) << 1
    return FdFrame(message.arbitration_id, bytes(message.data), message.is_extended_id, flags)


def _plain(text: str) -> Any:
    """An option of the URL as python-can takes it: a number if it is one."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return {"true": True, "false": False}.get(text.lower(), text)


def _first_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return reason(error)
    text = (str(error) or type(error).__name__).splitlines()[0]
    cause = error.__cause__
    if isinstance(cause, OSError) and cause.errno and f"[Errno {cause.errno}]" in text:
        return reason(OSError(cause.errno, os.strerror(cause.errno)))  # python-can has the text of pyserial, doubled
    if isinstance(cause, OSError) and cause.strerror and cause.strerror not in text:
        text += f": {reason(cause)}"
    return text[:1].lower() + text[1:]


# What single interfaces need -------------------------------------------------------------------------------------


_CHECKED_INTERFACES = ("virtual", "socketcand", "slcan", "udp_multicast")
"""Interfaces whose constructors name all their options. Others may take options that are named nowhere."""


def check_python_can_options(endpoint: Endpoint) -> None:
    """EncodeError for an unknown interface, or an option that neither barewire nor the interface has, which python-can
    would ignore."""
    interface, options = endpoint.place.partition("/")[0], endpoint.options.keys() - CAN_OPTIONS
    if interface not in can.interfaces.BACKENDS:
        names = sorted(can.interfaces.BACKENDS)
        text = f"unknown interface {shown(interface)}, expected {', '.join(names)}"
        raise EncodeError(f"endpoint {str(endpoint)!r}: {text}{suggest(interface, dict.fromkeys(names))}")
    if not options or interface not in _CHECKED_INTERFACES:
        return
    module, name = can.interfaces.BACKENDS[interface]
    try:
        kinds = getattr(import_module(module), name).__mro__
    except ImportError:
        return  # opening the bus reports what is missing
    known = {option for kind in kinds if "__init__" in vars(kind) for option in signature(kind.__init__).parameters}
    known = known - {"self", "args", "kwargs", "channel"} | CAN_OPTIONS
    for option in sorted(options - known):
        raise unknown_option(str(endpoint), option, known)


def _slcan_options(channel: str, extra: dict[str, Any]) -> str:
    """The path of the serial device.

    python-can's pause after opening is for hardware that reboots: an option has it.
    """
    extra.setdefault("sleep_after_open", 0.0)
    return channel if channel.startswith("/") else f"/{channel}"


def _drop_slcan_line(bus: can.BusABC) -> None:
    """Drop a line that is no text: python-can's slcan keeps it and would fail at it again."""
    held = getattr(bus, "_buffer", None)
    if isinstance(held, bytearray):
        held.clear()
