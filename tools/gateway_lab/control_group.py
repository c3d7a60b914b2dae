"""A control group of Linux: programs in it have so much memory together, and so much of a processor.

    version 1    /sys/fs/cgroup/memory/NAME and /sys/fs/cgroup/cpu/NAME
    version 2    /sys/fs/cgroup/NAME

What is charged to a group: the memory of its programs, and the pages of files that they were the first to read. Pages
of libraries that another program has read before are not; so the resident memory of each is looked at as well.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

_PERIOD = 100_000
"""Microseconds in which the share of the processor is counted."""


class NoControlGroup(Exception):
    """A control group cannot be made here; the text says what is needed."""


class ControlGroup:
    """A group with these limits, in MiB and in processors. It is removed with the block, after its programs."""

    def __init__(self, memory: int, cpu: float, *, root: Path = Path("/sys/fs/cgroup")) -> None:
        self.memory, self.cpu = memory, cpu
        self._root = root
        name = f"barewire-{os.getpid()}"
        self.is_second = (root / "cgroup.controllers").exists()
        parents = [root] if self.is_second else [root / "memory", root / "cpu"]
        self.folders = [parent / name for parent in parents]

    def __enter__(self) -> ControlGroup:
        quota = int(self.cpu * _PERIOD)
        try:
            if self.is_second:
                self._enable()
            elif not all(folder.parent.is_dir() for folder in self.folders):
                raise NoControlGroup(f"{self._root} has no control groups for memory and cpu")
            for folder in self.folders:
                folder.mkdir()
            if self.is_second:
                self._write("memory.max", self.memory << 20)
                with suppress(OSError):  # a kernel without swap has no such file
                    self._write("memory.swap.max", 0)
                self._write("cpu.max", f"{quota} {_PERIOD}")
            else:
                self._write("memory.limit_in_bytes", self.memory << 20)
                with suppress(OSError):
                    self._write("memory.memsw.limit_in_bytes", self.memory << 20)
                self._write("cpu.cfs_period_us", _PERIOD)
                self._write("cpu.cfs_quota_us", quota)
        except OSError as error:
            self.__exit__()
            need = "needed is root on a Linux whose control groups can be written (in a container: --privileged)"
            raise NoControlGroup(f"{error.filename}: {error.strerror}; {need}") from None
        return self

    def __exit__(self, *_: object) -> None:
        for folder in self.folders:
            for _attempt in range(50):  # the kernel forgets ended programs a little later
                with suppress(OSError):
                    folder.rmdir()
                if not folder.exists():
                    break
                time.sleep(0.1)

    def _enable(self) -> None:
        there = (self._root / "cgroup.controllers").read_text().split()
        if missing := {"memory", "cpu"} - set(there):
            raise NoControlGroup(f"{self._root} has no controller for {' and '.join(sorted(missing))}")
        (self._root / "cgroup.subtree_control").write_text("+memory +cpu")

    def _file(self, name: str) -> Path:
        return next(folder / name for folder in self.folders if self.is_second or name.startswith(folder.parent.name))

    def _write(self, name: str, value: object) -> None:
        self._file(name).write_text(f"{value}\n")

    @property
    def enter(self) -> Sequence[str]:
        """What stands before the command of a program that starts in the group."""
        writes = "; ".join(f"echo $$ > {folder}/cgroup.procs" for folder in self.folders)
        return ("sh", "-c", f'{writes}; exec "$@"', "sh")

    @property
    def peak(self) -> float:
        """The most memory that was charged to the group, in MiB."""
        name = "memory.peak" if self.is_second else "memory.max_usage_in_bytes"
        return int(self._file(name).read_text()) / 2**20

    @property
    def killed(self) -> int:
        """How many programs the kernel has killed because the memory was not enough."""
        return self._counters("memory.events" if self.is_second else "memory.oom_control").get("oom_kill", 0)

    @property
    def throttled(self) -> float:
        """In which part of the periods the share of the processor was used up."""
        counters = self._counters("cpu.stat")
        return counters["nr_throttled"] / max(1, counters["nr_periods"])

    def _counters(self, name: str) -> dict[str, int]:
        rows = (line.split() for line in self._file(name).read_text().splitlines())
        return {row[0]: int(row[1]) for row in rows if len(row) == 2}
