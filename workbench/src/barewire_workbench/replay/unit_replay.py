"""A unit that answers as it did in a recording.

    request                                       answer
    a read that was recorded                      its answers in order, each after its latency; then the last again
    a read within a recorded one                  the part of the next answer to that one
    a read of registers of several                their present values
    a write that was recorded, with its values    its answer; all reads go on behind the time of this write
    any other write to registers that were seen   done; they keep these values until a recorded write changes them
    any other function that was recorded          its answers in order
    anything else                                 exception 02 for registers, 01 for functions

So a client that asks what was asked gets what was answered, however fast it asks; and a write has the effects that it
had, because the reads behind it follow it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from barewire.codecs import Layout
from barewire.errors import EncodeError
from barewire.modbus.exceptions import ILLEGAL_DATA_ADDRESS, ILLEGAL_FUNCTION, ModbusException
from barewire.modbus.messages.base import Response
from barewire.modbus.server.server import Delayed
from barewire_workbench.replay.recorded import (
    READS,
    WRITES,
    RecordedAnswer,
    RecordedRequest,
    RecordedUnit,
    from_toml,
    values_in,
)


@dataclass(frozen=True, slots=True)
class _Verbatim(Response):
    """A response of which only the bytes are known."""

    pdu: bytes

    name: ClassVar[str] = "recorded"
    function_code: ClassVar[int] = 0
    layout: ClassVar[Layout] = Layout(">B", "function_code")

    def encode(self) -> bytes:
        return self.pdu


class _WriteAnswer(NamedTuple):
    """The answer to a write, and where the reads go on: after the time `at`, ahead or `back`."""

    answer: RecordedAnswer
    at: float | None
    back: bool


class _Position(NamedTuple):
    """Which answer is the next: the row of equal answers, and how many of this row were given."""

    row: int
    given: int


class _Track:
    """The answers to one request, and which of them is the next."""

    def __init__(self, request: RecordedRequest) -> None:
        self.request = request
        self._answers = request.answers
        self._next = _Position(0, 0)

    def take(self) -> RecordedAnswer:
        """Return the next answer; after the last one the last one again."""
        row, given = self._next
        answer = self._answers[row]
        if given + 1 < answer.times:
            self._next = _Position(row, given + 1)
        elif row + 1 < len(self._answers):
            self._next = _Position(row + 1, 0)
        return answer

    def take_write(self, values: tuple[int, ...]) -> _WriteAnswer | None:
        """Return the answer to a write of these values; `back` if it is before the one given last.

        They are searched from the next one on, and then from the first one on. None: these values were never written.
        The time is None if the recording ends with writes of these values: then nothing follows them.
        """
        next_row, given = self._next
        rows = range(len(self._answers))
        for row in (*rows[next_row:], *rows[:next_row]):
            if self._answers[row].wrote == values:
                break
        else:
            return None
        answer, is_last = self._answers[row], row == rows[-1]
        given = given if row == next_row else 0
        at = None if is_last and given >= answer.times else answer.time_of(given)
        if given + 1 < answer.times or is_last:
            # In the last row `given` reaches `times`: that is where the recording is over.
            self._next = _Position(row, min(given + 1, answer.times))
        else:
            self._next = _Position(row + 1, 0)
        return _WriteAnswer(answer, at, back=row < next_row)

    def go_to(self, at: float, *, back: bool) -> None:
        """Continue with the first answer after this time; without `back` only if it is ahead."""
        position = _Position(len(self._answers) - 1, self._answers[-1].times - 1)
        for row, answer in enumerate(self._answers):
            if answer.until > at:
                position = _Position(row, next(n for n in range(answer.times) if answer.time_of(n) > at))
                break
        if back or position > self._next:
            self._next = position

    @property
    def is_refused(self) -> bool:
        """Whether every answer is an exception."""
        return all(answer.exception is not None for answer in self._answers)


class ReplayedUnit:
    """A unit of a server that answers as it did in a recording.

    recorded     the unit of a recorded line
    latencies    whether answers take as long as they took; False answers at once, for quick tests

    >>> from barewire.modbus import ReadHoldingRegisters
    >>> answers = [RecordedAnswer(values=(23,)), RecordedAnswer(exception=6)]
    >>> unit = ReplayedUnit(RecordedUnit(7, [RecordedRequest(3, "holding", 0, 1, answers=answers)]))
    >>> unit.handle(ReadHoldingRegisters(0, 1), now=0.0).response
    ReadHoldingRegistersResponse(registers=(23,))
    >>> unit.handle(ReadHoldingRegisters(0, 1), now=1.0).response
    ModbusException(6, 3)
    """

    delays = True

    def __init__(self, recorded: RecordedUnit, *, latencies: bool = True) -> None:
        self.recorded = recorded
        self._latencies = latencies
        self._usual = recorded.latency
        self.rewind()

    def rewind(self) -> None:
        """Begin again at the start of the recording."""
        self._reads: dict[tuple[str, int, int], _Track] = {}
        self._writes: dict[tuple[int, int, int], _Track] = {}
        self._others: dict[bytes, _Track] = {}
        self._present: dict[tuple[str, int], int] = {}  # the values that were answered last
        self._written: dict[tuple[str, int], int] = {}  # those of a client, in writes that were not recorded
        for request in self.recorded.requests:
            track = _Track(request)
            place = request.address, request.quantity
            if request.function in READS and request.table:
                self._reads[request.table, *place] = track
                row = next((answer.values for answer in request.answers if answer.values), (0,) * request.quantity)
            elif request.table:
                self._writes[request.function, *place] = track
                row = (0,) * request.quantity
            else:
                self._others[request.pdu] = track
                continue
            for offset, value in enumerate(row):
                self._present.setdefault((request.table, request.address + offset), value)

    def handle(self, request: Any, now: float) -> Response | Delayed | None:
        """Return the recorded answer. Raises ModbusException 01 or 02 for what was not recorded."""
        function = request.function_code
        if (table := READS.get(function)) is not None:
            return self._read(request, table)
        if (table := WRITES.get(function)) is not None:
            return self._write(request, table)
        track = self._others.get(request.encode())
        if track is None:
            raise ModbusException(ILLEGAL_FUNCTION, function)
        return self._sent(request, track.take(), None)

    def _read(self, request: Any, table: str) -> Response | Delayed | None:
        address, quantity = request.address, request.quantity
        places = [(table, address + offset) for offset in range(quantity)]
        track = self._track(table, address, quantity)
        answer: RecordedAnswer | None = None
        if track is not None:
            answer, first = track.take(), track.request.address
            if answer.values is None:
                return self._sent(request, answer, None)
            self._present.update({(table, first + offset): value for offset, value in enumerate(answer.values)})
        if not all(place in self._present for place in places):
            raise ModbusException(ILLEGAL_DATA_ADDRESS, request.function_code)
        row = tuple(self._written.get(place, self._present[place]) for place in places)
        response = request.response(tuple(map(bool, row)) if table in ("coil", "discrete") else row)
        return self._sent(request, answer, response)

    def _track(self, table: str, address: int, quantity: int) -> _Track | None:
        """Return the answers to this read, or to the shortest one that it is within."""
        around = [
            (length, first)
            for known, first, length in self._reads
            if known == table and first <= address and address + quantity <= first + length
        ]
        if not around:
            return None
        length, first = min(around)  # the same read is the shortest of all
        return self._reads[table, first, length]

    def _write(self, request: Any, table: str) -> Response | Delayed | None:
        function, address = request.function_code, request.address
        values = values_in(request)
        places = {(table, address + offset): value for offset, value in enumerate(values)}
        track = self._writes.get((function, address, len(values)))
        recorded = None if track is None else track.take_write(values)
        done = request.response(address, request.value if function in (5, 6) else len(values))
        if recorded is not None:
            answer = recorded.answer
            if recorded.at is not None:
                for read in self._reads.values():
                    read.go_to(recorded.at, back=recorded.back)
            if answer.exception is None and not answer.silent and answer.pdu is None:
                self._present.update(places)
                for place in places:
                    self._written.pop(place, None)
            return self._sent(request, answer, done)
        if track is not None and track.is_refused:
            return self._sent(request, track.request.answers[-1], None)
        if not all(place in self._present for place in places):
            raise ModbusException(ILLEGAL_DATA_ADDRESS, function)
        self._written.update(places)
        return self._sent(request, None, done)

    def _sent(
        self, request: Any, answer: RecordedAnswer | None, response: Response | None
    ) -> Response | Delayed | None:
        """Return the response with the latency of a recorded answer, or with the usual one."""
        content: Response | ModbusException | None = response
        if answer is not None:
            if answer.silent:
                return None
            if answer.exception is not None:
                content = ModbusException(answer.exception, request.function_code)
            elif answer.pdu is not None:
                content = _Verbatim(answer.pdu)
        assert content is not None, "an answer has one of them"
        return Delayed(content, (self._usual if answer is None else answer.latency) if self._latencies else 0.0)


def recorded_units(path: str | Path, *, latencies: bool = True) -> dict[int, ReplayedUnit]:
    """Return the units of a file that `barewire record` wrote, by address, for a server.

        with ModbusServer("rtu://pty", recorded_units("pump.toml")) as server: ...

    `latencies=False` answers at once. Raises EncodeError for a file that cannot be read, and for wrong content with its
    place in the file.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise EncodeError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    units = from_toml(text, str(path)).units
    return {address: ReplayedUnit(unit, latencies=latencies) for address, unit in units.items()}
