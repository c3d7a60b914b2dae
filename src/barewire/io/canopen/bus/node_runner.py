"""Runs machines that also send, such as a SYNC producer or a whole node, each in a thread of its own.

`async_bus` runs them in asyncio tasks.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol, Self

from barewire.canopen.frame import CanFrame, ErrorFrame, FdFrame
from barewire.errors import EncodeError, PortError, shown
from barewire.io.canopen.bus.subscriber import BusDown, BusItem, FrameBus, FramesLost, Key, Subscriber
from barewire.io.engine.locking import SharedNode, exclusive
from barewire.io.log import PortLog

_BUS_OFF, _RESTARTED = 0x40, 0x100

CHECK_INTERVAL = 0.1
"""Seconds after which a machine is fed at the latest, because another thread may have changed its values."""


@dataclass
class NodeStatistics:
    """Counters of a node, or of another machine that runs on a bus."""

    received: int = 0
    """Frames received."""
    sent: int = 0
    unsent: int = 0
    """Frames that could not be sent, for example because no other node acknowledges them."""
    others: int = 0
    """Received items that are not classical CAN frames: reports of the controller, and CAN FD frames."""
    lost: int = 0
    """Frames that arrived faster than they were taken."""
    failures: int = 0
    """How often the port of the bus failed; each time it was opened again."""
    errors: list[str] = field(default_factory=list)
    """The latest ten errors in the code of the device; it works on after each."""

    def failed(self, text: str) -> None:
        """Record an error in the code of the device."""
        self.errors = [*self.errors[-9:], text]

    def count(self, item: BusItem | None) -> None:
        """Count an item that was received from the bus."""
        if isinstance(item, CanFrame):
            self.received += 1
        elif isinstance(item, FramesLost):
            self.lost += item.frames
        elif isinstance(item, BusDown):
            self.failures += 1
        elif isinstance(item, (ErrorFrame, FdFrame)):
            self.others += 1

    def refused(self, frame: CanFrame, error: PortError, log: PortLog) -> None:
        """Count and log a frame that could not be sent."""
        self.unsent += 1
        log.warning("unsent", f"frame {frame} not sent: {log.short(error)}")


class Speaker(Protocol):
    """A machine that sends frames, at its deadline or when it receives some."""

    @property
    def deadline(self) -> float | None: ...

    def feed(self, item: None, now: float) -> list[CanFrame]: ...


def check_instance(device: object) -> None:
    """Raise EncodeError for a class where an instance is expected."""
    if isinstance(device, type):
        name = device.__name__
        raise EncodeError(f"device: expected an instance, got the class {name}; write {name}(...)", "device")


def checked_machine(machine: Speaker) -> Speaker:
    """Return the machine. Raises EncodeError for an object that cannot run on a bus."""
    check_instance(machine)
    if not (hasattr(machine, "feed") and hasattr(machine, "deadline")):
        expected = "a LocalNode, or another machine with feed and deadline"
        raise EncodeError(f"{shown(machine)}: expected {expected}", "device")
    return machine


def check_node_is_free(bus: FrameBus, machine: object) -> None:
    """Raise EncodeError if a node with the same node-ID runs on this bus: both would answer each request."""
    numbers = node_ids(machine)
    for subscriber in tuple(bus.subscribers) if numbers else ():
        for number in sorted(numbers & node_ids(subscriber.machine)):
            text = f"node {number} runs on {bus.name} already: expected another node-ID, or stop the other one first"
            raise EncodeError(text, "device")


def node_ids(machine: object) -> frozenset[int]:
    """Return the node-IDs of a whole node, of a simulated one, or of a group. Other machines, such as a heartbeat
    producer, may serve a node that is on the bus."""
    from barewire.canopen import LocalNode, NodeGroup  # not at the top: few programs host a node

    machine = machine.served if isinstance(machine, SharedNode) else machine
    if isinstance(machine, NodeGroup):
        return frozenset[int]().union(*map(node_ids, machine.nodes))
    node = machine if isinstance(machine, LocalNode) else getattr(machine, "node", None)
    return frozenset([node.node]) if isinstance(node, LocalNode) and node.node is not None else frozenset()


class CallbackAdapter:
    """A machine whose results are frames and events, such as the master of node guarding. Its frames go to the bus, its
    events to `callback`, in the thread or task of the machine.

    An error of a callback is reported to `on_failure`, and the machine goes on. Without `on_failure` it is raised.
    """

    def __init__(self, machine: Any, callback: Callable[[Any], object]) -> None:
        self.machine = machine
        self.callback = callback
        self.on_failure: Callable[[str, Exception], object] | None = None

    @property
    def deadline(self) -> float | None:
        """The deadline of the machine."""
        due: float | None = self.machine.deadline
        return due

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Feed the machine; return its frames, and call the callback with its events."""
        frames = []
        for item in self.machine.feed(frame, now):
            if isinstance(item, CanFrame):
                frames.append(item)
            else:
                self.call(self.callback, item)
        return frames

    def call(self, callback: Callable[..., object], *values: Any) -> None:
        """Call a callback of the application, and report its error."""
        try:
            callback(*values)
        except Exception as error:
            if self.on_failure is None:
                raise
            self.on_failure("callback", error)


