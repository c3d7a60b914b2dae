"""A serial line without hardware: the two ends of a pseudo-terminal.

        this end (master)  <------------------>  the other end (slave), /dev/pts/7: opened like any serial port

A pseudo-terminal has neither speed nor parity nor noise: bytes arrive at the other end at once. With `pace`, sending
takes as long as on a real line.
"""

from __future__ import annotations

import contextlib
import os
import stat
import struct
import sys
import time
from pathlib import Path

from barewire.errors import PortError
from barewire.io.ports.descriptor import SharedDescriptor
from barewire.io.ports.network import reason
from barewire.rtu.frame import Timing

_SLAVE_MAJORS = range(136, 144)
"""The device numbers of /dev/pts on Linux."""
_NEW_MODES = (0o600, 0o620)
"""The permissions of a terminal that was not changed by chmod."""
_SAME_TIME = 1.0
"""Seconds by which a link may be older than its terminal although one program made both."""


class PseudoTerminal:
    """One end of a new pseudo-terminal. `path` is the other end; `link` a second name for it, removed on close.

    A link that another program left at this path is replaced, if its terminal is gone. Nothing else is.

    Raises PortError where there are no pseudo-terminals, as on Windows.
    """

    def __init__(self, link: str | None = None, pace: Timing | None = None) -> None:
        try:
            import tty
        except ModuleNotFoundError:
            raise PortError(f"{link or 'pty'}: this system has no pseudo-terminals; give the path of a port") from None
        self._link = Path(link) if link else None
        self._pace = pace
        if self._link is not None and self._link.is_symlink() and not self._link.exists():
            _remove_stale(self._link)
        # The other end stays open here too: otherwise the line fails whenever a client closes it.
        ours, self._kept = os.openpty()
        self._file = SharedDescriptor(ours, lambda: self._close_ends(ours))
        tty.setraw(self._kept)
        self.path = os.ttyname(self._kept)
        if self._link is not None:
            try:
                self._link.symlink_to(self.path)
            except OSError as error:
                self._link = None
                self.close()
                raise PortError(f"{link}: {reason(error)}") from None
        self.name = link or self.path

    def send(self, item: bytes) -> None:
        """Send bytes. With `pace` they arrive at the end of the time that sending takes, so that no answer arrives
        before it is over."""
        if self._pace:
            time.sleep(self._pace.duration(len(item)))
        try:
            # The buffer of the system is finite: bytes that are not read at the other end are lost.
            self._file.write(item, 1.0)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def receive(self, timeout: float) -> bytes | None:
        """Return received bytes, or None after `timeout` seconds."""
        try:
            return self._file.read(timeout)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def fileno(self) -> int:
        """Return the descriptor of this end, for an event loop."""
        return self._file.fileno()

    def close(self) -> None:
        """Close both ends and remove the link, unless there is something else at its path by now."""
        # The link first: after `os.close` another program may get the same number.
        link, self._link = self._link, None
        with contextlib.suppress(OSError):  # gone, not a link, or its folder is gone
            if link is not None and os.readlink(link) == self.path:
                link.unlink()
        self._file.close()

    def _close_ends(self, ours: int) -> None:
        for end in (ours, self._kept):
            with contextlib.suppress(OSError):
                os.close(end)

    def mark_as_served(self) -> None:
        """Mark the terminal as that of a server until it is closed, for `check_not_served` of other servers (Linux)."""
        if sys.platform == "linux":
            import fcntl

            with contextlib.suppress(OSError):  # an emulation of Linux without these locks
                fcntl.fcntl(self._kept, fcntl.F_OFD_SETLK, _file_lock())


def _remove_stale(link: Path) -> None:
    """Remove a broken link that a program left when it was killed: one to a terminal. It would lead to the new terminal
    if that got the same number. Raises PortError for another link, which is the user's."""
    import shlex

    target = os.readlink(link)
    if target.rstrip("0123456789") not in ("/dev/pts/", "/dev/ttys"):  # as Linux and macOS name them
        remedy = f"remove it for a new pseudo-terminal: rm {shlex.quote(str(link))}"
        raise PortError(f"{link}: the link is broken: there is no {target}; {remedy}")
    with contextlib.suppress(OSError):
        link.unlink()


def check_not_served(path: str, end: int) -> None:
    """Raise PortError for the terminal of a live server: a second server would take it for a line of other devices.

    `end` is the descriptor of the opened port: to open and close another one would hang up the other program.
    """
    if sys.platform != "linux" or not is_pseudo_terminal(path):
        return
    import fcntl

    try:
        held = fcntl.fcntl(end, fcntl.F_OFD_GETLK, _file_lock())
    except OSError:
        return  # no such locks here: `mark_as_served` set none
    if held[:2] != struct.pack("h", fcntl.F_UNLCK):
        what = "another barewire server has this pseudo-terminal"
        raise PortError(f"{path}: {what}; stop it, or give this server another path")


def check_not_foreign(path: str) -> None:
    """Raise PortError before a pseudo-terminal is opened that is certainly not the intended line.

        link older than its terminal      its program was killed and left it; the number now belongs to another program
        link without a terminal           the same, and no program has got the number yet
        terminal of a session             a program runs in it, such as a shell, which would get the bytes as its input

    A terminal is as old as the latest change of its inode: when it was made, or got other permissions than a new one.
    """
    if os.path.islink(path):
        link, terminal = os.lstat(path), os.path.realpath(path)
        if not os.path.exists(terminal):
            why = (
                "the program that made this link has ended"
                if terminal.startswith("/dev/pts/")
                else "the link is broken"
            )
            raise PortError(f"{path}: {why}: there is no {terminal}")
        if not is_pseudo_terminal(path):
            return
        state = os.stat(terminal)
        if state.st_ctime > link.st_mtime + _SAME_TIME and stat.S_IMODE(state.st_mode) in _NEW_MODES:
            import shlex

            cause = f"{terminal} was made after this link, by another program"
            raise PortError(
                f"{path}: left over from a program that has ended: {cause}; remove the link: rm {shlex.quote(path)}"
            )
    process = _process_in(path) if is_pseudo_terminal(path) else None
    if process is not None:
        raise PortError(f"{path}: the terminal in which process {process} runs; expected a serial line")


def _process_in(path: str) -> str | None:
    """Return the number of a process whose terminal this is, if there is one (Linux)."""
    device = os.stat(path).st_rdev
    number = os.minor(device) & 0xFF | os.major(device) << 8 | (os.minor(device) & ~0xFF) << 12
    try:
        processes = list(filter(str.isdecimal, os.listdir("/proc")))
    except OSError:
        return None  # no /proc is mounted here
    for process in processes:
        with contextlib.suppress(OSError, IndexError):  # it has ended meanwhile
            # "12 (name) S parent group session terminal ...", and a name may have blanks and brackets
            fields = Path("/proc", process, "stat").read_bytes().rpartition(b")")[2].split()
            if int(fields[4]) == number:
                return process
    return None


def _file_lock() -> bytes:
    """Return the `struct flock` of a lock on the whole file.

    A lock of an open file description (`F_OFD_...`) ends with the process that holds it, and is independent of the
    lock by `flock` with which clients open the port.
    """
    import fcntl

    return struct.pack("hhqqi", fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)


def is_pseudo_terminal(path: str) -> bool:
    """Return whether the path names the other end of a pseudo-terminal."""
    if sys.platform == "win32":  # which has neither these nor device numbers
        return False
    try:
        return os.major(os.stat(path).st_rdev) in _SLAVE_MAJORS
    except OSError:
        return False
