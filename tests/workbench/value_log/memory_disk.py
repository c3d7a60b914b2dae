"""A disk in memory that loses what was not synced at a power cut, and becomes full."""

from __future__ import annotations

import errno
from random import Random


class Stopped(Exception):
    """The program was killed, or the power was cut."""


class MemoryFile:
    """An open file of `MemoryDisk`."""

    def __init__(self, disk: MemoryDisk, path: str) -> None:
        self._disk, self._path = disk, path
        disk.synced.setdefault(path, disk.contents.setdefault(path, b""))

    def size(self) -> int:
        return len(self._disk.contents[self._path])

    def read(self, at: int, count: int) -> bytes:
        return self._disk.contents[self._path][at : at + count]

    def append(self, data: bytes) -> int:
        """Write what there is space for; at a stop a part of it. Some calls write a part only."""
        disk = self._disk
        try:
            disk.step()
        except Stopped:
            disk.contents[self._path] += data[: disk.random.randrange(len(data) + 1)]
            raise
        if disk.random.random() < 0.02:
            data = data[: disk.random.randrange(1, len(data) + 1)]
        if disk.free is not None:
            data = data[: disk.free]
            if not data:
                raise OSError(errno.ENOSPC, "No space left on device")
            disk.free -= len(data)
        disk.contents[self._path] += data
        return len(data)

    def cut(self, size: int) -> None:
        self._disk.step()
        if self._disk.free is not None:
            self._disk.free += self.size() - size
        self._disk.contents[self._path] = self._disk.contents[self._path][:size]

    def sync(self) -> None:
        self._disk.step()
        self._disk.synced[self._path] = self._disk.contents[self._path]

    def is_in_place(self) -> bool:
        return self._path in self._disk.contents

    def close(self) -> None:
        pass


class MemoryDisk:
    """Files by path. `stop_in`: after so many steps the program is stopped, None: never; `free`: bytes, None: any."""

    def __init__(self, seed: int = 0) -> None:
        self.contents: dict[str, bytes] = {}
        self.synced: dict[str, bytes] = {}
        self.random = Random(seed)
        self.stop_in: int | None = None
        self.free: int | None = None
        self.steps = 0

    def step(self) -> None:
        """Count something that changes the disk. Raises Stopped instead of doing it."""
        self.steps += 1
        if self.stop_in is not None:
            self.stop_in -= 1
            if self.stop_in < 0:
                raise Stopped

    def cut_power(self) -> None:
        """Lose a part of what was not synced; some file systems leave zeros in its place."""
        for path, content in self.contents.items():
            synced = self.synced[path]
            if content.startswith(synced):
                rest = content[len(synced) :]
                kept = rest[: self.random.randrange(len(rest) + 1)]
                zeros = b"\0" * (len(rest) - len(kept)) if self.random.random() < 0.3 else b""
                self.contents[path] = synced + kept + zeros
            elif self.random.random() < 0.5:  # it was cut, and that may be lost
                self.contents[path] = synced
        self.synced = dict(self.contents)

    # What a log needs

    def open(self, path: str) -> MemoryFile:
        if path not in self.contents:
            self.step()
        return MemoryFile(self, path)

    def exists(self, path: str) -> bool:
        return path in self.contents

    def rename(self, old: str, new: str) -> None:
        self.step()
        self.contents[new], self.synced[new] = self.contents.pop(old), self.synced.pop(old)

    def remove(self, path: str) -> None:
        self.step()
        del self.contents[path], self.synced[path]

    def names(self, start: str, end: str) -> list[str]:
        return [path for path in self.contents if path.startswith(start) and path.endswith(end)]
