"""Read named values of machines periodically.

Sample k is due at t0 + k * period. If one takes longer than the period, those that became due meanwhile are left out;
later ones are not delayed. If a machine refuses a request for several names, they are read one by one; from then on the
refused names are read alone, and the others together.

Machines on one port share it, and are read one after the other. Several ports are read at the same time, each by a
thread; a port that does not end its poll within the period is left to it, and its machines have no values in it.

    port A    az3, unit 1   az3, unit 2      |-- poll --|              |-- poll --|
    port B    adxl                           |-- poll, time-out ------------------|      <- no answer within the period
              sample                          k                         k + 1
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from queue import Empty, SimpleQueue
from typing import Any, Protocol

from barewire import ModbusClient, connect
from barewire.devices import Device, Reading
from barewire.errors import BarewireError, DecodeError, EncodeError, PortError, Refused
from barewire.io.endpoint import Endpoint
from barewire.io.machine import MachineClient
from barewire_workbench.live.results import text_with_notes
from barewire_workbench.value_log.sample import Poll, Sample, Watched

_NOT_IN_TIME = "no answer within the period"

_MOST_SAMPLES = 1e15
"""A period of 1e-310 s would have more of them than a number can count."""

_SHORTEST_WAIT = 0.05
"""Seconds that other ports are waited for at least, however short the period is."""


class Clock:
    """The clock of the computer; a test has another one."""

    def now(self) -> float:
        """Return seconds that no change of the date disturbs."""
        return time.monotonic()

    def wait_until(self, now: float) -> None:
        """Return at this time."""
        time.sleep(max(0.0, now - time.monotonic()))

    def date(self) -> datetime:
        """Return the time of day with the local zone."""
        return datetime.now().astimezone()


OF_A_VALUE = (Refused, DecodeError)
"""Errors of one value, which fail the reading of others with it; any other is one of the machine or its line."""


class MachineOnLine(Protocol):
    """What a poller uses of a machine."""

    def read(self, name: str, /) -> Reading: ...

    def read_all(self, names: Sequence[str], /) -> list[Reading]: ...

    def close(self) -> None: ...


class Poller:
    """Reads the names of one machine, with as few requests as it allows."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(dict.fromkeys(names))
        # Names that are read alone: those refused, or all of them if they are refused only together.
        self._alone: set[str] = set()

    def poll(self, machine: MachineOnLine) -> Poll:
        """Read every name once. Raises the errors of the machine if nothing was read."""
        readings: dict[str, Reading] = {}
        refused: dict[str, str] = {}
        refusal: Refused | DecodeError | None = None
        alone = self._alone
        try:
            together = machine.read_all([name for name in self.names if name not in alone])
            readings.update((reading.name, reading) for reading in together)
        except OF_A_VALUE as error:
            if len(self.names) == 1:
                raise
            refusal, alone = error, set(self.names)
        for name in self.names:
            if name in alone:
                try:
                    readings[name] = machine.read(name)
                except OF_A_VALUE as error:
                    # The name is beside the reason.
                    refusal, refused[name] = error, str(error).partition("; while reading ")[0]
        if not readings and refusal is not None:
            raise refusal
        refused_only_together = not refused and len(alone) == len(self.names)
        self._alone = alone if refused_only_together else set(refused)
        return Poll(tuple(readings[name] for name in self.names if name in readings), "", refused)


class PolledLine:
    """Machines on one port, which is opened when it is needed, and again after it failed.

    `check` is called with each machine after the port was opened; it raises an error for one that is not to be read,
    and returns False for one that did not answer: that is checked when it does.
    """

    def __init__(
        self,
        machines: Sequence[Watched],
        check: Callable[[Any], bool],
        connect: Callable[[Device, str], Any] = connect,
    ) -> None:
        self.watched = machines
        self.machine: Any = None
        """The first machine, while the port is open."""
        self._machines: list[Any] = []
        self._unchecked: set[int] = set()
        self._check, self._connect = check, connect
        self._pollers = [Poller([watched.device.find(name).name for name in watched.names]) for watched in machines]

    def open(self) -> None:
        """Open the port, if it is not open."""
        if self.machine is None:
            self.machine = self._connect(self.watched[0].device, self.watched[0].endpoint)
            self._machines = [self.machine, *(_Beside(self.machine, watched) for watched in self.watched[1:])]
            self._unchecked = set(range(len(self._machines)))

    def check(self) -> None:
        """Open the port, and check each machine."""
        self.open()
        for number in sorted(self._unchecked):
            self._check_one(number)

    def _check_one(self, number: int) -> None:
        if self._check(self._machines[number]):
            self._unchecked.discard(number)

    def poll(self) -> list[Poll]:
        """Read every name of each machine once."""
        return [self._poll(number) for number in range(len(self.watched))]

    def _poll(self, number: int) -> Poll:
        try:
            self.open()
            poll = self._pollers[number].poll(self._machines[number])
            if number in self._unchecked:  # only now: a silent machine does not pay two time-outs in each sample
                self._check_one(number)
            return poll
        except EncodeError:
            raise  # a request that cannot be encoded fails in every sample
        except BarewireError as error:
            if isinstance(error, PortError):
                self.close()
            return Poll((), text_with_notes(error))

    def close(self) -> None:
        """Close the port."""
        if self.machine is not None:
            self.machine.close()
            self.machine = None


