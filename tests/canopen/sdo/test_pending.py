"""What a channel remembers of responses that are still to come, and for how long."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.canopen import CanFrame, Channel, SdoServer, upload
from barewire.conversation import Conversation, Heard, Listen, Send, abort_frames
from barewire.errors import NoAnswer
from tests.canopen.sdo.sdo_bus import Bus, Store

X, Y = 0x2100, 0x2101


def answer(index: int) -> CanFrame:
    return CanFrame(0x585, bytes((0x43, index & 0xFF, index >> 8, 0, 1, 2, 3, 4)))


def sent_upload(channel: Channel, index: int, now: float, timeout: float = 1.0) -> Conversation[CanFrame, Any]:
    """An upload whose request is sent at this time, if it has to wait for nothing."""
    conversation = upload(channel, index, timeout=timeout)
    next(conversation)
    assert isinstance(conversation.send(Heard(None, now)), Send)
    assert isinstance(conversation.send(Heard(None, now)), Listen)
    return conversation


def test_a_short_transfer_does_not_end_the_wait_for_a_response_that_may_come_later() -> None:
    channel = Channel(5)
    abort_frames(sent_upload(channel, X, 0.0, timeout=60.0))
    unanswered = sent_upload(channel, Y, 1.0, timeout=0.1)
    unanswered.send(Heard(None, 1.1))
    with pytest.raises(NoAnswer):
        unanswered.send(Heard(None, 1.1))
    assert next(upload(channel, X)) == Listen(120.0)


def test_a_call_with_a_shorter_time_out_than_its_client_waits_as_long_for_its_late_response() -> None:
    channel = Channel(5)
    channel.timeout = 1.0
    abort_frames(sent_upload(channel, X, 0.0, timeout=0.02))
    assert next(upload(channel, X)) == Listen(2.0)


def test_the_response_to_one_abandoned_transfer_does_not_stand_for_that_to_another() -> None:
    channel = Channel(5)
    abort_frames(sent_upload(channel, X, 0.0))
    abort_frames(sent_upload(channel, Y, 0.1))
    again = upload(channel, X)
    assert next(again) == Listen(2.1)
    again.send(Heard(answer(X), 0.2))
    assert isinstance(again.send(Heard(None, 0.2)), Send)
    again.send(Heard(None, 0.2))
    abort_frames(again)
    assert next(upload(channel, Y)) == Listen(2.2)  # the response to the first request for Y is still to come


def test_a_request_that_is_abandoned_while_it_is_sent_may_have_been_sent() -> None:
    channel = Channel(5)
    conversation = upload(channel, X, timeout=1.0)
    next(conversation)
    assert isinstance(conversation.send(Heard(None, 7.0)), Send)
    assert [str(frame) for frame in abort_frames(conversation)] == ["605#8000210000000008"]
    assert next(upload(channel, X)) == Listen(9.0)


@pytest.mark.parametrize("waits", [3, 10, 30])
def test_the_transfer_after_an_abandoned_block_upload_waits_for_one_response(waits: int) -> None:
    store, channel = Store(), Channel(5)
    store.objects[X, 0] = bytes.fromhex("43002100") * 500  # bytes that look like responses
    bus = Bus(SdoServer(5, store, timeout=1.0))
    bus.run(_abandoned(upload(channel, X, timeout=1.0, block=True), waits))
    began = bus.now
    assert bus.run(upload(channel, Y, timeout=1.0, block=True)) == b"other"
    assert bus.now - began < 0.05


def test_a_server_that_ignores_the_probe_costs_two_time_outs() -> None:
    channel = Channel(5)
    bus = Bus(
        SdoServer(5, Store()), fault=lambda number, frame: [] if frame.data[:4] == b"\x40\0\0\0" else [(0.0, frame)]
    )
    bus.run(_abandoned(upload(channel, X, timeout=1.0, block=True), 3))
    began = bus.now
    assert bus.run(upload(channel, Y, timeout=1.0)) == b"other"
    assert 1.9 < bus.now - began < 2.3


def test_only_the_abort_that_answers_the_probe_ends_the_wait() -> None:
    channel = Channel(5)
    after = _probing(channel, 1.0, 0.0)
    assert after.send(Heard(None, 0.0)) == Listen(2.0)
    for text in ("4300000000000000", "4B00000000000000", "8000000001000405", "8000000000000405", "8000210000000206"):
        assert after.send(Heard(CanFrame.parse(f"585#{text}"), 0.5)) == Listen(2.0)
    after.send(Heard(CanFrame.parse("585#8000000000000206"), 0.5))
    assert isinstance(after.send(Heard(None, 0.5)), Send)
    assert channel.quiet_until is None


def test_the_answer_to_the_probe_of_a_shorter_call_may_be_as_late_as_any_of_the_client() -> None:
    channel = Channel(5)
    channel.timeout = 1.0
    assert _probing(channel, 0.02, 0.5).send(Heard(None, 0.5)) == Listen(2.5)


def test_a_probe_that_is_interrupted_while_it_is_sent_may_have_been_sent() -> None:
    channel = Channel(5)
    abort_frames(_probing(channel, 1.0, 1.5))
    assert next(upload(channel, Y)) == Listen(3.5)


def _probing(channel: Channel, timeout: float, at: float) -> Conversation[CanFrame, Any]:
    """Abandon an upload in blocks at time 0; return the next one, which sends its probe at `at`."""
    left = upload(channel, X, timeout=1.0, block=True)
    next(left)
    for item in (None, None, CanFrame.parse("585#C6002100EA010000"), None):
        left.send(Heard(item, 0.0))
    abort_frames(left)
    conversation = upload(channel, Y, timeout=timeout)
    step = next(conversation)
    while isinstance(step, Listen):
        step = conversation.send(Heard(None, at))
    assert step == Send(CanFrame.parse("605#4000000000000000"))
    return conversation


def _abandoned(conversation: Conversation[CanFrame, Any], waits: int) -> Conversation[CanFrame, None]:
    """Abandon a conversation at one of its waits."""
    step = next(conversation)
    while waits := waits - isinstance(step, Listen):
        step = conversation.send((yield step))
    for frame in abort_frames(conversation):
        yield Send(frame)
