"""FairQueue: round robin between units, in order within a unit; tickets that are given up."""

from __future__ import annotations

from contextlib import suppress

from hypothesis import given, strategies as st

from barewire.modbus.client import fair_queue
from barewire.modbus.client.fair_queue import FairQueue, Ticket
from tests.helpers import every_case, modest
from tests.interrupts import Interrupt, interrupt


def join(queue: FairQueue, unit: int | None) -> Ticket:
    """Join with a new ticket, and return it."""
    ticket = Ticket(unit)
    assert queue.join(ticket) == queue.place(ticket)
    return ticket


def order(queue: FairQueue, tickets: dict[Ticket, str]) -> str:
    """Return the names of the tickets in the order in which they are admitted."""
    found = ""
    while holders := queue.holders:
        (ticket,) = holders
        found += tickets[ticket]
        queue.leave(ticket)
    return found


def test_round_robin_by_unit_and_in_order_within_one() -> None:
    queue = FairQueue()
    first = join(queue, 9)
    tickets = {join(queue, unit): name for unit, name in [(1, "a"), (1, "b"), (1, "c"), (1, "d"), (2, "e"), (3, "f")]}
    tickets[join(queue, 3)] = "g"
    queue.leave(first)
    assert order(queue, tickets) == "aefbgcd"


def test_a_ticket_that_is_given_up_does_not_block_the_queue() -> None:
    queue = FairQueue()
    holder, waiting, gone = join(queue, 1), join(queue, 2), join(queue, 2)
    queue.leave(gone)
    queue.leave(gone)  # the second call has no effect
    queue.leave(holder)
    assert queue.place(waiting) == 0
    queue.leave(waiting)
    assert queue.holders == frozenset()


@modest
@given(places=st.integers(1, 16), units=st.lists(st.integers(1, 5), max_size=40), data=st.data())
def test_never_more_than_places_are_admitted_and_every_ticket_is(
    places: int, units: list[int], data: st.DataObject
) -> None:
    queue = FairQueue(places)
    waiting = [join(queue, unit) for unit in units]
    seen: set[Ticket] = set()
    while waiting:
        assert len(queue.holders) == min(places, len(waiting))
        seen |= queue.holders
        leaving = data.draw(st.sampled_from(waiting))
        if leaving not in queue.holders:
            seen.add(leaving)  # given up
        waiting.remove(leaving)
        queue.leave(leaving)
    assert len(seen) == len(units)
    assert not queue.holders


def test_a_new_ticket_does_not_overtake_waiting_ones() -> None:
    queue = FairQueue()
    holder, waiting, other = join(queue, 1), join(queue, 1), join(queue, 2)
    assert not queue.leave(join(queue, 2))  # it waited, so no other ticket is admitted
    assert queue.place(join(queue, 3)) is None
    assert queue.leave(holder)
    assert queue.place(other) == 0  # unit 1 was admitted before
    assert queue.leave(other)
    assert queue.place(waiting) is None  # unit 3 was not admitted yet


def test_the_unit_admitted_longest_ago_is_next() -> None:
    queue = FairQueue()
    for unit in (1, 2, 3, 2, 1):
        queue.leave(join(queue, unit))
    holder = join(queue, 9)
    tickets = {join(queue, unit): str(unit) for unit in (1, 2, 3)}
    queue.leave(holder)
    assert order(queue, tickets) == "321"


def test_every_place_that_is_given_back_can_be_taken_again() -> None:
    queue = FairQueue(2)
    for _ in range(2):
        tickets = [join(queue, unit) for unit in (1, 2, 3)]
        assert [queue.place(ticket) for ticket in tickets] == [0, 1, None]
        assert [queue.leave(ticket) for ticket in (tickets[2], *tickets[:2])] == [False, False, False]


@every_case("interrupted_at", range(60))
def test_an_exception_at_any_line_loses_no_ticket_and_no_place(interrupted_at: int) -> None:
    queue = FairQueue(2)
    tickets = [Ticket(unit) for unit in (1, 1, 2, 3)]

    def work() -> None:
        for ticket in tickets:
            queue.join(ticket)
        for ticket in tickets[:3]:
            queue.leave(ticket)

    with suppress(Interrupt):
        interrupt(work, interrupted_at, fair_queue.__file__)
    for ticket in tickets:
        queue.leave(ticket)
    assert queue.holders == frozenset()
    assert [queue.place(join(queue, unit)) for unit in (1, 2, 3)] == [0, 1, None]
