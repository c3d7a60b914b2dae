"""A log that comes part by part, as through a pipe, reads as the whole of it does."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pytest

from barewire.errors import DecodeError
from barewire.rtu import encode
from barewire_workbench.monitor.recording import read_recording
from barewire_workbench.recordings.modbus_log import LoggedBytes, ModbusLog, read_modbus_log, read_modbus_parts, reader
from barewire_workbench.recordings.modbus_log.model import FormContent
from barewire_workbench.recordings.modbus_replay import replay, replay_parts
from barewire_workbench.recordings.model import Unread
from barewire_workbench.recordings.source import LINE_MAX, RecordingSource
from tests.helpers import every_case, some_of, unhex
from tests.workbench.recordings.modbus_log.test_programs import SAMPLES
from tests.workbench.recordings.test_modbus_recordings import dump_of

READ, REFUSED = encode(1, unhex("03 0005 0002")), encode(1, unhex("83 02"))


def source_of(pieces: list[bytes]) -> RecordingSource:
    waiting = iter(pieces)
    return RecordingSource(lambda size: next(waiting, b""))


def cut(data: bytes, size: int) -> list[bytes]:
    return [data[start : start + size] for start in range(0, len(data), size)]


def octal(data: bytes) -> str:
    return "".join(f"\\{byte:o}" for byte in data)


@every_case("size", [17, 50, 333, 2000])
@every_case("path", sorted(SAMPLES.iterdir()))
def test_the_parts_of_a_log_are_the_whole(path: Path, size: int) -> None:
    data = path.read_bytes()
    try:
        whole = read_modbus_log(data)
    except DecodeError as error:
        with pytest.raises(DecodeError, match=error.text[:20]):
            list(read_modbus_parts(source_of(cut(data, size))))
        return
    parts = list(read_modbus_parts(source_of(cut(data, size))))
    assert list(chain.from_iterable(part.items for part in parts)) == list(whole.items)


@every_case(
    "form",
    [
        lambda at, asked, data: f"{at:.3f} {data.hex(' ')}\n",
        lambda at, asked, data: f"{data.hex(' ')}\n",
        lambda at, asked, data: f"COM3: {data.hex(' ')}\n",
        lambda at, asked, data: f"{'Tx' if asked else 'Rx'}: {data[:3].hex(' ')}\n {data[3:].hex(' ')}\n",
        lambda at, asked, data: (
            f'10:31:{at:06.3f} {"write" if asked else "read"}(3, "{octal(data)}", 99) = {len(data)}\n'
        ),
        lambda at, asked, data: f"10:31:{at:06.3f} {'TX' if asked else 'RX'}: {', '.join(map(str, data))}\n",
    ],
)
@every_case("size", [30, 111, 1000])
def test_each_entry_is_read_when_it_is_there(size: int, form: object) -> None:
    assert callable(form)
    data = "".join(form(at / 4, at % 2 == 0, REFUSED if at % 2 else READ) for at in range(100)).encode()
    parts = list(read_modbus_parts(source_of(cut(data, size))))
    items = list(chain.from_iterable(part.items for part in parts))
    whole = read_modbus_log(data).items
    assert [item._replace(at=0.0) for item in items] == [item._replace(at=0.0) for item in whole]
    assert [item.at for item in items] == pytest.approx([item.at for item in whole])
    assert len(parts) > len(data) / size / 4


def test_nothing_is_read_ahead() -> None:
    read = 0

    def pieces() -> Iterator[bytes]:
        nonlocal read
        for read in range(1000):
            yield f"[{read}.5] send: {READ.hex(' ')}\n[{read}.7] recv: {REFUSED.hex(' ')}\n".encode()

    waiting = pieces()
    parts = read_modbus_parts(RecordingSource(lambda size: next(waiting, b"")))
    assert [item.line for item in next(parts).items] == [1, 2]
    assert read == 0
    assert sum(len(part.items) for part in parts) == 1998


def test_the_end_of_an_endless_line_is_left_out() -> None:
    lines = [
        f"Tx: {READ.hex(' ')}\n".encode(),
        *cut(b"[" * (3 * LINE_MAX), 65536),
        f"\nRx: {REFUSED.hex(' ')}".encode(),
    ]
    source = source_of(lines)
    items = [item for part in read_modbus_parts(source) for item in part.items]
    assert [(type(item), item.line) for item in items] == [(LoggedBytes, 1), (Unread, 2), (LoggedBytes, 3)]
    assert source.cut == [2]
    source = source_of([b"(1.5) can0 705#05\n", *cut(b":" * (3 * LINE_MAX), 65536), b"\n(1.6) can0 705#05\n"])
    assert [item.at for item in read_recording(source)] == [1.5, 1.501, 1.6]
    assert source.cut == [2]


def test_what_the_first_part_shows_is_not_decided_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The forms of Wireshark, strace and the serial sniffers look at the first lines of a log only."""
    looked: list[int] = []

    def read_wireshark(lines: list[str], ports: object) -> FormContent:
        looked.append(len(lines))
        return FormContent([], set())

    monkeypatch.setitem(reader._OF_PACKETS, "Wireshark", read_wireshark)
    text = f"DEBUG send: {' '.join(map(hex, READ))}\nDEBUG recv: {' '.join(map(hex, REFUSED))}\n".encode()
    parts: list[ModbusLog] = list(read_modbus_parts(source_of([text] * 50)))
    assert len(parts) == 50
    assert sum(looked) <= 4


@pytest.mark.parametrize("exchanges_and_size", some_of([(1_000, 5_000), (10_000, 10_000), (10_000, 65_536)], 1))
def test_a_long_dump_is_read_in_parts(exchanges_and_size: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """In `make test` a tenth of the dump, of which a tenth is one piece."""
    exchanges, size = exchanges_and_size
    monkeypatch.setattr(reader, "_DUMP_WHOLE", reader._DUMP_WHOLE * exchanges // 10_000)
    data = b"".join(READ + REFUSED for _ in range(exchanges))
    text = dump_of(data)
    parts = list(read_modbus_parts(source_of(cut(text, size))))
    items = [item for part in parts for item in part.items if isinstance(item, LoggedBytes)]
    assert b"".join(item.data for item in items) == data
    assert len(parts) > 5
    assert {item.at for item in items} == {0.0}
    assert list(replay_parts(parts[0], parts[1:])) == list(replay(text))


def test_a_descriptor_that_carries_frames_later_is_a_line_of_its_own() -> None:
    calls = [f'write({number}, "{octal(READ)}", 8) = 8\n'.encode() for number in (3, 3, 4, 3)]
    parts = read_modbus_parts(source_of([b'read(4, "\\0\\1", 9) = 2\n', *calls]))
    assert [(item.line, getattr(item, "connection", None)) for part in parts for item in part.items] == [
        (2, ""), (3, ""), (4, "4"), (5, ""),
    ]  # fmt: skip
