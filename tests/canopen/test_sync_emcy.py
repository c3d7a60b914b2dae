"""The SYNC and EMCY messages."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, Emergency, SyncMessage, error_text, register_names
from barewire.errors import DecodeError, EncodeError


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


def test_emergency_heartbeat_of_node_2_lost() -> None:
    message = Emergency(5, 0x8130, 0x11, b"\2")
    assert str(message.encode()) == "085#3081110200000000"
    heard = Emergency.decode(message.encode())
    assert heard == Emergency(5, 0x8130, 0x11, b"\2\0\0\0\0")
    assert heard.text == "life guarding or heartbeat error"
    assert register_names(heard.register) == ("generic", "communication")


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
