"""Who may talk now: in order, without overtaking, and nobody waits for himself."""

from __future__ import annotations

from functools import partial

import pytest
from hypothesis import given, strategies as st

from barewire.canopen.bus.channel_locks import ChannelLock, ChannelLocks, Keys
from barewire.errors import EncodeError

FIVE, SIX = frozenset({5}), frozenset({6})


def test_one_at_a_time_on_a_key_and_others_beside_it() -> None:
    claims = ChannelLocks()
    woken: list[str] = []
    first, second, third, other = (
        claims.join(keys, wake=partial(woken.append, name))
        for name, keys in (("first", FIVE), ("second", FIVE), ("third", FIVE), ("other", SIX))
    )
    assert [claim.going for claim in (first, second, third, other)] == [True, False, False, True]
    claims.leave(first)
    assert woken == ["second"]
    claims.leave(third)  # gave up
    claims.leave(second)
    assert woken == ["second"]
    assert len(claims) == 1


def test_everything_waits_for_all_and_is_not_overtaken() -> None:
    claims = ChannelLocks()
    first, everything, late, beside = (claims.join(keys) for keys in (FIVE, None, SIX, frozenset[int]()))
    assert (everything.going, late.going, beside.going) == (False, False, True)
    claims.leave(first)
    assert (everything.going, late.going) == (True, False)
    claims.leave(everything)
    assert late.going


def test_several_keys_are_claimed_at_once() -> None:
    claims = ChannelLocks()
    both, five = claims.join(FIVE | SIX), claims.join(FIVE)
    assert not five.going
    claims.leave(both)
    assert five.going


def test_who_would_wait_for_himself_is_told() -> None:
    claims = ChannelLocks()
    claims.join(FIVE, owner="me")
    claims.join(SIX, owner="me")
    with pytest.raises(EncodeError, match="begun inside another one"):
        claims.join(FIVE, owner="me")
    with pytest.raises(EncodeError, match="begun inside another one"):
        claims.join(None, owner="me")
    assert not claims.join(FIVE, owner="you").going


@given(st.lists(st.one_of(st.none(), st.frozensets(st.integers(0, 3))), max_size=12), st.randoms())
def test_whatever_the_order_all_get_their_turn_and_never_two_on_a_key(wanted: list[Keys | None], dice: object) -> None:
    claims = ChannelLocks()
    standing: list[ChannelLock] = [claims.join(keys) for keys in wanted]
    while standing:
        going = [claim for claim in standing if claim.going]
        assert going, "nobody goes, so nobody ever will"
        for claim in going:
            assert not any(claim.meets(other) for other in going if other is not claim)
        for place, claim in enumerate(standing):
            assert claim.going or any(claim.meets(older) for older in standing[:place])
        leaving = dice.choice(standing)  # type: ignore[attr-defined]
        standing.remove(leaving)
        claims.leave(leaving)
    assert len(claims) == 0
