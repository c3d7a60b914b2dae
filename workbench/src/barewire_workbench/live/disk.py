"""The files of a log of values on the disk of this computer."""

from __future__ import annotations

import os
from contextlib import suppress
from glob import escape, glob

from barewire.errors import PortError


class DiskFile:
    """A file to the end of which is written. Nothing is kept in the memory of the program.

    Raises OSError, PortError if another program has the file open to write a log.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0), 0o644)
        try:
            import fcntl
        except ModuleNotFoundError:  # Windows
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._file)
            raise PortError(f"{path}: another program writes to it") from None
        except OSError:  # a file system without locks
            pass

    def size(self) -> int:
        """Return the size in bytes."""
        return os.fstat(self._file).st_size

    def read(self, at: int, count: int) -> bytes:
        """Return `count` bytes from `at` on, less at the end."""
        os.lseek(self._file, at, os.SEEK_SET)
        data = b""
        while len(data) < count and (piece := os.read(self._file, count - len(data))):
            data += piece
        return data

    def append(self, data: bytes) -> int:
        """Write at the end, and return how many of the bytes."""
        return os.write(self._file, data)

    def cut(self, size: int) -> None:
        """Make the file shorter."""
        os.ftruncate(self._file, size)

    def sync(self) -> None:
        """Return when what was written is on the disk."""
        os.fsync(self._file)

    def is_in_place(self) -> bool:
        """Return whether it still has its path."""
        try:
            return os.path.samestat(os.stat(self._path), os.fstat(self._file))
        except FileNotFoundError:
            return False

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


class LocalDisk:
    """Makes, renames and removes files; each is so after a power cut too."""

    def open(self, path: str) -> DiskFile:
        """Open a file, or make it."""
        is_new = not os.path.exists(path)
        file = DiskFile(path)
        if is_new:
            _sync_folder(path)
        return file

    def exists(self, path: str) -> bool:
        """Return whether there is such a file."""
        return os.path.exists(path)

    def rename(self, old: str, new: str) -> None:
        """Give a file another name."""
        os.rename(old, new)
        _sync_folder(new)

    def remove(self, path: str) -> None:
        """Remove a file."""
        os.remove(path)

    def names(self, start: str, end: str) -> list[str]:
        """Return the paths that begin and end so, that of the file which was written last at the end."""
        # Not by name: in the night in which summer time ends an hour comes twice.
        return sorted(glob(f"{escape(start)}*{escape(end)}"), key=lambda path: (os.stat(path).st_mtime_ns, path))


def _sync_folder(path: str) -> None:
    with suppress(OSError):  # Windows cannot open a folder
        folder = os.open(os.path.dirname(os.path.abspath(path)), os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
