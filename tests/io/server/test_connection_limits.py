"""Which connection is closed, without sockets and clock: compared with a simple rule, in any order of events."""

from __future__ import annotations

from hypothesis import given, strategies as st

from barewire.io.endpoint import Endpoint
from barewire.io.server.connection_limits import ConnectionTable
from tests.helpers import modest


class Fake:
    """A connection. Aborted, it may remove itself, as that of the threaded server does and that of asyncio does not."""

    def __init__(self, name: str, all_of_them: ConnectionTable[Fake], tells: bool = True) -> None:
        self.peer, self.was_answered, self.aborted = name, False, 0
        self._all, self._tells = all_of_them, tells

    unsent = 7

    def abort(self) -> None:
        self.aborted += 1
        if self._tells:
            self._all.remove(self)


def guests(**options: object) -> ConnectionTable[Fake]:
    return ConnectionTable(Endpoint.parse("tcp://host?" + "&".join(f"{key}={value}" for key, value in options.items())))


def came(found: ConnectionTable[Fake], *names: str, now: float = 0.0) -> list[Fake]:
    """New connections, each a second later than the last."""
    made = [Fake(name, found) for name in names]
    for place, guest in enumerate(made):
        found.add(guest, now + place)
    return made


def here(found: ConnectionTable[Fake]) -> str:
    return "".join(guest.peer for guest in found.open)


# One too many --------------------------------------------------------------------------------------------------------


def test_the_longest_silent_unanswered_connection_is_closed_first() -> None:
    found = guests(connections=3)
    a, b, c = came(found, "a", "b", "c")
    a.was_answered = c.was_answered = True
    found.received(b, 9.0)
    (d,) = came(found, "d", now=10.0)
    assert here(found) == "acd"
    d.was_answered = True
    found.received(a, 11.0)
    came(found, "e", now=12.0)
    assert here(found) == "ade"
    assert list(found.closed) == [f"{name}: unused longest of 3 connections" for name in "bc"]
    assert [guest.aborted for guest in (a, b, c, d)] == [0, 1, 1, 0]
    assert found.unsent == 21


def test_of_equally_silent_connections_the_oldest_is_closed() -> None:
    found = guests(connections=3)
    a, b, c = came(found, "a", "b", "c")
    for guest in (c, b, a):
        found.received(guest, 5.0)
    came(found, "d", now=5.0)
    assert here(found) == "bcd"


def test_with_a_limit_of_one_the_newest_connection_stays() -> None:
    found = guests(connections=1)
    first, _ = came(found, "a", "b")
    assert here(found) == "b"
    first.was_answered = True
    came(found, *"cdefg", now=5.0)
    assert here(found) == "g"
    assert len(found.closed) == 6


def test_a_flood_of_idle_connections_does_not_displace_working_ones() -> None:
    found = guests(connections=300)
    known = came(found, *map(str, range(299)))
    for guest in known:
        guest.was_answered = True
    came(found, *(f"stranger {number}" for number in range(1000)), now=1000.0)
    assert all(guest in found.open for guest in known)
    assert len(found.open) == 300
    assert len(found.closed) == 16


# Silent for too long -------------------------------------------------------------------------------------------------


def test_idle_connections_are_closed_exactly_at_the_time_out() -> None:
    found = guests(idle=10)
    assert found.close_idle(0.0) is None
    a, _, c = came(found, "a", "b", "c")
    assert found.close_idle(9.75) == 10.0
    found.received(a, 9.75)
    assert found.close_idle(10.0) == 11.0
    found.remove(c)
    assert found.close_idle(11.0) == 19.75
    assert here(found) == "a"
    assert found.close_idle(19.75) is None
    assert list(found.closed) == ["b: silent for 10 s", "a: silent for 10 s"]
    came(found, "d", now=30.0)
    assert found.close_idle(30.0) == 40.0


def test_a_changed_idle_time_out_applies_at_once() -> None:
    found = guests()
    came(found, "a", "b")
    assert found.close_idle(1000.0) is None
    found.idle_timeout = 2000.0
    assert found.close_idle(1000.0) == 2000.0
    found.idle_timeout = 999.5
    assert found.close_idle(1000.0) == 1000.5
    assert here(found) == "b"
    found.idle_timeout = 0.0
    assert found.close_idle(5000.0) is None
    found.idle_timeout = 1.0
    assert found.close_idle(5000.0) is None
    assert here(found) == ""


def test_a_connection_that_ends_with_another_is_closed_once() -> None:
    """Two connections of one client: closing one may close both."""
    found = guests(idle=1)
    a, b = came(found, "a", "b")
    a.abort = lambda: (found.remove(a), found.remove(b))  # type: ignore[assignment, func-returns-value]
    assert found.close_idle(100.0) is None
    assert (list(found.closed), b.aborted) == (["a: silent for 1 s"], 0)


# Whatever happens ----------------------------------------------------------------------------------------------------

STEPS = st.lists(
    st.tuples(
        st.sampled_from(["come", "hear", "hear", "hear", "leave", "answer", "watch", "watch", "idle"]),
        st.integers(0, 7),
        st.sampled_from([0.0, 0.0, 0.25, 1.0, 2.5]),
    ),
    max_size=60,
)


@modest
@given(STEPS, st.integers(1, 5), st.sampled_from([0.0, 1.0, 2.5]), st.booleans())
def test_the_table_follows_the_simple_rule_for_any_sequence_of_events(
    steps: list[tuple[str, int, float]], most: int, idle: float, tells: bool
) -> None:
    """The rule: a list in the order of the last requests. A step takes time or none; a connection may end and, late,
    be heard again."""
    found = guests(connections=most, idle=idle)
    everybody = [Fake(str(number), found, tells) for number in range(8)]
    row: list[tuple[float, int]] = []  # when it was heard, who
    now = 0.0

    def gone(whom: int) -> None:
        row[:] = [one for one in row if one[1] != whom]

    for what, whom, later in steps:
        now += later
        guest = everybody[whom]
        if what == "come" and guest not in found.open:
            while len(row) >= most:
                unused = [one for one in row if not everybody[one[1]].was_answered] or row
                longest = {who for heard, who in unused if heard == min(unused)[0]}
                first = next(int(one.peer) for one in found.open if int(one.peer) in longest)
                gone(first)
            found.add(guest, now)
            row.append((now, whom))
        elif what == "hear":
            found.received(guest, now)
            gone(whom)
            row.append((now, whom))
        elif what == "leave":
            found.remove(guest)
            gone(whom)
        elif what == "answer":
            guest.was_answered = True
        elif what == "idle":
            found.idle_timeout = later
        elif what == "watch":
            again = found.close_idle(now)
            row[:] = [one for one in row if not found.idle_timeout or one[0] + found.idle_timeout > now]
            if not found.idle_timeout or not row:
                assert again is None
            else:  # in time, and not without end: as soon as the first could go, or a little before
                assert again is not None
                assert now < again <= min(row)[0] + found.idle_timeout
        assert {int(one.peer) for one in found.open} == {who for _, who in row}
        assert {int(one.peer): heard for one, heard in found.open.items()} == {who: heard for heard, who in row}
