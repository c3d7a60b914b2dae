"""BLF files made by hand, object by object: each kind, containers, times, and what is damaged."""

from __future__ import annotations

import struct
import zlib

import pytest

from barewire.canopen import ErrorFrame
from barewire_workbench.recordings.blf import read_blf
from barewire_workbench.recordings.model import Dropped, Recorded, Unread
from tests.helpers import every_case
from tests.workbench.recordings.test_can_text_forms import BEGAN

START = struct.pack("<8H", 2023, 11, 2, 14, 22, 13, 20, 0)  # BEGAN


def blf(*objects: bytes) -> bytes:
    head = struct.pack("<4sL32x", b"LOGG", 144) + START + START
    return head.ljust(144, b"\0") + b"".join(objects)


def logged(kind: int, body: bytes, at: int = 0, *, flags: int = 2, version: int = 1) -> bytes:
    """Return an object with its padding: `at` in nanoseconds, or in 10 us with `flags` 1."""
    head = struct.pack("<LHHQ", flags, 0, 0, at) + (bytes(8) if version == 2 else b"")
    size = 16 + len(head) + len(body)
    return struct.pack("<4sHHLL", b"LOBJ", 16 + len(head), version, size, kind) + head + body + bytes(size % 4)


def container(data: bytes, packing: int = 2) -> bytes:
    body = struct.pack("<H6xL4x", packing, len(data)) + (zlib.compress(data) if packing == 2 else data)
    size = 16 + len(body)
    return struct.pack("<4sHHLL", b"LOBJ", 16, 1, size, 10) + body + bytes(size % 4)


def classical(number: int, data: bytes, *, channel: int = 1, flags: int = 0, kind: int = 1, at: int = 0) -> bytes:
    return logged(kind, struct.pack("<HBBL8s", channel, flags, len(data), number, data), at)


def fd_64(data: bytes, length: int, code: int, flags: int, behind: int = 0) -> bytes:
    """Return an object of type 101; zeros at the end of the data may be left out."""
    body = struct.pack("<BBBBLLL18xBBL", 2, code, length, 0, 0x123, 0, flags, 0, behind, 0) + data
    return logged(101, body, version=2)


def items_of(data: bytes) -> list[str]:
    return [str(item.frame) if isinstance(item, Recorded) else type(item).__name__ for item in read_blf(data)]


BEAT = classical(0x705, b"\x05")


@every_case(
    ("piece", "expected"),
    [
        (BEAT, ["705#05"]),
        (classical(0x705, b"\x7f", kind=86), ["705#7F"]),
        (classical(0x98EBFF00, b"\1\2"), ["18EBFF00#0102"]),
        (classical(0x705, b"\0", flags=0x80), ["705#R1"]),
        (classical(0x705, b""), ["705#"]),
        (logged(100, struct.pack("<HBBLLBBB5x64s", 1, 0, 9, 0x123, 0, 0, 3, 12, bytes(range(12)))),
         ["123##1000102030405060708090A0B"]),
        (logged(100, struct.pack("<HBBLLBBB5x64s", 1, 0, 2, 0x123, 0, 0, 0, 2, b"\1\2")), ["123#0102"]),
        (fd_64(b"\1\2", 12, 9, 0x1000), ["123##00102" + "00" * 10]),
        (fd_64(b"\1\2\3\4trailer", 4, 4, 0x7000, behind=40 + 40 + 4), ["123##301020304"]),
        (fd_64(b"", 0, 3, 0x10), ["123#R3"]),
        (fd_64(b"\1" * 8, 8, 8, 0), ["123#0101010101010101"]),
        (logged(73, struct.pack("<HHLBBBxLLH2x8s", 1, 0, 0, 0, 0, 0, 0, 0, 0, b"")), [str(ErrorFrame(0x80))]),
        (logged(2, struct.pack("<HH", 1, 0)), [str(ErrorFrame(0x80))]),
        (logged(96, b"a marker") + logged(4, bytes(24)), []),
        (classical(0x905, b"\1"), ["Unread"]),  # more than 11 bits
        (logged(100, struct.pack("<HBBLLBBB5x64s", 1, 0, 9, 0x123, 0, 0, 1, 65, b"")), ["Unread"]),
        (logged(1, b"\1\0"), ["Unread"]),  # too short for its type
        (b"LOBJ" + struct.pack("<HHLL", 32, 1, 0, 1) + BEAT, ["Unread", "705#05"]),  # a size of 0
        (b"LOBJ" + struct.pack("<HHLL", 32, 1, 0xFFFFFFFF, 1) + BEAT, ["Unread", "705#05"]),
        (b"\1\2\3\4\5" + BEAT, ["Unread", "705#05"]),
        (BEAT[:-3], ["Unread"]),
    ],
)  # fmt: skip
@every_case("packing", [0, 2, None])
def test_an_object_of_blf_is_read_packed_or_not(piece: bytes, expected: list[str], packing: int | None) -> None:
    """Compressed, not compressed, and outside a container."""
    wrapped = piece if packing is None else container(piece, packing)
    assert items_of(blf(wrapped)) == expected


def test_objects_continue_in_the_next_container_and_times_have_two_units() -> None:
    stream = b"".join(classical(0x705, bytes([place]), at=place * 1_000_000) for place in range(100))
    stream += logged(1, struct.pack("<HBBL8s", 3, 0, 1, 0x705, b"\x64"), 10_000, flags=1)
    parts = [stream[at : at + 37] for at in range(0, len(stream), 37)]
    items = list(read_blf(blf(*(container(part, packing=2 * (len(part) % 2)) for part in parts))))
    assert [item.frame.data[0] for item in items if isinstance(item, Recorded) and item.frame.data] == list(range(101))
    assert (items[0].at, items[-1].at) == (BEGAN, BEGAN + 0.1)
    assert isinstance(items[50], Recorded)
    assert items[50].at == pytest.approx(BEGAN + 0.050, abs=1e-6)
    assert {item.bus for item in items if isinstance(item, Recorded)} == {"0", "2"}


def test_damage_in_a_blf_is_reported_and_the_rest_is_read() -> None:
    broken = bytearray(container(BEAT * 3))
    broken[40:44] = b"\xff\xff\xff\xff"
    assert items_of(blf(container(BEAT), bytes(broken), container(BEAT))) == ["705#05", "Unread", "705#05"]
    assert items_of(blf(container(BEAT, packing=9), container(BEAT))) == ["Unread", "705#05"]
    assert items_of(blf(container(bytes(65 << 20)), container(BEAT))) == ["Unread", "705#05"]
    # The header says that it is longer than the file.
    assert items_of(b"LOGG" + b"\xff" * 200) == ["Unread"]
    # The recorder lost power: of the last container only the beginning is there.
    many = blf(container(b"".join(classical(0x705, bytes([at % 251]), at=at * 7919) for at in range(2000))))
    items = list(read_blf(many[: len(many) // 2]))
    assert sum(isinstance(item, Recorded) for item in items) > 500
    assert isinstance(items[-1], Unread)
    # The recorder reports lost frames on every bus that has frames.
    lost = logged(125, bytes(8), 2_000_000_000)
    items = list(read_blf(blf(container(BEAT + classical(0x701, b"\5", channel=2) + lost))))
    assert sorted(item for item in items if isinstance(item, Dropped)) == [
        Dropped(BEGAN + 2, "0", 0),
        Dropped(BEGAN + 2, "1", 0),
    ]
