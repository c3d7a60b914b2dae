"""A CAN bus through python-can: its Message becomes our CanFrame and back, and nothing else of it comes further in."""

from __future__ import annotations

import contextlib
import errno
import logging
import select
import socket
import time
from collections import deque
from typing import Any

from barewire.canopen.frame import EXTENDED_MAX, CanFrame, ErrorFrame, FdFrame
from barewire.errors import PortError
from barewire.io.endpoint import Endpoint, socketcand_address
from barewire.io.ports.tcp import reason

try:
    import can
except ModuleNotFoundError as missing:  # pragma: no cover - tried by CI in an environment without it
    raise PortError("CAN buses need python-can: pip install 'barewire[can]'") from missing

# python-can warns through logging about what it then raises; we say it once, as a PortError.
logging.getLogger("can").setLevel(logging.CRITICAL)

_OURS = ("node", "timeout", "bitrate")

GARBLED_MAX = 256
"""Pieces of nonsense in a row after which a carrier is broken."""

PATIENCE = 1.0
"""Seconds that a frame waits for room in the controller's buffer: a full bus empties the longest one sooner."""
RETRY = 0.0005
_GONE = {errno.ENETDOWN, errno.ENODEV, errno.ENXIO}
"""The interface is down or gone. The system says so once to each socket, to whoever asks first: if that is the one who
sends, the one who receives would wait for ever."""

_frame = tuple.__new__  # what CanFrame(...) comes to, without the function around it


class _Fresh(can.Message):
    """A message that nobody holds, not even who sends it. python-can's virtual bus gives each hearer a deep copy: the
    first of them may have this one itself, the others have plain ones."""

    __slots__ = ("_given",)
    _given: bool

    @classmethod
    def of(cls, item: CanFrame) -> _Fresh:
        """The frame as python-can has it."""
        if item.remote:
            made = cls(arbitration_id=item.id, is_extended_id=item.extended, is_remote_frame=True, dlc=item.requested)
        else:
            made = cls(arbitration_id=item.id, is_extended_id=item.extended, data=item.data)
        made._given = False
        return made

    def __deepcopy__(self, memo: dict[int, Any] | None) -> can.Message:
        if not self._given:
            self._given = True
            return self
        return can.Message(
            arbitration_id=self.arbitration_id,
            is_extended_id=self.is_extended_id,
            is_remote_frame=self.is_remote_frame,
            dlc=self.dlc,
            data=bytearray(self.data),
        )


