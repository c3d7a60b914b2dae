"""What a server has seen, for whoever wants to know how the line is. (What the standard counts is in `counters`.)"""

from __future__ import annotations

from barewire.record import Shown


class ServerStatistics(Shown):
    """Counts from 0, and the latest errors of units."""

    def __init__(self) -> None:
        self.requests = 0
        self.replies = 0
        self.exceptions = 0
        self.broadcasts = 0
        self.for_others = 0
        self.noise_bytes = 0
        self.not_requests = 0
        """Frames with bit 7 of the function set."""
        self.stale = 0
        """Requests that other traffic had followed before they could be answered."""
        self.echoes = 0
        """Our own answers, heard."""
        self.failures: list[str] = []
        """The latest errors of a unit's own code, at most ten: they were answered with exception 04."""

    def failed(self, error: Exception) -> None:
        """One more of them. Its text is the user's code as well."""
        try:
            text = str(error)
        except Exception:
            text = "(no text)"
        self.failures = [*self.failures[-9:], f"{type(error).__name__}: {text}"]
