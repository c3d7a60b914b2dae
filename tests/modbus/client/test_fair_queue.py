"""FairQueue: round robin between units, in order within a unit; tickets that are given up."""

from __future__ import annotations

from hypothesis import given, strategies as st

from barewire.modbus.client.fair_queue import FairQueue, Ticket
from tests.helpers import modest


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
    first = queue.join(9)
    tickets = {queue.join(unit): name for unit, name in [(1, "a"), (1, "b"), (1, "c"), (1, "d"), (2, "e"), (3, "f")]}
    tickets[queue.join(3)] = "g"
    queue.leave(first)
    assert order(queue, tickets) == "aefbgcd"


def test_a_ticket_that_is_given_up_does_not_block_the_queue() -> None:
    queue = FairQueue()
    holder, waiting, gone = queue.join(1), queue.join(2), queue.join(2)
    queue.leave(gone)
    queue.leave(gone)  # the second call has no effect
    queue.leave(holder)
    assert queue.has(waiting)
    queue.leave(waiting)
    assert queue.holders == frozenset()


@modest
@given(places=st.integers(1, 16), units=st.lists(st.integers(1, 5), max_size=40), data=st.data())
def test_never_more_than_places_are_admitted_and_every_ticket_is(
    places: int, units: list[int], data: st.DataObject
) -> None:
    queue = FairQueue(places)
    waiting = [queue.join(unit) for unit in units]
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


def test_enter_does_not_overtake_waiting_tickets() -> None:
    queue = FairQueue()
    assert queue.enter(1)
    assert not queue.enter(1)
    waiting = queue.join(1)
    other = queue.join(2)
    assert not queue.leave(queue.join(2))  # it waited, so no other ticket is admitted
    assert not queue.enter(3)
    assert queue.exit()
    assert queue.has(other)  # unit 1 was admitted before, without a ticket
    assert queue.leave(other)
    assert queue.has(waiting)
    assert not queue.enter(2)
    assert not queue.leave(waiting)
    assert queue.enter(2)


@modest
@given(places=st.integers(1, 4), steps=st.lists(st.tuples(st.booleans(), st.integers(1, 3)), max_size=60))
def test_enter_and_join_share_the_same_places(places: int, steps: list[tuple[bool, int]]) -> None:
    queue = FairQueue(places)
    entered, tickets = 0, list[Ticket]()
    for arrives, unit in steps:
        if arrives and queue.enter(unit):
            entered += 1
        elif arrives:
            tickets.append(queue.join(unit))
        elif entered:
            queue.exit()
            entered -= 1
        elif tickets:
            queue.leave(tickets.pop(0))
        inside = entered + len(queue.holders)
        assert inside == min(places, entered + len(tickets))
        assert queue.holders <= set(tickets)


def test_the_unit_admitted_longest_ago_is_next_whether_it_had_a_ticket_or_not() -> None:
    for with_ticket in (False, True):
        queue = FairQueue()
        for unit in (1, 2, 3, 2, 1):
            if with_ticket:
                queue.leave(queue.join(unit))
            else:
                queue.enter(unit)
                queue.exit()
        holder = queue.join(9)
        tickets = {queue.join(unit): str(unit) for unit in (1, 2, 3)}
        queue.leave(holder)
        assert order(queue, tickets) == "321"


def test_every_place_that_is_given_back_can_be_taken_again() -> None:
    queue = FairQueue(2)
    for _ in range(2):
        assert [queue.enter(unit) for unit in (1, 2, 3)] == [True, True, False]
        assert [queue.exit() for _ in range(2)] == [False, False]
