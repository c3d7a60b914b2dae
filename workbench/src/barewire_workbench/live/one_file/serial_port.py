"""A serial port of POSIX by the standard library alone: termios sets it, read and write are those of the system.

    8E1   | start | 8 data bits, lowest first | even parity | stop |        the default of Modbus [MB-SERIAL 2.5.1]

The port is exclusive, because two programs on one line would receive each other's answers. On Windows, which has no
termios, give the client a port of your own: any object with `send`, `receive` and `close`.
"""

from __future__ import annotations

import os
import select
import sys
import time
from contextlib import suppress

from barewire.errors import EncodeError, PortError
from barewire.io.ports.network import CHUNK, LONGEST_WAIT, reason
from barewire.rtu.frame import Timing, character_bits

if sys.platform != "win32":
    import fcntl
    import termios

_WRITE_TIMEOUT = 5.0
"""Seconds for which a port may take no byte: the driver of an unplugged adapter may never take one."""


class SerialPort:
    """An open serial port.

    baudrate    bit/s, one of those that the system has names for
    parity      "E" (default), "O" or "N"
    stopbits    1 or 2
    bytesize    8, or 7 for ASCII
    """

    def __init__(self, path: str, *, baudrate: int = 19200, parity: str = "E", stopbits: int = 1, bytesize: int = 8):
        if sys.platform == "win32":
            raise PortError(f"{path}: this system has no termios; give the client a port of your own")
        self.name = path
        self.timing = Timing.of(baudrate, character_bits(bytesize, parity, stopbits))
        speed = getattr(termios, f"B{baudrate}", None)
        if speed is None:
            raise EncodeError(f"baudrate {baudrate}: the system has no such speed", "baudrate")
        if (parity, stopbits, bytesize) not in [(p, s, b) for p in "NEO" for s in (1, 2) for b in (7, 8)]:
            text = f"{bytesize}{parity}{stopbits}: expected 7 or 8 bits, parity N, E or O, and 1 or 2 stop bits"
            raise EncodeError(text, "parity")
        flags = termios.CREAD | termios.CLOCAL | (termios.CS7 if bytesize == 7 else termios.CS8)
        flags |= {"N": 0, "E": termios.PARENB, "O": termios.PARENB | termios.PARODD}[parity]
        flags |= termios.CSTOPB if stopbits == 2 else 0
        try:
            self._file = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise PortError(f"{path}: {reason(error)}") from None
        if os.major(os.fstat(self._file).st_rdev) in range(136, 144):
            # A pseudo-terminal has no parity and no 7 bits; a second attempt to set them fails with "invalid argument".
            flags = termios.CREAD | termios.CLOCAL | termios.CS8
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # No translation of any byte, no echo, no line editing: the four words of flags, then the speeds.
            control = termios.tcgetattr(self._file)[6]
            termios.tcsetattr(self._file, termios.TCSANOW, [0, 0, flags, 0, speed, speed, control])
            termios.tcflush(self._file, termios.TCIFLUSH)
        except BlockingIOError:
            self.close()
            raise PortError(f"{path}: another program has it open") from None
        except (OSError, termios.error) as error:
            self.close()
            raise PortError(
                f"{path}: not a serial port with {baudrate} {bytesize}{parity}{stopbits}: {error}"
            ) from None

    def send(self, item: bytes) -> None:
        """Send bytes. Returns when the last one is on the wire, as far as the system reports."""
        unsent, until = memoryview(item), time.monotonic() + _WRITE_TIMEOUT
        try:
            while unsent:
                if not select.select([], [self._file], [], max(0.0, until - time.monotonic()))[1]:
                    raise PortError(f"{self.name}: the port has taken no byte for {_WRITE_TIMEOUT:g} s")
                unsent = unsent[os.write(self._file, unsent) :]
            termios.tcdrain(self._file)
        except (OSError, ValueError, termios.error) as error:
            raise self._failure(error) from None

    def receive(self, timeout: float) -> bytes | None:
        """Return received bytes, or None after `timeout` seconds. Raises PortError if the device is gone."""
        try:
            if not select.select([self._file], [], [], min(timeout, LONGEST_WAIT))[0]:
                return None
            data = os.read(self._file, CHUNK)
        except BlockingIOError:
            return None
        except (OSError, ValueError) as error:
            raise self._failure(error) from None
        if not data:
            raise PortError(f"{self.name}: the device is gone")
        return data

    def _failure(self, error: Exception) -> PortError:
        return error if isinstance(error, PortError) else PortError(f"{self.name}: {reason(error)}")

    def close(self) -> None:
        """Close the port."""
        file, self._file = self._file, -1
        with suppress(OSError):
            os.close(file)
