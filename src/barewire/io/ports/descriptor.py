"""A descriptor that one thread may close while others wait for it.

The system gives the number of a closed file to the next one that is opened. A thread that still waits for the number
of a serial port would read that file, or write to it. So every use is under a lock, which `close` takes too; `close`
also ends the waits.
"""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable

from barewire.io.ports.network import CHUNK, readiness


class SharedDescriptor:
    """The descriptor `number`, for reads and writes that do not block, and the function that closes its file."""

    _alarm: tuple[socket.socket, ...] = ()

    def __init__(self, number: int, close: Callable[[], object]) -> None:
        self._number = number
        self._close_file = close
        self._using = threading.RLock()  # not Lock: a signal handler may close what its own thread reads
        # When `close` closes the second, the first is readable, which wakes all that wait, also from then on.
        self._alarm = woken, _ = socket.socketpair()
        os.set_blocking(number, False)
        self._is_readable = readiness(number, woken)
        self._is_writable = readiness(woken, room_in=number)

    def __del__(self) -> None:
        for end in self._alarm:
            end.close()

    def fileno(self) -> int:
        """Return the number, -1 after `close`."""
        return self._number

    def read(self, timeout: float) -> bytes | None:
        """Return bytes, b"" at the end of the file, or None after `timeout` seconds. Raises OSError, also when it is
        closed."""
        if not self._is_readable(timeout):
            return None
        with self._using:
            try:
                return os.read(self._number, CHUNK)
            except BlockingIOError:
                return None

    def write(self, item: bytes, timeout: float) -> bool:
        """Write bytes. Return whether there was room for all of them, after `timeout` seconds at most for each part.
        Raises OSError, also when it is closed."""
        unsent = memoryview(item)
        while unsent:
            with self._using:
                try:
                    unsent = unsent[os.write(self._number, unsent) :]
                    continue
                except BlockingIOError:
                    pass
            if not self._is_writable(timeout):
                return False
        return True

    def close(self) -> None:
        """Close the file, once. Reads and writes that wait end."""
        try:
            with self._using:
                was_open, self._number = self._number >= 0, -1
                if was_open:
                    self._close_file()
        finally:
            self._alarm[1].close()  # not before: a read of a terminal without bytes looks like that of one at its end
