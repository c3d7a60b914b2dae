"""The text gateway on a socket: several connections on one bus, slow ones among them; and as a node of the bus."""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

import pytest

from barewire import CanopenClient, CanopenServer
from barewire.canopen import CanFrame, ErrorFrame
from barewire.devices.sim import simulator
from barewire.errors import EncodeError, PortError
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire_workbench.ascii_gateway.own_node import gateway_node
from barewire_workbench.live.ascii_gateway import GATEWAY_CONNECTIONS, UNREAD_LIMIT, CanopenGateway, serve_gateway
from tests.helpers import PATIENCE, refused


@asynccontextmanager
async def gateway(name: str) -> AsyncIterator[tuple[CanopenGateway, AsyncCanopenClient]]:
    """A simulated AZ3 as node 5 on a virtual bus, and a gateway to it."""
    url = f"can://virtual/{name}"
    machine = simulator("az3", 0.0, node=5)
    assert machine.canopen is not None
    with CanopenServer(url, device=machine.canopen):
        async with AsyncCanopenClient(url, timeout=PATIENCE) as client, await serve_gateway(client) as made:
            yield made, client


class TextClient:
    """A client such as netcat."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    @classmethod
    async def connect(cls, made: CanopenGateway) -> TextClient:
        return cls(*await asyncio.open_connection("127.0.0.1", made.port))

    def send_text(self, text: str) -> None:
        self.writer.write(text.encode())

    async def read_line(self) -> str:
        line = await asyncio.wait_for(self.reader.readline(), 30)
        assert line == b"" or line.endswith(b"\r\n"), line
        return line.decode().rstrip("\r\n")

    async def ask(self, line: str) -> str:
        self.send_text(line + "\n")
        return await self.read_line()

    async def close(self) -> None:
        self.writer.close()
        await self.writer.wait_closed()


def play(body: Callable[[], Coroutine[Any, Any, None]]) -> None:
    asyncio.run(asyncio.wait_for(body(), 120))


def test_lines_are_answered_in_order_in_whatever_pieces_they_come() -> None:
    async def body() -> None:
        async with gateway("gateway-lines") as (made, _):
            terminal = await TextClient.connect(made)
            text = "[1] 5 r 0x1000 0 x32\r\n# nothing\n\n[2] 5 w 0x1017 0 u16 0\n[3] nonsense\n[4] 5 r 0x1017 0 u16\n"
            for start in range(0, len(text), 7):
                terminal.send_text(text[start : start + 7])
                await asyncio.sleep(0)
            answers = [await terminal.read_line() for _ in range(6)]
            assert answers[0].startswith("[1] 0x")
            assert answers[1:3] == ["", ""]  # a comment and an empty line
            assert answers[3] == "[2] OK"
            assert answers[4].startswith("[3] ERROR:100 #")
            assert answers[5] == "[4] 0"
            await terminal.close()

    play(body)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_every_line_end_is_accepted(end: str) -> None:
    """Terminal programs send CR alone."""

    async def body() -> None:
        async with gateway(f"gateway-ends-{end.encode().hex()}") as (made, _):
            terminal = await TextClient.connect(made)
            for part in f"[1] set node 5{end}[2] info version{end}[3] set node 6{end}":
                terminal.send_text(part)
                await asyncio.sleep(0)
            for number in (1, 2, 3):
                assert (await terminal.read_line()).startswith(f"[{number}] ")
            await terminal.close()

    play(body)


def test_bytes_that_are_not_text_are_a_syntax_error() -> None:
    async def body() -> None:
        async with gateway("gateway-binary") as (made, _):
            terminal = await TextClient.connect(made)
            terminal.writer.write(b"\xff\xfb\x01\x00\x80" * 20 + b"\n\0\n[1] \xc3\x28\n")
            for _ in range(2):
                assert (await terminal.read_line()).startswith("[0] ERROR:101 #")
            assert (await terminal.read_line()).startswith("[1] ERROR:100 #")
            assert await terminal.ask("[2] set node 5") == "[2] OK"
            await terminal.close()

    play(body)


def test_a_bus_without_remote_frames_has_no_guarding() -> None:
    """A guarding request there once ended the whole gateway."""

    async def body() -> None:
        async with gateway("gateway-remote") as (_, client):
            client.bus.name = "socketcand/127.0.0.1:1/can0"  # python-can has no remote frames there
            async with await serve_gateway(client) as made:
                terminal = await TextClient.connect(made)
                refusal = await terminal.ask("[1] 5 enable guarding 20 2")
                assert refusal.startswith("[1] ERROR:100 #")
                assert "enable heartbeat" in refusal
                assert await terminal.ask("[2] 5 disable guarding") == "[2] OK"
                assert await terminal.ask("[3] 5 enable heartbeat 1000") == "[3] OK"
                assert not made.ended.is_set()
                await terminal.close()

    play(body)


def test_a_client_that_closes_its_sending_half_is_answered() -> None:
    async def body() -> None:
        async with gateway("gateway-eof") as (made, _):
            terminal = await TextClient.connect(made)
            terminal.send_text("[1] 5 r 0x1017 0 u16\n[2] info version")  # no line end, as `printf` leaves it
            terminal.writer.write_eof()
            assert (await terminal.read_line()).startswith("[1] ")
            assert (await terminal.read_line()).startswith("[2] ")
            assert await terminal.read_line() == ""
            await terminal.close()

    play(body)


def test_a_connection_gets_the_boot_ups_and_guarding_events_that_it_asked_for() -> None:
    async def body() -> None:
        async with gateway("gateway-notices") as (made, _):
            one, other = await TextClient.connect(made), await TextClient.connect(made)
            assert await other.ask("[1] boot_up_indication enable") == "[1] OK"
            assert await one.ask("[1] 5 reset node") == "[1] OK"
            assert await other.read_line() == "1 5 BOOT_UP"
            assert await one.ask("[2] 5 r 0x1017 0 u16") == "[2] 1000"  # and no line before
            assert await other.ask("[2] 99 enable guarding 20 2") == "[2] OK"
            assert await other.read_line() == "1 99 ERROR 201 #no answer to guarding"
            assert await other.ask("[3] 99 disable guarding") == "[3] OK"
            await one.close()
            await other.close()

    play(body)


def test_a_silent_node_does_not_delay_other_connections() -> None:
    async def body() -> None:
        async with gateway("gateway-dead") as (made, _):
            waiting, quick = await TextClient.connect(made), await TextClient.connect(made)
            assert await waiting.ask("[1] set sdo_timeout 3000") == "[1] OK"
            waiting.send_text("[2] 99 r 0x1000 0\n")
            for number in range(50):
                assert (await quick.ask(f"[{number}] 5 r 0x1017 0 u16")).startswith(f"[{number}] ")
            assert (await waiting.read_line()).startswith("[2] ERROR:0x05040000 #")
            await waiting.close()
            await quick.close()

    play(body)


def test_a_closed_connection_leaves_no_task_and_no_lock() -> None:
    async def body() -> None:
        async with gateway("gateway-leaving") as (made, _):
            aborted = await TextClient.connect(made)
            aborted.send_text("[1] set sdo_timeout 60000\n[2] 99 r 0x1000 0\n")
            assert await aborted.read_line() == "[1] OK"
            aborted.writer.transport.abort()
            terminal = await TextClient.connect(made)
            assert (await terminal.ask("[1] 5 r 0x1017 0 u16")).startswith("[1] ")
            await terminal.close()

    play(body)


def test_a_line_that_is_too_long_is_refused_and_the_next_is_read() -> None:
    async def body() -> None:
        async with gateway("gateway-long") as (made, _):
            terminal = await TextClient.connect(made)
            terminal.send_text("[1] 5 w 0x2000 0 d " + "A" * 200_000)
            assert (await terminal.read_line()).startswith("[0] ERROR:600 #")
            terminal.send_text("\n[2] set node 5\n")
            assert await terminal.read_line() == "[2] OK"
            await terminal.close()

    play(body)


def test_a_connection_that_is_not_read_loses_notices_and_gets_their_number() -> None:
    async def body() -> None:
        async with gateway("gateway-slow") as (made, _):
            terminal = await TextClient.connect(made)
            assert await terminal.ask("[1] set rpdo 1 0x4FF event 1 0x2000 0 u64") == "[1] OK"
            (connection,) = made._connections
            for writer, buffer in ((connection._writer, socket.SO_SNDBUF), (terminal.writer, socket.SO_RCVBUF)):
                writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, buffer, 4096)
            for number in range(2_000_000):  # the system's buffers take some first
                connection._feed_notices(CanFrame(0x4FF, number.to_bytes(8, "little")), 0.0)
                if connection._lost == 3:
                    break
            assert connection._writer.transport.get_write_buffer_size() < UNREAD_LIMIT + 1000
            while not connection._writer.transport.get_write_buffer_size() < 100:
                await terminal.read_line()
            connection._feed_notices(CanFrame(0x4FF, bytes(8)), 0.0)
            while not (line := await terminal.read_line()).startswith("#"):
                pass
            assert line == "#3 notices were lost: they were not read"
            await terminal.close()

    play(body)


def test_bus_off_is_a_notice() -> None:
    async def body() -> None:
        async with gateway("gateway-bus-off") as (made, client):
            terminal = await TextClient.connect(made)
            client.bus._report(ErrorFrame(0x40), 0.0)
            assert await terminal.ask("[1] _bus_indication enable") == "[1] OK"
            client.bus._report(ErrorFrame(0x40), 0.0)
            assert await terminal.read_line() == "1 ERROR 301 #bus off"
            client.bus._report(ErrorFrame(0x04, bytes([0, 0x20])), 0.0)
            assert (await terminal.read_line()).startswith("1 ERROR 300 #")
            client.bus._report(ErrorFrame(0x04, bytes([0, 0x04])), 0.0)  # a warning is not reported
            assert await terminal.ask("[2] set node 5") == "[2] OK"
            await terminal.close()

    play(body)


def test_the_end_of_the_bus_ends_the_gateway() -> None:
    async def body() -> None:
        async with gateway("gateway-gone") as (made, client):
            terminal = await TextClient.connect(made)
            assert await terminal.ask("[1] set node 5") == "[1] OK"
            client.bus._fail("the adapter was unplugged")
            await asyncio.wait_for(made.ended.wait(), 30)
            assert "unplugged" in str(made.failure)
            assert await terminal.read_line() == ""
            await terminal.close()

    play(body)


def test_connections_above_the_limit_are_refused() -> None:
    async def body() -> None:
        async with gateway("gateway-many") as (made, _):
            terminals = [await TextClient.connect(made) for _ in range(GATEWAY_CONNECTIONS)]
            for terminal in terminals:
                assert await terminal.ask("[1] set node 5") == "[1] OK"
            late = await TextClient.connect(made)
            assert (await late.read_line()).startswith("[0] ERROR:600 #")
            for terminal in [*terminals, late]:
                await terminal.close()

    play(body)


def test_fifty_connections_at_the_same_time() -> None:
    async def body() -> None:
        async with gateway("gateway-fifty") as (made, _):
            terminals = [await TextClient.connect(made) for _ in range(50)]

            async def main(number: int) -> None:
                terminal = terminals[number]
                for turn in range(1, 6):
                    assert await terminal.ask(f"[{100 * number + turn}] 5 r 0x1000 0 x32") == (
                        f"[{100 * number + turn}] 0x00020192"
                    )
                await terminal.close()

            await asyncio.gather(*map(main, range(50)))

    play(body)


def test_a_broken_connection_ends_its_transfer() -> None:
    async def body() -> None:
        async with gateway("gateway-broken") as (made, _):
            terminal = await TextClient.connect(made)
            assert await terminal.ask("[1] set sdo_timeout 60000") == "[1] OK"
            terminal.send_text("[2] 9 r 0x1000 0 u32\n")  # there is no node 9
            while not made.client.bus._locks._queue:
                await asyncio.sleep(0.01)
            sock = terminal.writer.get_extra_info("socket")
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset of the connection
            terminal.writer.transport.abort()
            while made._connections:
                await asyncio.sleep(0.01)
            other = await TextClient.connect(made)
            assert not made.client.bus._locks._queue
            assert await other.ask("[3] 5 r 0x1000 0 x32") == "[3] 0x00020192"
            await other.close()

    play(body)


def test_a_client_that_sends_no_more_still_gets_its_response() -> None:
    """As with `nc -N`: a client that closed its sending half still receives."""

    async def body() -> None:
        async with gateway("gateway-half") as (made, _):
            terminal = await TextClient.connect(made)
            terminal.send_text("[1] 5 r 0x1000 0 x32\n")
            terminal.writer.write_eof()
            assert await terminal.read_line() == "[1] 0x00020192"
            assert await terminal.read_line() == ""
            await terminal.close()

    play(body)


def test_a_port_in_use_is_a_port_error() -> None:
    async def body() -> None:
        async with gateway("gateway-taken") as (made, client):
            with pytest.raises(PortError, match="in use"):
                await serve_gateway(client, "127.0.0.1", made.port)

    play(body)


@pytest.mark.parametrize("client", [5, None, "can://virtual/gateway", CanopenClient])
def test_any_other_client_is_refused_at_once(client: Any) -> None:
    with refused(EncodeError, "expected an AsyncCanopenClient"):
        asyncio.run(serve_gateway(client))


def test_the_connections_of_a_gateway_add_up(log: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with AsyncCanopenClient("can://virtual/log-gateway") as client:
            async with await serve_gateway(client) as gateway:
                counted = gateway.statistics
                opened = [
                    await asyncio.open_connection("127.0.0.1", gateway.port) for _ in range(GATEWAY_CONNECTIONS + 1)
                ]
                reader, writer = opened[0]
                writer.write(b"[1] help\r\n")
                await reader.readline()
                assert (counted.opened, counted.refused, counted.commands) == (GATEWAY_CONNECTIONS + 1, 1, 1)
                writer.close()
                while not counted.left:
                    await asyncio.sleep(0.01)
            assert counted.opened == counted.left + counted.refused + counted.stopped
            assert (counted.left, counted.stopped) == (1, GATEWAY_CONNECTIONS - 1)
            for _, other in opened:
                other.close()

    asyncio.run(main())
    records = [record for record in log.records if record.name == "barewire.canopen.gateway"]
    found = [f"{record.levelname} {record.getMessage()}" for record in records]
    assert next(line for line in found if line.startswith("WARNING")).endswith("at most 64 connections: closed")
    assert found[0].endswith(": serving net 1")
    assert sum(line.endswith(" left, 63 in all") for line in found) == 1


# The node of the gateway ----------------------------------------------------------------------------------------------


@asynccontextmanager
async def node_gateway(name: str) -> AsyncIterator[tuple[CanopenGateway, AsyncCanopenClient]]:
    """A gateway that is node 1, and another master of the same bus."""
    url = f"can://virtual/{name}"
    async with AsyncCanopenClient(url) as master, AsyncCanopenClient(url) as client:
        boot_up = master.frames((0x701, False))
        async with await serve_gateway(client, own=gateway_node(1)) as made:
            first = await boot_up.get(30.0)
            assert str(first) == "701#00"
            boot_up.close()
            yield made, master


def test_other_masters_reach_the_node_of_the_gateway() -> None:
    async def body() -> None:
        async with node_gateway("gateway-node-master") as (made, master):
            assert await master.node(1).sdo.upload(0x1008) == b"barewire gateway"
            heartbeats = master.frames((0x701, False))
            terminal = await TextClient.connect(made)
            assert await terminal.ask("[1] set heartbeat 20") == "[1] OK"
            assert [str(await heartbeats.get(30.0)) for _ in range(2)] == ["701#7F", "701#7F"]
            assert await terminal.ask("[2] 0 start") == "[2] OK"
            while str(await heartbeats.get(30.0)) != "701#05":
                pass
            await terminal.close()

    play(body)


def test_lines_about_the_own_node_send_no_request_on_the_bus() -> None:
    async def body() -> None:
        async with node_gateway("gateway-node-silent") as (made, master):
            frames = master.frames()
            terminal = await TextClient.connect(made)
            assert await terminal.ask("[1] 1 r 0x1017 0 u16") == "[1] 0"
            assert await terminal.ask("[2] 1 w 0x1014 0 u32 0x80000081") == "[2] OK"
            assert await terminal.ask("[3] 1 r 0x6999 0") == (
                "[3] ERROR:0x06020000 #node 1, 6999h:00: 0602 0000h object does not exist"
            )
            assert await terminal.ask("[4] set id 2") == "[4] OK"
            assert await terminal.ask("[5] init 9") == "[5] OK"
            first = await frames.get(30.0)
            if str(first) == "701#00":  # the boot-up was still being delivered when the stream began
                first = await frames.get(30.0)
            assert str(first) == "702#00"  # the first frame of all these lines
            await terminal.close()

    play(body)


def test_an_nmt_command_reaches_the_own_node_before_the_next_line_does() -> None:
    """A reset restores 1017h, so a heartbeat time written after it must stay."""

    async def body() -> None:
        async with node_gateway("gateway-node-order") as (made, _):
            terminal = await TextClient.connect(made)
            for number in range(20):
                terminal.send_text("[1] 0 reset communication\n[2] 1 w 0x1017 0 u16 1000\n")
                assert [await terminal.read_line() for _ in range(2)] == ["[1] OK", "[2] OK"]
                assert await terminal.ask("[3] 1 r 0x1017 0 u16") == "[3] 1000", number
            await terminal.close()

    play(body)


def test_the_node_leaves_with_the_gateway() -> None:
    async def body() -> None:
        async with node_gateway("gateway-node-closed") as (made, master):
            frames = master.frames((0x701, False))
            assert made.own is not None
            terminal = await TextClient.connect(made)
            assert await terminal.ask("[1] set heartbeat 5") == "[1] OK"
            await frames.get(30.0)
            await made.close()
            await terminal.close()
            while await frames.get(0.1) is not None:
                await asyncio.sleep(0)

    play(body)


def test_an_answer_of_several_lines_ends_with_the_only_cr_lf() -> None:
    """Clients such as cocomm read an answer up to CR LF."""

    async def body() -> None:
        async with node_gateway("gateway-node-lines") as (made, _):
            terminal = await TextClient.connect(made)
            terminal.send_text("[1] help\r\n")
            answer = await asyncio.wait_for(terminal.reader.readuntil(b"\r\n"), 30)
            assert answer.endswith(b"\n[1] OK\r\n")
            assert answer.count(b"\r") == 1
            assert answer.count(b"\n") > 10
            terminal.send_text("\r")
            assert await terminal.read_line() == ""
            terminal.send_text("\n[2] set node 5\r\n")  # the second half of CR LF is no further line
            assert await terminal.read_line() == "[2] OK"
            await terminal.close()

    play(body)
