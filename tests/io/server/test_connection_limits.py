"""The connection that is closed, without sockets and clock, compared with a simple rule for any order of events."""

from __future__ import annotations

from hypothesis import given, strategies as st

from barewire.io.endpoint import Endpoint
from barewire.io.server.limits import ConnectionTable
from tests.helpers import modest


class Fake:
    """A connection. `abort` may remove it from the table, as in the threaded server, or not, as in asyncio."""

    def __init__(self, name: str, table: ConnectionTable[Fake], removes_itself: bool = True) -> None:
        self.peer, self.was_answered, self.aborted = name, False, 0
        self._table, self._removes_itself = table, removes_itself

    unsent = 7

    def abort(self) -> None:
        self.aborted += 1
        if self._removes_itself:
            self._table.remove(self)


def table_with(**options: object) -> ConnectionTable[Fake]:
    return ConnectionTable(Endpoint.parse("tcp://host?" + "&".join(f"{key}={value}" for key, value in options.items())))


def connected(found: ConnectionTable[Fake], *names: str, now: float = 0.0) -> list[Fake]:
    """Add new connections, each a second later than the one before."""
    made = [Fake(name, found) for name in names]
    for place, connection in enumerate(made):
        found.add(connection, now + place)
    return made


def peers(found: ConnectionTable[Fake]) -> str:
    return "".join(connection.peer for connection in found.open)


# Too many connections -------------------------------------------------------------------------------------------------


def test_the_longest_silent_unanswered_connection_is_closed_first() -> None:
    found = table_with(connections=3)
    a, b, c = connected(found, "a", "b", "c")
    a.was_answered = c.was_answered = True
    found.received(b, 9.0)
    (d,) = connected(found, "d", now=10.0)
    assert peers(found) == "acd"
    d.was_answered = True
    found.received(a, 11.0)
    connected(found, "e", now=12.0)
    assert peers(found) == "ade"
    assert list(found.closed) == [f"{name}: unused longest of 3 connections" for name in "bc"]
    assert [connection.aborted for connection in (a, b, c, d)] == [0, 1, 1, 0]
    assert found.unsent == 21


def test_of_equally_silent_connections_the_oldest_is_closed() -> None:
    found = table_with(connections=3)
    a, b, c = connected(found, "a", "b", "c")
    for connection in (c, b, a):
        found.received(connection, 5.0)
    connected(found, "d", now=5.0)
    assert peers(found) == "bcd"


def test_with_a_limit_of_one_the_newest_connection_stays() -> None:
    found = table_with(connections=1)
    first, _ = connected(found, "a", "b")
    assert peers(found) == "b"
    first.was_answered = True
    connected(found, *"cdefg", now=5.0)
    assert peers(found) == "g"
    assert len(found.closed) == 6


def test_a_flood_of_idle_connections_does_not_displace_working_ones() -> None:
    found = table_with(connections=300)
    known = connected(found, *map(str, range(299)))
    for connection in known:
        connection.was_answered = True
    connected(found, *(f"new {number}" for number in range(1000)), now=1000.0)
    assert all(connection in found.open for connection in known)
    assert len(found.open) == 300
    assert len(found.closed) == 16


# Silent for too long -------------------------------------------------------------------------------------------------


def test_idle_connections_are_closed_exactly_at_the_time_out() -> None:
    found = table_with(idle=10)
    assert found.close_idle(0.0) is None
    a, _, c = connected(found, "a", "b", "c")
    assert found.close_idle(9.75) == 10.0
    found.received(a, 9.75)
    assert found.close_idle(10.0) == 11.0
    found.remove(c)
    assert found.close_idle(11.0) == 19.75
    assert peers(found) == "a"
    assert found.close_idle(19.75) is None
    assert list(found.closed) == ["b: silent for 10 s", "a: silent for 10 s"]
    connected(found, "d", now=30.0)
    assert found.close_idle(30.0) == 40.0


