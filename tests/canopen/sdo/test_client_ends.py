"""How an SDO transfer of a client ends: what its error names, which aborts are its own, when the next begins."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from barewire.canopen import AbortCode, CanFrame, Channel, SdoAbort, download, upload
from barewire.canopen.nmt.node_monitor import NodeMonitor
from barewire.conversation import Conversation, Heard, Listen, Send, Wire, abort_frames, play
from barewire.errors import EncodeError, NoAnswer
from tests.canopen.sdo.test_client import Script, no_answer
from tests.helpers import every_case


@every_case("code", list(AbortCode))
def test_after_an_abort_that_is_out_of_step_the_channel_waits_for_late_responses(code: AbortCode) -> None:
    channel = Channel(5)
    abort = f"585#80416000{code.to_bytes(4, 'little').hex()}"
    with pytest.raises(SdoAbort):
        play(upload(channel, 0x6041, timeout=2.0), Script(("605#4041600000000000", abort)))
    out_of_step = code in (AbortCode.COMMAND, AbortCode.TOGGLE, AbortCode.SEQUENCE_NUMBER, AbortCode.TIMED_OUT)
    assert channel.quiet_until == (4.0 if out_of_step else None)


def test_a_client_that_ends_a_transfer_names_the_node_and_the_reason() -> None:
    with pytest.raises(SdoAbort) as caught:
        play(
            upload(5, 0x1008),
            Script(
                ("605#4008100000000000", "585#4108100002000000"),
                ("605#6000000000000000", "585#1B41420000000000"),  # the toggle bit of the second segment
            ),
        )
    assert (caught.value.node, caught.value.code) == (5, AbortCode.TOGGLE)
    assert caught.value.why


def test_a_time_out_of_0_is_allowed_and_less_or_an_endless_one_is_refused() -> None:
    wire = Wire[CanFrame](lambda frame, now: [])
    with pytest.raises(NoAnswer, match="within 0 s"):
        wire.play(upload(5, 0x6041, timeout=0.0))
    assert wire.now == 0.0
    for timeout in (-1.0, float("nan"), float("inf")):
        with pytest.raises(EncodeError) as refusal:
            play(upload(5, 0x6041, timeout=timeout), lambda frame, now: [])
        assert str(refusal.value) == f"time-out {timeout} s: expected 0 or more seconds, and finite"


def test_aborts_that_cannot_be_decoded_are_counted_and_an_abort_names_the_node() -> None:
    channel = Channel(5)
    with pytest.raises(SdoAbort) as caught:
        play(upload(channel, 0x6041), Script(("605#4041600000000000", "585#80", "585#8041", "585#8041600000000206")))
    assert (channel.counters.garbled, caught.value.node) == (2, 5)


def test_the_time_out_text_reports_how_long_ago_the_node_was_heard() -> None:
    monitor = NodeMonitor()
    monitor.feed(CanFrame.parse("705#05"), 1.0)
    text, sent = no_answer(upload(Channel(5, node_monitor=monitor), 0x6041, timeout=4.0))
    assert "node 5 last sent a frame 3 s ago, operational" in text
    assert len(sent) == 2


REQUEST, RESPONSE = "605#4041600000000000", "585#4B41600037060000"


@pytest.mark.parametrize(
    ("abort", "own"),
    [
        ("585#8041600000000206", True),
        ("585#8041600001000405", True),
        ("585#8000000000000206", True),  # many devices name no object
        ("585#8000000001000405", False),  # the response to a frame that came twice, after a transfer
        ("585#8000000000000405", False),
        ("585#8040600000000206", False),  # for the transfer of another object
        ("585#8030313200000305", False),
    ],
)
def test_an_abort_before_the_first_response_is_taken_if_it_can_only_be_the_answer(abort: str, own: bool) -> None:
    channel = Channel(5)
    script = Script((REQUEST, abort, RESPONSE))
    if own:
        with pytest.raises(SdoAbort):
            play(upload(channel, 0x6041), script)
    else:
        assert play(upload(channel, 0x6041), script)[0] == b"\x37\6"
    assert channel.counters.late == (not own)


@pytest.mark.parametrize("abort", ["585#8004100000000206", "585#8000000001000405"])
def test_an_abort_in_doubt_is_the_outcome_if_nothing_else_comes(abort: str) -> None:
    channel = Channel(5)
    wire = Wire[CanFrame](Script((REQUEST, abort)))
    with pytest.raises(SdoAbort) as caught:
        wire.play(upload(channel, 0x6041, timeout=0.5))
    named = bytes.fromhex(abort[4:])
    assert caught.value.named == (int.from_bytes(named[1:3], "little"), named[3])
    assert (wire.now, channel.quiet_until) == (0.5, 1.0)


def test_aborts_in_doubt_are_counted() -> None:
    channel = Channel(5)
    script = Script((REQUEST, "585#8004100000000206", "585#8005100000000206", RESPONSE))
    assert play(upload(channel, 0x6041), script)[0] == b"\x37\6"
    assert channel.counters.late == 2


@pytest.mark.parametrize("abort", ["585#8030313200000305", "585#8000000001000405"])
def test_after_the_first_response_an_abort_ends_the_transfer_whatever_it_names(abort: str) -> None:
    script = Script((REQUEST, "585#4141600014000000"), ("605#6000000000000000", abort))
    with pytest.raises(SdoAbort) as caught:
        play(upload(5, 0x6041), script)
    assert caught.value.named != (0x6041, 0)
    assert len(script.sent) == 2  # an abort is not answered


@pytest.mark.parametrize("abort", ["585#8008100001000405", "585#8000000001000405"])
def test_a_refusal_of_blocks_may_name_no_object(abort: str) -> None:
    script = Script(("605#A40810007F000000", abort), ("605#4008100000000000", "585#4F08100041000000"))
    assert play(upload(5, 0x1008, block=True), script)[0] == b"A"


@pytest.mark.parametrize("response", ["4141600014000000", "6041600000000000", "A44160007F000000", "C641600014000000"])
def test_a_late_response_that_begins_a_transfer_is_answered_by_an_abort(response: str) -> None:
    channel = Channel(5)
    with pytest.raises(NoAnswer):
        play(upload(channel, 0x6041, timeout=1.0), lambda frame, now: [])
    conversation = upload(channel, 0x6040)
    assert next(conversation) == Listen(2.0)
    closing = conversation.send(Heard(CanFrame.parse(f"585#{response}"), 1.5))
    assert closing == Send(CanFrame.parse("605#8041600000000405"))
    assert conversation.send(Heard(None, 1.5)) == Listen(2.0)
    # A late value, an abort, or a response that names another object begins nothing.
    for text in ("585#4B41600037060000", "585#8041600000000206", "585#4142600014000000", "585#2000000000000000"):
        assert conversation.send(Heard(CanFrame.parse(text), 1.6)) == Listen(2.0)


def test_the_transfer_of_another_client_is_not_aborted() -> None:
    channel = Channel(5)
    with pytest.raises(NoAnswer):
        play(upload(channel, 0x6041, timeout=1.0), lambda frame, now: [])
    conversation = upload(channel, 0x6040)
    next(conversation)
    conversation.send(Heard(CanFrame.parse(REQUEST), 1.4))
    assert isinstance(conversation.send(Heard(CanFrame.parse("585#4141600014000000"), 1.5)), Listen)


# Abandoned transfers: a cancelled task, Ctrl-C


def abandoned(conversation: Conversation[CanFrame, Any], *responses: str, at: float = 0.0) -> list[CanFrame]:
    """Play the beginning of a transfer at one time, abandon it, and return its final frames."""
    step, texts = next(conversation), list(responses)
    step = conversation.send(Heard(None, at))
    while texts or not isinstance(step, Listen):
        item = CanFrame.parse(f"585#{texts.pop(0)}") if isinstance(step, Listen) else None
        step = conversation.send(Heard(item, at))
    return abort_frames(conversation)


def wait_of(channel: Channel, index: int) -> float:
    """Return how long the transfer of an object waits at time 0 before its request, if nothing comes."""
    conversation = upload(channel, index)
    step, now = next(conversation), 0.0
    while not (isinstance(step, Send) and step.item.data[1:3] == index.to_bytes(2, "little")):
        now = max(now, step.until) if isinstance(step, Listen) else now
        step = conversation.send(Heard(None, now))
    conversation.close()
    return now


SEGMENTS = (0x6041, ("4141600014000000", "0041424344454647"))


@pytest.mark.parametrize(
    ("conversation", "responses", "same", "other"),
    [
        (lambda channel: upload(channel, 0x6041), (), 2.0, 0.0),
        (lambda channel: download(channel, 0x6041, 0, b"1"), (), 2.0, 0.0),
        (lambda channel: upload(channel, 0x6041), ("4141600014000000",), 0.0, 0.0),
        (lambda channel: upload(channel, 0x6041), SEGMENTS[1], 0.0, 0.0),
        (lambda channel: download(channel, 0x6041, 0, b"12345678"), ("6041600000000000",), 0.0, 0.0),
        (lambda channel: upload(channel, 0x6041, block=True), (), 2.0, 0.0),
        (lambda channel: upload(channel, 0x6041, block=True), ("C641600014000000",), 2.0, 2.0),
        (lambda channel: download(channel, 0x6041, 0, b"12345678", block=True), ("A44160007F000000",), 0.0, 0.0),
    ],
)
def test_after_an_abandoned_transfer_only_what_could_be_mistaken_is_waited_for(
    conversation: Callable[[Channel], Conversation[CanFrame, Any]],
    responses: tuple[str, ...],
    same: float,
    other: float,
) -> None:
    channel = Channel(5)
    (abort,) = abandoned(conversation(channel), *responses)
    assert str(abort) == "605#8041600000000008"
    assert (wait_of(channel, 0x6042), wait_of(channel, 0x6041)) == (other, same if not other else 0.0)


def test_the_response_to_the_abandoned_request_ends_the_wait() -> None:
    channel = Channel(5)
    abandoned(upload(channel, 0x6041))
    conversation = upload(channel, 0x6041)
    assert next(conversation) == Listen(2.0)
    step = conversation.send(Heard(CanFrame.parse("585#4B41600001000000"), 0.01))
    assert isinstance(step, Listen)  # for what has arrived already
    assert step.until < 0.0
    assert conversation.send(Heard(None, 0.01)) == Send(CanFrame.parse(REQUEST))
    assert channel.quiet_until is None


def test_a_transfer_that_the_server_begins_for_an_abandoned_request_is_aborted() -> None:
    channel = Channel(5)
    abandoned(upload(channel, 0x6041))
    conversation = upload(channel, 0x6041)
    assert next(conversation) == Listen(2.0)
    closing = conversation.send(Heard(CanFrame.parse("585#4141600014000000"), 0.01))
    assert closing == Send(CanFrame.parse("605#8041600000000405"))


@pytest.mark.parametrize(("at", "frame", "wait"), [(5.1, RESPONSE, 0.0), (5.0, RESPONSE, 7.0), (5.1, "585#20", 7.0)])
def test_the_response_may_have_come_while_nobody_listened(at: float, frame: str, wait: float) -> None:
    """A bus gives a channel the frames of its transfers only, but the node monitor sees them all."""
    channel = Channel(5, node_monitor=NodeMonitor())
    abandoned(upload(channel, 0x6041), at=5.0)
    assert channel.node_monitor is not None
    channel.node_monitor.feed(CanFrame.parse(frame), at)
    assert wait_of(channel, 0x6041) == wait


def test_the_objects_of_several_abandoned_transfers_add_up_until_a_response() -> None:
    channel = Channel(5)
    abandoned(upload(channel, 0x6041))
    abandoned(upload(channel, 0x6042))
    assert [wait_of(channel, index) for index in (0x6043, 0x6041)] == [0.0, 2.0]
    abandoned(upload(channel, 0x6041))
    play(upload(channel, 0x6042), Script(("605#4042600000000000", "585#4B42600037060000")))
    assert wait_of(channel, 0x6041) == 0.0  # the server answers in the order of the requests


def test_the_wait_after_a_time_out_is_not_shortened_by_an_abandoned_transfer() -> None:
    channel = Channel(5)
    with pytest.raises(NoAnswer):
        play(upload(channel, 0x6041, timeout=1.0), lambda frame, now: [])
    assert wait_of(channel, 0x6042) == 2.0


def test_after_an_early_begin_an_abort_out_of_step_is_in_doubt() -> None:
    channel = Channel(5)
    abandoned(upload(channel, 0x6041), *SEGMENTS[1])
    script = Script((REQUEST, "585#8041600000000405", RESPONSE))
    assert play(upload(channel, 0x6041), script)[0] == b"\x37\6"
