"""EMCY: the message; register, history and inhibit time of a device; the active errors that a consumer derives."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    CanFrame,
    EmcyConsumer,
    EmcyProducer,
    Emergency,
    Entry,
    LocalNode,
    NmtState,
    ObjectDictionary,
    error_text,
    register_names,
    register_of,
    standard_objects,
)
from barewire.canopen.abort_codes import SdoAbort
from barewire.canopen.emcy import ERRORS_MAX, WAITING_MAX
from barewire.errors import DecodeError, EncodeError
from tests.helpers import every_case


def test_emergency_heartbeat_of_node_2_lost() -> None:
    message = Emergency(5, 0x8130, 0x11, b"\2")
    assert str(message.encode()) == "085#3081110200000000"
    received = Emergency.decode(message.encode())
    assert received == Emergency(5, 0x8130, 0x11, b"\2\0\0\0\0")
    assert received.text == "life guarding or heartbeat error"
    assert register_names(received.register) == ("generic", "communication")


def test_a_short_emergency_is_kept_and_marked() -> None:
    assert Emergency.decode(CanFrame.parse("085#308111")) == Emergency(5, 0x8130, 0x11, bytes(5), padded=True)
    assert Emergency.decode(CanFrame.parse("085#3081")).code == 0x8130
    for text in ("085#30", "080#", "085#R8", "00000085#3081110200000000", "185#3081110200000000"):
        with pytest.raises(DecodeError):
            Emergency.decode(CanFrame.parse(text))


def test_an_emergency_has_at_most_five_bytes_of_information() -> None:
    with pytest.raises(EncodeError, match="expected at most 5"):
        Emergency(5, 0, 0, bytes(6)).encode()


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (0x0000, "no error, or an error is gone"),
        (0x1000, "generic error"),
        (0x2310, "current, on the output side of the device"),
        (0x2510, "current"),
        (0x3210, "voltage inside the device"),
        (0x8131, "communication"),
        (0x8210, "PDO not processed: too short"),
        (0x9001, "external error"),
        (0xFF42, "device specific"),
        (0x0500, "unknown error code"),
        (0xA000, "unknown error code"),
    ],
)
def test_error_code_classes(code: int, text: str) -> None:
    assert error_text(code) == text


def test_reserved_register_bit() -> None:
    assert register_names(0xC0) == ("reserved", "manufacturer")
    assert register_names(0) == ()


def device() -> LocalNode:
    device = LocalNode(5, ObjectDictionary(standard_objects()))
    device.start(0.0)
    return device


def texts(frames: list[CanFrame]) -> list[str]:
    return [str(frame) for frame in frames]


@pytest.mark.parametrize(
    ("code", "register"),
    [(0x1000, 1), (0x2310, 3), (0x3210, 5), (0x4210, 9), (0x5000, 1), (0x8130, 0x11), (0x8000, 1), (0xFF42, 0x81)],
)
def test_register_bits_of_a_code(code: int, register: int) -> None:
    assert register_of(code) == register


def test_code_0000h_reports_the_remaining_register() -> None:
    node = device()
    assert texts(node.error(0x3210, 1.0)) == ["085#1032050000000000"]
    assert texts(node.error(0x8130, 2.0, info=b"\2")) == ["085#3081150200000000"]
    assert node.error(0x8130, 2.5) == []  # active already
    assert texts(node.error_gone(0x3210, 3.0)) == ["085#0000110000000000"]
    assert node.error_gone(0x3210, 3.5) == []
    assert node.objects.get(0x1001) == 0x11
    assert texts(node.error_gone(0x8130, 4.0)) == ["085#0000000000000000"]
    assert node.errors.active == ()


def test_the_same_error_from_two_sources_counts_twice() -> None:
    node = device()
    node.error(0x8210, 0.0, source=1)
    assert len(node.error(0x8210, 0.0, source=2)) == 1
    assert texts(node.error_gone(0x8210, 0.0, source=1)) == ["085#0000110000000000"]


def test_history_is_read_and_cleared_by_1003h() -> None:
    node = device()
    for code in range(0x1001, 0x100B):
        node.error(code, 0.0, info=b"\x34\x12")
    objects = node.objects
    assert objects.read(0x1003, 0) == b"\x08"
    assert objects.get(0x1003, 1) == 0x1234100A
    assert objects.get(0x1003, 8) == 0x12341003
    with pytest.raises(SdoAbort, match="0609 0030h"):
        objects.write(0x1003, 0, b"\1")
    with pytest.raises(SdoAbort, match="0601 0002h"):
        objects.write(0x1003, 1, bytes(4))
    objects.write(0x1003, 0, b"\0")
    assert objects.read(0x1003, 0) == b"\0"
    with pytest.raises(SdoAbort, match="0800 0024h"):
        objects.read(0x1003, 1)


def test_an_error_with_too_much_information_is_not_recorded_and_none_is_cleared() -> None:
    node = device()
    with pytest.raises(EncodeError, match="6 bytes of manufacturer information"):
        node.error(0x3210, 0.0, info=bytes(6))
    assert (node.errors.active, node.errors.history, node.errors.register) == ((), (), 0)
    assert texts(node.error(0x3210, 0.0, info=bytes(5))) == ["085#1032050000000000"]
    with pytest.raises(EncodeError, match="6 bytes of manufacturer information"):
        node.error_gone(0x3210, 1.0, info=bytes(6))
    assert texts(node.error_gone(0x3210, 1.0)) == ["085#0000000000000000"]


def test_messages_wait_for_the_inhibit_time() -> None:
    node = device()
    node.objects.set(0x1015, 0, 1000)  # 100 ms
    assert len(node.error(0x1000, 0.0)) == 1
    assert node.error(0x3210, 0.01) == []
    assert node.error_gone(0x1000, 0.02) == []
    assert node.deadline == pytest.approx(0.1)
    assert texts(node.feed(None, 0.1)) == ["085#1032050000000000"]
    assert node.deadline == pytest.approx(0.2)
    assert texts(node.feed(None, 0.25)) == ["085#0000050000000000"]
    assert node.deadline is None


def test_the_number_of_waiting_messages_is_bounded() -> None:
    errors = EmcyProducer(5, ObjectDictionary([Entry(0x1015, 0, "inhibit", "u16", "rw", 60_000)]))
    for code in range(0x1000, 0x1000 + 3 * WAITING_MAX):
        errors.error(code, 0.0)
    assert errors.dropped == 2 * WAITING_MAX - 1
    assert len(errors.history) == 8


def test_a_stopped_device_sends_no_emergency_but_keeps_register_and_history() -> None:
    node = device()
    node.feed(CanFrame.parse("000#0205"), 0.0)
    assert node.error(0x3210, 0.0) == []
    assert node.objects.get(0x1001) == 5
    assert node.objects.get(0x1003, 1) == 0x3210
    node.feed(CanFrame.parse("000#8005"), 0.0)
    assert texts(node.error_gone(0x3210, 1.0)) == ["085#0000000000000000"]


def test_1014h_changes_the_identifier_and_switches_emcy_off() -> None:
    node = device()
    assert node.objects.get(0x1014) == 0x85
    for word, code in ((0x86, "0609 0030h"), (0x80000605, None), (0x605, "0609 0030h"), (0x9A, None)):
        data = word.to_bytes(4, "little")
        if code is not None:
            with pytest.raises(SdoAbort, match=code):
                node.objects.write(0x1014, 0, data)
        else:
            node.objects.write(0x1014, 0, data)
    assert texts(node.error(0x1000, 0.0)) == ["09A#0010010000000000"]
    node.objects.write(0x1014, 0, (0x8000009A).to_bytes(4, "little"))
    assert node.error_gone(0x1000, 0.0) == []


@every_case("word", [0x000, 0x07F, 0x180, 0x605])
def test_a_restricted_identifier_in_1014h_counts_as_the_default_one(word: int) -> None:
    """A description without a DefaultValue has 0: the emergency 0x80xxh would be an NMT command to all nodes."""
    node = LocalNode(5, ObjectDictionary(standard_objects()))
    node.objects.replace(Entry(0x1014, 0, "COB-ID EMCY", "u32", "rw", word))
    node.start(0.0)
    assert texts(node.error(0x8130, 0.0)) == ["085#3081110000000000"]
    node.objects.set(0x1014, 0, 1 << 31 | word)
    assert node.error(0x3210, 0.0) == []


def test_a_restricted_identifier_in_1028h_is_not_consumed() -> None:
    objects = ObjectDictionary(standard_objects(emcy_consumers=9))
    objects.set(0x1028, 9, 0)
    device = LocalNode(5, objects)
    device.start(0.0)
    device.feed(CanFrame.parse("000#0109"), 0.1)
    assert device.emergencies.active(9) == ()


def test_a_reset_clears_communication_errors_or_all_errors() -> None:
    node = device()
    node.error(0x3210, 0.0)
    node.error(0x8130, 0.0)
    assert texts(node.feed(CanFrame.parse("000#8205"), 1.0)) == ["705#00"]
    assert (node.errors.active, node.state) == ((0x3210,), NmtState.PRE_OPERATIONAL)
    node.feed(CanFrame.parse("000#8105"), 2.0)
    assert (node.errors.active, node.errors.history) == ((), ())


def test_a_register_computed_by_the_application_is_sent_unchanged() -> None:
    node = LocalNode(5, ObjectDictionary([Entry(0x1001, 0, "error register", "u8", "ro", on_read=lambda: 0x20)]))
    node.start(0.0)
    assert texts(node.error(0xFF00, 0.0)) == ["085#00FF200000000000"]


def test_the_consumer_clears_errors_whose_register_bit_is_reset() -> None:
    consumer = EmcyConsumer()
    for text in ("085#1032050000000000", "085#3081150200000000", "085#1042150000000000"):
        (event,) = consumer.feed(CanFrame.parse(text), 0.0)
    assert event.active == (0x3210, 0x8130, 0x4210)
    (event,) = consumer.feed(CanFrame.parse("085#0000110000000000"), 1.0)
    assert (event.gone, event.active) == ((0x3210, 0x4210), (0x8130,))
    assert (consumer.active(5), consumer.register(5), consumer.active(6)) == ((0x8130,), 0x11, ())
    (event,) = consumer.feed(CanFrame.parse("085#0000000000000000"), 2.0)
    assert event.gone == (0x8130,)


def test_short_messages_are_padded_and_marked() -> None:
    consumer = EmcyConsumer()
    (event,) = consumer.feed(CanFrame.parse("085#308111"), 0.0)
    assert (event.message.padded, event.active) == (True, (0x8130,))
    assert consumer.feed(CanFrame.parse("085#30"), 0.0) == []
    assert consumer.unreadable == 1
    for text in ("00000085#3081110200000000", "085#R8", "080#", "185#0000"):
        assert consumer.feed(CanFrame.parse(text), 0.0) == []
    assert len(consumer.history) == 1


def test_configured_identifiers_boot_ups_and_the_limit_of_errors() -> None:
    consumer = EmcyConsumer({(0x18FF0005, True): 5})
    assert consumer.feed(CanFrame.parse("18FF0005#3081110200000000"), 0.0)[0].message.node == 5
    consumer.feed(CanFrame.parse("705#00"), 1.0)
    assert (consumer.active(5), consumer.register(5)) == ((), None)
    for code in range(0x1000, 0x1400):
        consumer.feed(CanFrame(0x86, code.to_bytes(2, "little") + bytes(6)), 2.0)
    assert len(consumer.active(6)) == ERRORS_MAX
    assert consumer.active(6)[-1] == 0x13FF


def test_1028h_lists_the_nodes_whose_emergencies_are_consumed() -> None:
    objects = ObjectDictionary(standard_objects(emcy_consumers=127))
    device = LocalNode(5, objects)
    device.start(0.0)
    frames = [CanFrame.parse(text) for text in ("089#3081110000000000", "1F0#1032150000000000")]
    for frame in frames:
        device.feed(frame, 0.1)
    assert (device.emergencies.active(9), device.emergencies.active(16)) == ((), ())
    objects.write(0x1028, 9, (0x89).to_bytes(4, "little"))
    objects.write(0x1028, 16, (0x1F0).to_bytes(4, "little"))
    for frame in [*frames, CanFrame.parse("08A#3081110000000000")]:
        device.feed(frame, 0.2)
        device.feed(frame, 0.2)
    assert device.emergencies.active(9) == (0x8130,)
    assert device.emergencies.active(16) == (0x3210,)
    assert device.emergencies.active(10) == ()


def test_recovery_from_bus_off_is_sent_as_8140h() -> None:
    device = LocalNode(5, ObjectDictionary(standard_objects()))
    device.start(0.0)
    assert [str(frame) for frame in device.recovered(1.0)] == ["085#4081110000000000", "085#0000000000000000"]
    assert device.objects.get(0x1003, 1) == 0x8140
