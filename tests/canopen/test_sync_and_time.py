"""SYNC and TIME: the messages, producers, monitor and consumer, and both in a device."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    CanFrame,
    LocalNode,
    ObjectDictionary,
    PdoConfig,
    SyncMessage,
    SyncMonitor,
    SyncProducer,
    TimeConsumer,
    TimeProducer,
    TimeStamp,
    standard_objects,
)
from barewire.canopen.abort_codes import SdoAbort
from barewire.canopen.object_dictionary import Entry
from barewire.canopen.time_stamp import EPOCH_UNIX
from barewire.errors import DecodeError, EncodeError
from tests.helpers import every_case


@pytest.mark.parametrize(("text", "counter"), [("080#", None), ("080#01", 1), ("080#F0", 240)])
def test_sync(text: str, counter: int | None) -> None:
    assert SyncMessage.decode(CanFrame.parse(text)) == SyncMessage(counter)
    assert str(SyncMessage(counter).encode()) == text


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("080#00", "value"),
        ("080#F1", "value"),
        ("080#0102", "long"),
        ("081#", "mismatch"),
        ("00000080#", "mismatch"),
        ("080#R", "mismatch"),
    ],
)
def test_invalid_sync_messages_raise(text: str, reason: str) -> None:
    with pytest.raises(DecodeError) as caught:
        SyncMessage.decode(CanFrame.parse(text))
    assert caught.value.reason == reason


@pytest.mark.parametrize("counter", [0, 241])
def test_sync_counter_has_a_range(counter: int) -> None:
    with pytest.raises(EncodeError):
        SyncMessage(counter).encode()


def test_the_producer_has_absolute_times_a_counter_and_statistics() -> None:
    producer = SyncProducer(0.01, overflow=3)
    producer.start(0.0)
    sent = [str(producer.feed(None, now)[0]) for now in (0.010, 0.0205, 0.030, 0.040)]
    assert sent == ["080#01", "080#02", "080#03", "080#01"]
    assert producer.latest == pytest.approx(0.0005)
    assert producer.deadline == pytest.approx(0.05)  # not 0.0505
    assert len(producer.feed(None, 0.1)) == 1
    assert producer.missed == 5
    producer.stop()
    assert producer.feed(None, 9.0) == []
    for period, overflow in ((0.0, 0), (0.01, 1), (0.01, 241)):
        with pytest.raises(EncodeError):
            SyncProducer(period, overflow=overflow)


def kinds(monitor: SyncMonitor, text: str | None, now: float) -> list[str]:
    return [event.kind for event in monitor.feed(None if text is None else CanFrame.parse(text), now)]


def test_the_monitor_reports_sync_jump_wrong_and_lost() -> None:
    monitor = SyncMonitor(0.01, overflow=3)
    assert kinds(monitor, "080#02", 0.000) == ["sync"]
    assert kinds(monitor, "080#03", 0.011) == ["sync"]
    assert kinds(monitor, "080#01", 0.020) == ["sync"]
    assert kinds(monitor, "080#03", 0.030) == ["jump"]
    assert kinds(monitor, "080#", 0.031) == ["wrong"]
    assert kinds(monitor, "080#0102", 0.031) == ["wrong"]
    assert kinds(monitor, "080#F1", 0.031) == ["wrong"]
    assert monitor.deadline == pytest.approx(0.045)
    assert kinds(monitor, None, 0.045) == ["lost"]
    assert kinds(monitor, None, 1.0) == []
    assert kinds(monitor, "080#01", 2.0) == ["sync"]
    assert monitor.shortest == pytest.approx(0.009)
    assert monitor.longest == pytest.approx(0.011)
    assert kinds(monitor, "00000080#01", 2.0) == kinds(monitor, "080#R1", 2.0) == []


def device(**objects: int) -> LocalNode:
    device = LocalNode(5, ObjectDictionary([*standard_objects(), Entry(0x6041, 0, "status", "u16", "ro", 7)]),
                    [PdoConfig("TPDO", 1, (0x60410010,), type=1)])  # fmt: skip
    device.start(0.0)
    return device


def write(device: LocalNode, index: int, size: int, value: int) -> None:
    device.objects.write(index, 0, value.to_bytes(size, "little"))


def feed(device: LocalNode, text: str | None, now: float = 0.0) -> list[str]:
    return [str(frame) for frame in device.feed(None if text is None else CanFrame.parse(text), now)]


def test_a_device_produces_sync_and_its_own_pdos_follow_it() -> None:
    node = device()
    write(node, 0x1019, 1, 2)
    write(node, 0x1006, 4, 10_000)
    assert feed(node, None, 1.0) == []
    write(node, 0x1005, 4, 0x4000_0080)
    assert feed(node, None, 1.0) == []
    assert node.deadline == pytest.approx(1.01)  # the first after one period
    assert feed(node, None, 1.01) == ["080#01"]
    feed(node, "000#0105", 1.011)
    assert feed(node, None, 1.02) == ["080#02", "185#0700"]
    assert feed(node, None, 1.03) == ["080#01", "185#0700"]
    feed(node, "000#0205", 1.031)
    assert feed(node, None, 1.05) == []
    assert node.deadline is None
    feed(node, "000#0105", 2.0)
    assert feed(node, None, 2.01) == ["080#01", "185#0700"]  # after STOPPED the counter starts with 1


def test_an_rpdo_that_arrives_when_the_own_sync_is_due_is_used() -> None:
    """Both take effect in one `feed`: the RPDO was received before the SYNC is sent, so this SYNC stores it."""
    objects = ObjectDictionary([*standard_objects(), Entry(0x6040, 0, "controlword", "u16", "rw")])
    node = LocalNode(5, objects, [PdoConfig("RPDO", 1, (0x60400010,), type=1)])
    node.start(0.0)
    write(node, 0x1006, 4, 10_000)
    write(node, 0x1005, 4, 0x4000_0080)
    feed(node, "000#0105", 1.0)
    assert feed(node, "205#0700", 1.01) == ["080#"]
    assert objects.get(0x6040) == 7


def test_writes_to_the_sync_objects_are_validated() -> None:
    node = device()
    for value in (1, 241):
        with pytest.raises(SdoAbort, match="0609 0030h"):
            write(node, 0x1019, 1, value)
    write(node, 0x1006, 4, 1000)
    with pytest.raises(SdoAbort, match="0800 0022h"):
        write(node, 0x1019, 1, 10)
    write(node, 0x1005, 4, 0x4000_0080)
    with pytest.raises(SdoAbort, match="0609 0030h"):
        write(node, 0x1005, 4, 0x4000_0081)
    with pytest.raises(SdoAbort, match="0609 0030h"):
        write(node, 0x1005, 4, 0x0000_0605)
    write(node, 0x1005, 4, 0x0000_0090)


@pytest.mark.parametrize(("overflow", "wrong", "right"), [(0, "080#01", "080#"), (4, "080#", "080#01")])
def test_a_sync_of_the_wrong_length_is_reported(overflow: int, wrong: str, right: str) -> None:
    node = device()
    write(node, 0x1019, 1, overflow)
    feed(node, "000#0105")
    length = len(CanFrame.parse(wrong).data)
    assert feed(node, wrong) == [f"085#408211{length:02X}00000000"]
    assert feed(node, wrong) == []
    assert feed(node, right) == ["085#0000000000000000", "185#0700"]


def test_sync_on_a_configured_extended_identifier() -> None:
    node = device()
    feed(node, "000#0105")
    write(node, 0x1005, 4, 0x2000_0080)
    assert feed(node, "080#") == []
    assert feed(node, "00000080#") == ["185#0700"]


def test_synchronous_rpdos_outside_the_window_are_not_used() -> None:
    objects = ObjectDictionary([*standard_objects(), Entry(0x6040, 0, "control", "u16", "rw", 0)])
    node = LocalNode(5, objects, [PdoConfig("RPDO", 1, (0x60400010,), type=1)])
    node.start(0.0)
    write(node, 0x1007, 4, 5000)
    for text, now in (("000#0105", 0.0), ("080#", 1.0), ("205#0100", 1.004), ("205#0200", 1.006), ("080#", 2.0)):
        feed(node, text, now)
    assert (objects.get(0x6040), node.pdo.outside_window) == (1, 1)


# Computed by hand from 1984-01-01.
@pytest.mark.parametrize(
    ("unix", "data"),
    [
        (441763200, "000000000000"),
        (441763200 + 3 * 86400 + 1.5, "DC0500000300"),
        (946684800, "00000000D416"),
        (1709210096.789, "952CB3024D39"),
        (1782691199.999, "FF5B26059F3C"),
    ],
)
def test_time_stamps(unix: float, data: str) -> None:
    stamp = TimeStamp.of_unix(unix)
    assert str(stamp.encode()) == f"100#{data}"
    assert TimeStamp.decode(CanFrame.parse(f"100#{data}")) == stamp
    assert stamp.unix == pytest.approx(unix)


@pytest.mark.parametrize(
    ("text", "reason"),
    [("100#0000000000", "short"), ("100#00000000000000", "long"), ("100#00000000", "short"),
     ("100#005C26050000", "value"), ("101#000000000000", "mismatch"), ("100#R6", "mismatch"),
     ("00000100#000000000000", "mismatch")],
)  # fmt: skip
def test_invalid_time_messages_raise(text: str, reason: str) -> None:
    with pytest.raises(DecodeError) as caught:
        TimeStamp.decode(CanFrame.parse(text))
    assert caught.value.reason == reason


def test_time_before_1984_and_after_2163() -> None:
    for unix in (0, EPOCH_UNIX - 1, EPOCH_UNIX + 65536 * 86400):
        with pytest.raises(EncodeError):
            TimeStamp.of_unix(unix)


def test_time_from_producer_to_consumer() -> None:
    producer, consumer = TimeProducer(60.0, 1_700_000_000.0), TimeConsumer()
    assert consumer.unix(0.0) is None
    (frame,) = producer.feed(None, 100.0)
    assert producer.feed(None, 130.0) == []
    (heard,) = consumer.feed(frame, 0.25)  # the consumer has a clock of its own
    assert heard.unix_at_zero + 0.25 == pytest.approx(1_700_000_100.0)
    assert consumer.unix(10.25) == pytest.approx(1_700_000_110.0)
    assert consumer.feed(CanFrame.parse("100#00"), 1.0) == []
    assert consumer.unreadable == 1
    with pytest.raises(EncodeError):
        TimeProducer(0.0, 0.0)


def test_bit_31_of_1012h_consumes_and_bit_30_produces() -> None:
    node = device()
    frame = TimeStamp.of_unix(1_700_000_000).encode()
    node.feed(frame, 1.0)
    assert node.time.unix(2.0) == pytest.approx(1_700_000_001)
    assert node.send_time(TimeStamp.of_unix(0x60000000)) == []
    write(node, 0x1012, 4, 0x4000_0100)
    node.feed(TimeStamp.of_unix(1_800_000_000).encode(), 3.0)
    assert node.time.unix(2.0) == pytest.approx(1_700_000_001)
    assert [frame.id for frame in node.send_time(TimeStamp.of_unix(0x60000000))] == [0x100]
    feed(node, "000#0205")
    assert node.send_time(TimeStamp.of_unix(0x60000000)) == []


@every_case("word", [0x000, 0x07F, 0x180, 0x605])
def test_a_restricted_identifier_in_1005h_or_1012h_counts_as_the_default_one(word: int) -> None:
    """A description without a DefaultValue has 0, where a device would receive NMT commands as SYNC, or send SYNC."""
    node = device()
    node.objects.set(0x1005, 0, word)
    feed(node, "000#0105")
    assert feed(node, "080#") == ["185#0700"]
    assert feed(node, f"{word:03X}#") == []
    node.objects.set(0x1006, 0, 10_000)
    node.objects.set(0x1005, 0, 0x4000_0000 | word)
    feed(node, None, 1.0)
    assert feed(node, None, 1.01) == ["080#", "185#0700"]

    stamp = TimeStamp.of_unix(1_700_000_000)
    node.objects.set(0x1012, 0, 0xC000_0000 | word)
    assert node.send_time(stamp) == [stamp.encode()]
    node.feed(stamp.encode(), 2.0)
    assert node.time.unix(3.0) == pytest.approx(1_700_000_001)
