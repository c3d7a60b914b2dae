"""Conversations with `play` and `abort_frames`, step by step; and the texts and classes of the errors."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import pytest

from barewire.conversation import Abandoned, Conversation, Heard, Listen, Send, SendAll, Wire, abort_frames, play
from barewire.errors import REASONS, BarewireError, DecodeError, EncodeError, NoAnswer, PortError, Refused
from barewire.modbus import ModbusException
from tests.helpers import refused

Talk = Conversation[str, list[Heard[str]]]


def with_steps(*steps: Send[str] | SendAll[str] | Listen) -> Talk:
    """Return a conversation that yields these steps; its result is the list of what it received."""
    heard = []
    for step in steps:
        heard.append((yield step))
    return heard


def silent(item: str, now: float) -> list[tuple[float, str]]:
    return []


def echo_after(*delays: float) -> Callable[[str, float], list[tuple[float, str]]]:
    return lambda item, now: [(now + delay, f"{item} after {delay:g}") for delay in delays]


# play ------------------------------------------------------------------------------------------------------------


def test_send_is_resumed_after_the_time_that_sending_takes() -> None:
    heard, end = play(with_steps(Send("four")), silent, start=10.0, sending_takes=len)
    assert heard == [Heard(None, 14.0)]
    assert end == 14.0


def test_the_peer_receives_an_item_when_it_is_transmitted() -> None:
    heard, end = play(with_steps(Send("four"), Listen(9.0)), echo_after(1.0), sending_takes=len)
    assert heard[1] == Heard("four after 1", 5.0)
    assert end == 5.0


def test_listen_without_item_ends_at_its_time() -> None:
    heard, end = play(with_steps(Send("x"), Listen(3.0), Listen(5.0)), echo_after(4.0))
    assert heard == [Heard(None, 0.0), Heard(None, 3.0), Heard("x after 4", 4.0)]
    assert end == 4.0


def test_an_item_at_exactly_the_end_of_listen_is_received() -> None:
    heard, _ = play(with_steps(Send("x"), Listen(3.0)), echo_after(3.0))
    assert heard[1] == Heard("x after 3", 3.0)


def test_answers_come_in_the_order_of_their_times() -> None:
    heard, _ = play(with_steps(Send("x"), Listen(9.0), Listen(9.0)), echo_after(2.0, 1.0))
    assert [item for item, _ in heard[1:]] == ["x after 1", "x after 2"]


def test_an_item_that_arrives_while_sending_is_received_afterwards() -> None:
    heard, _ = play(with_steps(Send("x"), Send("long"), Listen(9.0)), echo_after(1.0), sending_takes=len)
    assert heard[2] == Heard("x after 1", 5.0)


def test_send_all_is_resumed_after_the_last_item_and_each_reaches_the_peer_in_turn() -> None:
    heard, end = play(
        with_steps(SendAll(("one", "three")), Listen(9.0), Listen(9.0)), echo_after(1.0), sending_takes=len
    )
    assert heard == [Heard(None, 8.0), Heard("one after 1", 8.0), Heard("three after 1", 9.0)]
    assert end == 9.0


def test_send_all_of_no_items_takes_no_time() -> None:
    assert play(with_steps(SendAll(())), silent, start=2.0, sending_takes=len) == ([Heard(None, 2.0)], 2.0)


@pytest.mark.parametrize("until", [float("-inf"), 0.0, 4.0])
def test_listen_until_a_past_time_takes_an_item_that_is_there(until: float) -> None:
    nothing, _ = play(with_steps(Listen(until)), silent, start=4.0)
    assert nothing == [Heard(None, 4.0)]
    waiting, _ = play(with_steps(Send("x"), Listen(until)), echo_after(0.0), start=4.0)
    assert waiting[1] == Heard("x after 0", 4.0)


def test_time_never_runs_backwards() -> None:
    heard, _ = play(with_steps(Listen(5.0), Listen(3.0), Send("x"), Listen(1.0)), echo_after(-9.0))
    times = [now for _, now in heard]
    assert times == sorted(times) == [5.0, 5.0, 5.0, 5.0]


def test_errors_of_a_conversation_propagate_from_play() -> None:
    def giving_up() -> Talk:
        yield Listen(1.0)
        raise NoAnswer("no answer")

    with refused(NoAnswer, "no answer"):
        play(giving_up(), silent)


def test_the_next_conversation_on_a_wire_continues_in_time_and_receives_late_items() -> None:
    def giving_up() -> Talk:
        yield Send("x")
        yield Listen(1.0)
        raise NoAnswer("no answer")

    wire = Wire(echo_after(4.0))
    with refused(NoAnswer, "no answer"):
        wire.play(giving_up())
    assert (wire.now, wire.coming) == (1.0, [(4.0, "x after 4")])
    assert wire.play(with_steps(Send("y"), Listen(9.0), Listen(9.0))) == [
        Heard(None, 1.0),
        Heard("x after 4", 4.0),
        Heard("y after 4", 5.0),
    ]
    assert wire.now == 5.0


# abort_frames ----------------------------------------------------------------------------------------------------


def with_final_frames(*items: str) -> Talk:
    """Return a conversation that sends these items when it is abandoned."""
    try:
        yield Listen(1.0)
    except Abandoned:
        for item in items:
            yield Send(item)
        raise
    return []


def test_an_abandoned_conversation_may_send_a_final_frame() -> None:
    conversation = with_final_frames("abort", "goodbye")
    next(conversation)
    assert abort_frames(conversation) == ["abort", "goodbye"]


def test_final_frames_may_come_from_send_all() -> None:
    def with_send_all() -> Talk:
        try:
            yield Listen(1.0)
        except Abandoned:
            yield SendAll(["abort", "abort"])
            yield Send("goodbye")
            yield Listen(1.0)
        raise AssertionError("an abandoned conversation is not resumed after Listen")

    conversation = with_send_all()
    next(conversation)
    assert abort_frames(conversation) == ["abort", "abort", "goodbye"]


def test_a_conversation_without_final_frames_gives_none() -> None:
    conversation = with_steps(Listen(1.0))
    next(conversation)
    assert abort_frames(conversation) == []


def test_a_conversation_that_never_began_has_no_final_frames() -> None:
    assert abort_frames(with_final_frames("abort")) == []


def test_a_conversation_that_is_over_has_no_final_frames() -> None:
    conversation = with_steps()
    with pytest.raises(StopIteration):
        next(conversation)
    assert abort_frames(conversation) == []


def test_an_abandoned_conversation_receives_nothing() -> None:
    listened = []

    def listening_again() -> Talk:
        try:
            yield Listen(1.0)
        except Abandoned:
            yield Send("abort")
            listened.append((yield Listen(2.0)))
        return []

    conversation = listening_again()
    next(conversation)
    assert abort_frames(conversation) == ["abort"]
    assert listened == []
    assert conversation.gi_frame is None  # type: ignore[attr-defined]  # closed


def test_an_abandoned_conversation_may_return() -> None:
    def quiet() -> Talk:
        try:
            yield Listen(1.0)
        except Abandoned:
            yield Send("abort")
        return []

    conversation = quiet()
    next(conversation)
    assert abort_frames(conversation) == ["abort"]


def test_an_error_in_the_final_frames_propagates() -> None:
    def with_error() -> Talk:
        try:
            yield Listen(1.0)
        except Abandoned:
            raise EncodeError("not encodable") from None
        return []

    conversation = with_error()
    next(conversation)
    with refused(EncodeError, "not encodable"):
        abort_frames(conversation)


# Errors ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("error", [EncodeError, DecodeError, Refused, NoAnswer, PortError, Abandoned])
def test_every_error_is_a_barewire_error(error: type[Exception]) -> None:
    assert issubclass(error, BarewireError)


def test_errors_are_also_the_matching_builtin_errors() -> None:
    assert issubclass(EncodeError, ValueError)
    assert issubclass(DecodeError, ValueError)
    assert issubclass(NoAnswer, TimeoutError)
    assert issubclass(PortError, OSError)


def test_reasons_are_a_closed_list() -> None:
    assert len(REASONS) == len(set(REASONS)) == 11


@pytest.mark.parametrize(
    ("data", "shown"),
    [(b"", "nothing"), (b"\x01\xab", "01 AB"), (bytes(32), "00 " * 31 + "00"), (bytes(33), "00 " * 32 + "...")],
)
def test_a_decode_error_shows_the_bytes_but_not_all_of_many(data: bytes, shown: str) -> None:
    assert str(DecodeError("short", data, 0, "no")) == f"no (short, at byte 0 of {shown})"


def test_errors_can_be_pickled() -> None:
    undecoded = pickle.loads(pickle.dumps(DecodeError("checksum", b"\x01", 1, "no CRC")))
    assert (undecoded.reason, undecoded.data, undecoded.at, undecoded.text) == ("checksum", b"\x01", 1, "no CRC")
    exception = pickle.loads(pickle.dumps(ModbusException(2, 3)))
    assert (exception.code, exception.function_code) == (2, 3)
    unencoded = pickle.loads(pickle.dumps(EncodeError("unit 300", "unit")))
    assert (str(unencoded), unencoded.field) == ("unit 300", "unit")
