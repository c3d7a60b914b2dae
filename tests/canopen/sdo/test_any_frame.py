"""Arbitrary frames in the middle of each transfer: no exception, bounded memory, and the next transfer works."""

from __future__ import annotations

from contextlib import suppress

import pytest
from hypothesis import given, strategies as st

from barewire.canopen import BlockSettings, CanFrame, Channel, SdoAbort, SdoServer, download, upload
from barewire.conversation import Heard, Listen
from barewire.errors import NoAnswer
from tests.canopen.sdo.sdo_bus import Store
from tests.helpers import modest

BEGINNINGS = {
    "idle": [],
    "segmented upload": ["4001210000000000"],
    "segmented download": ["2100210030000000"],
    "block upload": ["A401210004000000", "A300000000000000"],
    "block upload at its end": ["A401210004000000", "A300000000000000", "A203040000000000"],
    "block download": ["C600210030000000", "0100000000000000"],
    "block download at its end": ["C600210005000000", "8100000000000000"],
}
COMMANDS = st.one_of(st.integers(0, 255), st.sampled_from([0x80, 0x81, 0xA1, 0xA2, 0xA3, 0xA4, 0xC1, 0xC6, 0x60]))
DATA = st.one_of(
    st.binary(max_size=8),
    st.builds(lambda command, rest: bytes([command]) + rest, COMMANDS, st.binary(min_size=7, max_size=7)),
    st.builds(
        lambda command, place, rest: bytes([command]) + place + rest,
        COMMANDS,
        st.sampled_from([b"\x00\x21\0", b"\x01\x21\0", b"\3\4\0", b"\0\4\0"]),
        st.binary(min_size=4, max_size=4),
    ),
)
FRAMES_AND_PAUSES = st.lists(st.tuples(DATA, st.floats(0, 0.6)), max_size=30)


@pytest.mark.parametrize("beginning", BEGINNINGS)
@modest
@given(FRAMES_AND_PAUSES)
def test_the_server_survives_any_frames(beginning: str, frames: list[tuple[bytes, float]]) -> None:
    store = Store()
    store.objects[0x2101, 0] = bytes(20)
    server = SdoServer(5, store, limit=100, blksize=4)
    for text in BEGINNINGS[beginning]:
        server.feed(CanFrame(0x605, bytes.fromhex(text)), 0.0)
    now = 0.0
    for data, pause in frames:
        now += pause
        responses = server.feed(CanFrame(0x605, data), now) + server.feed(None, now)
        assert all(frame.id == 0x585 and len(frame.data) == 8 for frame in responses)
        assert len(responses) <= 10
        assert all(len(value) <= 100 for value in store.objects.values())
    for _ in range(40):
        if server.deadline is None:
            break
        now = max(now, server.deadline)
        server.feed(None, now)
    assert server.deadline is None
    (answer,) = server.feed(CanFrame.parse("605#4003210000000000"), now + 5.0)
    assert answer.data.hex() == "8003210000000206"


@pytest.mark.parametrize("downloads", [False, True])
@pytest.mark.parametrize("block", [False, BlockSettings(size=4)])
@modest
@given(FRAMES_AND_PAUSES, st.integers(0, 8))
def test_the_client_survives_any_frames(
    block: bool | BlockSettings, downloads: bool, frames: list[tuple[bytes, float]], good: int
) -> None:
    """Run `good` requests with a real server, then arbitrary frames."""
    store = Store()
    store.objects[0x2101, 0] = bytes(50)
    server = SdoServer(5, store, blksize=4)
    channel = Channel(5)
    how = {"block": block, "timeout": 0.5}
    conversation = (
        download(channel, 0x2101, 0, bytes(50), **how)  # type: ignore[arg-type]
        if downloads
        else upload(channel, 0x2101, limit=100, **how)  # type: ignore[arg-type]
    )
    coming = [(CanFrame(0x585, data), pause) for data, pause in frames]
    waiting: list[CanFrame] = []
    step, now = next(conversation), 0.0
    with suppress(SdoAbort, NoAnswer, StopIteration):
        for _ in range(1000):
            frame = None
            if not isinstance(step, Listen):
                if good:
                    good -= 1
                    for item in step.items:
                        waiting += server.feed(item, now)
            elif waiting:
                frame = waiting.pop(0)
            elif coming and not good:
                frame, pause = coming.pop(0)
                now += pause
            else:
                now = max(now, step.until)
            step = conversation.send(Heard(frame, now))
        raise AssertionError("the transfer did not end after 1000 steps")
    assert not channel.busy
