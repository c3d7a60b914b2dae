"""Turns: fair between units, in order within one, and nothing is lost when somebody gives up."""

from __future__ import annotations

from hypothesis import given, strategies as st

from barewire.modbus.client.fair_queue import FairQueue, Ticket
from tests.helpers import modest


def order(turns: FairQueue, tickets: dict[Ticket, str]) -> str:
    """Who gets a turn, one after the other."""
    found = ""
    while holders := turns.holders:
        (ticket,) = holders
        found += tickets[ticket]
        turns.leave(ticket)
    return found


def test_round_robin_by_unit_and_in_order_within_one() -> None:
    turns = FairQueue()
    first = turns.join(9)
    tickets = {turns.join(unit): name for unit, name in [(1, "a"), (1, "b"), (1, "c"), (1, "d"), (2, "e"), (3, "f")]}
    tickets[turns.join(3)] = "g"
    turns.leave(first)
    assert order(turns, tickets) == "aefbgcd"


def test_a_ticket_that_is_given_up_does_not_block_the_queue() -> None:
    turns = FairQueue()
    holder, waiting, gone = turns.join(1), turns.join(2), turns.join(2)
    turns.leave(gone)
    turns.leave(gone)  # twice is once
    turns.leave(holder)
    assert turns.has(waiting)
    turns.leave(waiting)
    assert turns.holders == frozenset()


@modest
@given(places=st.integers(1, 16), units=st.lists(st.integers(1, 5), max_size=40), data=st.data())
def test_never_more_than_places_are_admitted_and_every_ticket_is(
    places: int, units: list[int], data: st.DataObject
) -> None:
    turns = FairQueue(places)
    waiting = [turns.join(unit) for unit in units]
    had: set[Ticket] = set()
    while waiting:
        assert len(turns.holders) == min(places, len(waiting))
        had |= turns.holders
        leaving = data.draw(st.sampled_from(waiting))
        if leaving not in turns.holders:
            had.add(leaving)  # it gave up
        waiting.remove(leaving)
        turns.leave(leaving)
    assert len(had) == len(units)
    assert not turns.holders


def test_enter_does_not_overtake_waiting_tickets() -> None:
    turns = FairQueue()
    assert turns.enter(1)
    assert not turns.enter(1)
    waiting = turns.join(1)
    other = turns.join(2)
    assert not turns.enter(3)
    assert turns.exit()
    assert turns.has(other)  # unit 1 had its turn, if without a ticket
    assert turns.leave(other)
    assert turns.has(waiting)
    assert not turns.enter(2)
    assert not turns.leave(waiting)
    assert turns.enter(2)


@modest
@given(places=st.integers(1, 4), steps=st.lists(st.tuples(st.booleans(), st.integers(1, 3)), max_size=60))
def test_enter_and_join_share_the_same_places(places: int, steps: list[tuple[bool, int]]) -> None:
    turns = FairQueue(places)
    entered, tickets = 0, list[Ticket]()
    for arrives, unit in steps:
        if arrives and turns.enter(unit):
            entered += 1
        elif arrives:
            tickets.append(turns.join(unit))
        elif entered:
            turns.exit()
            entered -= 1
        elif tickets:
            turns.leave(tickets.pop(0))
        inside = entered + len(turns.holders)
        assert inside == min(places, entered + len(tickets))
        assert turns.holders <= set(tickets)
