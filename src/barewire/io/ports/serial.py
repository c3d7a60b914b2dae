"""Blocking serial ports, through pyserial. Every failure is a PortError of one line."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import sys
import time
from typing import NamedTuple

from barewire.errors import EncodeError, PortError
from barewire.io.endpoint import DEFAULT_BAUDRATE, PSEUDO_TERMINAL, Endpoint, SetDirection
from barewire.io.ports.descriptor import SharedDescriptor
from barewire.io.ports.network import LONGEST_WAIT, UNPLUGGED, reason
from barewire.io.ports.pty import check_not_foreign, check_not_served, is_pseudo_terminal
from barewire.rtu.frame import Timing, character_bits

try:
    import serial
    from serial.rs485 import RS485Settings
except ModuleNotFoundError as missing:  # pragma: no cover - tried by CI in an environment without it
    raise PortError("serial ports need pyserial: pip install 'barewire[serial]'") from missing


# The exceptions of pyserial: ValueError and OverflowError for settings that no port has, TypeError for a port that
# another thread closed meanwhile.
_FAILURES: tuple[type[Exception], ...] = (OSError, ValueError, OverflowError, TypeError, serial.SerialException)
if sys.platform != "win32":
    import termios

    _FAILURES += (termios.error,)


_WRITE_TIMEOUT = 5.0
"""Seconds after which a write ends for which there is no room."""


class SerialSettings(NamedTuple):
    """The settings of a line. The default of Modbus is 19200 8E1 [MB-SERIAL 2.5.1]."""

    baudrate: int = DEFAULT_BAUDRATE
    bytesize: int = 8
    parity: str = "E"
    stopbits: float = 1

    @classmethod
    def of(cls, endpoint: Endpoint) -> SerialSettings:
        """Return the settings of an endpoint."""
        return cls(
            endpoint.integer("baudrate", DEFAULT_BAUDRATE),
            int(endpoint.choice("bytesize", "8")),
            endpoint.choice("parity", "E"),
            float(endpoint.choice("stopbits", "1")),
        )

    def __str__(self) -> str:
        return f"{self.baudrate} {self.bytesize}{self.parity}{self.stopbits:g}"

    @property
    def timing(self) -> Timing:
        """The character times of these settings."""
        return Timing.of(self.baudrate, character_bits(self.bytesize, self.parity, self.stopbits))


class SerialPort:
    """An open serial port.

    pace            sending on a pseudo-terminal takes as long as on a line with these settings
    rs485           what sets the direction of a two-wire line: the adapter ("off", the default), the driver ("kernel"),
                    or this port by RTS ("rts"), which is on while it sends and off after the last bit
    set_direction   called with True before the first bit, with False after the last, and when the port is opened
    """

    def __init__(
        self,
        path: str,
        settings: SerialSettings,
        *,
        pace: bool = False,
        rs485: str = "off",
        set_direction: SetDirection | None = None,
    ) -> None:
        check_not_foreign(path)
        self.name = path
        self._is_pseudo_terminal = is_pseudo_terminal(path)
        self._timed = pace or not self._is_pseudo_terminal
        self._pace = settings.timing if pace else None
        self._character = settings.timing.character
        self.character = 0.0 if self._is_pseudo_terminal else self._character
        """Seconds in which a byte reaches other stations: a pseudo-terminal has no speed, whatever its `pace`."""
        self._rts = rs485 == "rts"
        self._set_direction = set_direction
        self._turns = self._rts or set_direction is not None  # this port sets the direction of the line
        self._sending = False
        self._serial = _open(path, settings)
        # Not by pyserial: each change of its time-out configures the port again, its `read` waits for more bytes after
        # the first ones, and its `write` waits by `select`, which fails for files above number 1023.
        self._file: SharedDescriptor | None = None  # on Windows a port has no descriptor
        try:
            if sys.platform != "win32":
                self._file = SharedDescriptor(self._serial.fileno(), self._serial.close)
        except _FAILURES as error:
            self.close()
            raise PortError(f"{path}: {_text(error)}") from None
        try:
            if rs485 == "kernel":
                self._serial.rs485_mode = RS485Settings()
            elif self._rts:
                self._serial.rts = False
        except _FAILURES as error:
            self.close()
            raise PortError(f"{path}: rs485={rs485} is not possible here: {_text(error)}") from None
        try:
            if set_direction is not None:
                self._call(set_direction, sending=False)
        except PortError:
            self.close()
            raise

    @classmethod
    def of(cls, endpoint: Endpoint) -> SerialPort:
        """Open the port of an endpoint. Raises EncodeError for `pty`: a new pseudo-terminal has a server at once."""
        if endpoint.place == PSEUDO_TERMINAL:
            text = "rtu://pty is for servers, which make a new pseudo-terminal; a client opens the path that they print"
            raise EncodeError(f"endpoint {str(endpoint)!r}: {text}")
        adapter = endpoint.adapter
        port = cls(
            endpoint.place if adapter is None else adapter.find(),
            SerialSettings.of(endpoint),
            pace=endpoint.flag("pace"),
            rs485=endpoint.choice("rs485", "off"),
            set_direction=endpoint.set_direction,
        )
        if adapter is not None:
            adapter.opened(port.name)
        return port

    @classmethod
    def of_server(cls, endpoint: Endpoint) -> SerialPort:
        """Open the port of an endpoint for a server. Raises PortError for the terminal of another barewire server."""
        port = cls.of(endpoint)
        try:
            if sys.platform != "win32":
                check_not_served(endpoint.place, port.fileno())
        except PortError:
            port.close()
            raise
        return port

    def fileno(self) -> int:
        """Return the descriptor of the port, for an event loop. Raises PortError on Windows, where it has none."""
        if sys.platform == "win32":
            raise PortError(f"{self.name}: asyncio cannot wait for a serial port on Windows; use ModbusClient there")
        return int(self._serial.fileno())

    def send(self, item: bytes) -> None:
        """Send bytes. Returns when the last one is on the wire, as far as the system reports."""
        ends = time.monotonic() + (self._pace.duration(len(item)) if self._pace else 0.0)
        try:
            if self._turns:
                self._send_and_turn(item)
            else:
                self._write(item)
        except PortError:
            raise
        except _FAILURES as error:
            raise PortError(f"{self.name}: {self.failure(error)}") from None
        time.sleep(max(0.0, ends - time.monotonic()))

    def _send_and_turn(self, item: bytes) -> None:
        self.set_direction(sending=True)
        try:
            self._write(item)
        finally:
            self.set_direction(sending=False)

    def _write(self, item: bytes) -> None:
        if self._file is None:
            self._serial.write(item)
        elif not self._file.write(item, _WRITE_TIMEOUT):
            raise PortError(f"{self.name}: the device has taken no bytes for {_WRITE_TIMEOUT:g} s")
        self._serial.flush()

    def set_direction(self, *, sending: bool) -> None:
        """Set the direction of the line by RTS or by the function of the caller, if one of them is to do that."""
        self._sending = sending
        if self._rts:
            self._serial.rts = sending
        elif self._set_direction is not None:
            self._call(self._set_direction, sending=sending)

    def _call(self, set_direction: SetDirection, *, sending: bool) -> None:
        try:
            set_direction(sending)
        except Exception as error:
            # Any exception of the caller's function: a port whose direction cannot be set has failed.
            text = f"{self.name}: the direction of the line could not be set: {type(error).__name__}: {error}"
            raise PortError(text) from error

    def takes(self, length: int) -> float:
        """Return the seconds that so many bytes take on the wire."""
        return length * self._character if self._timed else 0.0

    def waiting(self) -> int:
        """Return how many bytes the system still has to send."""
        return int(self._serial.out_waiting)

    def receive(self, timeout: float) -> bytes | None:
        """Return received bytes, or None after `timeout` seconds."""
        try:
            if self._file is not None:
                received = self._file.read(timeout)
                if received == b"":
                    raise PortError(f"{self.name}: {self.failure()}")
                return received
            self._serial.timeout = min(timeout, LONGEST_WAIT)
            data = self._serial.read(1)
            return bytes(data + self._serial.read(self._serial.in_waiting)) if data else None
        except _FAILURES as error:
            if isinstance(error, PortError):
                raise
            raise PortError(f"{self.name}: {self.failure(error)}") from None

    def failure(self, error: Exception | None = None) -> str:
        """Return why the open port failed. Without an error, it is at its end."""
        if error is None or "readiness to read" in str(error) or getattr(error, "errno", None) in UNPLUGGED:
            if self._is_pseudo_terminal:
                return "the device is gone: the program at the other end of the pseudo-terminal has ended"
            return "the device is gone: was the adapter unplugged?"
        return _text(error)

    def close(self) -> None:
        """Close the port. If it was sending, the line is set to receiving first."""
        if self._sending and self._set_direction is not None:
            with contextlib.suppress(PortError):
                self.set_direction(sending=False)
        with contextlib.suppress(*_FAILURES):
            (self._serial if self._file is None else self._file).close()


def _open(path: str, settings: SerialSettings) -> serial.Serial:
    parity, bytesize = settings.parity, settings.bytesize
    if is_pseudo_terminal(path):
        # A pseudo-terminal has neither parity nor 7 bits; a second attempt to set them fails with "invalid argument".
        parity, bytesize = "N", 8
    baudrate, stopbits = settings.baudrate, settings.stopbits
    try:
        # Exclusive, because two programs on one line would receive each other's answers. A write must end too, where
        # nothing reads: the driver of an unplugged adapter, or a pseudo-terminal, may never take the bytes.
        return serial.Serial(
            path,
            baudrate,
            bytesize,
            parity,
            stopbits,
            timeout=0,
            write_timeout=_WRITE_TIMEOUT,
            exclusive=os.name == "posix" or None,
        )
    except _FAILURES as error:
        raise PortError(f"{path}: {_text(error)}") from None


def _text(error: Exception) -> str:
    """Return the system's text of an error, without the text that pyserial puts around it."""
    if isinstance(error, TypeError) or getattr(error, "errno", None) == errno.EBADF or "is not open" in str(error):
        return "the port was closed"
    if isinstance(error, OSError) and error.errno in (errno.EAGAIN, errno.EACCES) and "lock" in str(error):
        return "another program has it open"
    if isinstance(error, OSError) and error.errno is not None:
        return reason(OSError(error.errno, os.strerror(error.errno)))
    text = str(error)
    # "Could not configure port: (25, 'Inappropriate ioctl for device')", or termios's own (5, 'Input/output error').
    system = re.search(r"\((\d+), '([^']+)'\)", text)
    if system and int(system[1]) == errno.ENOTTY:
        return "the file exists, but is not a serial port"
    return system[2][:1].lower() + system[2][1:] if system else text
