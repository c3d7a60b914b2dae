"""What a server has seen, for whoever wants to know how the line is. (What the standard counts is in `counters`.)"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class ServerStatistics:
    """Counts from 0, and the latest errors of units."""

    requests: int = 0
    replies: int = 0
    exceptions: int = 0
    broadcasts: int = 0
    for_others: int = 0
    noise_bytes: int = 0
    not_requests: int = 0
    """Frames with bit 7 of the function set."""
    stale: int = 0
    """Requests that other traffic had followed before they could be answered."""
    echoes: int = 0
    """Our own answers, heard."""
    failures: list[str] = field(default_factory=list)
    """The latest errors of a unit's own code, at most ten: they were answered with exception 04."""

    def failed(self, error: Exception) -> None:
        """One more of them. Its text is the user's code as well."""
        try:
            text = str(error)
        except Exception:
            text = "(no text)"
        self.failures = [*self.failures[-9:], f"{type(error).__name__}: {text}"]
