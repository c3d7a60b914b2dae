"""Arbitrary frames: machines raise nothing and do not grow, decoders raise DecodeError, nodes send their own frames."""

from __future__ import annotations

from contextlib import suppress

from hypothesis import given, settings, strategies as st

from barewire.canopen import (
    CanFrame,
    Channel,
    EmcyConsumer,
    Emergency,
    Entry,
    Fastscan,
    Guard,
    GuardedNode,
    GuardingMaster,
    HeartbeatConsumer,
    LocalNode,
    LssAddress,
    LssMessage,
    LssSlave,
    NmtCommand,
    NmtMessage,
    NmtSlave,
    NodeState,
    ObjectDictionary,
    PdoConfig,
    SyncMessage,
    SyncMonitor,
    TimeConsumer,
    TimeStamp,
    assign_node_ids,
    classify,
    fastscan,
    read_pdo,
    scan,
    send_nmt,
    standard_objects,
    upload,
    write_pdo,
)
from barewire.canopen.abort_codes import SdoAbort
from barewire.canopen.sdo import decode_sdo_request, decode_sdo_response
from barewire.conversation import Conversation, Heard, Listen
from barewire.devices.sdo_dialects import AZ3
from barewire.errors import BarewireError, DecodeError, NoAnswer

# Mostly identifiers in use, so that the frames reach the services.
IDENTIFIERS = st.one_of(
    st.sampled_from([0, 0x80, 0x81, 0x85, 0x100, 0x185, 0x205, 0x585, 0x605, 0x702, 0x705, 0x7E4, 0x7E5]),
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
SDO_FRAMES = st.builds(
    CanFrame, IDENTIFIERS, DATA, st.sampled_from([False, False, False, True]), st.sampled_from([False, False, True])
)


def az3_device() -> LocalNode:
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


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(SDO_FRAMES, st.floats(0, 0.5)), max_size=40))
def test_a_device_and_nmt_machines_accept_sdo_frames(frames: list[tuple[CanFrame, float]]) -> None:
    node, slave, consumer = az3_device(), NmtSlave(5), HeartbeatConsumer({5: 0.3})
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


@settings(max_examples=60, deadline=None)
@given(SDO_FRAMES)
def test_decoders_raise_nothing_but_decode_error(frame: CanFrame) -> None:
    for decode in (NmtMessage.decode, NodeState.decode, SyncMessage.decode, Emergency.decode):
        with suppress(DecodeError):
            decode(frame)
    for read in (decode_sdo_request, decode_sdo_response):
        with suppress(DecodeError):
            read(frame.data)


@settings(max_examples=60, deadline=None)
@given(st.lists(SDO_FRAMES, max_size=40))
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


# All services

INDICES = [0x1003, 0x1005, 0x1006, 0x1007, 0x100C, 0x100D, 0x1012, 0x1014, 0x1015, 0x1016, 0x1017, 0x1019, 0x1029,
          0x1400, 0x1600, 0x1800, 0x1A00]  # fmt: skip
WRITES = st.builds(
    lambda command, index, sub, value: bytes([command]) + index.to_bytes(2, "little") + bytes([sub]) + value,
    st.sampled_from([0x23, 0x2B, 0x2F, 0x40]),
    st.sampled_from(INDICES),
    st.integers(0, 6),
    st.one_of(st.binary(min_size=4, max_size=4), st.sampled_from([b"\1\0\0\0", b"\x80\0\0\x40", b"\x64\0\2\0"])),
)
LSS = st.builds(
    lambda service, body: bytes([service]) + body,
    st.sampled_from([0x04, 0x11, 0x13, 0x15, 0x17, *range(0x40, 0x52), *range(0x5A, 0x5F)]),
    st.one_of(st.binary(min_size=7, max_size=7), st.sampled_from([b"\1" + bytes(6), bytes(7), b"\5" + bytes(6)])),
)
FRAMES = st.one_of(
    st.builds(
        CanFrame,
        IDENTIFIERS,
        st.binary(max_size=8),
        st.sampled_from([False, False, True]),
        st.just(False),
        requested=st.just(0),  # only remote frames request bytes; hypothesis would otherwise invent numbers
    ),
    st.builds(lambda id, extended: CanFrame(id, b"", extended, True, 1), IDENTIFIERS, st.booleans()),
    st.builds(lambda data: CanFrame(0x605, data), WRITES),
    st.builds(lambda data: CanFrame(0x7E5, data), LSS),
    st.builds(lambda command: CanFrame(0, bytes([command, 5])), st.sampled_from(list(NmtCommand))),
)
TIMED_FRAMES = st.lists(st.tuples(FRAMES, st.floats(0, 0.5)), max_size=40)


