"""Device identification: the objects of a server at all levels, and the conversation that reads them."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from barewire.conversation import play
from barewire.errors import DecodeError, EncodeError
from barewire.modbus import (
    Bus,
    DeviceIdentification,
    Identity,
    ModbusException,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
    Server,
    Table,
    read_device_identification,
)
from barewire.tcp import TcpLine, decode as tcp_decode, encode as tcp_frame
from tests.helpers import refused, serving

BASIC = {0: b"ACME", 1: b"bench", 2: b"1.0"}
REGULAR = BASIC | {3: b"https://example.org", 5: b"model"}
EXTENDED = REGULAR | {0x80: bytes(100), 0x90: bytes(range(244)), 0xFF: b"last"}


def asked(objects: dict[int, bytes], read_code: int) -> DeviceIdentification:
    table = Table(vendor="", product="")
    table.identity = Identity(objects)
    server = Server(TcpLine(), {1: table}, serial=False)
    return play(read_device_identification(Bus(TcpLine()), 1, read_code), serving(server))[0]


@pytest.mark.parametrize(
    ("objects", "conformity"), [(BASIC, 0x81), (REGULAR, 0x82), (EXTENDED, 0x83)], ids=["basic", "regular", "extended"]
)
@pytest.mark.parametrize(("read_code", "last"), [(1, 2), (2, 6), (3, 0xFF)])
def test_every_level_of_every_device_is_read_completely(
    objects: dict[int, bytes], conformity: int, read_code: int, last: int
) -> None:
    wanted = {number: value for number, value in objects.items() if number <= last}
    assert asked(objects, read_code) == DeviceIdentification(conformity, wanted)


def test_an_object_of_244_bytes_fills_a_response() -> None:
    identity = Identity(EXTENDED)
    parts = []
    request = ReadDeviceIdentification(3, 0)
    while True:
        answer = identity.answer(request)
        assert len(answer.encode()) <= 253
        parts.append([number for number, _ in answer.objects])
        if not answer.more_follows:
            break
        request = ReadDeviceIdentification(3, answer.next_object)
    assert parts == [[0, 1, 2, 3, 5, 0x80], [0x90], [0xFF]]


@pytest.mark.parametrize("read_code", [1, 2])
def test_a_stream_does_not_begin_at_an_object_of_a_higher_level(read_code: int) -> None:
    answer = Identity(EXTENDED).answer(ReadDeviceIdentification(read_code, 0x80))
    assert answer.objects[0] == (0, b"ACME")


def test_single_objects_of_any_level() -> None:
    identity = Identity(EXTENDED)
    assert identity.answer(ReadDeviceIdentification(4, 0xFF)).objects == ((0xFF, b"last"),)
    with pytest.raises(ModbusException) as caught:
        identity.answer(ReadDeviceIdentification(4, 0x81))
    assert caught.value.code == 2


@pytest.mark.parametrize(
    ("objects", "text"),
    [
        (BASIC | {0x80: bytes(245)}, "object 80h has 245 bytes: more than 244 never fit a PDU"),
        (BASIC | {7: b""}, "object 07h is reserved"),
        (BASIC | {0x100: b""}, "object 256: expected a number in 00h..06h or 80h..FFh"),
        ({0: b"", 1: b""}, "objects 00h, 01h and 02h (vendor, product, revision) are not optional"),
    ],
)
def test_an_object_that_could_never_be_sent_is_refused_by_identity(objects: dict[int, bytes], text: str) -> None:
    with refused(EncodeError, text):
        Identity(objects)


def test_texts_name_the_objects() -> None:
    assert DeviceIdentification(1, {0: b"ACME", 6: b"x", 0x81: b"\xe9"}).texts() == {
        "VendorName": "ACME",
        "UserApplicationName": "x",
        "object 81h": "é",
    }


# A device whose objects do not end -------------------------------------------------------------------------------


@pytest.mark.parametrize(("objects", "following"), [(((0, b"x"),), 0), (((0, b"x"), (3, b"y")), 2), ((), 0)])
def test_a_next_object_that_does_not_grow_is_an_error(objects: tuple[tuple[int, bytes], ...], following: int) -> None:
    def peer(item: bytes, now: float) -> Iterable[tuple[float, bytes]]:
        answer = ReadDeviceIdentificationResponse(1, 1, objects, True, following)
        return [(now, tcp_frame(1, answer.encode(), tcp_decode(item).transaction or 0))]

    with refused(DecodeError, f"the next one given is {following:02X}h: that would never end"):
        play(read_device_identification(Bus(TcpLine()), 1), peer)


def test_reading_ends_although_every_response_is_empty_and_promises_more() -> None:
    asked: list[int] = []

    def peer(item: bytes, now: float) -> Iterable[tuple[float, bytes]]:
        adu = tcp_decode(item)
        asked.append(adu.pdu[3])
        more = asked[-1] < 0xFF
        answer = ReadDeviceIdentificationResponse(3, 3, (), more, asked[-1] + 1 if more else 0)
        return [(now, tcp_frame(1, answer.encode(), adu.transaction or 0))]

    found, _ = play(read_device_identification(Bus(TcpLine()), 1, 3), peer)
    assert found == DeviceIdentification(3, {})
    assert asked == list(range(256))


def test_individual_access_is_refused() -> None:
    with refused(EncodeError, "read_code = 4: expected 1..3"):
        read_device_identification(Bus(TcpLine()), 1, 4)
