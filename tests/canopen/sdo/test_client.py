"""The SDO client as dialogues: its requests, the responses it accepts, and its errors without a response."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import pytest

from barewire.canopen import AbortCode, BlockSettings, CanFrame, Channel, SdoAbort, download, fit, upload
from barewire.conversation import Conversation, Heard, Listen, Send, abort_frames, play
from barewire.devices.sdo_dialects import AZ3
from barewire.errors import EncodeError, NoAnswer
from tests.helpers import every_case

Peer = Callable[[CanFrame, float], Iterable[tuple[float, CanFrame]]]


class Script:
    """A peer that expects frames and responds to each with its own, 1 ms apart; `sent` records what it received."""

    def __init__(self, *lines: tuple[str, *tuple[str, ...]]) -> None:
        self.lines = list(lines)
        self.sent: list[str] = []

    def __call__(self, frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        self.sent.append(str(frame))
        expected, *answers = self.lines.pop(0) if self.lines else (str(frame),)
        assert str(frame) == expected
        return [(now + 0.001 * place, CanFrame.parse(answer)) for place, answer in enumerate(answers, 1)]


def test_read_a_u32() -> None:
    script = Script(("605#4000100000000000", "585#4300100091010F00"))
    assert play(upload(5, 0x1000), script) == (bytes.fromhex("91010F00"), 0.001)


@pytest.mark.parametrize(
    ("answer", "value"),
    [
        ("585#4F0020010A000000", "0A"),
        ("585#4B0020010A0B0000", "0A0B"),
        ("585#470020010A0B0C00", "0A0B0C"),
        ("585#430020010A0B0C0D", "0A0B0C0D"),
        ("585#4F0020010A0B0C0D", "0A"),  # bytes that are not data may have any value
        ("585#420020010A0B0C0D", "0A0B0C0D"),
    ],
)
def test_read_one_to_four_bytes(answer: str, value: str) -> None:
    data, _ = play(upload(5, 0x2000, 1), Script(("605#4000200100000000", answer)))
    assert data == bytes.fromhex(value)


@pytest.mark.parametrize(
    ("value", "request_"),
    [
        ("0A", "605#2F0020010A000000"),
        ("0A0B", "605#2B0020010A0B0000"),
        ("0A0B0C", "605#270020010A0B0C00"),
        ("0A0B0C0D", "605#230020010A0B0C0D"),
    ],
)
def test_write_one_to_four_bytes(value: str, request_: str) -> None:
    play(download(5, 0x2000, 1, bytes.fromhex(value)), Script((request_, "585#6000200100000000")))


def test_write_without_indicating_the_size() -> None:
    script = Script(("605#22171000E8030000", "585#6017100000000000"))
    play(download(5, 0x1017, 0, bytes.fromhex("E8030000"), indicated=False), script)


# The worked example of the AZ3's guide, 4.3.1, node 15, with the index in the order of the wire.
def test_read_the_controlword_as_the_az3_guide_does() -> None:
    script = Script(("60F#4340600000000000", "58F#4340600006000000"))
    data, _ = play(upload(15, 0x6040, dialect=AZ3), script)
    assert data == bytes.fromhex("06000000")
    assert fit(data, 2) == b"\x06\x00"


@pytest.mark.parametrize(("size", "command"), [(1, "4F"), (2, "4B"), (4, "43")])
def test_the_az3_dialect_requests_by_size(size: int, command: str) -> None:
    script = Script((f"60F#{command}40600000000000", "58F#4B40600006000000"))
    assert play(upload(15, 0x6040, size=size, dialect=AZ3), script)[0] == b"\x06\x00"


def test_write_the_controlword_as_the_az3_guide_does() -> None:
    script = Script(("60F#234060000F000000", "58F#6040600000000000"))
    play(download(15, 0x6040, 0, bytes.fromhex("0F000000"), dialect=AZ3), script)


def test_a_value_of_unknown_size_is_cut_to_the_size_that_the_caller_knows() -> None:
    channel = Channel(5)
    script = Script(("605#4041600000000000", "585#4241600037060BAD"))
    assert play(upload(channel, 0x6041, size=2), script)[0] == bytes.fromhex("3706")
    assert channel.counters.unsized == 1


def test_an_indicated_size_is_not_changed() -> None:
    script = Script(("605#4041600000000000", "585#4341600037060000"))
    assert play(upload(5, 0x6041, size=2), script)[0] == bytes.fromhex("37060000")


@every_case("code", list(AbortCode))
def test_every_abort_code_of_a_server_raises_sdo_abort(code: AbortCode) -> None:
    abort = f"585#80416000{code.to_bytes(4, 'little').hex()}"
    for conversation in (upload(5, 0x6041), download(5, 0x6041, 0, b"\1")):
        with pytest.raises(SdoAbort) as caught:
            play(conversation, lambda frame, now: [(now, CanFrame.parse(abort))])
        assert caught.value.code == code
        assert (caught.value.index, caught.value.sub) == (0x6041, 0)


def test_other_frames_and_late_responses_are_counted_and_ignored() -> None:
    channel = Channel(5)
    script = Script(
        (
            "605#4041600000000000",
            "605#4041600000000000",  # the request itself, as some adapters echo it
            "586#4B41600001000000",  # another node
            "00000585#4B41600001000000",  # the same number, another identifier
            "585#R8",  # a remote frame
            "585#4B40600001000000",  # another object: late
            "585#4B41600101000000",  # another sub-index: late
            "585#6041600000000000",  # the end of an earlier write: late
            "585#A141600000000000",  # the end of an earlier block transfer: late
            "585#E141600000000000",  # no SDO response
            "585#4B4160",  # cut off
            "705#05",
            "585#4B4160003706",  # the response, shorter than 8 bytes
        )
    )
    assert play(upload(channel, 0x6041), script)[0] == bytes.fromhex("3706")
    heard = channel.counters
    assert (heard.frames, heard.late, heard.garbled, heard.short, heard.extended) == (12, 4, 2, 1, 1)
    assert heard.state is not None
    assert heard.state.name == "operational"


def test_the_response_about_another_object_is_not_taken() -> None:
    late = ("585#4301200701020304", "585#6001200000000000")
    script = Script(("605#4000210000000000", *late, "585#4300210005060708"))
    assert play(upload(5, 0x2100), script)[0] == bytes.fromhex("05060708")
    script = Script(("605#2F00210001000000", *late, "585#6000210000000000"))
    assert play(download(5, 0x2100, 0, b"\1"), script) == (None, 0.003)
    for conversation in (upload(5, 0x2100), download(5, 0x2100, 0, b"\1")):
        with pytest.raises(NoAnswer, match="2 responses to another request"):
            play(conversation, lambda frame, now: [(now, CanFrame.parse(text)) for text in late])


def no_answer(conversation: Conversation[CanFrame, object], *answers: str) -> tuple[str, list[str]]:
    """Return the text of the NoAnswer, and all frames sent."""
    sent: list[str] = []

    def peer(frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        sent.append(str(frame))
        return [(now, CanFrame.parse(answer)) for answer in answers] if len(sent) == 1 else []

    with pytest.raises(NoAnswer) as caught:
        play(conversation, peer)
    return str(caught.value), sent


def test_a_time_out_sends_an_abort_that_names_the_object() -> None:
    text, sent = no_answer(upload(5, 0x6041, 2, timeout=0.5))
    assert sent == ["605#4041600200000000", "605#8041600200000405"]
    assert text == ("node 5 did not answer the upload of 6041h:02 within 0.5 s: no frame was received on the bus")


def test_a_write_is_never_repeated() -> None:
    _, sent = no_answer(download(5, 0x6040, 0, b"\x0f\0"))
    assert sent == ["605#2B4060000F000000", "605#8040600000000405"]


def test_the_time_out_text_reports_a_stopped_node() -> None:
    text, _ = no_answer(upload(5, 0x6041), "705#04", "706#05")
    assert text.endswith(
        "1 from node 5, its heartbeat reports stopped, and a stopped node does not answer SDO, none on 585h"
    )


def test_the_time_out_text_reports_frames_of_other_nodes_only() -> None:
    text, _ = no_answer(upload(5, 0x6041), "706#05")
    assert text.endswith("received 1 frame, none from node 5, none on 585h")


def test_the_time_out_text_reports_what_came_instead() -> None:
    text, _ = no_answer(upload(5, 0x6041), "585#4B40600001000000", "585#FF", "00000585#4B41600001000000")
    assert text.endswith(
        "received 3 frames, 2 from node 5, 2 on 585h, 1 response to another request, 1 unreadable, "
        "1 extended frame 00000585h, which is another identifier"
    )


def busy_bus(conversation: Conversation[CanFrame, object], times: list[float]) -> None:
    """A bus with a frame of another node every millisecond, beyond the time-out. It records when frames were sent."""
    step, now = next(conversation), 0.0
    while now < 10.0:
        if not isinstance(step, Listen):
            times.append(now)
            step = conversation.send(Heard(None, now))
        else:
            now += 0.001
            step = conversation.send(Heard(CanFrame(0x186), now))


def test_a_bus_that_is_never_silent_does_not_extend_the_time_out() -> None:
    sent: list[float] = []
    with pytest.raises(NoAnswer, match="none from node 5"):
        busy_bus(upload(5, 0x6041, timeout=1.0), sent)
    assert sent == [pytest.approx(1.0, abs=0.002), pytest.approx(2.0, abs=0.002)]


@pytest.mark.parametrize(
    "stale",
    [["585#4341600099990000"], ["605#4041600000000000"], ["605#4041600000000000", "585#4341600099990000"]],
    ids=["responses", "requests", "both"],
)
def test_frames_that_wait_are_all_read_before_the_request_also_on_a_slow_computer(stale: list[str]) -> None:
    """Another client has read the same object again and again; each frame takes two milliseconds to be read."""
    conversation, now = upload(5, 0x6041, timeout=1.0), 9.0
    step = next(conversation)
    for number in range(300):
        assert isinstance(step, Listen)
        now += 0.002
        step = conversation.send(Heard(CanFrame.parse(stale[number % len(stale)]), now))
    while isinstance(step, Listen):  # a request of another client may still get its response
        now = max(now, step.until)
        step = conversation.send(Heard(None, now))
    assert step == Send(CanFrame.parse("605#4041600000000000"))
    conversation.send(Heard(None, now))
    with pytest.raises(StopIteration) as done:
        conversation.send(Heard(CanFrame.parse("585#4B41600037060000"), now + 0.01))
    assert done.value.value == bytes.fromhex("3706")


def test_after_a_time_out_the_channel_waits_for_late_responses() -> None:
    channel = Channel(5)
    with pytest.raises(NoAnswer):
        play(upload(channel, 0x6041, timeout=1.0), lambda frame, now: [])
    assert channel.quiet_until == 2.0
    conversation = upload(channel, 0x6041, timeout=1.0)
    assert next(conversation) == Listen(2.0)
    # The response to the first request arrives now, and is not mistaken for the response to the second.
    assert conversation.send(Heard(CanFrame.parse("585#4B41600099990000"), 1.5)) == Listen(2.0)
    assert conversation.send(Heard(None, 2.0)) == Send(CanFrame.parse("605#4041600000000000"))
    assert conversation.send(Heard(None, 2.0)) == Listen(3.0)
    with pytest.raises(StopIteration) as done:
        conversation.send(Heard(CanFrame.parse("585#4B41600037060000"), 2.1))
    assert done.value.value == bytes.fromhex("3706")
    assert channel.counters.late == 1
    assert channel.quiet_until is None


def test_a_channel_carries_one_transfer_at_a_time() -> None:
    channel = Channel(5)
    first, second = upload(channel, 0x6041), upload(channel, 0x6040)
    next(first)
    text = "6040h:00 must wait: the SDO channel to node 5 carries one transfer at a time"
    with pytest.raises(EncodeError, match=text):
        next(second)
    first.close()
    assert isinstance(next(upload(channel, 0x6040)), Listen)


def test_frames_received_before_the_request_are_not_the_response() -> None:
    """The same object is read repeatedly, and one response arrives twice."""
    channel = Channel(5)
    conversation = upload(channel, 0x6041)
    step = next(conversation)
    assert isinstance(step, Listen)
    assert step.until < 0.0
    conversation.send(Heard(CanFrame.parse("585#4B41600001000000"), 9.0))
    assert conversation.send(Heard(None, 9.0)) == Send(CanFrame.parse("605#4041600000000000"))
    conversation.send(Heard(None, 9.0))
    with pytest.raises(StopIteration) as done:
        conversation.send(Heard(CanFrame.parse("585#4B41600002000000"), 9.1))
    assert done.value.value == b"\2\0"
    assert channel.counters.late == 1


def test_counts_are_summed_up_over_transfers() -> None:
    channel = Channel(5)
    for _ in range(3):
        play(upload(channel, 0x6041), lambda frame, now: [(now, CanFrame.parse("585#4B4160003706"))])
    assert (channel.total.short, channel.counters.short) == (2, 1)


def test_an_abandoned_transfer_sends_an_abort() -> None:
    channel = Channel(5)
    conversation = upload(channel, 0x6041, timeout=1.0)
    next(conversation)
    assert isinstance(conversation.send(Heard(None, 0.0)), Send)
    conversation.send(Heard(None, 0.0))
    assert [str(frame) for frame in abort_frames(conversation)] == ["605#8041600000000008"]
    assert next(upload(channel, 0x6041)) == Listen(2.0)  # its response may still arrive


def test_a_transfer_abandoned_before_its_request_sends_nothing() -> None:
    channel = Channel(5)
    channel.quiet_until = 1.0
    conversation = upload(channel, 0x6041)
    assert next(conversation) == Listen(1.0)
    assert abort_frames(conversation) == []
    assert not channel.busy


def test_invalid_arguments_raise_at_once() -> None:
    with pytest.raises(EncodeError):
        upload(0, 0x6041)
    with pytest.raises(EncodeError):
        upload(5, 0x16041)
    with pytest.raises(EncodeError):
        upload(5, 0x6041, size=3, dialect=AZ3)
    with pytest.raises(EncodeError, match="sub"):
        download(5, 0x6041, 256, bytes(5))
    with pytest.raises(EncodeError, match="size"):
        download(5, 0x6041, 0, [], size=1 << 32)
    for block in (BlockSettings(size=0), BlockSettings(size=128), BlockSettings(switch=256)):
        with pytest.raises(EncodeError):
            upload(5, 0x6041, block=block)
    with pytest.raises(EncodeError, match="has the SDO dialect standard, not az3"):
        upload(Channel(5), 0x6041, dialect=AZ3)


# Another client on the channel

OTHER_READS = CanFrame.parse("605#4064600000000000")


def test_a_request_of_another_client_ends_the_transfer_without_an_abort() -> None:
    channel = Channel(5)
    conversation = upload(channel, 0x6041, timeout=1.0)
    steps = [next(conversation), conversation.send(Heard(None, 0.0)), conversation.send(Heard(None, 0.0))]
    assert steps[1:] == [Send(CanFrame.parse("605#4041600000000000")), Listen(1.0)]
    with pytest.raises(NoAnswer, match="another client sent 40 64 60 00 00 00 00 00 on 605h") as caught:
        conversation.send(Heard(OTHER_READS, 0.25))
    assert "whether the upload of 6041h:00 was carried out is unknown" in str(caught.value)
    assert (channel.counters.rivals, channel.quiet_until, channel.busy) == (1, 2.0, False)


@pytest.mark.parametrize("text", ["605#R8", "605#4064", "606#4064600000000000", "00000605#4064600000000000"])
def test_other_frames_are_not_requests_of_another_client(text: str) -> None:
    script = Script(("605#4041600000000000", text, "585#4B41600037060000"))
    assert play(upload(5, 0x6041), script)[0] == bytes.fromhex("3706")


def test_a_transfer_begins_after_the_response_to_another_client() -> None:
    conversation = upload(Channel(5), 0x6041, timeout=1.0)
    next(conversation)
    assert conversation.send(Heard(OTHER_READS, 0.0)) == Listen(1.0)
    response = Heard(CanFrame.parse("585#4364600000000000"), 0.5)
    step = conversation.send(response)
    assert isinstance(step, Listen)  # whether more frames wait
    assert step.until < 0.0
    assert conversation.send(Heard(None, 0.5)) == Send(CanFrame.parse("605#4041600000000000"))


@pytest.mark.parametrize("text", ["605#8064600000000405", "605#A100000000000000"])
def test_a_transfer_begins_at_once_after_the_last_frame_of_another_client(text: str) -> None:
    conversation = upload(Channel(5), 0x6041, timeout=1.0)
    next(conversation)
    conversation.send(Heard(CanFrame.parse(text), 0.0))
    assert conversation.send(Heard(None, 0.0)) == Send(CanFrame.parse("605#4041600000000000"))


def test_a_transfer_does_not_begin_while_another_client_sends_one_request_after_the_other() -> None:
    conversation = upload(Channel(5), 0x6041, timeout=1.0)
    next(conversation)
    steps = [conversation.send(Heard(OTHER_READS, tenth / 10)) for tenth in range(20)]
    assert all(isinstance(step, Listen) for step in steps)
    with pytest.raises(NoAnswer, match=r"the one to it: nothing was sent$"):
        conversation.send(Heard(OTHER_READS, 2.0))


def test_an_adapter_that_returns_what_it_sends_is_no_other_client() -> None:
    channel = Channel(5)
    request, response = CanFrame.parse("605#4041600000000000"), CanFrame.parse("585#4B41600037060000")
    for _ in range(2):
        assert play(upload(channel, 0x6041), lambda frame, now: [(now, frame), (now, response)])[1] == 0.0
    assert channel.own_frames is None
    play(upload(channel, 0x6041), lambda frame, now: [(now, response)])
    assert channel.own_frames is False  # a response came, and the request did not
    with pytest.raises(NoAnswer, match="another client"):
        play(upload(channel, 0x6041), lambda frame, now: [(now, request), (now, response)])


def test_a_transfer_that_ends_early_leaves_its_response_as_much_time_as_one_that_times_out() -> None:
    """The abort is a late one of the transfer before. The request may be late too, and so may its confirmation."""
    channel = Channel(5)
    conversation = download(channel, 0x6040, 0, b"\x0f\0", timeout=1.0)
    for heard in (None, Heard(None, 0.0), Heard(None, 0.0)):
        conversation.send(heard) if heard else next(conversation)
    with pytest.raises(SdoAbort, match="timed out"):
        conversation.send(Heard(CanFrame.parse("585#8040600000000405"), 0.1))
    assert channel.quiet_until == 2.0


def test_an_abort_is_not_the_response_to_the_other_client_that_ends_the_wait() -> None:
    """Its frame before the request may be the one that the server did not understand."""
    conversation = upload(Channel(5), 0x6041, timeout=1.0)
    next(conversation)
    conversation.send(Heard(CanFrame.parse("605#A100000000000000"), 0.0))
    conversation.send(Heard(OTHER_READS, 0.0))
    assert conversation.send(Heard(CanFrame.parse("585#8000000001000405"), 0.0)) == Listen(1.0)