class NodeDriver:
    """Feeds a machine on a bus with frames, with time, and with bus-off and recovery of the controller.

    An error in the code of the machine is counted and logged with its traceback, and the machine is fed again at the
    next frame or after 0.1 s. A machine with `on_failure`, such as `LocalNode`, reports its errors itself and answers
    the request; an `on_failure` of the application is called as well. Only an error of `start` is raised.

    A node that goes bus-off follows its error behavior. It sends emergency 8140h when it is back on the bus: after the
    controller was restarted, or when a frame arrives. While a bus is being opened again, it is only silent for the
    machine.
    """

    def __init__(self, machine: Speaker, statistics: NodeStatistics, log: PortLog) -> None:
        self.machine = machine
        self.statistics = statistics
        self._log = log
        self._off = False
        self._waits_until = float("-inf")
        # Any machine may have `on_failure`, as `LocalNode` has.
        self._reporter: Any = machine.served if isinstance(machine, SharedNode) else machine
        self._on_failure: Callable[[str, Exception], object] | None = None
        self._is_attached = False

    def start(self, now: float) -> list[CanFrame]:
        """Start a machine, if it has a `start`, feed it the time, and return its first frames. An error is raised."""
        if hasattr(self._reporter, "on_failure"):
            self._on_failure, self._is_attached = self._reporter.on_failure, True
            self._reporter.on_failure = self._failed
        start = getattr(self.machine, "start", None)
        return [*((start and start(now)) or ()), *self._feed(None, now)]

    def release(self) -> None:
        """Give the machine back its own `on_failure`; end the frames that the kernel sends for it."""
        if getattr(self.machine, "by_kernel", False):
            self._reporter.close()
        if self._is_attached:
            self._is_attached = False
            self._reporter.on_failure = self._on_failure

    def _failed(self, place: str, error: Exception) -> None:
        text = f"{type(error).__name__}: {_text_of(error)}"
        self.statistics.failed(f"{place}: {text}")
        self._log.error(("code", place, type(error)), f"{place}: its code failed: {text}", error)
        if self._on_failure is not None:
            self._on_failure(place, error)

    def wait(self, now: float) -> float:
        """Return the seconds after which the machine must be fed, if nothing is received before."""
        try:
            deadline = self.machine.deadline
        except Exception as error:
            self._caught("deadline", error)
            deadline = None
        wait = CHECK_INTERVAL if deadline is None else min(CHECK_INTERVAL, deadline - now)
        return max(0.0, wait, min(CHECK_INTERVAL, self._waits_until - now))

    def feed(self, item: BusItem | None, now: float) -> list[CanFrame]:
        """Feed the machine with an item, or with the time, and return its frames."""
        try:
            return self._feed(item, now)
        except Exception as error:
            self._waits_until = now + CHECK_INTERVAL
            self._caught("feed", error)
            return []

    def _caught(self, place: str, error: Exception) -> None:
        """Report an error that the machine raised. `on_failure` of the application may have raised it."""
        on_failure, self._on_failure = self._on_failure, None
        try:
            self._failed(f"{type(self._reporter).__name__}.{place}", error)
        finally:
            self._on_failure = on_failure

    def _feed(self, item: BusItem | None, now: float) -> list[CanFrame]:
        frame = item if isinstance(item, CanFrame) else None
        classes = item.classes if isinstance(item, ErrorFrame) else 0
        frames: list[CanFrame] = []
        if self._off and (frame is not None or classes & _RESTARTED):
            self._off = False
            recovered = getattr(self.machine, "recovered", None)
            frames = [] if recovered is None else recovered(now)
        if classes & _BUS_OFF:
            self._off = True
            bus_off = getattr(self.machine, "bus_off", None)
            if bus_off is not None:
                bus_off(now)
        return frames + self.machine.feed(frame, now)  # type: ignore[arg-type]


