"""The machine of a panel: one thread owns the port, whatever the number of browsers.

    browsers     look_at(names) ... look_at(names)       write(name, value)        changes_since(revision)
                        \\      /                              |                          ^
    thread        the union is polled, in blocks     between two blocks      values and frames, numbered

Only what is looked at is polled, and at most half of the time, so that a slow line stays free for writes. A machine
that does not answer is asked for one value only until it does. A write is sent once, and read back.
"""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from math import isfinite
from queue import Empty, Full, Queue
from typing import TYPE_CHECKING, Any, NamedTuple

from barewire import connect
from barewire.codecs import Value
from barewire.devices import Device, Parameter, Reading
from barewire.errors import BarewireError, NoAnswer, PortError
from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.panels.diagnosis import LastFrames
from barewire_workbench.cli.shown_frames import ShownFrames
from barewire_workbench.live.check_device import check_device
from barewire_workbench.live.polling import OF_A_VALUE, Clock, Poller
from barewire_workbench.live.read_values import read_alone
from barewire_workbench.live.results import text_with_notes
from barewire_workbench.live.save_settings import select
from barewire_workbench.settings.rules import SettingRules
from barewire_workbench.value_log.sample import plain_value

if TYPE_CHECKING:
    from barewire.io.ports.base import Direction
    from barewire_workbench import Explanation

_BLOCK = 16
"""Values of one poller: a write waits for one block at most."""
_FRAMES = 300
"""Frames that are kept."""
_WRITES = 32
"""Writes that may wait."""
_DIAGNOSED = 1.0
"""Seconds between two diagnoses of the line; one takes some ten milliseconds."""
_IDLE = 0.5
"""Seconds after which the thread looks whether there is something to do."""


NOT_ASKED = "not asked yet"
"""The problem of a machine of which no value was looked at so far."""


class Busy(BarewireError):
    """Too many writes wait for the line."""


class KeptFrame(NamedTuple):
    """A frame that passed."""

    number: int
    direction: str
    digits: str
    explanation: Explanation


class _KeptFrames(ShownFrames):
    """Joins frames and explains them; a panel keeps them."""

    def __init__(self, endpoint: str, device: Device, keep: Callable[[str, str, Explanation], None]) -> None:
        super().__init__(endpoint, device)
        self._keep = keep

    def show_frame(self, word: str, digits: str, explanation: Explanation) -> None:
        """Keep one explained frame."""
        self._keep(word, digits, explanation)


