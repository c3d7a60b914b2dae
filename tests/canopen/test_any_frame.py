"""Arbitrary frames: machines raise nothing and do not grow, decoders raise DecodeError only."""

from __future__ import annotations

from contextlib import suppress

from hypothesis import given, settings, strategies as st

from barewire.canopen import (
    CanFrame,
    Channel,
    Emergency,
    Entry,
    HeartbeatConsumer,
    LocalNode,
    NmtMessage,
    NmtSlave,
    NodeState,
    ObjectDictionary,
    PdoConfig,
    SdoAbort,
    SyncMessage,
    upload,
)
from barewire.canopen.sdo import decode_sdo_request, decode_sdo_response
from barewire.conversation import Heard, Listen
from barewire.devices.sdo_dialects import AZ3
from barewire.errors import DecodeError, NoAnswer

# Mostly identifiers in use, so that the frames reach the services.
IDENTIFIERS = st.one_of(
    st.sampled_from([0, 0x80, 0x85, 0x185, 0x205, 0x305, 0x585, 0x605, 0x705]),
    st.integers(0, 0x7FF),
    st.integers(0, 0x1FFFFFFF),
)
COMMANDS = st.sampled_from([0x01, 0x02, 0x22, 0x23, 0x2B, 0x2F, 0x40, 0x43, 0x60, 0x80, 0x81, 0x82])
DATA = st.one_of(
    st.binary(max_size=8),
    st.builds(lambda command, rest: bytes([command]) + rest, COMMANDS, st.binary(min_size=7, max_size=7)),
    st.builds(
        lambda command, address, rest: bytes([command]) + address + rest,
        COMMANDS,
        st.sampled_from([b"\x00\x14\1", b"\x00\x16\0", b"\x00\x16\1", b"\x00\x18\2", b"\x17\x10\0", b"\x40\x60\0"]),
        st.binary(min_size=4, max_size=4),
    ),
    st.sampled_from([b"\1\5", b"\x80\5", b"\x82\5"]),
)
FRAMES = st.builds(
    CanFrame, IDENTIFIERS, DATA, st.sampled_from([False, False, False, True]), st.sampled_from([False, False, True])
)


def device() -> LocalNode:
    objects = ObjectDictionary(
        [
            Entry(0x1017, 0, "heartbeat time", "u16", "rw", 100),
            Entry(0x6040, 0, "controlword", "u16", "rw", 0),
            Entry(0x6041, 0, "statusword", "u16", "ro", 0),
        ]
    )
    return LocalNode(
        5, objects, [PdoConfig("RPDO", 1, (0x60400010,)), PdoConfig("TPDO", 1, (0x60410010, 0x60400010))], dialect=AZ3
    )


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(FRAMES, st.floats(0, 0.5)), max_size=40))
def test_machines_accept_any_frames(frames: list[tuple[CanFrame, float]]) -> None:
    node, slave, consumer = device(), NmtSlave(5), HeartbeatConsumer({5: 0.3})
    slave.booted()
    node.start(0.0)
    now = 0.0
    for frame, pause in frames:
        now += pause
        for machine in (node, slave, consumer):
            machine.feed(frame, now)
        sent = node.feed(None, now)
        assert all(len(answer.data) <= 8 for answer in sent)
        due = node.deadline
        assert due is None or due > now or not node.feed(None, now)
    assert len(node.objects.subs(0x1600)) == 9


@settings(max_examples=200, deadline=None)
@given(FRAMES)
def test_decoders_raise_nothing_but_decode_error(frame: CanFrame) -> None:
    for decode in (NmtMessage.decode, NodeState.decode, SyncMessage.decode, Emergency.decode):
        with suppress(DecodeError):
            decode(frame)
    for read in (decode_sdo_request, decode_sdo_response):
        with suppress(DecodeError):
            read(frame.data)


@settings(max_examples=200, deadline=None)
@given(st.lists(FRAMES, max_size=40))
def test_an_upload_ends_with_a_value_or_an_error_of_barewire(frames: list[CanFrame]) -> None:
    conversation = upload(Channel(5), 0x6041)
    coming = iter(frames)
    step, now, turns = next(conversation), 0.0, 0
    with suppress(SdoAbort, NoAnswer, DecodeError, StopIteration):
        while turns < len(frames) + 10:
            turns += 1
            frame = next(coming, None) if isinstance(step, Listen) else None
            now += 1.0 if frame is None and isinstance(step, Listen) else 0.001
            step = conversation.send(Heard(frame, now))
    assert turns < len(frames) + 10
