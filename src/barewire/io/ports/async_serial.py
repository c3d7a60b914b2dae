"""Serial ports of asyncio clients. The loop watches the descriptor, so this works on POSIX only.

Sending takes time on a serial line: `sent` ends when the last bit is on the wire, as far as the system reports. Then a
two-wire line is set back to receiving, if RTS or a function of the caller sets its direction.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import Callable

from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.serial import SerialPort
from barewire.io.ports.tcp import CHUNK, reason

_POLL = 0.001
"""Seconds between two checks whether everything has been sent."""


async def connect(endpoint: Endpoint, receive: Callable[[bytes], None], lose: Callable[[str], None]) -> SerialLink:
    """Open the serial port of an endpoint. Raises PortError, in one line, if that fails."""
    return SerialLink(SerialPort.of(endpoint), receive, lose)


class SerialLink:
    """An open serial port. `receive` is called with received bytes, `lose` with the reason when the port fails."""

    def __init__(self, port: SerialPort, receive: Callable[[bytes], None], lose: Callable[[str], None]) -> None:
        self.name = port.name
        self._port = port
        self._receive = receive
        self._lose = lose
        self._loop = asyncio.get_running_loop()
        self._unsent = bytearray()
        self._out: asyncio.Event = asyncio.Event()
        self._out.set()
        self._fd = port.fileno()
        self._loop.add_reader(self._fd, self._read)

    def _read(self) -> None:
        try:
            data = os.read(self._fd, CHUNK)
        except BlockingIOError:
            return
        except OSError as error:
            return self._fail(self._port.failure(error))
        if not data:
            return self._fail(self._port.failure())
        self._receive(data)

    def _fail(self, why: str) -> None:
        self.close()
        self._lose(why)

    def pause_reading(self) -> None:
        """Leave received bytes in the buffer of the system."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)

    def resume_reading(self) -> None:
        """Receive again, after `pause_reading`."""
        if self._fd >= 0:
            self._loop.add_reader(self._fd, self._read)

    def write(self, item: bytes) -> None:
        """Send bytes, as fast as the system takes them."""
        if self._fd < 0:
            raise PortError(f"{self.name}: the port was closed")
        try:
            self._port.set_direction(sending=True)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None
        self._out.clear()
        self._unsent += item
        self._write_some()
        self._loop.call_later(self._port.takes(len(item)), self._check_sent)

    def _write_some(self) -> None:
        try:
            del self._unsent[: os.write(self._fd, self._unsent)]
        except BlockingIOError:
            pass
        except OSError as error:
            return self._fail(self._port.failure(error))
        if self._unsent:
            self._loop.add_writer(self._fd, self._write_some)
        else:
            self._loop.remove_writer(self._fd)

    def _check_sent(self) -> None:
        """Set the line back to receiving if everything has been sent."""
        if self._fd >= 0:
            with contextlib.suppress(OSError):
                if self._unsent or self._port.waiting():
                    self._loop.call_later(_POLL, self._check_sent)
                    return
            try:
                self._port.set_direction(sending=False)
            except OSError as error:
                self._fail(self._port.failure(error))
            except PortError as error:
                self._fail(str(error))
        self._out.set()

    def write_together(self, item: bytes) -> None:
        """Send bytes: a line has only one request under way."""
        self.write(item)

    async def sent(self) -> None:
        """Wait until everything has been sent."""
        await self._out.wait()

    def close(self) -> None:
        """Close the port."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            self._loop.remove_writer(self._fd)
            self._fd = -1
            self._port.close()
        self._out.set()
