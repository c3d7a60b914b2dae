"""What was recorded of a line: its units, the requests to each, and the answers to each request, in order.

    RecordedLine
      '- RecordedUnit(address=7)
           |- RecordedRequest(read="holding:0", quantity=2)    12 times, every 1.0 s
           |     values 23 7      9 times from 0.0 s on, after 12 ms
           |     values 24 7      2 times from 9.0 s on, after 12 ms
           |     exception 06     at 11.0 s, after 300 ms
           '- RecordedRequest(write="holding:1", function=6)   once
                 wrote 3, done    at 2.0 s, after 15 ms

Equal answers in a row are one `RecordedAnswer` with a number of times.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median

READS = {1: "coil", 2: "discrete", 3: "holding", 4: "input"}
"""Function code -> the table that it reads."""
WRITES = {5: "coil", 6: "holding", 15: "coil", 16: "holding"}
"""Function code -> the table that it writes."""


@dataclass(slots=True)
class RecordedAnswer:
    """An answer, and how often it came in a row. At most one of values, exception, silent and pdu is given.

    at, until    when the first and the last request of the row were sent, in seconds from the start of the recording
    times        how many answers
    latency      seconds from the request to the answer
    values       what was read; bits are 0 and 1
    wrote        what the request wrote
    exception    the exception code
    silent       there was no answer
    pdu          any other answer

    Without the last four it is the usual answer to a write: done.
    """

    at: float = 0.0
    until: float = 0.0
    times: int = 1
    latency: float = 0.0
    values: tuple[int, ...] | None = None
    wrote: tuple[int, ...] | None = None
    exception: int | None = None
    silent: bool = False
    pdu: bytes | None = None

    @property
    def content(self) -> tuple[object, ...]:
        """What is equal in the answers of a row."""
        return self.values, self.wrote, self.exception, self.silent, self.pdu

    def time_of(self, place: int) -> float:
        """Return when the request with this place in the row, from 0 on, was sent, as if all were equally spaced."""
        return self.at if self.times < 2 else self.at + place * (self.until - self.at) / (self.times - 1)


@dataclass(slots=True)
class RecordedRequest:
    """A request, and its answers. Reads and writes have a place; any other function has its `pdu`.

    function     the function code
    table        "coil", "discrete", "holding" or "input"; empty for other functions
    period       the median time between two of these requests in seconds, 0 if there was one
    left_out     answers that are not in `answers`, because there were too many
    """

    function: int
    table: str = ""
    address: int = 0
    quantity: int = 0
    pdu: bytes = b""
    period: float = 0.0
    answers: list[RecordedAnswer] = field(default_factory=list)
    left_out: int = 0

    @property
    def count(self) -> int:
        """How often it was sent."""
        return sum(answer.times for answer in self.answers) + self.left_out


@dataclass(slots=True)
class RecordedUnit:
    """A unit address, and the requests to it."""

    address: int
    requests: list[RecordedRequest] = field(default_factory=list)

    def answers(self) -> Iterator[RecordedAnswer]:
        """Yield all answers."""
        for request in self.requests:
            yield from request.answers

    @property
    def latency(self) -> float:
        """The median of the latencies of its answers, in seconds."""
        return median([answer.latency for answer in self.answers() if not answer.silent] or [0.0])


@dataclass(slots=True)
class RecordedLine:
    """The units of a line by address, and what was not understood."""

    units: dict[int, RecordedUnit] = field(default_factory=dict)
    seconds: float = 0.0
    """From the first frame to the last one."""
    broadcasts: int = 0
    strays: int = 0
    """Responses without their request, and frames that can be a request or a response."""
    noise: int = 0
    """Pieces of noise: damaged frames."""