class PanelLine:
    """A machine that is polled while a page shows it. `turn` does what is due now; `run` repeats it in a thread."""

    def __init__(
        self,
        device: Device,
        endpoint: str,
        *,
        period: float = 0.5,
        check: bool = True,
        connect: Callable[..., Any] = connect,
        clock: Clock = Clock(),  # noqa: B008  # has no state
    ) -> None:
        self.device, self.endpoint, self.period = device, endpoint, period
        self.on_change: Callable[[], None] = lambda: None
        self.revision = 0
        self.polls = 0
        self.frames: deque[KeptFrame] = deque(maxlen=_FRAMES)
        self._frames = _KeptFrames(endpoint, device, self._keep_frame)
        self._last_frames = LastFrames(device, endpoint)
        self._diagnosis: tuple[int, dict[str, Any]] = 0, {}  # revision, what was found
        self._next_diagnosis, self._diagnosed = 0.0, 0
        self._connect, self._check, self._clock = connect, check, clock
        self._machine: Any = None
        self._is_known = self._is_checking = False
        self._problem, self._is_alive, self._since = NOT_ASKED, False, clock.now()
        self._start = clock.now()
        self._cells: dict[str, tuple[int, Any, str, str]] = {}  # name -> revision, value, text, why there is none
        # What a reading changes is not polled; its cell says why.
        self._cells |= {name: (1, None, "", f"not polled: {why}") for name, why in read_alone(device).items()}
        self._polled = [row.name for row in device.parameters if row.name not in self._cells]
        self.is_can = Endpoint.parse(endpoint).scheme == "can"
        self.menus = SettingRules.of(device).behind_menus(is_can=self.is_can)
        """Settings that are read and written only on demand, because numbers must be written before."""
        self._looked_at: Counter[str] = Counter()
        self._pollers: dict[tuple[str, ...], Poller] = {}
        self._next_block = 0
        self._writes: Queue[tuple[str, Value | None, Future[str]]] = Queue(_WRITES)
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._stop = False

    # For browsers, from any thread

    @contextmanager
    def look_at(self, names: Iterable[str]) -> Iterator[None]:
        """Have these values polled while the block runs."""
        names = list(dict.fromkeys(names))
        with self._lock:
            self._looked_at.update(names)
        self._wake.set()
        try:
            yield
        finally:
            with self._lock:
                self._looked_at -= Counter(names)

    def write(self, name: str, value: Value | None) -> Future[str]:
        """Have a value written, or a setting of a menu only read (None); the result says what the machine has then.
        Raises Busy."""
        result: Future[str] = Future()
        try:
            if self._stop:
                raise Busy("the panel has ended: nothing was sent")
            self._writes.put_nowait((name, value, result))
        except Full:
            raise Busy(f"{_WRITES} writes wait for the line: try again") from None
        self._wake.set()
        return result

    def changes_since(self, revision: int, names: Iterable[str]) -> dict[str, Any]:
        """Return the state of the machine, and the values and frames that are newer than a revision."""
        with self._lock:
            cells = {name: self._cells[name] for name in names if name in self._cells}
            return {
                "revision": self.revision,
                "at": round(self._clock.now() - self._start, 3),
                "alive": self._is_alive,
                "problem": self._problem,
                "for": round(self._clock.now() - self._since, 1),
                "polls": self.polls,
                "values": {name: cell[1:] for name, cell in cells.items() if cell[0] > revision},
                "frames": [
                    (frame.number, frame.direction, frame.digits, frame.explanation.verdict, frame.explanation.valid)
                    for frame in self.frames
                    if frame.number > revision
                ],
                "diagnosis": self._diagnosis[1] if self._diagnosis[0] > revision else None,
            }

    def frame(self, number: int) -> KeptFrame | None:
        """Return a frame by its number; None if it is no longer kept."""
        with self._lock:
            return next((frame for frame in self.frames if frame.number == number), None)

    # In the thread of the line

    def run(self) -> None:
        """Do what is due until `stop`."""
        try:
            while not self._stop:
                self._wake.clear()
                pause = self.turn()
                if self._writes.empty():
                    self._wake.wait(pause)
        except BaseException as error:
            self._is_alive, self._problem = False, f"the code of the panel failed: {error!r}"
            raise
        finally:
            self._stop = True
            with suppress(Empty):
                while True:
                    self._writes.get_nowait()[2].set_exception(BarewireError("the panel has ended: nothing was sent"))
            self._close()

    def stop(self) -> None:
        """End `run` after what it is doing. A write that waits is not sent, and fails."""
        self._stop = True
        self._wake.set()

    def turn(self) -> float:
        """Write what waits, poll once what is looked at; return the seconds until the next poll is due."""
        start = self._clock.now()
        with self._lock:
            names = [name for name in self._polled if self._looked_at[name]]
        try:
            self._do_writes()
            if names:
                if not self._is_alive:
                    self._poll_block(Poller(names[:1]))
                self._poll(names)
        except BarewireError as error:
            self._failed(error)
        self._frames.flush()
        self._diagnose()
        self.on_change()
        return max(self.period, 2 * (self._clock.now() - start)) if names else _IDLE

    def _poll(self, names: Sequence[str]) -> None:
        blocks = [tuple(names[place : place + _BLOCK]) for place in range(0, len(names), _BLOCK)]
        self._pollers = {block: self._pollers.get(block) or Poller(block) for block in blocks}
        # An error ends the poll. The next one begins behind its block: a line that loses answers must not leave the
        # last blocks unread.
        for _ in blocks:
            block = blocks[self._next_block % len(blocks)]
            self._next_block += 1
            self._poll_block(self._pollers[block])
        self.polls += 1

    def _poll_block(self, poller: Poller) -> None:
        machine = self._opened()
        try:
            poll = poller.poll(machine)
        except OF_A_VALUE as error:  # every value of the block
            self._keep((), dict.fromkeys(poller.names, str(error).partition("; while reading ")[0]))
        else:
            self._keep(poll.readings, poll.refused)
        self._answered()
        self._do_writes()

    def _do_writes(self) -> None:
        while not self._writes.empty():
            name, value, result = self._writes.get_nowait()
            if not result.set_running_or_notify_cancel():
                continue
            try:
                machine = self._opened(before_write=True)
                setting = self.menus.get(name)
                if setting is None:
                    parameter, read_as = self.device.find(name), name
                else:
                    parameter, read_as = setting.parameter, setting.read_as
                    select(machine, self.endpoint, setting)
                if value is not None:
                    machine.write(read_as, value)
                done = "read" if value is None else "written"
                result.set_result(self._read_back(machine, parameter, read_as, done))
                self._answered()
            except BarewireError as error:
                result.set_exception(error)
                if isinstance(error, (NoAnswer, PortError)):
                    raise
            except BaseException as error:
                result.set_exception(error)
                raise

    def _read_back(self, machine: Any, parameter: Parameter, read_as: str, done: str) -> str:
        if not (parameter.readable and parameter.answered):
            return "sent: it cannot be read back"
        try:
            reading = Reading(parameter, machine.read(read_as).value)
        except BarewireError as error:
            return f"{done}; not read back: {error}"
        self._keep([reading], {})
        return f"{done}; the device has {parameter.text(reading.value)}"

    def _opened(self, *, before_write: bool = False) -> Any:
        """Return the connected machine, asked once for each connection what it is."""
        if self._machine is None:
            self._machine = self._connect(self.device, self.endpoint, watch=self._watch)
            self._is_known = not self._check
        if not self._is_known:
            self._is_checking = True
            try:
                check_device(self._machine, before_write=before_write)
            finally:
                self._is_checking = False
            self._is_known = True
        return self._machine

    def _answered(self) -> None:
        if not self._is_alive:
            self._is_alive, self._problem, self._since = True, "", self._clock.now()

    def _failed(self, error: BarewireError) -> None:
        with self._lock:
            if self._is_alive:
                self._is_alive, self._since = False, self._clock.now()
            self._problem = text_with_notes(error)
            self._is_known = not self._check  # what answers next may be another machine
        if isinstance(error, PortError):
            self._close()

    def _close(self) -> None:
        if self._machine is not None:
            self._machine.close()
            self._machine = None

    def _keep(self, readings: Iterable[Reading], refused: Mapping[str, str]) -> None:
        cells: dict[str, tuple[Any, str, str]] = {
            row.name: (_cell_value(row.value), row.parameter.text(row.value), "") for row in readings
        }
        cells |= {name: (None, "", reason) for name, reason in refused.items()}
        with self._lock:
            for name, cell in cells.items():
                if name not in self._cells or self._cells[name][1:] != cell:
                    self.revision += 1
                    self._cells[name] = (self.revision, *cell)

    def _watch(self, direction: Direction, item: Any) -> None:
        if not self._is_checking:  # many devices refuse to say what they are: that is no fault
            self._last_frames.take(direction, item, self._clock.now() - self._start)
        self._frames.watch(direction, item)

    def _diagnose(self) -> None:
        """Diagnose the last frames, if others have passed."""
        now, taken = self._clock.now(), self._last_frames.taken
        if taken == self._diagnosed or now < self._next_diagnosis:
            return
        self._next_diagnosis, self._diagnosed = now + _DIAGNOSED, taken
        diagnosis = self._last_frames.diagnosis()
        with self._lock:
            self.revision += 1
            self._diagnosis = self.revision, diagnosis

    def _keep_frame(self, direction: str, digits: str, explanation: Explanation) -> None:
        with self._lock:
            self.revision += 1
            self.frames.append(KeptFrame(self.revision, direction, digits, explanation))


def _cell_value(value: Value) -> int | float | str | None:
    """Return a value for the page; None for NaN and the infinities, which only the text shows: JSON has none, and the
    scope draws nothing there."""
    return None if isinstance(value, float) and not isfinite(value) else plain_value(value)


@contextmanager
def running(line: PanelLine) -> Iterator[PanelLine]:
    """Run a line in a thread while the block runs."""
    thread = threading.Thread(target=line.run, name=line.endpoint, daemon=True)
    thread.start()
    try:
        yield line
    finally:
        line.stop()
        thread.join(5)
