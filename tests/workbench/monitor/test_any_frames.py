"""Any frames: no exception, bounded memory, and every event as a printable line and as JSON."""

from __future__ import annotations

import json
from binascii import crc_hqx

import pytest
from hypothesis import given, settings, strategies as st

from barewire.canopen import CanFrame, ErrorFrame, FdFrame
from barewire.canopen.frame import AnyFrame
from barewire.devices import load
from barewire.errors import DecodeError
from barewire_workbench.monitor import BUS_RULES, CanMonitor, event_as_dict, event_line, of_device, sdo_transfer
from barewire_workbench.monitor.events import MonitorEvent, SdoTransferReport, Violation
from barewire_workbench.monitor.recording import is_can_recording, read_recording, replay_can
from barewire_workbench.monitor.sdo_transfer import HELD_MAX, VALUE_MAX
from barewire_workbench.recordings.model import Dropped
from tests.helpers import part_or_whole
from tests.workbench.monitor.recorded_run import of

many = settings(max_examples=100, deadline=None, derandomize=True, database=None)

KNOWN = [of_device(load("az3"), 5)]
SERVICES = [0x000, 0x080, 0x085, 0x100, 0x185, 0x205, 0x285, 0x485, 0x585, 0x605, 0x705, 0x7E4, 0x7E5, 0x690, 0x6E5]
COMMANDS = [*range(0, 0x20), 0x20, 0x21, 0x23, 0x2F, 0x30, 0x40, 0x41, 0x43, 0x4F, 0x60, 0x70, 0x80, 0x81, 0x82, 0x83,
            0xA0, 0xA1, 0xA2, 0xA3, 0xA4, 0xC0, 0xC1, 0xC2, 0xC4, 0xC6, 0xD1, 0xFF]  # fmt: skip

PLACES = st.sampled_from([b"\x41\x60\x00", b"\x00\x1a\x00", b"\x00\x1a\x01", b"\x00\x18\x01", b"\x17\x10\x00"])
SDO = st.builds(
    lambda from_client, command, place, rest: CanFrame(
        0x605 if from_client else 0x585, bytes([command]) + place + rest
    ),
    *(st.booleans(), st.sampled_from(COMMANDS), PLACES, st.binary(min_size=4, max_size=4)),
)
SMALL = st.builds(
    lambda from_client, data: CanFrame(0x605 if from_client else 0x585, bytes(data)),
    *(st.booleans(), st.lists(st.integers(0, 7), min_size=1, max_size=8)),
)
CLASSICAL = st.builds(lambda number, data: CanFrame(number, data), st.sampled_from(SERVICES), st.binary(max_size=8))
REMOTE = st.builds(
    lambda number, size: CanFrame(number, b"", False, True, size), st.sampled_from(SERVICES), st.integers(0, 8)
)
ODD = st.one_of(
    st.builds(CanFrame, st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.just(True)),
    st.builds(FdFrame, st.integers(0, 0x7FF), st.binary(max_size=64)),
    st.builds(ErrorFrame, st.integers(0, 0x1FFFFFFF), st.binary(max_size=8)),
    st.builds(Dropped, st.just(0.0), st.just("can0"), st.integers(0, 9)),
)
ITEMS: st.SearchStrategy[AnyFrame | Dropped | None] = st.one_of(SDO, SDO, SMALL, CLASSICAL, REMOTE, ODD, st.none())
STEPS = st.sampled_from([0.0, 0.0001, 0.01, 0.5, 1.0, 4.0, -0.5, -20.0])


def check_events(events: list[MonitorEvent]) -> None:
    for event in events:
        line = event_line(event)
        assert line.isprintable(), line
        assert json.loads(json.dumps(event_as_dict(event), allow_nan=False))
        if isinstance(event, Violation):
            assert event.rule in BUS_RULES
        if (
            isinstance(event, SdoTransferReport)
            and event.outcome == "done"
            and event.size is not None
            and event.missing
        ):
            assert event.data is None or len(event.data) <= event.size or event.manner != "block"


@many
@given(st.lists(st.tuples(ITEMS, STEPS), max_size=60))
def test_any_frames_give_printable_events(frames: list[tuple[AnyFrame | Dropped | None, float]]) -> None:
    monitor, now = CanMonitor(KNOWN), 100.0
    for item, step in frames:
        now += step
        check_events(monitor.feed(item, now))
        if isinstance(item, CanFrame):
            monitor.takes_segment(item)
        if step >= 0:
            assert monitor.deadline is None or monitor.deadline > now - 21
    check_events(monitor.end(now))
    assert monitor.held.used == 0


