"""The text gateway as a node of the bus, next to its connections."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from barewire.canopen.gateway.own_node import gateway_node
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire.io.server.gateway import CanopenGateway, serve_gateway
from tests.io.canopen.test_gateway_server import TextClient, play


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
