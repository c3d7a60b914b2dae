"""A client that is used inside one of its own callbacks, while it holds the line: an error, not a wait for ever."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from barewire import ModbusClient, ModbusServer, Table
from barewire.errors import EncodeError
from tests.helpers import free_port
from tests.interrupts import in_a_thread

TEXT = "the client is used inside one of its own callbacks (watch=, a handler of its log, ...)"


@pytest.fixture
def url() -> Iterator[str]:
    with ModbusServer("tcp://127.0.0.1:0", {1: Table()}) as server:
        yield server.url


def ends(work: Callable[[], object]) -> BaseException | None:
    """The error of `work`, in a thread of its own, which must end."""
    try:
        in_a_thread(work, 20, "the line")
    except AssertionError:
        raise
    except BaseException as error:
        return error
    return None


USES: list[Callable[[ModbusClient], object]] = [
    lambda client: client.read_holding_registers(0, 1),
    lambda client: client.at(unit=2).read("adxl", "Status"),
    lambda client: client.read_device_identification(),
    lambda client: client.open(),
]


@pytest.mark.parametrize("use", USES)
def test_in_watch(url: str, use: Callable[[ModbusClient], object]) -> None:
    inside = True

    def watch(direction: str, data: bytes) -> None:
        if inside:
            use(client)

    client = ModbusClient(url, timeout=30, watch=watch)
    error = ends(lambda: client.read_holding_registers(0, 1))
    assert isinstance(error, EncodeError)
    assert TEXT in str(error)
    inside = False
    assert client.read_holding_registers(0, 1) == (0,)
    client.close()


def test_in_a_handler_of_the_log(caplog: pytest.LogCaptureFixture) -> None:
    errors: list[BaseException] = []

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            try:
                client.read_holding_registers(0, 1)
            except EncodeError as error:
                errors.append(error)

    handler, logger = Handler(), logging.getLogger("barewire.modbus.client")
    client = ModbusClient(f"tcp://127.0.0.1:{free_port()}", lazy=True)
    with caplog.at_level(logging.INFO, logger.name):
        logger.addHandler(handler)
        try:
            for work in (lambda: client.read_holding_registers(0, 1), client.open):
                assert "refused" in str(ends(work))
        finally:
            logger.removeHandler(handler)
    assert [str(error)[: len(TEXT)] for error in errors] == [TEXT, TEXT]


def test_another_client_may_be_used_in_a_callback(url: str) -> None:
    heard: list[Any] = []
    with ModbusClient(url, timeout=30) as other:

        def watch(direction: str, data: bytes) -> None:
            heard.append(other.read_holding_registers(0, 1))

        with ModbusClient(url, timeout=30, watch=watch) as client:
            assert ends(lambda: client.read_holding_registers(0, 1)) is None
    assert heard == [(0,), (0,)]


def test_threads_that_wait_for_each_other_are_not_refused(url: str) -> None:
    with ModbusClient(url, timeout=30) as client:

        def ask() -> None:
            for _ in range(200):
                assert client.read_holding_registers(0, 1) == (0,)

        threads = [threading.Thread(target=ask) for _ in range(4)]
        for thread in threads:
            thread.start()
        assert ends(ask) is None
        for thread in threads:
            thread.join()
