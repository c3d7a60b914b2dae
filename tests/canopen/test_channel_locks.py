"""Locks are granted in order, without overtaking, and no owner can wait for itself."""

from __future__ import annotations

from contextlib import suppress
from functools import partial

import pytest
from hypothesis import given, strategies as st

from barewire.canopen.channel_locks import ChannelLock, ChannelLocks, LockKeys
from barewire.errors import EncodeError
from tests.interrupts import Interrupt, interrupt

FIVE, SIX = frozenset({5}), frozenset({6})


def test_one_lock_per_key_at_a_time_and_other_keys_are_independent() -> None:
    locks = ChannelLocks()
    woken: list[str] = []
    first, second, third, other = (
        locks.request(keys, wake=partial(woken.append, name))
        for name, keys in (("first", FIVE), ("second", FIVE), ("third", FIVE), ("other", SIX))
    )
    assert [lock.granted for lock in (first, second, third, other)] == [True, False, False, True]
    locks.release(first)
    assert woken == ["second"]
    locks.release(third)  # a waiting request is removed
    locks.release(second)
    assert woken == ["second"]
    assert len(locks) == 1


def test_a_lock_on_everything_waits_for_all_and_is_not_overtaken() -> None:
    locks = ChannelLocks()
    first, everything, late, beside = (locks.request(keys) for keys in (FIVE, None, SIX, frozenset[int]()))
    assert (everything.granted, late.granted, beside.granted) == (False, False, True)
    locks.release(first)
    assert (everything.granted, late.granted) == (True, False)
    locks.release(everything)
    assert late.granted


def test_several_keys_are_locked_at_once() -> None:
    locks = ChannelLocks()
    both, five = locks.request(FIVE | SIX), locks.request(FIVE)
    assert not five.granted
    locks.release(both)
    assert five.granted


def test_a_request_that_would_wait_for_its_own_owner_raises() -> None:
    locks = ChannelLocks()
    locks.request(FIVE, owner="first")
    locks.request(SIX, owner="first")
    with pytest.raises(EncodeError, match="begun inside another one"):
        locks.request(FIVE, owner="first")
    with pytest.raises(EncodeError, match="begun inside another one"):
        locks.request(None, owner="first")
    assert not locks.request(FIVE, owner="second").granted


@given(st.lists(st.one_of(st.none(), st.frozensets(st.integers(0, 3))), max_size=12), st.randoms())
def test_in_any_order_every_request_is_granted_and_never_two_on_one_key(
    wanted: list[LockKeys | None], random: object
) -> None:
    locks = ChannelLocks()
    queue: list[ChannelLock] = [locks.request(keys) for keys in wanted]
    while queue:
        granted = [lock for lock in queue if lock.granted]
        assert granted, "no request is granted: a deadlock"
        for lock in granted:
            assert not any(lock.conflicts_with(other) for other in granted if other is not lock)
        for place, lock in enumerate(queue):
            assert lock.granted or any(lock.conflicts_with(older) for older in queue[:place])
        ended = random.choice(queue)  # type: ignore[attr-defined]
        queue.remove(ended)
        locks.release(ended)
    assert len(locks) == 0


def test_a_release_completed_after_an_exception_at_any_line_wakes_who_waits() -> None:
    def run(at: int | None) -> int:
        locks, lines = ChannelLocks(), 0
        woken: list[str] = []
        first, everything = locks.request(FIVE), locks.request(None, wake=partial(woken.append, "everything"))

        def interrupted() -> None:
            nonlocal lines
            lines = interrupt(lambda: locks.release(first), at)

        with suppress(Interrupt):
            interrupted()
        locks.release(first)
        assert everything.granted
        assert not first.granted
        assert "everything" in woken, at
        return lines

    lines = run(None)
    assert lines > 5
    for at in range(lines):
        run(at)
