"""How an SDO transfer of a client ends: what its error names, and how long the channel is quiet after it."""

from __future__ import annotations

import pytest

from barewire.canopen import AbortCode, CanFrame, Channel, SdoAbort, upload
from barewire.canopen.nmt.node_monitor import NodeMonitor
from barewire.conversation import Wire, play
from barewire.errors import EncodeError, NoAnswer
from tests.canopen.sdo.test_client import Script, no_answer


@pytest.mark.parametrize("code", list(AbortCode))
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


def test_a_time_out_of_0_is_allowed_and_less_is_refused() -> None:
    wire = Wire[CanFrame](lambda frame, now: [])
    with pytest.raises(NoAnswer, match="within 0 s"):
        wire.play(upload(5, 0x6041, timeout=0.0))
    assert wire.now == 0.0
    for timeout in (-1.0, float("nan")):
        with pytest.raises(EncodeError) as refusal:
            play(upload(5, 0x6041, timeout=timeout), lambda frame, now: [])
        assert str(refusal.value) == f"time-out {timeout} s: expected 0 or more"


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
