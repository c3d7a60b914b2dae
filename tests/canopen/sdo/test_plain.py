"""A plain exchange has the results, errors, frames, times and counters of the conversation of its transfer.

Both run in virtual time against the same peer, transfer after transfer, and everything visible is compared after each.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, strategies as st

from barewire.canopen import CanFrame, Channel, Entry, ObjectDictionary, SdoDialect, download, read_object, upload
from barewire.canopen.nmt.node_monitor import NodeMonitor
from barewire.canopen.sdo.plain import NOT_PLAIN, PlainDownload, PlainExchange, PlainUpload, plain_read
from barewire.conversation import Abandoned, Conversation, Heard, Listen
from barewire.errors import BarewireError, EncodeError
from tests.canopen.sdo.sdo_bus import plainly
from tests.helpers import every_case, modest

TIMEOUT = 1.0
INDEX, OTHER = 0x6041, 0x6042
OBJECTS = ObjectDictionary([Entry(INDEX, 0, "state", "u16"), Entry(OTHER, 0, "on", "bool")])
Make = Callable[[Channel, str, int], Conversation[CanFrame, Any]]

KINDS = {
    "good": ("4B {} 37 06 00 00", "60 {} 00 00 00 00"),
    "of four bytes": ("43 {} 01 02 03 04", "60 {} 01 02 03 04"),
    "unsized": ("42 {} 01 02 03 04", "60 {} 00 00 00 00"),
    "reserved bits": ("5B {} 37 06 00 00", "70 {} 00 00 00 00"),
    "short": ("4B {} 37 06", "60 {}"),
    "too short": ("4B {} 37", "60 41"),
    "segmented": ("41 {} 10 00 00 00", "20 00 00 00 00 00 00 00"),
    "a segment": ("0B 32 33 00 00 00 00 00", "30 00 00 00 00 00 00 00"),
    "abort": ("80 {} 00 00 02 06", "80 {} 30 00 09 06"),
    "abort without object": ("80 00 00 00 00 00 02 06", "80 00 00 00 00 00 02 06"),
    "out of step": ("80 {} 01 00 04 05", "80 00 00 00 01 00 04 05"),
    "empty": ("", ""),
    "unknown": ("E0 {} 00 00 00 00", "E0 {} 00 00 00 00"),
    "the other's": ("60 {} 00 00 00 00", "4B {} 37 06 00 00"),
}
WRAPPED = ("of another object", "extended", "remote", "a request", "a heartbeat", "interrupt", "nothing")
ITEM = st.tuples(st.sampled_from([*KINDS, *WRAPPED, "good", "good"]), st.sampled_from([0.0, 0.25, 0.5, 1.0]))
STEP = st.tuples(
    st.sampled_from(["upload", "download", "read"]),
    st.sampled_from([INDEX, INDEX, OTHER]),
    st.lists(ITEM, max_size=3) | st.just([("good", 0.25)]),
    st.sampled_from([0.0, 0.0, 5.0]),
)


class Peer:
    """What the port of a client receives, in virtual time: scripts relative to the request."""

    def __init__(self) -> None:
        self.now = 100.0
        self.sent: list[tuple[float, CanFrame]] = []
        self.coming: list[tuple[float, CanFrame | None]] = []  # None: the user interrupts
        self.script: list[tuple[str, float]] = []
        self.monitor = NodeMonitor()

    def answer(self, request: CanFrame) -> None:
        self.sent.append((self.now, request))
        at, script, self.script = self.now, self.script, []
        for kind, pause in script:
            at += pause
            if kind != "nothing":
                self.coming.append((at, self.item(kind, request.data)))
        self.coming.sort(key=lambda pair: pair[0])

    def item(self, kind: str, request: bytes) -> CanFrame | None:
        if kind == "interrupt":
            return None
        if kind == "a request":
            return CanFrame(0x605, bytes.fromhex("4008100000000000"))
        if kind == "a heartbeat":
            return CanFrame(0x705, b"\x05")
        named = OTHER.to_bytes(2, "little") + b"\1" if kind == "of another object" else request[1:4]
        text = KINDS.get(kind, KINDS["good"])[request[0] >> 5 == 1]
        data = bytes.fromhex(text.format(named.hex()))
        return CanFrame(0x585, b"" if kind == "remote" else data, kind == "extended", kind == "remote")

    def receive(self, until: float) -> CanFrame | None:
        """Return the next frame of the channel, as a bus delivers it; the node monitor gets all."""
        while self.coming and self.coming[0][0] <= max(until, self.now):
            at, frame = self.coming.pop(0)
            self.now = max(self.now, at)
            if frame is None:
                raise Abandoned("interrupted")
            self.monitor.feed(frame, self.now)
            if frame.key in ((0x585, False), (0x605, False)):
                return frame
        self.now = max(self.now, until)
        return None

    def run(self, conversation: Conversation[CanFrame, Any]) -> Any:
        try:
            step = next(conversation)
            while True:
                item = None
                try:
                    if isinstance(step, Listen):
                        item = self.receive(step.until)
                    else:
                        for frame in step.items:
                            self.answer(frame)
                except Abandoned as error:
                    step = conversation.throw(error)
                else:
                    step = conversation.send(Heard(item, self.now))
        except StopIteration as stop:
            return stop.value
        except BarewireError as error:
            return type(error), str(error), getattr(error, "code", None)


def by_conversation(channel: Channel, verb: str, index: int) -> Conversation[CanFrame, Any]:
    if verb == "upload":
        return upload(channel, index, timeout=TIMEOUT)
    if verb == "read":
        return read_object(channel, OBJECTS, index, timeout=TIMEOUT)
    return download(channel, index, 0, b"\x0f\x00", timeout=TIMEOUT)


def by_exchange(channel: Channel, verb: str, index: int) -> Conversation[CanFrame, Any]:
    if verb == "upload":
        return plainly(PlainUpload(channel, index, 0, TIMEOUT, None, 1 << 24, bytes))
    if verb == "read":
        return plainly(plain_read(channel, OBJECTS.at(index), TIMEOUT))
    return plainly(PlainDownload(channel, index, 0, TIMEOUT, b"\x0f\x00"))


def visible(make: Make, steps: list[Any], own_frames: bool | None, monitored: bool) -> list[Any]:
    peer = Peer()
    channel = Channel(5, node_monitor=peer.monitor if monitored else None, own_frames=own_frames)
    found = []
    for verb, index, script, pause in steps:
        peer.script = script
        result = peer.run(make(channel, verb, index))
        state = (
            channel.quiet_until,
            channel.quiet_for,
            channel.abandoned,
            channel.busy,
            channel.own_frames,
            channel.sent,
        )
        found.append((result, peer.now, list(peer.sent), repr(channel.counters), repr(channel.total), state))
        peer.now += pause
    return found


@modest
@given(st.lists(STEP, min_size=1, max_size=5), st.sampled_from([False, False, None, True]), st.booleans())
def test_a_plain_exchange_does_what_its_conversation_does(
    steps: list[Any], own_frames: bool | None, monitored: bool
) -> None:
    assert visible(by_exchange, steps, own_frames, monitored) == visible(by_conversation, steps, own_frames, monitored)


@every_case("verb", ["upload", "download", "read"])
@every_case("first", [*KINDS, *WRAPPED])
def test_after_every_pair_of_frames_both_are_in_the_same_state(first: str, verb: str) -> None:
    for second in (*KINDS, *WRAPPED):
        steps = [(verb, INDEX, [(first, 0.25), (second, 0.25)], 0.0), ("upload", INDEX, [("good", 0.25)], 0.0)]
        assert visible(by_exchange, steps, False, True) == visible(by_conversation, steps, False, True), second


def test_a_frame_that_waits_before_the_request_is_explained_by_both() -> None:
    twice = [("good", 0.0), ("good", 0.0)]
    steps = [("upload", INDEX, script, 0.0) for script in ([("good", 0.25)], twice, [])]
    assert visible(by_exchange, steps, False, True) == visible(by_conversation, steps, False, True)


@pytest.mark.parametrize("data", [b"\1", b"\1\2", b"\1\2\3", b"\1\2\3\4"])
def test_the_request_is_that_of_the_conversation(data: bytes) -> None:
    for plain, conversation in (
        (PlainDownload(Channel(5, own_frames=False), 0x6040, 7, 1.0, data), download(5, 0x6040, 7, data)),
        (PlainUpload(Channel(5, own_frames=False), 0x6040, 7, 1.0, None, None, bytes), upload(5, 0x6040, 7)),
    ):
        next(conversation)
        (sent,) = conversation.send(Heard(None, 1.0))
        assert plain.begin() == sent


@pytest.mark.parametrize(
    ("data", "value"),
    [("4F", "01"), ("4B", "0102"), ("47", "010203"), ("43", "01020304")],
)
def test_a_value_has_as_many_bytes_as_its_response_says(data: str, value: str) -> None:
    plain = PlainUpload(Channel(5, own_frames=False), INDEX, 0, 1.0, None, None, bytes)
    plain.begin()
    response = bytes.fromhex(data + "416000 01020304")
    assert plain.answer_in(CanFrame(0x585, response, True)) is NOT_PLAIN
    assert plain.answer_in(CanFrame(0x585, response)) == bytes.fromhex(value)


SIZED = SdoDialect("sized", ((2, 0x4B), (4, 0x43)))
UPLOAD: dict[str, Any] = {"index": INDEX, "sub": 0, "timeout": 1.0, "size": None, "limit": None, "decode": bytes}


@pytest.mark.parametrize("changed", [{"timeout": 0.0}, {"limit": 3}, {"index": -1}, {"index": 0x10000}, {"sub": 256}])
def test_arguments_that_need_more_than_an_exchange_begin_none(changed: dict[str, Any]) -> None:
    channel = Channel(5, own_frames=False)
    assert PlainUpload(channel, **(UPLOAD | changed)).begin() is None
    assert not channel.busy


def test_a_channel_on_which_something_may_come_begins_no_exchange() -> None:
    monitor = NodeMonitor()
    for channel in (
        Channel(5, SIZED, own_frames=False),
        Channel(5),
        Channel(5, own_frames=False, node_monitor=monitor),
    ):
        monitor.feed(CanFrame(0x605, bytes.fromhex("4008100000000000")), 1.0)
        plain: PlainExchange[Any] = PlainUpload(channel, **UPLOAD)
        assert plain.begin() is None
    channel = Channel(5, own_frames=False)
    channel.be_quiet(5.0, None, None)
    assert PlainUpload(channel, **UPLOAD).begin() is None


def test_a_channel_that_is_busy_refuses_the_conversation_too() -> None:
    channel = Channel(5, own_frames=False)
    first, second = PlainUpload(channel, **UPLOAD), PlainUpload(channel, **UPLOAD)
    assert first.begin()
    assert second.begin() is None
    with pytest.raises(EncodeError, match="one transfer at a time"):
        next(second.whole())
    first.cancel()
    assert second.begin()


def test_an_exchange_counts_its_response_and_ends() -> None:
    channel = Channel(5, own_frames=False)
    for number in range(1, 4):
        plain = PlainUpload(channel, **UPLOAD)
        plain.begin()
        assert plain.answer_in(CanFrame(0x585, bytes.fromhex("4B416000 37060000"))) == b"\x37\x06"
        assert (channel.counters.responses, channel.total.responses, channel.busy) == (1, number - 1, False)
    assert repr(plain) == "<PlainUpload of 6041h:00, node 5>"
