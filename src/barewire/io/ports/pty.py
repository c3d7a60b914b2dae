"""A serial line without hardware: the two ends of a pseudo-terminal.

        our end (master)  <------------------>  the other end (slave), /dev/pts/7: opened like any serial port

A pseudo-terminal has no speed, no parity and no noise: bytes fall out at the other end at once. `pace` gives it the
time of a real line back: sending takes as long as the characters would.
"""

from __future__ import annotations

import contextlib
import os
import select
import time
import tty
from pathlib import Path

from barewire.errors import PortError
from barewire.io.ports.tcp import CHUNK, reason
from barewire.rtu.timing import Timing

_SLAVE_MAJORS = range(136, 144)
"""The device numbers of /dev/pts on Linux."""


class PseudoTerminal:
    """Our end of a new pseudo-terminal. `path` is the other end; `link` a second name for it, removed on close."""

    def __init__(self, link: str | None = None, pace: Timing | None = None) -> None:
        self._link = Path(link) if link else None
        self._pace = pace
        # The other end is kept open here too: otherwise the line fails whenever a client closes it.
        self._ours, self._kept = os.openpty()
        tty.setraw(self._kept)
        self.path = os.ttyname(self._kept)
        if self._link is not None:
            try:
                if self._link.is_symlink() and not self._link.exists():
                    self._link.unlink()  # left over from somebody who had no time to take it away
                self._link.symlink_to(self.path)
            except OSError as error:
                self._link = None
                self.close()
                raise PortError(f"{link}: {reason(error)}") from None
        self.name = link or self.path
        self.sent_at = time.monotonic()
        """When the latest bytes arrived at the other end; `send` returns a little later, or much on a busy machine."""

    def send(self, item: bytes) -> None:
        """Put bytes on the line; takes as long as `pace` says. They arrive when the last one would: whoever answers
        sooner than that would speak while we still do."""
        if self._pace:
            time.sleep(self._pace.duration(len(item)))
        self.sent_at = time.monotonic()
        try:
            left = memoryview(item)
            while left:
                # Nobody may be reading: the system's buffer is finite, and a line that nobody hears loses bytes.
                if not select.select([], [self._ours], [], 1.0)[1]:
                    break
                left = left[os.write(self._ours, left) :]
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def receive(self, timeout: float) -> bytes | None:
        """What came within `timeout` seconds, or None."""
        try:
            ready, _, _ = select.select([self._ours], [], [], min(timeout, 3600.0))
            return os.read(self._ours, CHUNK) if ready else None
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def fileno(self) -> int:
        """The descriptor of our end, for whoever waits with others."""
        return self._ours

    def close(self) -> None:
        """Close both ends and take the link away."""
        for end in (self._ours, self._kept):
            with contextlib.suppress(OSError):
                os.close(end)
        if self._link is not None:
            self._link.unlink(missing_ok=True)


def is_pseudo_terminal(path: str) -> bool:
    """Whether the path names the other end of a pseudo-terminal."""
    try:
        return os.major(os.stat(path).st_rdev) in _SLAVE_MAJORS
    except OSError:
        return False
