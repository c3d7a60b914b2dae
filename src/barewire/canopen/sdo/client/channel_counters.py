"""Counts of the frames that a client received on and beside its SDO channel, and the sentence on a time-out."""

from __future__ import annotations

from dataclasses import dataclass, fields

from barewire.canopen.nmt.heartbeat import NodeState
from barewire.canopen.nmt.messages import NmtState


@dataclass(slots=True)
class ChannelCounters:
    """Counts of the frames that a client received while it waited for a response. They explain a time-out."""

    responses: int = 0  # frames on the response identifier of this channel
    others: int = 0  # frames on other identifiers
    rivals: int = 0  # of `others`: requests of another client on this channel
    signs: int = 0  # of `others`: sent by the node of this channel
    late: int = 0  # of `responses`: responses to an earlier request
    garbled: int = 0  # of `responses`: cannot be decoded
    short: int = 0  # of `responses`: decoded, with fewer than 8 bytes
    unsized: int = 0  # of `responses`: 42h, a value without its size
    extended: int = 0  # extended frames with the number of the response identifier
    state: NodeState | None = None  # the last heartbeat of the node

    @property
    def frames(self) -> int:
        """All frames received."""
        return self.responses + self.others

    @property
    def from_node(self) -> int:
        """Frames from the node, on any of its identifiers."""
        return self.responses + self.signs

    def explain(self, node: int, response_id: int) -> str:
        """Return the counters as one sentence."""
        if not self.frames:
            return "no frame was received on the bus"
        parts = [f"received {_count(self.frames, 'frame')}", f"{self.from_node or 'none'} from node {node}"]
        if self.state is not None:
            stopped = ", and a stopped node does not answer SDO" if self.state.state == NmtState.STOPPED else ""
            parts.append(f"its heartbeat reports {self.state.name}{stopped}")
        parts.append(f"{self.responses or 'none'} on {response_id:03X}h")
        parts += self.oddities()
        if self.extended:
            parts.append(f"{_count(self.extended, 'extended frame')} {response_id:08X}h, which is another identifier")
        return ", ".join(parts)

    def oddities(self) -> list[str]:
        """Return the irregular frames on the channel itself, in words."""
        parts = []
        if self.late:
            parts.append(f"{_count(self.late, 'response')} to another request")
        if self.garbled:
            parts.append(f"{self.garbled} unreadable")
        if self.rivals:
            parts.append(f"{_count(self.rivals, 'request')} of another client on the same channel")
        return parts

    def add(self, other: ChannelCounters) -> None:
        """Add the counters of `other`, and adopt its state, which is the later one."""
        for name in _COUNTERS:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.state = other.state


_COUNTERS = tuple(field.name for field in fields(ChannelCounters) if field.name != "state")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
