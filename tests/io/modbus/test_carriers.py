"""Every carrier, both clients, both servers: the same methods and the same values."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Awaitable, Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar, assert_type

import pytest

from barewire import AsyncModbusClient, AsyncModbusServer, ModbusClient, ModbusServer
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.endpoint import CARRIERS, Endpoint
from barewire.io.modbus import async_client
from barewire.io.modbus.carriers import timing_in_words
from barewire.io.ports import async_links
from barewire.io.ports.pty import PseudoTerminal
from barewire.modbus import ReadHoldingRegisters, Table, WriteSingleRegister
from tests.certificates import tls_url
from tests.helpers import refused
from tests.io.peers import answer, honest, peer, read_exactly
from tests.io.schemes import NETWORK, NUMBERED, SERIAL, TUNNELS

T = TypeVar("T")

URLs = Mapping[str, str]


@pytest.fixture(scope="module")
def urls(certificates: Path) -> Iterator[URLs]:
    """A server on every carrier, each with units 1 and 2."""
    wanted = {scheme: f"{scheme}://127.0.0.1:0" for scheme in NETWORK}
    wanted |= {scheme: f"{scheme}://pty?baudrate=115200" for scheme in SERIAL}
    wanted["tls"] = tls_url(certificates, "server", roles="any")
    hosts = {scheme: ModbusServer(url, units={1: Table(), 2: Table()}) for scheme, url in wanted.items()}
    for host in hosts.values():
        host.start()
    found = {scheme: host.url for scheme, host in hosts.items()}
    place = found["tls"].partition("?")[0].removeprefix("tls://")
    found["tls"] = tls_url(certificates, "operator", place)
    yield found
    for host in hosts.values():
        host.close()


def blocking(url: str, exchange: Callable[[Any], Any]) -> None:
    """Run the coroutine `exchange` with the blocking client, whose methods it awaits."""

    class Answered:
        def __init__(self, client: ModbusClient) -> None:
            self._client = client

        def __getattr__(self, name: str) -> Any:
            def message(*args: Any, **kwargs: Any) -> Awaitable[Any]:
                async def answer() -> Any:
                    return getattr(self._client, name)(*args, **kwargs)

                return answer()

            return message

        def at(self, **how: Any) -> Any:
            return Answered(self._client.at(**how))

    with ModbusClient(url) as client:
        asyncio.run(exchange(Answered(client)))


def waiting(url: str, exchange: Callable[[Any], Any]) -> None:
    """Run `exchange` with the asyncio client."""

    async def main() -> None:
        async with AsyncModbusClient(url) as client:
            await exchange(client)

    asyncio.run(main())


@pytest.mark.needs("openssl")
@pytest.mark.parametrize("how", [blocking, waiting])
@pytest.mark.parametrize("scheme", CARRIERS)
def test_both_clients_have_the_same_results_on_every_carrier(urls: URLs, scheme: str, how: Callable[..., None]) -> None:
    async def exchange(client: Any) -> None:
        await client.write_multiple_registers(0, tuple(range(100)))
        await client.write_single_register(0, 7)
        assert await client.read_holding_registers(0, 100) == (7, *range(1, 100))
        await client.write_single_coil(3, True)
        await client.write_multiple_coils(4, (True, False, True))
        assert await client.read_coils(3, 4) == (True, True, False, True)
        assert await client.read_discrete_inputs(0, 3) == (False, False, False)
        assert await client.read_input_registers(9, 2) == (0, 0)
        answer = await client.ask(ReadHoldingRegisters(address=1, quantity=1))
        assert answer.registers == (1,)
        await client.at(unit=2).write_single_register(address=1, value=99)
        assert await client.at(unit=2).read_holding_registers(address=1, quantity=1) == (99,)
        assert await client.read_holding_registers(1, 1) == (1,)

    how(urls[scheme], exchange)


@pytest.mark.parametrize("scheme", TUNNELS)
def test_a_serial_line_behind_tcp_has_broadcasts_and_time_outs(urls: URLs, scheme: str) -> None:
    with ModbusClient(urls[scheme]) as client:
        client.broadcast(WriteSingleRegister(50, 5), turnaround=0.05)
        assert client.read_holding_registers(50, 1) == (5,)
        assert client.at(unit=2).read_holding_registers(50, 1) == (5,)
        with pytest.raises(NoAnswer, match="unit 9 did not answer"):
            client.ask(ReadHoldingRegisters(0, 1), unit=9, timeout=0.1)


def test_the_types_of_the_methods() -> None:
    """Checked by mypy: the result is a value with one client and a coroutine with the other."""

    def blocking_client(client: ModbusClient) -> None:
        assert_type(client.read_holding_registers(0, 2), tuple[int, ...])
        assert_type(client.read_coils(address=0, quantity=2), tuple[bool, ...])
        assert_type(client.write_single_register(0, 2), None)

    async def asyncio_client(client: AsyncModbusClient) -> None:
        assert_type(await client.read_holding_registers(0, 2), tuple[int, ...])

    assert blocking_client.__name__ != asyncio_client.__name__
    assert "125 holding registers" in (ModbusClient.read_holding_registers.__doc__ or "")


@pytest.mark.parametrize("scheme", SERIAL)
def test_the_asyncio_server_on_a_serial_line(scheme: str) -> None:
    async def exchange() -> None:
        # Two pseudo-terminals and a task between them, which is the cable.
        ends = [PseudoTerminal(), PseudoTerminal()]
        loop = asyncio.get_running_loop()

        def carry(here: PseudoTerminal, there: PseudoTerminal) -> None:
            there.send(here.receive(0.0) or b"")

        for here, there in (ends, ends[::-1]):
            loop.add_reader(here.fileno(), carry, here, there)
        async with (
            AsyncModbusServer(f"{scheme}://{ends[0].path}", {1: Table()}),
            AsyncModbusClient(f"{scheme}://{ends[1].path}") as client,
        ):
            await client.write_multiple_registers(0, tuple(range(120)))
            assert await client.read_holding_registers(0, 120) == tuple(range(120))
            await client.broadcast(WriteSingleRegister(0, 9), turnaround=0.05)
            assert await client.read_holding_registers(0, 1) == (9,)
        for end in ends:
            loop.remove_reader(end.fileno())
            end.close()

    asyncio.run(exchange())


@pytest.mark.needs("openssl")
@pytest.mark.parametrize("scheme", NUMBERED)
def test_sixteen_requests_under_way(urls: URLs, scheme: str) -> None:
    async def exchange() -> None:
        async with AsyncModbusClient(urls[scheme], in_flight=16) as client:
            await asyncio.gather(*(client.write_single_register(register, 2 * register) for register in range(200)))
            got = await asyncio.gather(*(client.read_holding_registers(register, 1) for register in range(200)))
            assert got == [(2 * register,) for register in range(200)]

    asyncio.run(exchange())


def test_answers_in_any_order_are_matched_to_their_requests() -> None:
    def backwards(connection: socket.socket) -> None:
        """Collects sixteen questions and answers the last one first."""
        while True:
            requests = [read_exactly(connection, 12) for _ in range(16)]
            connection.sendall(b"".join(answer(request) for request in reversed(requests)))

    async def exchange(port: int) -> None:
        async with AsyncModbusClient(f"tcp://127.0.0.1:{port}", in_flight=16) as client:
            got = await asyncio.gather(*(client.read_holding_registers(register, 1) for register in range(64)))
            assert got == [(register,) for register in range(64)]

    with peer(backwards) as port:
        asyncio.run(exchange(port))


@pytest.mark.parametrize("in_flight", [1, 4])
def test_bytes_that_arrive_with_the_last_ones_of_a_handshake(
    in_flight: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """They arrive before the task that connects runs again; they answer nothing, and are counted or logged."""

    caplog.set_level("INFO", "barewire")

    async def connect_to_a_talker(
        endpoint: Endpoint, receive: Callable[[bytes], None], lose: Callable[[str], None]
    ) -> Any:
        link = await async_links.connect(endpoint, receive, lose)
        receive(bytes.fromhex("0BAD 0000 0005 01 03 02 00 63"))
        return link

    async def main(port: int) -> None:
        async with AsyncModbusClient(f"tcp://127.0.0.1:{port}", in_flight=in_flight) as client:
            assert [await client.read_holding_registers(0, 1) for _ in range(3)] == [(0,)] * 3
            assert client.bus.counters.strays == 1 or "0B AD 00 00" in caplog.text

    monkeypatch.setattr(async_client, "connect", connect_to_a_talker)
    with ModbusServer("tcp://127.0.0.1:0", {1: Table()}) as server:
        asyncio.run(main(int(server.url.rpartition(":")[2])))


def test_a_wrong_header_fails_all_pending_requests_and_the_next_request_works() -> None:
    def wrong(connection: socket.socket) -> None:
        read_exactly(connection, 3 * 12)
        connection.sendall(bytes.fromhex("0001 1234 0005 01 03 02 0000"))
        connection.recv(1)

    async def exchange(port: int) -> None:
        async with AsyncModbusClient(f"tcp://127.0.0.1:{port}?timeout=5", in_flight=16) as client:
            sent_requests = (client.read_holding_registers(register, 1) for register in range(3))
            failed = await asyncio.gather(*sent_requests, return_exceptions=True)
            assert len(failed) == 3
            for error in failed:
                assert isinstance(error, (NoAnswer, PortError))
                assert "protocol identifier is 12 34, Modbus has 00 00" in str(error)
            assert await client.read_holding_registers(7, 1) == (7,)

    with peer(wrong, honest) as port:
        asyncio.run(exchange(port))


@pytest.mark.parametrize(
    ("url", "in_flight", "message"),
    [
        ("rtu:///dev/null", 2, "one at a time"),
        ("tcp://127.0.0.1?any_transaction=1", 2, "one at a time"),
        ("tcp://127.0.0.1", 17, "expected 1..16"),
    ],
)
def test_in_flight_above_one_needs_transaction_numbers(url: str, in_flight: int, message: str) -> None:
    with refused(EncodeError, message):
        AsyncModbusClient(url, in_flight=in_flight)


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("rtu:///dev/x", "sends after 2.01 ms of silence (t3.5), accepts pauses up to 30 ms inside a frame"),
        (
            "rtu:///dev/x?latency=uart&baudrate=115200",
            "sends after 1.75 ms of silence (t3.5), accepts pauses up to 5 ms",
        ),
        ("rtu:///dev/x?latency=tunnel&patience=0.5", "accepts pauses up to 500 ms inside a frame"),
        ("rtu:///dev/x?patience=strict", "accepts pauses up to 0.86 ms (t1.5) inside a frame"),
        ("rtu+tcp://host:4001", "waits for no silence, accepts pauses up to 200 ms inside a frame"),
    ],
)
def test_the_times_of_a_line_in_words(url: str, message: str) -> None:
    assert message in timing_in_words(Endpoint.parse(url))
