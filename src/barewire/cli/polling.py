"""Named values again and again, at times that do not drift: what `barewire watch` asks for, and when.

poll k is due at t0 + k * period; one that took too long makes the next ones be left out, never pushed back

A name that is refused takes no other with it: after a refusal the names are read one by one, and those that are refused
stay apart from the others, which go on travelling together.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

from barewire.devices import Device, Reading
from barewire.errors import BarewireError, EncodeError, PortError, Refused
from barewire.io.machine import MachineClient, connect

_NONE: Mapping[str, str] = MappingProxyType({})


class Poll(NamedTuple):
    """One reading of all names: what came, or why not; `time` is in seconds from the first one on.

    `refused` are the names that the device would not give, each with its words. Where nothing came there is `error`.
    """

    time: float
    readings: tuple[Reading, ...]
    error: str = ""
    refused: Mapping[str, str] = _NONE


def due(number: int, period: float, passed: float) -> int:
    """The number of the next poll after `number`: the first whose time is not past yet.

    >>> due(0, 0.5, passed=0.1), due(1, 0.5, passed=1.0), due(2, 0.5, passed=2.3)
    (1, 2, 5)
    """
    # Nearer than a thousandth of a period counts as now.
    missed = int(passed / period + 0.999)
    return max(number + 1, missed)


class Source:
    """Polls one device. A port that failed is opened anew at the next poll."""

    def __init__(self, endpoint: str, device: Device, names: tuple[str, ...]) -> None:
        self.endpoint, self.device = endpoint, device
        self.names = tuple(dict.fromkeys(device.find(name).name for name in names))
        self.apart: set[str] = set()
        """Names that are read by themselves: those refused, and all where only together they are refused."""
        # The first time a port that is not there is an error; later it may have been unplugged for a while.
        self.machine: MachineClient | None = connect(device, endpoint)

    def poll(self, time: float) -> Poll:
        """Read once."""
        try:
            if self.machine is None:
                self.machine = connect(self.device, self.endpoint)
            return self._read(self.machine, time)
        except EncodeError:
            raise  # what cannot be asked for today cannot be asked for tomorrow
        except BarewireError as error:
            if isinstance(error, PortError):
                self.close()
            return Poll(time, (), _words(error))

    def _read(self, machine: MachineClient, time: float) -> Poll:
        came: dict[str, Reading] = {}
        refused: dict[str, str] = {}
        together = [name for name in self.names if name not in self.apart]
        alone = [name for name in self.names if name in self.apart]
        last: Refused | None = None
        try:
            came.update((reading.name, reading) for reading in machine.read_all(together))
        except Refused as error:
            last, alone = error, list(self.names)
        if len(self.names) == 1 and last is not None:
            raise last
        for name in alone:
            try:
                came[name] = machine.read(name)
            except Refused as error:
                last = error
                refused[name] = str(error)
        if not came and last is not None:
            raise last
        one_by_one = not refused and (last is not None or len(alone) == len(self.names))
        self.apart = set(self.names) if one_by_one else set(refused)
        return Poll(time, tuple(came[name] for name in self.names if name in came), "", refused)

    def close(self) -> None:
        """Give the port back."""
        if self.machine is not None:
            self.machine.close()
            self.machine = None


def _words(error: BarewireError) -> str:
    return "; ".join([str(error), *getattr(error, "__notes__", [])])


def polls(source: Source, period: float, count: int | None) -> Iterator[Poll]:
    """Poll after poll, each at its time, until `count` of them were made."""
    began, number, made = time.monotonic(), 0, 0
    while count is None or made < count:
        time.sleep(max(0.0, began + number * period - time.monotonic()))
        yield source.poll(time.monotonic() - began)
        made += 1
        number = due(number, period, time.monotonic() - began)