class CanPort:
    """An open bus.

    Error frames and CAN FD frames are not CANopen's: `others` counts them, `strange` keeps the last of them. `garbled`
    counts what came over the carrier (a serial line, the network) and is no frame at all: noise, and no reason to end.
    """

    def __init__(self, endpoint: Endpoint) -> None:
        interface, _, channel = endpoint.place.partition("/")
        self.name = f"{interface}/{channel}"
        self.others = 0
        self.garbled = 0
        self._nonsense = 0  # in a row
        self.strange: deque[ErrorFrame | FdFrame] = deque(maxlen=64)
        extra: dict[str, Any] = {key: _plain(value) for key, value in endpoint.options.items() if key not in _OURS}
        if interface == "socketcand" and "host" not in extra:
            host, port = socketcand_address(channel)
            channel = channel.partition("/")[2]
            extra |= {"host": host, "port": port}
            extra.setdefault("tcp_tune", True)  # each frame at once: TCP would wait up to 40 ms for more
        if interface == "slcan":
            # The pause python-can makes after opening is for hardware that reboots; the option brings it back.
            extra.setdefault("sleep_after_open", 0.0)
            channel = channel if channel.startswith("/") else f"/{channel}"
        self._gone: str | None = None
        try:
            if interface == "socketcand":
                _greeted(extra["host"], extra["port"])
            self._bus = can.Bus(
                channel=channel, interface=interface, bitrate=endpoint.integer("bitrate", 125_000), **extra
            )
        except Exception as error:
            # Each interface of python-can raises its own; all of them mean that there is no such bus.
            raise PortError(f"can://{self.name}: {_first_line(error)}") from None

    def send(self, item: CanFrame) -> None:
        """Hand the frame to the controller, as soon as it has room: a second at most."""
        if self.try_send(item):
            return
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            time.sleep(RETRY)
            if self.try_send(item):
                return
        raise PortError(f"can://{self.name}: the controller has had no room for a frame for {PATIENCE:g} s")

    def try_send(self, item: CanFrame) -> bool:
        """Hand the frame to the controller; False if it has no room for it now."""
        if item.remote and self.name.startswith("socketcand/"):
            raise PortError(f"can://{self.name}: socketcand carries no remote frames")
        try:
            self._bus.send(_Fresh.of(item))
        except (can.CanError, OSError, ValueError) as error:
            if _is_full(error):
                return False
            why = f"can://{self.name}: {_first_line(error)}"
            if _errors(error) & _GONE:
                self._gone = why
            raise PortError(why) from None
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
        """The same, and what is no classical frame as well."""
        begin = time.monotonic()
        while True:
            if self._gone is not None:
                raise PortError(self._gone)
            try:
                message = self._bus.recv(timeout if timeout > 0.0 else 0.0)
                break
            except Exception as error:
                # Each interface raises its own, for a port that failed and for a byte that makes no sense.
                cause = error if error.__cause__ is None else error.__cause__
                if isinstance(cause, (can.CanError, OSError)) or self._nonsense >= GARBLED_MAX:
                    raise PortError(f"can://{self.name}: {_first_line(error)}") from None
                self._skip()
                begin, before = time.monotonic(), begin
                timeout -= begin - before
        if message is None:
            self._check_open()
            return None
        self._nonsense = 0
        if message.is_error_frame or message.is_fd:
            return _strange(message)
        if message.is_remote_frame:
            return CanFrame(message.arbitration_id, b"", message.is_extended_id, True, message.dlc)
        return _frame(CanFrame, (message.arbitration_id, bytes(message.data), message.is_extended_id, False, 0))

    def _skip(self) -> None:
        """What python-can could not make a frame of is counted, and thrown away where it is still held."""
        self.garbled += 1
        self._nonsense += 1
        held = getattr(self._bus, "_buffer", None)  # slcan keeps a line that is no text, and stumbles over it again
        if isinstance(held, bytearray):
            held.clear()

    def _check_open(self) -> None:
        """Whether a socketcand server has hung up: python-can would look at the dead socket for ever."""
        connection = getattr(self._bus, "_SocketCanDaemonBus__socket", None)
        if connection is None:
            return
        try:
            if not select.select([connection], [], [], 0)[0] or connection.recv(1, socket.MSG_PEEK):
                return
        except (OSError, ValueError) as error:
            raise PortError(f"can://{self.name}: {_first_line(error)}") from None
        raise PortError(f"can://{self.name}: the server hung up")

    def close(self) -> None:
        """Leave the bus."""
        with contextlib.suppress(can.CanError, OSError):
            self._bus.shutdown()


def _greeted(host: str, port: int) -> None:
    """Whether a socketcand server is there: python-can would try for ten seconds, or wait for ever for the greeting."""
    with socket.create_connection((host, port), timeout=3.0) as probe:
        if b"< hi >" not in probe.recv(64):
            raise PortError(f"can://socketcand/{host}:{port}: that is no socketcand server")


def _is_full(error: Exception) -> bool:
    """Whether the controller's buffer is full, which passes."""
    return bool(_errors(error) & {errno.ENOBUFS, errno.EAGAIN}) or "buffer full" in str(error).lower()


def _errors(error: Exception) -> set[int]:
    """The numbers of the system's error, as python-can and as Python say them."""
    return {getattr(error, name, None) or 0 for name in ("error_code", "errno")}


def _strange(message: Any) -> ErrorFrame | FdFrame:
    """What is no classical frame, as the kind that it is."""
    if message.is_error_frame:
        return ErrorFrame(message.arbitration_id & EXTENDED_MAX, bytes(message.data))
    flags = bool(message.bitrate_switch) | bool(message.error_state_indicator) << 1
    return FdFrame(message.arbitration_id, bytes(message.data), message.is_extended_id, flags)


def _plain(text: str) -> Any:
    """An option of the URL as python-can wants it: a number where it is one."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return {"true": True, "false": False}.get(text.lower(), text)


def _first_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return reason(error)
    text = (str(error) or type(error).__name__).splitlines()[0]
    cause = error.__cause__
    if isinstance(cause, OSError) and cause.strerror and cause.strerror not in text:
        text += f": {reason(cause)}"
    return text[:1].lower() + text[1:]