def _text_of(error: BaseException) -> str:
    """Return the text of an error. Its `__str__` may belong to the application, and fail."""
    try:
        return str(error)
    except Exception:
        return "(no text)"


def ended_text(machine: object, error: BaseException) -> str:
    """Return the text that tells that a machine has ended."""
    name = type(machine.served if isinstance(machine, SharedNode) else machine).__name__
    return f"{name} ended: its code failed: {type(error).__name__}: {_text_of(error)}"


Action = Callable[[float], Iterable[CanFrame] | None]
"""Changes a machine at the given time; the frames that it returns are sent."""


class RunningMachine:
    """A machine on a bus, until it is stopped or the bus is closed. `statistics` counts frames, also those that could
    not be sent; the machine continues."""

    def __init__(
        self, bus: FrameBus, machine: Speaker, statistics: NodeStatistics | None = None, log: PortLog | None = None
    ) -> None:
        self.machine = machine
        self.statistics = NodeStatistics() if statistics is None else statistics
        self._log = PortLog("barewire.canopen.client", f"can://{bus.name}") if log is None else log
        self._driver = NodeDriver(machine, self.statistics, self._log)
        check_node_is_free(bus, machine)
        self.failure: BaseException | None = None
        """The error that ended the machine: it could not be started."""
        self.by_kernel: bool = getattr(machine, "by_kernel", False)
        """Whether the kernel sends the frames of the machine."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """Stop the machine: it sends no further frame."""
        raise NotImplementedError

    def _ended(self, error: BaseException) -> None:
        self.failure = error
        self._log.error("ended", ended_text(self.machine, error), error)

    def _release(self) -> None:
        self._driver.release()
        self._log.flush()

    def _check_running(self) -> None:
        if self.failure is not None:
            raise PortError(f"{self._log.place}: {ended_text(self.machine, self.failure)}")


class Running(RunningMachine):
    """A machine in a thread of its own.

    `do` changes the machine from another thread, and sends the resulting frames at once. A change without `do` takes
    effect within 0.1 s.
    """

    def __init__(self, bus: FrameBus, machine: Speaker, keys: Iterable[Key] | None) -> None:
        super().__init__(bus, machine)
        self._sending = threading.RLock()  # frames are sent in the order in which they were made
        self._subscriber = Subscriber(bus, keys, node=True, reports=True)
        self._subscriber.machine = machine
        self._is_ending = False
        self._thread = threading.Thread(target=self._run, name=f"{type(machine).__name__} on {bus.name}", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._serve()
        except BaseException as error:
            self._ended(error)
            raise
        finally:
            self._release()

    def _serve(self) -> None:
        machine, driver, clock = self.machine, self._driver, time.monotonic
        with self._subscriber:
            with self._sending:
                with exclusive(machine):
                    frames = driver.start(clock())
                self._send(frames)
            while True:
                try:
                    arrived = self._subscriber.pull(driver.wait(clock()))
                except PortError:
                    return
                if self._is_ending:
                    return
                item = None if arrived is None else arrived.item
                self.statistics.count(item)
                with self._sending:
                    with exclusive(machine):
                        frames = driver.feed(item, clock())
                    self._send(frames)

    def _send(self, frames: Iterable[CanFrame]) -> None:
        for frame in frames:
            try:
                self._subscriber.send(frame)
                self.statistics.sent += 1
            except PortError as error:
                self.statistics.refused(frame, error, self._log)

    def do(self, action: Action) -> None:
        """Call `action(now)` with the machine locked, then send the frames that it returns and those that are due.

        Raises what the action raises, and PortError if the machine has ended.
        """
        self._check_running()
        with self._sending:
            with exclusive(self.machine):
                now = time.monotonic()
                frames = [*(action(now) or ()), *self._driver.feed(None, now)]
            self._send(frames)  # without the lock of the machine: sending may wait for room

    def stop(self) -> None:
        """Stop the machine: it sends no further frame. Returns when the thread has ended. Frames that the machine has
        not received yet are dropped."""
        self._is_ending = True
        self._subscriber.close()
        if self._thread is not threading.current_thread():
            self._thread.join()

    close = stop


def stop_all(tasks: Iterable[Any]) -> None:
    """Stop machines, and close other users of a bus. All threads are told to end before the first one is waited for."""
    running = list(tasks)  # a weak set may change meanwhile
    for task in running:
        if isinstance(task, Running):
            task._is_ending = True  # nothing else: with many threads at work, each lock would wait for all of them
    for task in running:
        task.close()
