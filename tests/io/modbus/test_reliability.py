"""The server killed, the cable unplugged, the task cancelled at any point: the next request works."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from barewire import AsyncModbusClient, ModbusClient, ModbusServer
from barewire.errors import NoAnswer, PortError
from barewire.io.engine.connections import BackOff
from barewire.modbus import ReadHoldingRegisters, WriteOutcomeUnknown, WriteSingleRegister
from tests.helpers import free_port, refused
from tests.io.peers import answer, full, honest, peer, read_exactly
from tests.io.schemes import EVERY_SCHEME_WITHOUT_TLS, SERIAL

# Connections that fail -----------------------------------------------------------------------------------------------


def restarted(url: str) -> Callable[[], ModbusServer]:
    def start() -> ModbusServer:
        host = ModbusServer(url, units=full())
        host.start()
        return host

    return start


@EVERY_SCHEME_WITHOUT_TLS
def test_a_blocking_client_reconnects_to_a_restarted_server(scheme: str, tmp_path: Path) -> None:
    place = f"{tmp_path}/line" if scheme in SERIAL else "127.0.0.1:0"
    first = restarted(f"{scheme}://{place}")()
    start = restarted(first.url)
    with ModbusClient(first.url) as client:
        assert client.read_holding_registers(7, 1) == (7,)
        first.close()
        with pytest.raises((PortError, NoAnswer)):
            client.at(timeout=0.3).read_holding_registers(8, 1)
        second = start()
        assert client.read_holding_registers(9, 1) == (9,)
        second.close()
        third = start()  # without a request meanwhile: the client detects it before it sends
        assert client.read_holding_registers(10, 1) == (10,)
        third.close()


@EVERY_SCHEME_WITHOUT_TLS
def test_an_asyncio_client_reconnects_to_a_restarted_server(scheme: str, tmp_path: Path) -> None:
    place = f"{tmp_path}/line" if scheme in SERIAL else "127.0.0.1:0"
    first = restarted(f"{scheme}://{place}")()
    start = restarted(first.url)

    async def main() -> None:
        async with AsyncModbusClient(first.url) as client:
            assert await client.read_holding_registers(7, 1) == (7,)
            await asyncio.to_thread(first.close)
            with pytest.raises((PortError, NoAnswer)):
                await client.at(timeout=0.3).read_holding_registers(8, 1)
            second = await asyncio.to_thread(start)
            assert await client.read_holding_registers(9, 1) == (9,)
            await asyncio.to_thread(second.close)
            third = await asyncio.to_thread(start)
            assert await client.read_holding_registers(10, 1) == (10,)
            await asyncio.to_thread(third.close)

    asyncio.run(main())


def hang_up(connection: socket.socket) -> None:
    read_exactly(connection, 12)


def test_a_read_is_repeated_on_a_new_connection_and_a_write_is_not() -> None:
    with peer(hang_up, honest) as port, ModbusClient(f"tcp://127.0.0.1:{port}") as client:
        assert client.ask(ReadHoldingRegisters(7, 1), retries=1).registers == (7,)
    with (
        peer(hang_up, honest) as port,
        ModbusClient(f"tcp://127.0.0.1:{port}") as client,
        refused(WriteOutcomeUnknown, "the other side closed the connection; whether it was carried out is unknown"),
    ):
        client.ask(WriteSingleRegister(7, 1), retries=5)

    async def main(port: int) -> None:
        async with AsyncModbusClient(f"tcp://127.0.0.1:{port}") as client:
            assert (await client.ask(ReadHoldingRegisters(7, 1), retries=1)).registers == (7,)

    with peer(hang_up, honest) as port:
        asyncio.run(main(port))


def test_between_attempts_there_is_a_pause_and_the_error_names_it() -> None:
    port = free_port()
    with ModbusClient(f"tcp://127.0.0.1:{port}?timeout=0.01", lazy=True, jitter=lambda: 16.5) as client:  # pause 1.1 s
        with refused(PortError, f"127.0.0.1:{port}: connection refused"):
            client.read_holding_registers(0, 1)
        with refused(PortError, f"127.0.0.1:{port}: connection refused; tried again in "):
            client.read_holding_registers(0, 1)
        with socket.create_server(("127.0.0.1", port)), pytest.raises(NoAnswer):
            client.at(timeout=30.0).ask(ReadHoldingRegisters(0, 1), timeout=0.1)  # waits for the pause, then connects


def test_pauses_grow_to_a_limit_and_start_again_after_success() -> None:
    pauses = BackOff(lambda: 0.5, first=1.0, longest=10.0)
    now, waits = 0.0, []
    for _ in range(8):
        pauses.failed(now, "connection refused")
        waits.append(pauses.wait(now))
        now += waits[-1]
    assert waits == [1, 2, 4, 8, 10, 10, 10, 10]
    pauses.reset()
    assert pauses.wait(now) == 0.0
    pauses.failed(now, "again")
    assert pauses.wait(now) == 1.0


@pytest.mark.parametrize("chance", [0.0, 0.25, 1.0])
def test_pauses_vary_at_random_within_bounds(chance: float) -> None:
    pauses = BackOff(lambda: chance, first=1.0, longest=10.0, jitter=0.5)
    for _ in range(2000):
        pauses.failed(0.0, "")
    assert pauses.wait(0.0) == 10.0 * (1 + 0.5 * (chance - 0.5))


def test_a_closed_client_stays_closed() -> None:
    with peer(honest) as port:
        client = ModbusClient(f"tcp://127.0.0.1:{port}")
        client.close()
        with refused(PortError, "the client was closed"):
            client.read_holding_registers(0, 1)


# Cancellation --------------------------------------------------------------------------------------------------------


def slow(connection: socket.socket) -> None:
    """Answers after a while."""
    while True:
        request = read_exactly(connection, 12)
        time.sleep(0.003)
        connection.sendall(answer(request))


@pytest.mark.parametrize("in_flight", [1, 4])
def test_cancelled_after_any_number_of_turns_of_the_loop_over_tcp(in_flight: int) -> None:
    async def main(port: int) -> None:
        for turns in range(25):
            client = AsyncModbusClient(f"tcp://127.0.0.1:{port}", in_flight=in_flight, lazy=turns % 2 == 0)
            async with client:
                task = asyncio.ensure_future(client.read_holding_registers(1000, 1))
                for _ in range(turns):
                    await asyncio.sleep(0 if turns % 3 else 0.0005)
                task.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    assert await task == (1000,)
                assert await client.read_holding_registers(turns, 1) == (turns,)

    with peer(slow) as port:
        asyncio.run(main(port))


@pytest.mark.parametrize("scheme", SERIAL)
def test_cancelled_at_any_time_on_a_serial_line(scheme: str) -> None:
    async def main(url: str) -> None:
        async with AsyncModbusClient(url, late_window=30) as client:
            for step in range(30):
                task = asyncio.ensure_future(client.read_holding_registers(299 - step, 1))
                await asyncio.sleep(0.0005 * step)
                task.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    assert await task == (299 - step,)
                assert await client.read_holding_registers(step, 1) == (step,)

    with ModbusServer(f"{scheme}://pty?baudrate=115200", units=full()) as host:
        asyncio.run(main(host.url))


def test_cancelled_while_it_waits_for_its_turn() -> None:
    async def main(port: int) -> None:
        async with AsyncModbusClient(f"tcp://127.0.0.1:{port}") as client:
            tasks = [asyncio.ensure_future(client.read_holding_registers(register, 1)) for register in range(12)]
            await asyncio.sleep(0)
            for task in tasks[1::2]:
                task.cancel()
            got = await asyncio.gather(*tasks, return_exceptions=True)
            assert got[::2] == [(register,) for register in range(0, 12, 2)]
            assert all(isinstance(error, asyncio.CancelledError) for error in got[1::2])
            assert await client.read_holding_registers(5, 1) == (5,)

    with peer(slow) as port:
        asyncio.run(main(port))


# Turns ---------------------------------------------------------------------------------------------------------------


def test_a_busy_unit_does_not_delay_the_others() -> None:
    order: list[int] = []
    go = threading.Event()

    def watching(connection: socket.socket) -> None:
        while True:
            request = read_exactly(connection, 12)
            order.append(request[6])
            go.wait(60)  # the first is answered when all requests are waiting
            connection.sendall(answer(request))

    async def tasks(port: int) -> None:
        async with AsyncModbusClient(f"tcp://127.0.0.1:{port}") as client:
            busy = [client.at(unit=1).read_holding_registers(register, 1) for register in range(20)]
            late = [client.at(unit=2).read_holding_registers(register, 1) for register in range(3)]
            together = asyncio.gather(*busy, *late)
            await asyncio.sleep(0.1)
            go.set()
            await together

    with peer(watching) as port:
        asyncio.run(tasks(port))
    assert max(place for place, unit in enumerate(order) if unit == 2) <= 6

    order.clear()
    go.clear()
    with peer(watching) as port, ModbusClient(f"tcp://127.0.0.1:{port}") as client:
        threads = [
            threading.Thread(target=client.at(unit=unit).read_holding_registers, args=(0, 1))
            for unit in [1] * 20 + [2] * 3
        ]
        for thread in threads:
            thread.start()
        give_up = time.monotonic() + 60
        while len(client.connection._tickets) < len(threads) - 1 and time.monotonic() < give_up:
            time.sleep(0.001)  # until all but the first wait for their turn
        go.set()
        for thread in threads:
            thread.join(60)
    assert sorted(order) == [1] * 20 + [2] * 3
    assert max(place for place, unit in enumerate(order) if unit == 2) <= 6


# Quirks --------------------------------------------------------------------------------------------------------------


def quirky(change: Callable[[bytes], bytes]) -> Callable[[socket.socket], None]:
    def main(connection: socket.socket) -> None:
        while True:
            request = read_exactly(connection, 12)
            if request[7] == 0x08:
                connection.sendall(change(request[:5] + b"\x06" + request[6:12]))
            else:
                connection.sendall(change(answer(request)))

    return main


@pytest.mark.parametrize(
    ("option", "change"),
    [
        ("any_unit", lambda frame: frame[:6] + b"\xff" + frame[7:]),
        ("any_transaction", lambda frame: b"\0\0" + frame[2:]),
    ],
)
def test_a_quirk_is_tolerated_only_with_its_option(option: str, change: Callable[[bytes], bytes]) -> None:
    with peer(quirky(change)) as port:
        with (
            ModbusClient(f"tcp://127.0.0.1:{port}?timeout=2") as client,
            pytest.raises(NoAnswer, match="received instead"),
        ):
            client.read_holding_registers(7, 1)
        with ModbusClient(f"tcp://127.0.0.1:{port}?{option}=1") as client:
            assert client.read_holding_registers(7, 1) == (7,)


def test_with_any_transaction_a_late_answer_is_not_delivered() -> None:
    def late(connection: socket.socket) -> None:
        held = b""
        while True:
            request = read_exactly(connection, 12)
            reply = request[:5] + b"\x06" + request[6:12] if request[7] == 0x08 else answer(request)
            if request[8:10] == b"\0\x0a":
                held = reply  # the answer for register 10 is sent with the next one
            else:
                connection.sendall(b"\0\0" + held[2:] + b"\0\0" + reply[2:] if held else b"\0\0" + reply[2:])
                held = b""

    with peer(late) as port, ModbusClient(f"tcp://127.0.0.1:{port}?any_transaction=1") as client:
        with pytest.raises(NoAnswer):
            client.at(timeout=0.2).read_holding_registers(10, 1)
        assert client.read_holding_registers(20, 1) == (20,)
        assert client.bus.counters.late == 1
