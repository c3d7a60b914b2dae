"""Frames that are sent again and again: the heartbeat of a master, the set point of a drive.   [CiA 301]

        t0         t0 + T       t0 + 2T      t0 + 3T
        205#0F00   205#0F00     205#0F00     205#1F00      one frame, changed by `update`
        701#05     701#05       701#05       701#05        a heartbeat
        301#01     302#02       301#01       302#02        several frames take turns

The times are absolute, so a late call does not shift the later ones.
"""

from __future__ import annotations

from barewire.canopen.frame import CanFrame
from barewire.errors import EncodeError, shown


def check_period(what: str, period: object) -> float:
    """Return the period in seconds. Raise EncodeError unless it is a number above 0, and finite."""
    if isinstance(period, bool) or not isinstance(period, (int, float)) or not 0 < period < float("inf"):
        raise EncodeError(f"{what} {shown(period)} s: expected a number of seconds above 0", "period")
    return period


def next_due(due: float, period: float, now: float) -> tuple[float, int]:
    """Return the first of the times `due` + k * `period` after `now`, and how many before it were missed.

    >>> next_due(10.0, 2.0, 10.5), next_due(10.0, 2.0, 15.0)
    ((12.0, 0), (16.0, 2))
    """
    missed = int((now - due) / period)
    due += (missed + 1) * period
    # Rounding errors, if the period is tiny compared with the time, shall not send for ever at one time.
    return (due if due > now else now + period), missed


class CyclicProducer:
    """A machine that sends a frame every `period` seconds, the first one at once. Several frames take turns.

    >>> setpoint = CyclicProducer(0.01, CanFrame.parse("205#0F00"))
    >>> setpoint.start(0.0)
    >>> str(setpoint.feed(None, 0.0)[0]), setpoint.deadline
    ('205#0F00', 0.01)
    >>> setpoint.update(CanFrame.parse("205#1F00"))
    >>> setpoint.feed(None, 0.005), str(setpoint.feed(None, 0.01)[0])
    ([], '205#1F00')

    A frame that was due while `feed` was not called is not sent later, but counted in `missed`.
    """

    __slots__ = ("_next", "_turn", "frames", "missed", "period")

    def __init__(self, period: float, *frames: CanFrame) -> None:
        self.period = check_period("period", period)
        self.missed = 0
        self._turn = 0
        self._next: float | None = None
        self.update(*frames)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} every {self.period:g} s: {', '.join(map(str, self.frames))}>"

    def update(self, *frames: CanFrame) -> None:
        """Send these frames from the next time on."""
        if not frames:
            raise EncodeError("expected one frame or several", "frames")
        for frame in frames:
            if not isinstance(frame, CanFrame):
                raise EncodeError(f"{shown(frame)}: expected a CanFrame", "frames")
            CanFrame.checked(
                frame.id, frame.data, extended=frame.extended, remote=frame.remote, requested=frame.requested
            )
        self.frames = frames

    @property
    def deadline(self) -> float | None:
        """When the next frame is due."""
        return self._next

    def start(self, now: float) -> None:
        """Send the first frame now."""
        self._turn = 0
        self._next = now

    def stop(self) -> None:
        """Send no further frame."""
        self._next = None

    def feed(self, item: None, now: float) -> list[CanFrame]:
        """Return the frame, if one is due."""
        if self._next is None or now < self._next:
            return []
        self._next, missed = next_due(self._next, self.period, now)
        self.missed += missed
        frames = self.frames
        frame = frames[self._turn % len(frames)]
        self._turn = (self._turn + 1) % len(frames)
        return [frame]
