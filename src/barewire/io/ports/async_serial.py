"""A serial port under asyncio: the loop watches the descriptor, so this is for POSIX.

Sending takes time on a serial line: `sent` is done when the last bit has left, as far as the system knows; then the
line is turned back, if it is RTS or a function of the user's that turns it.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import Callable

from barewire.errors import PortError
from barewire.io.engine.asyncio import Mailbox
from barewire.io.ports.serial import SerialPort
from barewire.io.ports.tcp import CHUNK, reason

_LOOK = 0.001
"""Seconds between two looks at whether everything is out."""


class SerialLink:
    """An open serial port of this loop. `receive` is given what comes, `lose` why nothing comes any more."""

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
            return self._fail(reason(error))
        if not data:
            return self._fail("the device is gone")
        self._receive(data)

    def _fail(self, why: str) -> None:
        self.close()
        self._lose(why)

    def write(self, item: bytes) -> None:
        """Hand the bytes over, in order, as fast as the system takes them."""
        if self._fd < 0:
            raise PortError(f"{self.name}: the port was closed")
        try:
            self._port.set_direction(sending=True)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None
        self._out.clear()
        self._unsent += item
        self._push()
        self._loop.call_later(self._port.takes(len(item)), self._look)

    def _push(self) -> None:
        try:
            del self._unsent[: os.write(self._fd, self._unsent)]
        except BlockingIOError:
            pass
        except OSError as error:
            return self._fail(reason(error))
        if self._unsent:
            self._loop.add_writer(self._fd, self._push)
        else:
            self._loop.remove_writer(self._fd)

    def _look(self) -> None:
        """Is everything out? Then the line is turned back."""
        if self._fd >= 0:
            with contextlib.suppress(OSError):
                if self._unsent or self._port.waiting():
                    self._loop.call_later(_LOOK, self._look)
                    return
            try:
                self._port.set_direction(sending=False)
            except OSError as error:
                self._fail(reason(error))
            except PortError as error:
                self._fail(str(error))
        self._out.set()

    async def sent(self) -> None:
        """Wait until everything is out."""
        await self._out.wait()

    def close(self) -> None:
        """Give the port back."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            self._loop.remove_writer(self._fd)
            self._fd = -1
            self._port.close()
        self._out.set()


class SerialMailbox(Mailbox):
    """A mailbox whose bytes take their time to leave."""

    link: SerialLink

    async def sent(self) -> float | None:
        """Wait until the last bit has left."""
        await self.link.sent()
        return None
