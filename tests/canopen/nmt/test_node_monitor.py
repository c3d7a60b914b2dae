"""The node monitor: explanations of why a node did not respond."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, Channel, ErrorFrame, NmtState, NodeState, upload
from barewire.canopen.nmt.node_monitor import NodeMonitor
from barewire.conversation import Heard, Listen, Send, play
from barewire.errors import NoAnswer


def monitor_of(*lines: tuple[float, str]) -> NodeMonitor:
    monitor = NodeMonitor()
    for time, text in lines:
        assert monitor.feed(CanFrame.parse(text), time) == []
    return monitor


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ((), "node 5 has sent no frame, 0 frames on 585h, nothing at all on the bus meanwhile"),
        (((7.0, "705#7F"),), "node 5 last sent a frame 3 s ago, pre-operational, 0 frames on 585h, 1 frame on the bus"),
        (((7.0, "705#04"),), "stopped, and a stopped node does not answer SDO"),
        (((7.0, "705#00"),), "node 5 last sent a frame 3 s ago, booting"),
        (((8.0, "705#7F"), (9.5, "185#00")), "node 5 last sent a frame 0.5 s ago, pre-operational"),
        (((7.0, "605#4000100000000000"),), "node 5 has sent no frame"),
        (((7.0, "00000585#4000100000000000"),), "1 frame on extended 00000585h, which is another identifier"),
        (
            ((7.0, "706#7F"), (7.0, "706#7F")),
            "node 5 has sent no frame (others: node 6), 0 frames on 585h, 2 frames on the bus",
        ),
    ],
)
def test_explanation_of_silence(lines: tuple[tuple[float, str], ...], expected: str) -> None:
    mark = NodeMonitor().mark(0x585)
    assert expected in monitor_of(*lines).explain_silence(5, 0x585, mark, 10.0, responses=0)


def test_a_recent_report_of_the_controller_is_included() -> None:
    monitor = NodeMonitor()
    monitor.report(ErrorFrame(0x60), 10.0)
    mark = monitor.mark(0x585)
    report = "the controller reported no acknowledgement, bus off 0.5 s ago"
    assert report in monitor.explain_silence(5, 0x585, mark, 10.5, responses=0)
    assert report[:14] not in monitor.explain_silence(5, 0x585, mark, 30.0, responses=0)


def test_a_remote_frame_is_neither_a_request_nor_a_frame_of_the_node() -> None:
    """A master of node guarding sends 705h as a remote frame. On an SDO identifier it is not a request or response."""
    monitor = monitor_of((7.0, "705#7F"), (8.0, "705#R1"), (8.0, "186#R8"), (9.0, "605#R8"))
    assert monitor.unanswered(0x605, 0x585) is None
    assert monitor.state(5) == NodeState(5, NmtState.PRE_OPERATIONAL)
    assert (monitor.last_sent(5), monitor.nodes()) == (7.0, [5])
    monitor.feed(CanFrame.parse("605#4000100000000000"), 9.5)
    monitor.feed(CanFrame.parse("585#R8"), 9.6)
    assert monitor.unanswered(0x605, 0x585) == 9.5
    assert monitor.frames == 6


def test_a_request_has_eight_bytes() -> None:
    assert monitor_of((9.0, "605#40001000")).unanswered(0x605, 0x585) is None


def test_another_protocol_does_not_fill_the_memory() -> None:
    monitor = NodeMonitor()
    for number in range(10_000):
        monitor.feed(CanFrame(0x18F00000 + number, b"", True), 0.0)
    assert (monitor.foreign, monitor.frames, len(monitor._extended)) == (10_000, 10_000, 0)


def test_the_time_out_of_a_channel_is_explained() -> None:
    monitor = monitor_of((-3.0, "705#7F"))
    with pytest.raises(NoAnswer) as caught:
        play(upload(Channel(5, node_monitor=monitor), 0x6041), lambda frame, now: [])
    assert str(caught.value) == (
        "node 5 did not answer the upload of 6041h:00 within 1 s: node 5 last sent a frame 4 s ago, pre-operational, "
        "0 frames on 585h, nothing at all on the bus meanwhile"
    )


def test_other_nodes_are_listed_when_the_node_has_sent_no_frame() -> None:
    monitor = NodeMonitor()
    mark = monitor.mark(0x585)
    monitor.feed(CanFrame.parse("581#0000000000000000"), 1.0)
    text = "node 5 has sent no frame (others: node {}), 0 frames on 585h, {} on the bus meanwhile"
    assert monitor.explain_silence(5, 0x585, mark, 2.0, responses=0) == text.format("1", "1 frame")
    for node in (2, 3, 4, 6, 7):
        monitor.feed(CanFrame.parse(f"{0x700 + node:03X}#05"), 1.0)
    assert monitor.explain_silence(5, 0x585, mark, 2.0, responses=0) == text.format("1, 2, 3, 4, 6, ...", "6 frames")


def test_a_silent_bus_has_the_remark_until_a_frame_arrives() -> None:
    monitor = NodeMonitor("the bus is inside one process")
    before = monitor.mark(0x585)
    text = monitor.explain_silence(5, 0x585, before, 1.0, responses=0)
    assert text.endswith("nothing at all on the bus meanwhile, and the bus is inside one process")
    monitor.feed(CanFrame.parse("705#7F"), 1.0)
    assert "one process" not in monitor.explain_silence(5, 0x585, monitor.mark(0x585), 2.0, responses=0)


def test_an_unanswered_request_of_another_client_is_known() -> None:
    monitor = NodeMonitor()
    assert monitor.unanswered(0x605, 0x585) is None
    monitor.feed(CanFrame.parse("605#4064600000000000"), 1.0)
    assert monitor.unanswered(0x605, 0x585) == 1.0
    monitor.feed(CanFrame.parse("585#8064600000000206"), 1.5)
    assert monitor.unanswered(0x605, 0x585) == 1.0  # the abort may respond to an earlier frame
    monitor.feed(CanFrame.parse("585#4364600000000000"), 2.0)
    assert monitor.unanswered(0x605, 0x585) is None
    monitor.feed(CanFrame.parse("605#8064600000000405"), 3.0)
    assert monitor.unanswered(0x605, 0x585) is None  # an abort has no response


def test_a_transfer_waits_for_the_response_to_another_client_that_asked_before() -> None:
    monitor = NodeMonitor()
    monitor.feed(CanFrame.parse("605#4064600000000000"), 1.0)
    conversation = upload(Channel(5, node_monitor=monitor), 0x6041, timeout=1.0)
    assert next(conversation) == Listen(2.0)
    assert conversation.send(Heard(None, 2.0)) == Send(CanFrame.parse("605#4041600000000000"))