class _Beside:
    """Another machine on the port of a first one."""

    def __init__(self, first: MachineClient, watched: Watched) -> None:
        self.device = device = watched.device
        endpoint = Endpoint.parse(watched.endpoint)
        if isinstance(first.client, ModbusClient):
            unit = endpoint.integer("unit", device.modbus.unit if device.modbus else 1)
            self.client: Any = first.client.at(unit=unit, timeout=endpoint.timeout)
            self._read: Callable[[Sequence[str]], Any] = lambda names: self.client.read(device, *names)
        else:
            self.client = first.client
            self.node = endpoint.integer("node", device.canopen.node if device.canopen else 1)
            node = first.client.node(self.node, device=device, timeout=endpoint.timeout)
            self._read = node.read_all
        self._first = first

    def read(self, name: str, /) -> Reading:
        """Read one parameter."""
        return self.read_all([name])[0]

    def read_all(self, names: Sequence[str], /) -> list[Reading]:
        """Read these parameters."""
        return list(self._read(names)) if names else []

    def close(self) -> None:
        """Close the port of both."""
        self._first.close()


# Rounds


class _Worker:
    """Polls a line in a thread of its own, which does not keep the program from ending."""

    def __init__(self, line: PolledLine) -> None:
        self._asked: SimpleQueue[None] = SimpleQueue()
        self._answers: SimpleQueue[list[Poll] | BaseException] = SimpleQueue()
        self._is_busy = False
        threading.Thread(target=self._run, args=(line,), daemon=True).start()

    def start(self) -> None:
        """Begin a poll, if none is under way."""
        if not self._is_busy:
            self._is_busy = True
            self._asked.put(None)

    def result(self, wait: float) -> list[Poll] | None:
        """Return the polls of the machines; None if they do not come within `wait` seconds."""
        try:
            answer = self._answers.get(timeout=max(0.0, wait))
        except Empty:
            return None
        self._is_busy = False
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def _run(self, line: PolledLine) -> None:
        if hasattr(signal, "pthread_sigmask"):
            # The main thread gets the signals: it can put them off while it writes a row.
            signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
        while True:
            self._asked.get()
            try:
                self._answers.put(line.poll())
            except BaseException as error:
                self._answers.put(error)


def next_sample(number: int, period: float, seconds: float) -> int:
    """Return the number of the sample after `number`: the first whose time is not over yet.

    >>> next_sample(0, 0.5, seconds=0.1), next_sample(1, 0.5, seconds=1.0), next_sample(2, 0.5, seconds=2.3)
    (1, 2, 5)
    """
    # A sample that became due less than a thousandth of a period ago is still made.
    due = int(min(seconds / period, _MOST_SAMPLES) + 0.999)
    return max(number + 1, due)


def samples(
    lines: Sequence[PolledLine],
    period: float,
    *,
    clock: Clock = Clock(),  # noqa: B008  # has no state
    count: int | None = None,
    until: float | None = None,
) -> Iterator[Sample]:
    """Poll all machines `count` times, or until so many seconds are over, or without end; yield each at its time.

    The polls of a sample are in the order of the lines and their machines.
    """
    workers = [_Worker(line) for line in lines] if len(lines) > 1 else []
    start, number, samples_made = clock.now(), 0, 0
    while (count is None or samples_made < count) and (until is None or number * period < until or not samples_made):
        clock.wait_until(start + number * period)
        date, seconds = clock.date(), clock.now() - start
        if workers:
            wait = max(_SHORTEST_WAIT, (number + 1) * period - seconds)
            polls = list(_polls(lines, workers, clock.now() + wait, clock))
        else:
            polls = lines[0].poll()
        yield Sample(seconds, date, tuple(polls))
        samples_made += 1
        number = next_sample(number, period, clock.now() - start)


def _polls(lines: Sequence[PolledLine], workers: Sequence[_Worker], end: float, clock: Clock) -> Iterator[Poll]:
    for worker in workers:
        worker.start()
    for line, worker in zip(lines, workers):
        polls = worker.result(end - clock.now())
        yield from [Poll((), _NOT_IN_TIME)] * len(line.watched) if polls is None else polls


def by_port(machines: Sequence[Watched]) -> list[list[Watched]]:
    """Return the machines on each port, in their order."""
    groups: dict[str, list[Watched]] = {}
    for watched in machines:
        endpoint = Endpoint.parse(watched.endpoint)
        options = {key: text for key, text in endpoint.options.items() if key not in ("unit", "node", "timeout")}
        groups.setdefault(str(endpoint._replace(options=options)), []).append(watched)
    return list(groups.values())
