"""The text gateway on a socket: several connections on one bus, slow ones among them."""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

import pytest

from barewire import CanopenServer
from barewire.canopen import CanFrame, ErrorFrame
from barewire.devices.sim import simulator
from barewire.errors import PortError
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire.io.canopen.gateway_server import GATEWAY_CONNECTIONS, UNREAD_LIMIT, CanopenGateway, serve_gateway


@asynccontextmanager
async def gateway(name: str) -> AsyncIterator[tuple[CanopenGateway, AsyncCanopenClient]]:
    """A simulated AZ3 as node 5 on a virtual bus, and a gateway to it."""
    url = f"can://virtual/{name}"
    machine = simulator("az3", 0.0, node=5)
    assert machine.canopen is not None
    with CanopenServer(url, device=machine.canopen):
        async with AsyncCanopenClient(url) as client, await serve_gateway(client) as made:
            yield made, client


class TextClient:
    """A client such as netcat."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    @classmethod
    async def at(cls, made: CanopenGateway) -> TextClient:
        return cls(*await asyncio.open_connection("127.0.0.1", made.port))

    def say(self, text: str) -> None:
        self.writer.write(text.encode())

    async def hear(self) -> str:
        line = await asyncio.wait_for(self.reader.readline(), 30)
        assert line == b"" or line.endswith(b"\r\n"), line
        return line.decode().rstrip("\r\n")

    async def ask(self, line: str) -> str:
        self.say(line + "\n")
        return await self.hear()

    async def leave(self) -> None:
        self.writer.close()
        await self.writer.wait_closed()


def play(body: Callable[[], Coroutine[Any, Any, None]]) -> None:
    asyncio.run(asyncio.wait_for(body(), 120))


def test_lines_are_answered_in_order_in_whatever_pieces_they_come() -> None:
    async def body() -> None:
        async with gateway("gateway-lines") as (made, _):
            person = await TextClient.at(made)
            text = "[1] 5 r 0x1000 0 x32\r\n# nothing\n\n[2] 5 w 0x1017 0 u16 0\n[3] nonsense\n[4] 5 r 0x1017 0 u16\n"
            for at in range(0, len(text), 7):
                person.say(text[at : at + 7])
                await asyncio.sleep(0)
            answers = [await person.hear() for _ in range(4)]
            assert answers[0].startswith("[1] 0x")
            assert answers[1] == "[2] OK"
            assert answers[2].startswith("[3] ERROR:101 #")
            assert answers[3] == "[4] 0"
            await person.leave()

    play(body)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_every_line_end_is_accepted(end: str) -> None:
    """Terminal programs send CR alone."""

    async def body() -> None:
        async with gateway(f"gateway-ends-{end.encode().hex()}") as (made, _):
            person = await TextClient.at(made)
            for part in f"[1] set node 5{end}[2] info version{end}[3] set node 6{end}":
                person.say(part)
                await asyncio.sleep(0)
            for number in (1, 2, 3):
                assert (await person.hear()).startswith(f"[{number}] ")
            await person.leave()

    play(body)


def test_bytes_that_are_not_text_are_a_syntax_error() -> None:
    async def body() -> None:
        async with gateway("gateway-binary") as (made, _):
            person = await TextClient.at(made)
            person.writer.write(b"\xff\xfb\x01\x00\x80" * 20 + b"\n\0\n[1] \xc3\x28\n")
            for _ in range(2):
                assert (await person.hear()).startswith("[0] ERROR:101 #")
            assert (await person.hear()).startswith("[1] ERROR:101 #")
            assert await person.ask("[2] set node 5") == "[2] OK"
            await person.leave()

    play(body)


def test_a_bus_without_remote_frames_has_no_guarding() -> None:
    """A guarding request there once ended the whole gateway."""

    async def body() -> None:
        async with gateway("gateway-remote") as (_, client):
            client.bus.name = "socketcand/127.0.0.1:1/can0"  # what python-can says over it has no remote frames
            async with await serve_gateway(client) as made:
                person = await TextClient.at(made)
                refusal = await person.ask("[1] 5 enable guarding 20 2")
                assert refusal.startswith("[1] ERROR:100 #")
                assert "enable heartbeat" in refusal
                assert await person.ask("[2] 5 disable guarding") == "[2] OK"
                assert await person.ask("[3] 5 enable heartbeat 1000") == "[3] OK"
                assert not made.ended.is_set()
                await person.leave()

    play(body)


def test_a_client_that_closes_its_sending_half_is_answered() -> None:
    async def body() -> None:
        async with gateway("gateway-eof") as (made, _):
            person = await TextClient.at(made)
            person.say("[1] 5 r 0x1017 0 u16\n[2] info version")  # no line end, as `printf` leaves it
            person.writer.write_eof()
            assert (await person.hear()).startswith("[1] ")
            assert (await person.hear()).startswith("[2] ")
            assert await person.hear() == ""
            await person.leave()

    play(body)


def test_all_connections_get_boot_ups_and_guarding_events() -> None:
    async def body() -> None:
        async with gateway("gateway-notices") as (made, _):
            one, other = await TextClient.at(made), await TextClient.at(made)
            assert await other.ask("[1] set sdo_timeout 300") == "[1] OK"
            assert await one.ask("[1] 5 reset node") == "[1] OK"
            assert await one.hear() == "1 5 BOOT_UP"
            assert await other.hear() == "1 5 BOOT_UP"
            assert await other.ask("[2] 99 enable guarding 20 2") == "[2] OK"
            assert await other.hear() == "1 99 ERROR 201 #no answer to guarding"
            assert await other.ask("[3] 99 disable guarding") == "[3] OK"
            await one.leave()
            await other.leave()

    play(body)


def test_a_silent_node_does_not_delay_other_connections() -> None:
    async def body() -> None:
        async with gateway("gateway-dead") as (made, _):
            patient, quick = await TextClient.at(made), await TextClient.at(made)
            assert await patient.ask("[1] set sdo_timeout 3000") == "[1] OK"
            patient.say("[2] 99 r 0x1000 0\n")
            for number in range(50):
                assert (await quick.ask(f"[{number}] 5 r 0x1017 0 u16")).startswith(f"[{number}] ")
            assert (await patient.hear()).startswith("[2] ERROR:0x05040000 #")
            await patient.leave()
            await quick.leave()

    play(body)


def test_a_closed_connection_leaves_no_task_and_no_lock() -> None:
    async def body() -> None:
        async with gateway("gateway-leaving") as (made, _):
            gone = await TextClient.at(made)
            gone.say("[1] set sdo_timeout 60000\n[2] 99 r 0x1000 0\n")
            assert await gone.hear() == "[1] OK"
            gone.writer.transport.abort()
            person = await TextClient.at(made)
            assert (await person.ask("[1] 5 r 0x1017 0 u16")).startswith("[1] ")
            await person.leave()

    play(body)


def test_a_line_that_is_too_long_is_refused_and_the_next_is_read() -> None:
    async def body() -> None:
        async with gateway("gateway-long") as (made, _):
            person = await TextClient.at(made)
            person.say("[1] 5 w 0x2000 0 d " + "A" * 200_000)
            assert (await person.hear()).startswith("[0] ERROR:600 #")
            assert await person.ask("\n[2] set node 5") == "[2] OK"
            await person.leave()

    play(body)


def test_a_connection_that_is_not_read_loses_notices_and_gets_their_number() -> None:
    async def body() -> None:
        async with gateway("gateway-slow") as (made, _):
            person = await TextClient.at(made)
            assert await person.ask("[1] set rpdo 1 0x7FF event 1 0x2000 0 u64") == "[1] OK"
            (connection,) = made._connections
            for number in range(2_000_000):  # the system's buffers take some megabytes first
                connection._feed_notices(CanFrame(0x7FF, number.to_bytes(8, "little")), 0.0)
                if connection._lost == 3:
                    break
            assert connection._writer.transport.get_write_buffer_size() < UNREAD_LIMIT + 1000
            while not connection._writer.transport.get_write_buffer_size() < 100:
                await person.hear()
            connection._feed_notices(CanFrame(0x7FF, bytes(8)), 0.0)
            while not (line := await person.hear()).startswith("#"):
                pass
            assert line == "#3 notices were lost: they were not read"
            await person.leave()

    play(body)


def test_bus_off_is_a_notice() -> None:
    async def body() -> None:
        async with gateway("gateway-bus-off") as (made, client):
            person = await TextClient.at(made)
            assert await person.ask("[1] set node 5") == "[1] OK"
            client.bus._report(ErrorFrame(0x40), 0.0)
            assert await person.hear() == "1 ERROR 301 #bus off"
            client.bus._report(ErrorFrame(0x04, bytes([0, 0x20])), 0.0)
            assert (await person.hear()).startswith("1 ERROR 300 #")
            client.bus._report(ErrorFrame(0x04, bytes([0, 0x04])), 0.0)  # a warning, not told
            assert await person.ask("[2] set node 5") == "[2] OK"
            await person.leave()

    play(body)


def test_the_end_of_the_bus_ends_the_gateway() -> None:
    async def body() -> None:
        async with gateway("gateway-gone") as (made, client):
            person = await TextClient.at(made)
            assert await person.ask("[1] set node 5") == "[1] OK"
            client.bus._fail("the adapter was unplugged")
            await asyncio.wait_for(made.ended.wait(), 30)
            assert "unplugged" in str(made.failure)
            assert await person.hear() == ""
            await person.leave()

    play(body)


def test_connections_above_the_limit_are_refused() -> None:
    async def body() -> None:
        async with gateway("gateway-many") as (made, _):
            people = [await TextClient.at(made) for _ in range(GATEWAY_CONNECTIONS)]
            for person in people:
                assert await person.ask("[1] set node 5") == "[1] OK"
            late = await TextClient.at(made)
            assert (await late.hear()).startswith("[0] ERROR:600 #")
            for person in [*people, late]:
                await person.leave()

    play(body)


def test_fifty_connections_at_the_same_time() -> None:
    async def body() -> None:
        async with gateway("gateway-fifty") as (made, _):
            people = [await TextClient.at(made) for _ in range(50)]

            async def talk(number: int) -> None:
                person = people[number]
                for turn in range(1, 6):
                    assert await person.ask(f"[{100 * number + turn}] 5 r 0x1000 0 x32") == (
                        f"[{100 * number + turn}] 0x00020192"
                    )
                await person.leave()

            await asyncio.gather(*map(talk, range(50)))

    play(body)


def test_a_broken_connection_ends_its_transfer() -> None:
    async def body() -> None:
        async with gateway("gateway-broken") as (made, _):
            person = await TextClient.at(made)
            assert await person.ask("[1] set sdo_timeout 60000") == "[1] OK"
            person.say("[2] 9 r 0x1000 0 u32\n")  # there is no node 9
            while not made.client.bus._locks._queue:
                await asyncio.sleep(0.01)
            sock = person.writer.get_extra_info("socket")
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset, no farewell
            person.writer.transport.abort()
            while made._connections:
                await asyncio.sleep(0.01)
            other = await TextClient.at(made)
            assert not made.client.bus._locks._queue
            assert await other.ask("[3] 5 r 0x1000 0 x32") == "[3] 0x00020192"
            await other.leave()

    play(body)


def test_a_client_that_sends_no_more_still_gets_its_response() -> None:
    """As `nc -N` does: the end of what is said is not the end of the connection."""

    async def body() -> None:
        async with gateway("gateway-half") as (made, _):
            person = await TextClient.at(made)
            person.say("[1] 5 r 0x1000 0 x32\n")
            person.writer.write_eof()
            assert await person.hear() == "[1] 0x00020192"
            assert await person.hear() == ""
            await person.leave()

    play(body)


def test_a_port_in_use_is_a_port_error() -> None:
    async def body() -> None:
        async with gateway("gateway-taken") as (made, client):
            with pytest.raises(PortError, match="in use"):
                await serve_gateway(client, "127.0.0.1", made.port)

    play(body)
