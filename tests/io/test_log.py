"""The log: names, levels, its limit, and that a program without `logging` does not load it."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest

from barewire.io.log import INTERVAL, LINES, PortLog
from tests.test_footprint import loaded

NAME = "barewire.test"


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def log(clock: Clock, caplog: pytest.LogCaptureFixture) -> Iterator[PortLog]:
    with caplog.at_level(logging.INFO, NAME):
        yield PortLog(NAME, "tcp://plc:502", clock)


def texts(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage().removeprefix("tcp://plc:502: ") for record in caplog.records]


def test_levels_and_the_beginning_of_a_line(log: PortLog, caplog: pytest.LogCaptureFixture) -> None:
    log.info("a", "connected")
    log.warning("b", "refused")
    error = ValueError("x")
    log.error("c", "failed", error)
    assert [(record.name, record.levelname, record.getMessage()) for record in caplog.records] == [
        (NAME, "INFO", "tcp://plc:502: connected"),
        (NAME, "WARNING", "tcp://plc:502: refused"),
        (NAME, "ERROR", "tcp://plc:502: failed"),
    ]
    assert [record.exc_info and record.exc_info[1] for record in caplog.records] == [None, None, error]


def test_ten_lines_of_a_kind_in_a_minute_then_the_number_of_the_others(
    log: PortLog, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    for number in range(500):
        log.info("flood", f"line {number}")
        clock.now += 0.01
    log.info("other", "another kind has a limit of its own")
    assert texts(caplog) == [*(f"line {number}" for number in range(LINES)), "another kind has a limit of its own"]
    caplog.clear()
    clock.now = 100.0 + INTERVAL
    log.info("flood", "line 500")
    log.info("flood", "line 501")
    assert texts(caplog) == ["line 500 (490 more like this in the last 60 s)", "line 501"]


def test_what_was_left_out_is_logged_at_the_end(log: PortLog, clock: Clock, caplog: pytest.LogCaptureFixture) -> None:
    for number in range(13):
        log.warning("flood", f"line {number}")
    clock.now += 5.0
    log.flush()
    log.flush()
    assert texts(caplog)[LINES:] == ["line 12 (2 more like this in the last 5 s)"]
    assert caplog.records[-1].levelname == "WARNING"
    for number in range(13):
        log.warning("flood", f"line {number}")
    clock.now += 0.2
    log.flush()
    assert texts(caplog)[-1] == "line 12 (2 more like this in the last second)"


def test_kinds_beyond_the_limit_share_one(log: PortLog, clock: Clock, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(LINES + 1):
        log.info("first", "x")
    for number in range(3000):
        for _ in range(2):
            log.info(number, f"y {number}")
    assert texts(caplog).count("x") == LINES
    assert len(caplog.records) <= 2 * 250 + 2 * LINES
    assert len(log._kinds) <= 251
    caplog.clear()
    clock.now += INTERVAL
    log.info("new", "z")
    assert [text for text in texts(caplog) if text[0] != "y"] == ["x", "z"]  # no line is lost
    assert texts(caplog)[-2].startswith("y 2999 (549")
    assert list(log._kinds) == ["new"]


def test_a_kind_in_use_is_not_forgotten_with_the_old_ones(
    log: PortLog, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    log.info("used", "x")
    for number in range(249):
        log.info(number, "y")
    clock.now += INTERVAL
    for _ in range(LINES + 1):
        log.info("used", "x")
    log.info("new", "z")
    assert list(log._kinds) == ["used", "new"]
    caplog.clear()
    log.flush()
    assert texts(caplog) == ["x"]


def test_a_long_text_is_cut_also_in_the_traceback(log: PortLog, caplog: pytest.LogCaptureFixture) -> None:
    def read_sensor() -> None:
        raise ValueError("9" * 1_000_000)

    try:
        read_sensor()
    except ValueError as error:
        log.error("a", f"failed: {error}", error)
    assert len(caplog.text) < 5000
    assert "(1000008 characters)" in texts(caplog)[0]
    assert "read_sensor" in caplog.text
    assert "ValueError: 999" in caplog.text


def test_a_level_that_is_off_uses_up_no_lines(log: PortLog, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.ERROR, NAME):
        for _ in range(LINES):
            log.info("a", "off")
    log.info("a", "on")
    assert texts(caplog) == ["on"]


def test_a_filter_that_fails_raises_nothing(log: PortLog, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(record: logging.LogRecord) -> bool:
        raise RuntimeError("a wrong filter")

    monkeypatch.setattr(logging.getLogger(NAME), "filters", [fail])
    log.error("a", "x", ValueError())
    monkeypatch.setattr(logging.getLogger(NAME), "level", logging.DEBUG)
    watch = log.watch()
    assert watch is not None
    watch("sent", b"")


def test_frames_are_logged_if_debug_is_on_when_the_port_is_opened(
    log: PortLog, caplog: pytest.LogCaptureFixture
) -> None:
    assert log.watch() is None
    with caplog.at_level(logging.DEBUG, NAME):
        watches = log.watch(), log.watch("10.0.0.1:999")
    with caplog.at_level(logging.DEBUG, NAME):
        for watch in watches:
            assert watch is not None
            watch("sent", b"\x01\xab")
    assert texts(caplog) == ["sent 01 AB", "10.0.0.1:999: sent 01 AB"]


@pytest.mark.parametrize(
    ("line", "loads"), [("info('a', 'b')", False), ("watch()", False), ("warning('a', 'b')", True)]
)
def test_logging_is_loaded_for_warnings_only(line: str, loads: bool) -> None:
    found = loaded(f"from barewire.io.log import PortLog; PortLog('barewire', 'x').{line}")
    assert ("logging" in found) is loads
