"""Any text is read or refused with a DecodeError; times never run backwards, and no line is dropped in silence."""

from __future__ import annotations

import json
from pathlib import Path

from hypothesis import given, strategies as st

from barewire.errors import DecodeError
from barewire.rtu import encode
from barewire.tcp import encode as tcp_frame
from barewire_workbench.frames.modbus_exchanges import Exchanges, PairedExchange, exchange_as_dict
from barewire_workbench.recordings.modbus_log import LoggedBytes, read_modbus_log
from barewire_workbench.recordings.modbus_replay import replay_log
from barewire_workbench.recordings.model import Unread
from tests.helpers import modest, unhex

SAMPLES = Path(__file__).parent / "samples"
SAMPLE_LINES = [
    line for path in sorted(SAMPLES.iterdir()) for line in path.read_text(encoding="utf-8").splitlines() if line.strip()
]
PDUS = ["03 0000 0002", "03 04 0017 0007", "06 0001 0003", "83 02", "10 0000 0001 02 00FF", "2B 0E 01 00"]
frames = st.one_of(
    st.builds(lambda unit, pdu: encode(unit, unhex(pdu)), st.integers(0, 5), st.sampled_from(PDUS)),
    st.builds(lambda pdu, number: tcp_frame(1, unhex(pdu), number), st.sampled_from(PDUS), st.integers(0, 3)),
    st.binary(max_size=12),
)
stamps = st.sampled_from(
    [
        "",
        "10:00:00.5 ",
        "2024-01-05 10:31:18,257 ",
        "[00:00:01] ",
        "23:59:59 ",
        "12.5 ",
        "(0.1) ",
        "5/6/2024 1:00:00 PM ",
    ]
)
directions = st.sampled_from(
    ["", "Tx: ", "Rx: ", "send: ", "recv: ", "> ", "<< ", "request ", "Response from instrument: "]
)
notations = st.sampled_from(
    [
        lambda data: data.hex(" "),
        lambda data: " ".join(f"{byte:#x}" for byte in data),
        lambda data: "".join(f"[{byte:02X}]" for byte in data),
        lambda data: "".join(f"<{byte:02X}>" for byte in data),
        lambda data: ", ".join(map(str, data)),
        lambda data: f"write(3, {str(data)[1:]}, {len(data)}) = {len(data)}",
        lambda data: f"00000000  {data.hex(' ')}",
    ]
)
lines = st.one_of(
    st.builds(lambda stamp, word, data, form: stamp + word + form(data), stamps, directions, frames, notations),
    st.sampled_from(SAMPLE_LINES),
    st.text(max_size=30),
)


def is_read_or_refused(data: bytes) -> None:
    try:
        log = read_modbus_log(data)
    except DecodeError:
        return
    times = [item.at for item in log.items]
    assert times == sorted(times)
    assert all(item.line >= 1 for item in log.items)
    last, shown = float("-inf"), Exchanges(timed=True)
    rows: list[PairedExchange] = []
    for event in replay_log(data).events:
        json.dumps(exchange_as_dict(event, timed=log.timed))
        rows += shown.feed(event)
    for row in rows + shown.end():
        at = float(str(row).split(" ", 1)[0])
        assert at >= last
        last = at


@modest
@given(st.lists(lines, max_size=12))
def test_any_lines(given_lines: list[str]) -> None:
    is_read_or_refused("\n".join(given_lines).encode())


@modest
@given(st.binary(max_size=80))
def test_any_bytes(data: bytes) -> None:
    is_read_or_refused(data)


@modest
@given(st.lists(st.sampled_from(SAMPLE_LINES), min_size=1, max_size=12))
def test_every_line_is_an_item_or_known(given_lines: list[str]) -> None:
    """A line of letters only is nothing that a form knows: it is in the items."""
    text = "\n".join([*given_lines, "zzzz yyyy"])
    try:
        log = read_modbus_log(text.encode())
    except DecodeError:
        return
    if any(isinstance(item, LoggedBytes) for item in log.items):
        assert [item.line for item in log.items if isinstance(item, Unread)][-1:] == [len(given_lines) + 1]


def test_times_of_a_log_of_bytes_that_go_back() -> None:
    sample = b"2.5 01 03 00 00 00 02 C4 0B\n1.0 01 03 04 00 00 00 01 3B F3\n1.5 01 03 00 00 00 02 C4 0B"
    log = read_modbus_log(sample)
    assert [item.at for item in log.items] == [2.5, 2.5, 3.0]
    assert log.notes == ("line 2: the times go back by 1.5 s; later ones are counted from there",)
    midnight = read_modbus_log(b"23:59:59.5 01 03 00 00 00 02 C4 0B\n00:00:00.5 01 03 04 00 00 00 01 3B F3")
    assert [item.at for item in midnight.items] == [86399.5, 86400.5]
    assert midnight.notes == ()


def test_a_number_of_hundreds_of_digits_is_not_a_time() -> None:
    assert not read_modbus_log(b"1" * 400 + b".000000 01 03 00 00 00 02 C4 0B").timed


def test_colours_of_a_terminal_are_not_read() -> None:
    coloured = b"\x1b[32m[01][03][00][00][00][02][C4][0B]\x1b[0m\n\x1b[1;31m<01><83><02><C0><F1>\x1b[0m\n"
    items = read_modbus_log(coloured).items
    assert [item.data.hex() for item in items if isinstance(item, LoggedBytes)] == ["010300000002c40b", "018302c0f1"]


def test_a_line_of_thousands_of_digits_is_bytes() -> None:
    items = read_modbus_log(b"01" * 3000).items
    assert [item.data for item in items if isinstance(item, LoggedBytes)] == [b"\1" * 3000]
