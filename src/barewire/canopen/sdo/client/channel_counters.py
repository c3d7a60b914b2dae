"""What a client heard while it waited on an SDO channel: counters, and the evidence that a time-out is explained with.

Everything that comes and is no answer to the question of the moment is not an error but weather:

    foreign    other identifiers, extended frames, remote frames: somebody else's talk
    late       an answer on our identifier to an earlier question (another object, another service)
    garbled    something on our identifier that cannot be read
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from barewire.canopen.nmt.heartbeat import NodeState
from barewire.canopen.nmt.messages import NmtState


@dataclass(slots=True)
class ChannelCounters:
    """What was heard while waiting: the counters, and the evidence that a time-out is explained with."""

    answers: int = 0  # on the answer identifier of this channel
    others: int = 0  # elsewhere, whosever they were
    signs: int = 0  # of these: sent by the node
    late: int = 0  # of these: to another question
    garbled: int = 0  # of these: unreadable
    short: int = 0  # of these: read, although with fewer than 8 bytes
    unsized: int = 0  # of these: 42h, a value without its size
    extended: int = 0  # with the number of our answer identifier, but extended: not ours
    state: NodeState | None = None  # the last heartbeat of the node

    @property
    def frames(self) -> int:
        """All that was heard."""
        return self.answers + self.others

    @property
    def from_node(self) -> int:
        """What the node sent, on any of its identifiers."""
        return self.answers + self.signs

    def explain(self, node: int, answer_id: int) -> str:
        """The evidence in one sentence."""
        if not self.frames:
            return "nothing at all was heard on the bus"
        said = [f"heard {_count(self.frames, 'frame')}", f"{self.from_node or 'none'} from node {node}"]
        if self.state is not None:
            stopped = ", and a stopped node answers no SDO" if self.state.state == NmtState.STOPPED else ""
            said.append(f"its heartbeat says {self.state.name}{stopped}")
        said.append(f"{self.answers or 'none'} on {answer_id:03X}h")
        said += self.oddities()
        if self.extended:
            said.append(f"{_count(self.extended, 'extended frame')} {answer_id:08X}h, which is another identifier")
        return ", ".join(said)

    def oddities(self) -> list[str]:
        """What came on the channel itself and was no answer."""
        said = []
        if self.late:
            said.append(f"{_count(self.late, 'answer')} to another question")
        if self.garbled:
            said.append(f"{self.garbled} unreadable")
        return said

    def add(self, other: ChannelCounters) -> None:
        """Sum up: what `other` counted is counted here too, and its state is the later one."""
        for name in _COUNTERS:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.state = other.state


_COUNTERS = tuple(field.name for field in fields(ChannelCounters) if field.name != "state")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