def test_a_changed_idle_time_out_applies_at_once() -> None:
    found = table_with()
    connected(found, "a", "b")
    assert found.close_idle(1000.0) is None
    found.idle_timeout = 2000.0
    assert found.close_idle(1000.0) == 2000.0
    found.idle_timeout = 999.5
    assert found.close_idle(1000.0) == 1000.5
    assert peers(found) == "b"
    found.idle_timeout = 0.0
    assert found.close_idle(5000.0) is None
    found.idle_timeout = 1.0
    assert found.close_idle(5000.0) is None
    assert peers(found) == ""


def test_a_connection_that_ends_with_another_is_closed_once() -> None:
    """Two connections of one client: closing one may close both."""
    found = table_with(idle=1)
    a, b = connected(found, "a", "b")
    a.abort = lambda: (found.remove(a), found.remove(b))  # type: ignore[assignment, func-returns-value]
    assert found.close_idle(100.0) is None
    assert (list(found.closed), b.aborted) == (["a: silent for 1 s"], 0)


# Any sequence of events -----------------------------------------------------------------------------------------------

STEPS = st.lists(
    st.tuples(
        st.sampled_from(
            ["connect", *["request"] * 3, "disconnect", "answer", "close_idle", "close_idle", "new idle_timeout"]
        ),
        st.integers(0, 7),
        st.sampled_from([0.0, 0.0, 0.25, 1.0, 2.5]),
    ),
    max_size=60,
)


@modest
@given(STEPS, st.integers(1, 5), st.sampled_from([0.0, 1.0, 2.5]), st.booleans())
def test_the_table_follows_the_simple_rule_for_any_sequence_of_events(
    steps: list[tuple[str, int, float]], most: int, idle: float, removes_itself: bool
) -> None:
    """The rule: a list in the order of the last requests. Steps may take no time; a connection that has ended may still
    send a request."""
    found = table_with(connections=most, idle=idle)
    connections = [Fake(str(number), found, removes_itself) for number in range(8)]
    row: list[tuple[float, int]] = []  # the time of the last request, and the number of the connection
    now = 0.0

    def remove(number: int) -> None:
        row[:] = [entry for entry in row if entry[1] != number]

    for event, number, seconds in steps:
        now += seconds
        connection = connections[number]
        if event == "connect" and connection not in found.open:
            while len(row) >= most:
                unused = [entry for entry in row if not connections[entry[1]].was_answered] or row
                longest = {peer for received_at, peer in unused if received_at == min(unused)[0]}
                remove(next(int(open_one.peer) for open_one in found.open if int(open_one.peer) in longest))
            found.add(connection, now)
            row.append((now, number))
        elif event == "request":
            found.received(connection, now)
            remove(number)
            row.append((now, number))
        elif event == "disconnect":
            found.remove(connection)
            remove(number)
        elif event == "answer":
            connection.was_answered = True
        elif event == "new idle_timeout":
            found.idle_timeout = seconds
        elif event == "close_idle":
            again = found.close_idle(now)
            row[:] = [entry for entry in row if not found.idle_timeout or entry[0] + found.idle_timeout > now]
            if not found.idle_timeout or not row:
                assert again is None
            else:  # when the first can be closed, or a little before; but later than now, so that it ends
                assert again is not None
                assert now < again <= min(row)[0] + found.idle_timeout
        times = {int(connection.peer): received_at for connection, received_at in found.open.items()}
        assert times == {number: received_at for received_at, number in row}


def test_the_unsent_bytes_may_be_asked_for_while_connections_come_and_go() -> None:
    """Another thread than that of the server may ask."""
    found = table_with()

    class Hasty(Fake):
        @property
        def unsent(self) -> int:  # type: ignore[override]
            connected(found, "b")  # as the thread of the server does meanwhile
            return 5

    found.add(Hasty("a", found), 0.0)
    assert found.unsent == 5
    assert len(found) == 2