@many
@given(st.lists(st.integers(0, 2**32 - 1), max_size=40), st.booleans())
def test_passing_time_ends_all_deadlines(words: list[int], far: bool) -> None:
    """Feeding None at each deadline ends after finitely many deadlines."""
    monitor = CanMonitor(KNOWN)
    for place, word in enumerate(words):
        data = word.to_bytes(4, "little") * 2
        monitor.feed(CanFrame(SERVICES[word % len(SERVICES)], data[: word % 9]), place * (1.0 if far else 0.001))
    for _ in range(400):
        due = monitor.deadline
        if due is None:
            return
        check_events(monitor.feed(None, due))
    raise AssertionError("the deadlines do not end")


@pytest.mark.long
def test_nothing_grows_without_a_bound() -> None:
    """All identifiers, all nodes, all objects of the mapping: memory stays bounded, and refused bytes are counted."""
    monitor = CanMonitor(held=25_000)
    for number in range(0x800):
        monitor.feed(CanFrame(number, bytes([number & 0xFF] * 8)), number / 1000)
    for place in range(3000):
        index = 0x1A00 + place % 512
        node = 1 + place % 127
        monitor.feed(CanFrame(0x600 + node, b"\x23" + index.to_bytes(2, "little") + b"\x01\x10\0\x41\x60"), 3.0)
        monitor.feed(CanFrame(0x580 + node, b"\x60" + index.to_bytes(2, "little") + b"\x01" + bytes(4)), 3.0)
    for number in range(20_000):
        monitor.feed(CanFrame(0x10000 + number, b"", True), 4.0)
    assert len(monitor.pdos._records) <= 1024
    assert len(monitor.pdos._last) <= 512
    assert len(monitor.nodes.nodes) <= 127
    assert len(monitor.channels._channels) <= 512
    assert len(monitor._reported) <= 4096
    # Many long values at once.
    for node in range(1, 61):
        monitor.feed(CanFrame(0x600 + node, b"\x21\0\x21\0" + bytes(4)), 5.0)
        monitor.feed(CanFrame(0x580 + node, b"\x60\0\x21\0" + bytes(4)), 5.0)
        for segment in range(70):
            monitor.feed(CanFrame(0x600 + node, bytes([segment % 2 * 16]) + b"longone"), 5.0)
            monitor.feed(CanFrame(0x580 + node, bytes([0x20 | segment % 2 * 16]) + bytes(7)), 5.0)
    assert monitor.held.used <= 25_000
    assert monitor.held.refused > 0
    *events, summary = monitor.end(6.0)
    assert event_as_dict(summary)["counts"]["bytes not held"] == monitor.held.refused
    assert {transfer.count for transfer in of(SdoTransferReport, events)} == {490}
    assert monitor.held.used == 0
    assert HELD_MAX >= VALUE_MAX


@pytest.mark.long
@pytest.mark.parametrize("most", part_or_whole(20_000, VALUE_MAX))
def test_a_value_too_long_to_hold_is_counted_and_its_crc_checked(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bytes are not held, but the CRC is computed."""
    monkeypatch.setattr(sdo_transfer, "VALUE_MAX", most)
    monitor, events = CanMonitor(), list[MonitorEvent]()
    size = most + 1003
    value = (bytes(range(256)) * (size // 256 + 1))[:size]

    def send(number: int, data: bytes) -> None:
        events.extend(monitor.feed(CanFrame(number, data.ljust(8, b"\0")), 0.0))

    send(0x605, b"\xc6\0\x21\0" + size.to_bytes(4, "little"))
    send(0x585, b"\xa4\0\x21\0\x7f")
    for begin in range(0, size, 127 * 7):
        parts = [value[at : at + 7] for at in range(begin, min(begin + 127 * 7, size), 7)]
        for number, part in enumerate(parts, start=1):
            last = 0x80 if begin + 127 * 7 >= size and number == len(parts) else 0
            send(0x605, bytes([number | last]) + part)
        send(0x585, bytes([0xA2, len(parts), 127]))
    unused = -size % 7
    send(0x605, bytes([0xC1 | unused << 2]) + crc_hqx(value, 0).to_bytes(2, "little"))
    send(0x585, b"\xa1")
    (done,) = of(SdoTransferReport, events)
    assert (done.outcome, done.count, done.data, done.crc) == ("done", size, None, "ok")
    assert of(Violation, events) == []


TEXT = st.text("(). 0123456789ABCDEF#RTcan[]{}`'\t\nxd", max_size=80)


@many
@given(st.one_of(TEXT, TEXT.map(lambda text: "(1.0) can0 605#40\n" + text), TEXT.map(lambda text: "base hex\n" + text)))
def test_any_text_is_read_or_refused(text: str) -> None:
    data = text.encode()
    if not is_can_recording(data):
        with pytest.raises(DecodeError):
            list(read_recording(data))
        return
    for _, event in replay_can(read_recording(data), KNOWN):
        check_events([event])