def local_node(node: int | None) -> LocalNode:
    objects = [
        *standard_objects(LssAddress(0, 0, 0, 1)),
        Entry(0x6040, 0, "controlword", "u16", "rw", 0),
        Entry(0x6041, 0, "statusword", "u16", "ro", 0),
    ]
    pdos = [
        PdoConfig("RPDO", 1, (0x60400010,), event_timer=100),
        PdoConfig("TPDO", 1, (0x60410010, 0x60400010), type=1),
    ]
    return LocalNode(node, ObjectDictionary(objects), pdos, lss=LssSlave(LssAddress(0, 0, 0, 1), store=lambda *_: True))


@settings(max_examples=100, deadline=None)
@given(TIMED_FRAMES, st.sampled_from([5, None]))
def test_a_local_node_sends_only_frames_of_its_own(
    timed_frames: list[tuple[CanFrame, float]], node: int | None
) -> None:
    device = local_node(node)
    device.start(0.0)
    now = 0.0
    for frame, pause in timed_frames:
        now += pause
        sent = device.feed(frame, now)
        for answer in sent:
            # PDOs, SYNC and EMCY may have other identifiers by now; all other services are those of this node.
            owner = classify(answer)
            assert len(answer.data) <= 8
            assert not answer.remote
            if device.node is None and frame.id != 0:
                assert answer.key == (0x7E4, False), (frame, answer)
            elif owner is not None and owner[0].name in ("error control", "SDO answer"):
                assert owner[1] == device.node
        due = device.deadline
        if due is not None and due <= now:
            device.feed(None, now)
            assert device.deadline is None or device.deadline > now or device.deadline >= due
    assert len(device.errors.history) <= 8


@settings(max_examples=60, deadline=None)
@given(TIMED_FRAMES)
def test_other_machines_accept_any_frames(timed_frames: list[tuple[CanFrame, float]]) -> None:
    emergencies, guarded, slave = EmcyConsumer(history=10), GuardedNode(5), LssSlave(LssAddress(0, 0, 0, 0))
    machines = [emergencies, guarded, slave, GuardingMaster({5: Guard(0.3)}, 0.0), SyncMonitor(0.1), TimeConsumer()]
    now = 0.0
    for frame, pause in timed_frames:
        now += pause
        for machine in machines:
            machine.feed(frame, now)  # type: ignore[attr-defined]
            machine.feed(None, now)  # type: ignore[attr-defined]
    assert len(emergencies.history) <= 10


@settings(max_examples=100, deadline=None)
@given(FRAMES)
def test_decoded_messages_encode_to_the_same_frame(frame: CanFrame) -> None:
    with suppress(DecodeError):
        assert TimeStamp.decode(frame).encode().key == frame.key
    with suppress(DecodeError):
        assert LssMessage.decode(frame).encode() == frame
    with suppress(DecodeError):
        Fastscan.of_body(frame.data)


CONVERSATIONS = st.sampled_from(
    [
        lambda: scan([5, 6], timeout=0.1),
        lambda: fastscan(timeout=0.1),
        lambda: assign_node_ids([5], timeout=0.1),
        lambda: send_nmt(NmtCommand.START, 5, ask_every=0.1, timeout=0.5),
        lambda: read_pdo(5, "TPDO", 1, timeout=0.1),
        lambda: write_pdo(5, PdoConfig("TPDO", 1, (0x60410010,)), timeout=0.1),
    ]
)


@settings(max_examples=100, deadline=None)
@given(CONVERSATIONS, st.lists(st.tuples(FRAMES, st.floats(0, 0.05)), max_size=60))
def test_conversations_end_whatever_arrives(make: object, timed_frames: list[tuple[CanFrame, float]]) -> None:
    conversation: Conversation[CanFrame, object] = make()  # type: ignore[operator]
    coming = iter(timed_frames)
    now, turns = 0.0, 0
    with suppress(StopIteration, SdoAbort, BarewireError):
        step = next(conversation)
        while turns < 5000:
            turns += 1
            if not isinstance(step, Listen):
                step = conversation.send(Heard(None, now))
                continue
            frame, pause = next(coming, (None, 0.0))
            now = now + pause if frame is not None else max(now, step.until)
            step = conversation.send(Heard(frame, now))
    assert turns < 5000
