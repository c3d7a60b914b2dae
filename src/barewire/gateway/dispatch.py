"""Which request goes out next on a bus, and which clients get its response. Each bus has one dispatcher, which owns it.

    client 1   read u3, read u4  ->  |                     |  ->  one exchange at a time (or up to 16 on TCP)
    client 2   read u3           ->  |  queued, or joined  |
    client 3   write u3          ->  |                     |  <-  response, or none

    submit    a query is answered at once (from the cache; 06 busy; 0B, its unit is dead), joins an identical read
              that is under way, or waits
    take      the exchange that is due next; identical reads that wait go with it
    finish    the response goes to every query of the exchange

**The order is fair by client, then by unit.** The clients take turns, however many requests each has sent; within a
client its units take turns. A write goes before the reads of all clients, and its client is passed over once for that
when its turn comes. So one that only writes gets no more turns than the others.

**A dead unit** left `dead_after` requests in a row unanswered. Queries for it get 0B at once, until its pause is over.
Then one query is sent to it, on trial, if the others use less than a quarter of the time; on a bus that is used more,
trials take no more than one fiftieth of the time. The pause doubles with each trial that fails. A trial goes to another
client and another request than the one before, if such have come.

**What a unit ignores** says nothing about it: units leave unknown functions and addresses unanswered. So of a unit that
answers, a request that it never answered is counted for itself: only requests like it get 0B, and are tried. Unless it
ignores `dead_after` of them without a response in between: then it may be dead, and the next ones count. Until one is
unanswered that it has answered before, such requests are still sent.

**A read joins** an identical one that is under way. If none is, it waits for its own turn; when one of several that are
identical goes out, all are answered with it. Unless a write to that unit was submitted in between. A response is kept
for `cache` seconds, and adjacent reads are merged into one, where the options of the unit allow it.

Time is an argument. `respond` of every query is called once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

from barewire.codecs import pack_bits, unpack_bits
from barewire.modbus.adu import BROADCAST
from barewire.modbus.client.line_state import UnitOptions, UnitState
from barewire.modbus.messages.coils import READ_COILS_LIMIT, ReadCoils
from barewire.modbus.messages.raw import RawRequest
from barewire.modbus.messages.registers import READ_REGISTERS_LIMIT, ReadHoldingRegisters
from barewire.modbus.server.server import Caller

BUSY, NO_PATH, NO_RESPONSE = 0x06, 0x0A, 0x0B
"""Exception codes: the queue is full; the line cannot be opened; the unit did not respond.        [MB-APP 7]"""

_TRIAL_SHARE = 50
"""On a busy bus, a time-out of t seconds of a dead unit is followed by no trial for this many times t."""

_GAPS = 4
"""A bus is busy if exchanges take more than one of so many parts of the time."""

_CACHED = 256
"""The most responses of a unit that are kept."""

_KINDS = 512
"""The most kinds of queries of a unit that are remembered."""


ASKING = UnitOptions(dead_after=2)
"""How a unit is asked by default."""


@dataclass(frozen=True, slots=True)
class UnitConfig:
    """How the queries to a unit are carried out.

    asking    how the unit is asked, as by every client
    cache     how long, in seconds, a response answers identical reads
    merge     how many values that none asked for a merged read may contain between two that were; None: reads are not
              merged
    """

    asking: UnitOptions = ASKING
    cache: float = 0.0
    merge: int | None = None


class Query:
    """One request of a client to one unit.

    `respond` is called once: with the PDU of the response, or with None if there must be none, or the client has left.
    """

    __slots__ = (
        "client", "epoch", "followers", "must_be_alone", "request", "respond", "since", "twins", "unit", "writes",
    )  # fmt: skip

    def __init__(
        self, client: Caller, unit: int, request: RawRequest, respond: Callable[[bytes | None], object]
    ) -> None:
        self.client = client
        self.unit = unit
        self.request = request
        self.writes = request.writes
        self.respond = respond
        self.since = 0.0
        self.epoch = -1
        """That of the unit when it began to wait: see `UnitRecord.epoch`."""
        self.followers: list[Query] = []
        """Identical reads, which get the same response."""
        self.twins: list[Query] | None = None
        """The identical reads that wait."""
        self.must_be_alone = False
        """Whether it was part of a merged read that failed."""

    def __repr__(self) -> str:
        return f"<Query {self.request.name} to unit {self.unit} of {self.client!r}>"

    @property
    def kind(self) -> bytes:
        """What requests that a unit answers, or ignores, have in common: of a write not its values."""
        return self.request.pdu[:3] if self.writes else self.request.pdu

    @property
    def size(self) -> int:
        """The query and those that joined it."""
        return 1 + len(self.followers)

    @property
    def is_wanted(self) -> bool:
        """Whether a client waits for the response."""
        return not self.client.is_gone or any(not follower.client.is_gone for follower in self.followers)

    def answer(self, pdu: bytes | None) -> None:
        """Give the response to all clients that wait for it; None for silence."""
        for query in (self, *self.followers):
            query.respond(pdu)

    def decline(self, code: int) -> None:
        """Answer with an exception."""
        self.answer(bytes((self.request.function_code | 0x80, code)))


@dataclass(slots=True)
class Exchange:
    """One request that goes out, for one query or for several merged ones. `timeout` is in seconds."""

    unit: int
    request: RawRequest
    timeout: float
    queries: list[Query]
    epoch: int
    started: float


class _Span(NamedTuple):
    """The values that a read asks for."""

    function: int
    first: int
    after: int


def _span(request: RawRequest) -> _Span | None:
    """Return what a read of one of the four tables asks for; None for any other request."""
    known = request.known
    if isinstance(known, ReadHoldingRegisters | ReadCoils):
        return _Span(request.function_code, known.address, known.address + known.quantity)
    return None


@dataclass(slots=True)
class UnitCounters:
    """What happened to the queries of one unit, since the gateway began. Each query is in exactly one of the first six.

    responses, exceptions, and no_responses are those of the exchanges on the bus: each is in the first or in the last,
    unless it must have no response, as a broadcast. Times are in seconds.
    """

    answered: int = 0
    """Queries with a response of the unit, exceptions among them."""
    cached: int = 0
    """Queries answered with a response that was kept."""
    unanswered: int = 0
    """Queries that got 0B: the unit did not respond, or is dead."""
    busy: int = 0
    """Queries that got 06: too many waited, or it waited too long."""
    without_path: int = 0
    """Queries that got 0A: the line could not be opened."""
    failed: int = 0
    """Queries that got 04: the code of the gateway failed."""
    joined: int = 0
    """Reads that joined an identical one, or were merged with another one."""
    requests: int = 0
    """Exchanges on the bus."""
    responses: int = 0
    """Exchanges with a response of the unit."""
    exceptions: int = 0
    """Exchanges that the unit declined."""
    no_responses: int = 0
    """Exchanges without a response: the unit did not respond, or the connection ended."""
    latest: float = 0.0
    """How long the latest response took."""
    total: float = 0.0
    """How long all responses took together."""


_COUNTERS = {BUSY: "busy", NO_PATH: "without_path", NO_RESPONSE: "unanswered"}
"""The counter of queries that are declined with a code; `failed` for any other."""


class UnitRecord(UnitState):
    """What the dispatcher remembers of one unit, besides what every client does."""

    def __init__(self, number: int, config: UnitConfig) -> None:
        super().__init__(config.asking)
        self.number = number
        self.config = config
        self.counters = UnitCounters()
        self.under_way = 0
        self.epoch = 0
        """How many writes were submitted or ended. A read joins only a read of the same epoch."""
        self.joinable: dict[bytes, Query] = {}
        """The reads that are under way."""
        self.twins: dict[bytes, list[Query]] = {}
        """Those that wait."""
        self.cached: dict[bytes, tuple[float, bytes]] = {}
        self.mergeable: dict[Query, _Span] = {}
        """The reads that wait and may become part of a merged one."""
        self.answered: set[bytes] = set()
        """The kinds of queries that it has answered."""
        self.ignored: dict[bytes, UnitState] = {}
        """Those that it has not, though it answers others. Each may be dead for itself."""
        self.ignores = 0
        """How many were added to them since its latest response."""
        self.doubts = 0
        """How many queries were unanswered since then whose kind it has answered before."""
        self.tried: tuple[Caller, bytes] | None = None
        """The client and the request that it left unanswered last, if that made it dead or left it so."""
        self.others_wait = False
        """Whether another client was declined since then that asked for something else."""
        self.merging = UnitState(UnitOptions(dead_after=1))
        """Whether merged reads have responses, and the pause after one that had none."""

    def decline(self, query: Query, code: int) -> None:
        """Answer a query with an exception code of the gateway."""
        name = _COUNTERS.get(code, "failed")
        setattr(self.counters, name, getattr(self.counters, name) + query.size)
        query.decline(code)

    def answer(self, query: Query, pdu: bytes) -> None:
        """Answer a query with a response of the unit."""
        self.counters.answered += 1 + len(query.followers)
        kind = query.kind
        if kind not in self.answered:
            if len(self.answered) >= _KINDS:
                self.answered.clear()
            self.answered.add(kind)
            self.ignored.pop(kind, None)
        query.answer(pdu)

    def blocker(self, query: Query) -> UnitState | None:
        """Return what is dead if a query must not be sent: the unit, or what it ignores."""
        if self.is_dead and (self.doubts or query.kind not in self.answered):
            return self
        ignored = self.ignored.get(query.kind)
        return ignored if ignored is not None and ignored.is_dead else None

    def left_unanswered(self, queries: list[Query], now: float) -> None:
        """Count queries that went out as one request and have no response."""
        kind = queries[0].kind
        is_known = kind in self.answered
        is_merged = len(queries) > 1
        if is_merged:
            self.merging.was_silent(now)
        elif self.answered and not is_known and not self.is_dead:
            if kind not in self.ignored and self.ignores < self.options.dead_after:
                if len(self.ignored) >= _KINDS:
                    self.ignored.clear()
                self.ignored[kind] = UnitState(self.options)
                self.ignores += 1
            if kind in self.ignored:
                self.ignored[kind].was_silent(now)
                return
        self.doubts += is_known and not is_merged
        self.was_silent(now)
        self.tried, self.others_wait = (queries[0].client, queries[0].request.pdu), False

    def changed(self) -> None:
        """Record that a write was submitted or ended: what was read before may be out of date."""
        self.epoch += 1
        self.joinable.clear()
        self.twins.clear()
        self.cached.clear()


class _ClientQueue:
    """The queries of one client that wait: writes and reads, by unit, in the order in which the units have turns."""

    __slots__ = ("owes_until", "reads", "size", "writes")

    def __init__(self) -> None:
        self.writes: dict[int, deque[Query]] = {}
        self.reads: dict[int, deque[Query]] = {}
        self.size = 0
        self.owes_until = 0
        """The number of the exchange until which the client owes a turn, because a write of it went first."""

    def add(self, query: Query) -> None:
        by_unit = self.writes if query.writes else self.reads
        by_unit.setdefault(query.unit, deque()).append(query)
        self.size += 1

    def remove(self, query: Query) -> None:
        """Remove a query. Then it is the turn of the other units."""
        by_unit = self.writes if query.writes else self.reads
        queue = by_unit.pop(query.unit)
        queue.remove(query)
        if queue:
            by_unit[query.unit] = queue
        self.size -= 1

    @staticmethod
    def first(by_unit: dict[int, deque[Query]], is_ready: Callable[[int], bool]) -> Query | None:
        """Return the first query to the first unit that is ready."""
        return next((queue[0] for unit, queue in by_unit.items() if is_ready(unit)), None)

    def all(self) -> list[Query]:
        """Return every query that waits."""
        return [query for queue in (*self.writes.values(), *self.reads.values()) for query in queue]

    def latest(self) -> Query:
        """Return the query that was submitted last."""
        return max(reversed(self.all()), key=lambda query: query.since)


class Dispatcher:
    """The queue of one bus.

    units        how each unit is asked
    default      how all others are
    capacity     the most queries that wait; beyond it the client with the most waiting queries gets 06
    patience     seconds after which a query that still waits gets 06: its client has probably given up
    """

    def __init__(
        self,
        units: Mapping[int, UnitConfig] | None = None,
        *,
        default: UnitConfig | None = None,
        capacity: int = 1024,
        patience: float = 10.0,
    ) -> None:
        self.configs = {} if units is None else units
        self.default = UnitConfig() if default is None else default
        self._capacity = capacity
        self._patience = patience
        self._units: dict[int, UnitRecord] = {}
        self._clients: dict[Caller, _ClientQueue] = {}
        self._waiting: dict[Caller, _ClientQueue] = {}  # those with queries, in the order of their turns
        self._exchanges = 0
        self._trial: Query | None = None  # waits
        self._tried: Query | None = None  # is under way
        self._next_trial = -inf
        self._busy = 0.0  # seconds in which exchanges were under way since `_busy_since`
        self._busy_since = -inf
        self.on_death_or_return: Callable[[UnitRecord], object] | None = None
        """Called with a unit that has become dead, or that was dead and has responded; see its `is_dead`."""
        self.one_each = False
        """Whether a unit has one exchange under way at most."""
        self.size = 0
        """The number of queries that wait."""
        self.wake: float | None = None
        """After `take` returned None: when the pause of a unit ends for which a query waits."""

    def __repr__(self) -> str:
        return f"<Dispatcher: {self.size} queries wait>"

    @property
    def units(self) -> Mapping[int, UnitRecord]:
        """The units that were asked so far, by address."""
        return self._units

    @property
    def has_work(self) -> bool:
        """Whether a query waits, trials of dead units among them."""
        return self.size > 0 or self._trial is not None

    def unit(self, number: int) -> UnitRecord:
        """Return the state of a unit."""
        state = self._units.get(number)
        if state is None:
            state = self._units[number] = UnitRecord(number, self.configs.get(number, self.default))
        return state

    # A query arrives

    def submit(self, query: Query, now: float, *, is_lane_free: bool = False) -> Exchange | None:
        """Answer a query at once, let it join another one, or let it wait.

        If a lane is free and nothing waits, the exchange that goes out at once is returned, as `take` would.
        """
        state = self.unit(query.unit)
        query.since = now
        if query.writes:
            self._changed(state)
        else:
            cached = state.cached.get(query.request.pdu)
            if cached is not None and now < cached[0]:
                state.counters.cached += 1
                query.answer(cached[1])
                return None
            leader = state.joinable.get(query.request.pdu)
            if leader is None and self.size >= self._capacity and query.request.pdu in state.twins:
                leader = state.twins[query.request.pdu][0]  # it needs no room
            if leader is not None:
                leader.followers.append(query)
                state.counters.joined += 1
                return None
        if (state.silent or state.ignored) and (blocker := state.blocker(query)) is not None:
            self._try_dead_unit(query, state, blocker, now)
        elif is_lane_free and not self.size and self._trial is None and self._is_ready(state, now):
            query.epoch = state.epoch
            return self._exchange(query, state, now)
        elif self.size >= self._capacity and not self._make_room(query.client):
            state.decline(query, BUSY)
        else:
            self._wait(query, state)
        return None

    def _is_ready(self, state: UnitRecord, now: float) -> bool:
        """Whether a unit may be asked now: its pause is over, and it may have one more exchange under way."""
        return state.free_at <= now and not (self.one_each and state.under_way)

    def _try_dead_unit(self, query: Query, state: UnitRecord, blocker: UnitState, now: float) -> None:
        """Let one query to a dead unit go out next, on trial, if one is due; decline the others.

        One trial at a time, so that none waits for the time-out of others. Others than the latest have precedence.
        """
        is_other, due_at = False, blocker.dead_until
        if blocker is state and state.tried is not None:
            is_other = query.client is not state.tried[0] and query.request.pdu != state.tried[1]
            if state.others_wait and not is_other:
                due_at += state.options.longest_pause
        is_due = now >= due_at and (now >= self._next_trial or self._has_gaps(now))
        if is_due and self._trial is None and self._tried is None:
            self._trial = query
        else:
            state.others_wait |= is_other
            state.decline(query, NO_RESPONSE)

    def _has_gaps(self, now: float) -> bool:
        """Whether the others use so little of the bus that the time-out of a trial takes little from them.

        That nothing waits at this moment would not say so: nothing waits either while clients read a response.
        """
        known_for = now - self._busy_since
        return known_for >= 1.0 and self._busy < known_for / _GAPS

    def _make_room(self, client: Caller) -> bool:
        """Decline the latest query of the client that has the most. Returns False if the given client would have as
        many as that one."""
        greedy = max(reversed(self._waiting), key=lambda client: self._waiting[client].size)
        own = self._clients.get(client)
        if self._waiting[greedy].size <= (0 if own is None else own.size) + 1:
            return False
        latest = self._waiting[greedy].latest()
        state = self.unit(latest.unit)
        self._leave_queue(latest)
        self._end(latest, state)
        state.decline(latest, BUSY)
        return True

    def _wait(self, query: Query, state: UnitRecord) -> None:
        queue = self._clients.get(query.client)
        if queue is None:
            queue = self._clients[query.client] = _ClientQueue()
        queue.add(query)
        self._waiting.setdefault(query.client, queue)
        self.size += 1
        if query.writes:
            return
        query.epoch = state.epoch
        query.twins = state.twins.setdefault(query.request.pdu, [])
        query.twins.append(query)
        may_merge = state.config.merge is not None and not query.must_be_alone
        if may_merge and query.request.pdu not in state.ignored and (span := _span(query.request)) is not None:
            state.mergeable[query] = span

    def _leave_queue(self, query: Query) -> None:
        """Take a query out of the queue of its client."""
        state, queue = self.unit(query.unit), self._clients[query.client]
        state.mergeable.pop(query, None)
        if query.twins is not None:
            query.twins.remove(query)
            if not query.twins and state.twins.get(query.request.pdu) is query.twins:
                del state.twins[query.request.pdu]
        queue.remove(query)
        self.size -= 1
        if not queue.size:
            del self._waiting[query.client]
            # A client that owes a turn is remembered, or it would go first with every write; but not for ever.
            if query.client.is_gone or queue.owes_until <= self._exchanges:
                del self._clients[query.client]

    def _forget_clients(self) -> None:
        """Forget the clients that do not wait and owe no turn any more."""
        for client, queue in list(self._clients.items()):
            if client not in self._waiting and (client.is_gone or queue.owes_until <= self._exchanges):
                del self._clients[client]

    def _changed(self, state: UnitRecord) -> None:
        """Record that a write was submitted or ended. One to unit 0 may be a broadcast, which changes all units."""
        state.changed()
        if state.number == BROADCAST:
            for other in self._units.values():
                other.changed()

    # The next exchange

    def take(self, now: float) -> Exchange | None:
        """Return the exchange that is due next, or None: see `wake`."""
        self.wake = None
        while True:
            trial, self._trial = self._trial, None
            query = trial or self._next(now)
            if query is None:
                return None
            if query.is_wanted and now < query.since + self._patience:
                self._tried = trial or self._tried
                return self._exchange(query, self.unit(query.unit), now)
            self._end(query, self.unit(query.unit))
            if query.is_wanted:
                self.unit(query.unit).decline(query, BUSY)
            else:
                query.answer(None)

    def _next(self, now: float) -> Query | None:
        """Take the query whose turn it is, of a unit that has no pause."""

        def is_ready(unit: int) -> bool:
            state = self.unit(unit)
            if state.free_at > now:
                self.wake = state.free_at if self.wake is None else min(self.wake, state.free_at)
            return self._is_ready(state, now)

        for client, queue in self._waiting.items():
            if queue.writes and self._exchanges >= queue.owes_until:
                query = queue.first(queue.writes, is_ready)
                if query is not None:
                    # It is the last in the order then, so its next turn, the one it owes, comes before this number.
                    queue.owes_until = self._exchanges + len(self._waiting) + 1
                    return self._served(client, query)
        owing = []
        for client, queue in self._waiting.items():
            if self._exchanges < queue.owes_until:
                owing.append(client)
                continue
            query = queue.first(queue.writes, is_ready) or queue.first(queue.reads, is_ready)
            if query is not None:
                for passed_over in owing:
                    self._waiting[passed_over].owes_until = 0
                    self._waiting[passed_over] = self._waiting.pop(passed_over)
                return self._served(client, query)
        for client in owing:  # no other client has a query that can go out
            queue = self._waiting[client]
            query = queue.first(queue.writes, is_ready) or queue.first(queue.reads, is_ready)
            if query is not None:
                queue.owes_until = 0
                return self._served(client, query)
        return None

    def _served(self, client: Caller, query: Query) -> Query:
        """Record that a client has had its turn: it is the last in the order now."""
        self._leave_queue(query)
        if client in self._waiting:
            self._waiting[client] = self._waiting.pop(client)
        return query

    def _exchange(self, query: Query, state: UnitRecord, now: float) -> Exchange:
        self._exchanges += 1
        if len(self._clients) > 2 * len(self._waiting) + 64:
            self._forget_clients()
        state.under_way += 1
        state.counters.requests += 1
        if query.twins:
            for twin in tuple(query.twins):
                self._leave_queue(twin)
                query.followers += (twin, *twin.followers)
                twin.followers = []
                state.counters.joined += 1
        queries, request = [query], query.request
        may_merge = state.config.merge is not None and not query.must_be_alone and state.merging.dead_until <= now
        if may_merge and (span := _span(request)) is not None:
            queries, request = self._merged(query, span, state)
        for read in queries:
            if read.epoch == state.epoch:
                state.joinable[read.request.pdu] = read
        return Exchange(query.unit, request, state.options.timeout, queries, state.epoch, now)

    def _merged(self, query: Query, span: _Span, state: UnitRecord) -> tuple[list[Query], RawRequest]:
        """Add waiting reads to a read, as long as they are near and all fit one response."""
        merge = state.config.merge or 0
        limit = READ_COILS_LIMIT if span.function in (0x01, 0x02) else READ_REGISTERS_LIMIT
        queries = [query]
        near = sorted(
            (other.first, other.after, id(read), read)
            for read, other in state.mergeable.items()
            if other.function == span.function
        )
        first, after = span.first, span.after
        has_grown = True
        while has_grown:
            has_grown = False
            for other_first, other_after, _, read in near:
                low, high = min(first, other_first), max(after, other_after)
                is_near = other_first <= after + merge and first <= other_after + merge
                if is_near and high - low <= limit and read in state.mergeable:
                    self._leave_queue(read)
                    state.counters.joined += read.size
                    queries.append(read)
                    first, after, has_grown = low, high, True
        if len(queries) == 1:
            return queries, query.request
        pdu = bytes((span.function,)) + first.to_bytes(2, "big") + (after - first).to_bytes(2, "big")
        return queries, RawRequest(pdu)

    # The exchange has ended

    def finish(self, exchange: Exchange, response: bytes | int | None, now: float, *, is_silence: bool = True) -> None:
        """Give the response to the queries of an exchange.

        A number is the exception code in place of a response. With `is_silence` it counts as a request that the unit
        left unanswered; without, it says nothing about the unit. None: there is no response, and must be none.
        """
        state = self._units[exchange.unit]
        if exchange.queries[0].writes:
            self._changed(state)
        counters, took = state.counters, now - exchange.started
        state.under_way -= 1
        self._busy += took
        if self._tried is not None and self._tried in exchange.queries:
            self._tried = None
        state.free_at = now + state.gap
        for query in exchange.queries:
            self._end(query, state)
        if isinstance(response, int):
            counters.no_responses += 1
            if is_silence:
                self._was_silent(state, exchange, now, took)
            for query in exchange.queries:
                if is_silence and len(exchange.queries) > 1 and state.blocker(query) is None:
                    query.must_be_alone = True
                    self._wait(query, state)
                else:
                    state.decline(query, response)
        elif response is None:
            for query in exchange.queries:
                query.answer(None)
        else:
            if state.silent or state.ignores:
                was_dead, state.silent, state.ignores, state.doubts = state.is_dead, 0, 0, 0
                if was_dead and self.on_death_or_return is not None:
                    self.on_death_or_return(state)
            counters.responses += 1
            counters.latest = took
            counters.total += took
            counters.exceptions += response[0] >> 7
            if len(exchange.queries) > 1:
                state.merging.silent = 0
                self._give_parts(state, exchange, response, now)
            else:
                self._keep(state, exchange, exchange.queries[0], response, now)
                state.answer(exchange.queries[0], response)

    def decline_all(self, code: int) -> None:
        """Answer every query that waits with an exception: the bus cannot be reached."""
        waiting = [query for queue in self._waiting.values() for query in queue.all()]
        for query in waiting:
            self._leave_queue(query)
        if self._trial is not None:
            waiting.append(self._trial)
            self._trial = None
        for query in waiting:
            state = self.unit(query.unit)
            self._end(query, state)
            state.decline(query, code)

    def _end(self, query: Query, state: UnitRecord) -> None:
        """No further query joins this one."""
        if state.joinable.get(query.request.pdu) is query:
            del state.joinable[query.request.pdu]

    def _was_silent(self, state: UnitRecord, exchange: Exchange, now: float, took: float) -> None:
        """Count a request without a response, which took so long."""
        was_dead = state.is_dead
        state.left_unanswered(exchange.queries, now)
        if state.is_dead and not was_dead and self.on_death_or_return is not None:
            self.on_death_or_return(state)
        if state.blocker(exchange.queries[0]) is None:
            return
        self._next_trial = now + _TRIAL_SHARE * took
        self._busy, self._busy_since = 0.0, now
        waiting = [query for queue in self._waiting.values() for query in queue.all() if query.unit == state.number]
        for query in waiting:
            if state.blocker(query) is not None:
                self._leave_queue(query)
                self._end(query, state)
                state.decline(query, NO_RESPONSE)

    def _give_parts(self, state: UnitRecord, exchange: Exchange, response: bytes, now: float) -> None:
        """Give each query of a merged read its part; let each go out alone if the unit declined all of it together."""
        whole = _span(exchange.request)
        if response[0] & 0x80 or whole is None:
            for query in exchange.queries:
                query.must_be_alone = True
                self._wait(query, state)
            return
        for query in exchange.queries:
            pdu = _part(response, whole, _span(query.request) or whole)
            self._keep(state, exchange, query, pdu, now)
            state.answer(query, pdu)

    def _keep(self, state: UnitRecord, exchange: Exchange, query: Query, pdu: bytes, now: float) -> None:
        """Keep a response for identical reads, unless a write has gone out since the read did."""
        if not state.config.cache or query.writes or pdu[0] & 0x80 or exchange.epoch != state.epoch:
            return
        if len(state.cached) >= _CACHED:
            state.cached.clear()
        state.cached[query.request.pdu] = (now + state.config.cache, pdu)


def _part(response: bytes, whole: _Span, part: _Span) -> bytes:
    """Return the response to a part of a merged read.

    >>> _part(bytes.fromhex("03 06 0001 0002 0003"), _Span(3, 10, 13), _Span(3, 11, 12)).hex(" ")
    '03 02 00 02'
    >>> _part(bytes.fromhex("01 01 06"), _Span(1, 0, 3), _Span(1, 1, 3)).hex(" ")
    '01 01 03'
    """
    start, quantity = part.first - whole.first, part.after - part.first
    if part.function in (0x01, 0x02):
        data = pack_bits(unpack_bits(response[2:])[start : start + quantity])
    else:
        data = response[2 + 2 * start : 2 + 2 * (start + quantity)]
    return bytes((part.function, len(data))) + data
