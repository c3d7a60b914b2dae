"""Whatever arrives at a listener: the gateway goes on, and nothing gets past the policy."""

from __future__ import annotations

import asyncio
import random

import pytest

from barewire import AsyncModbusClient, AsyncModbusServer
from barewire.ascii import encode as ascii_frame
from barewire.errors import BarewireError
from barewire.gateway.config import read_config
from barewire.gateway.gateway import Gateway
from barewire.modbus import Caller, RawRequest
from barewire.rtu import encode as rtu_frame
from barewire.tcp import encode as tcp_frame
from tests.helpers import part_or_whole

WAIT = 30.0
POLICY = """
[[policy.allow]]
units = "1-2"
functions = [3]
addresses = "0-9"
[[policy.allow]]
units = 1
functions = [6, 16]
addresses = "5"
"""


class Witness:
    """A unit that keeps every request, and answers with an exception."""

    def __init__(self, unit: int, seen: list[tuple[int, bytes]]) -> None:
        self.unit, self.seen = unit, seen

    def handle_pdu(self, pdu: bytes, caller: Caller) -> bytes:
        self.seen.append((self.unit, pdu))
        return b"\x03\x02\x00\x07" if pdu == b"\x03\0\0\0\x01" else bytes((pdu[0] | 0x80, 2))


def frame(scheme: str, unit: int, pdu: bytes, dice: random.Random) -> bytes:
    if scheme in ("tcp", "udp"):
        return tcp_frame(unit, pdu, dice.randrange(65536))
    return rtu_frame(unit, pdu) if scheme == "rtu+tcp" else ascii_frame(unit, pdu)


def junk(scheme: str, dice: random.Random) -> bytes:
    """A piece of what arrives: a request that is allowed or not, a damaged one, or anything."""
    code = dice.choice((1, 3, 3, 3, 6, 6, 16, 23, 0x2B, 0x41, dice.randrange(1, 128)))
    body = dice.randbytes(dice.choice((0, 1, 4, 4, 4, 4, 7, 60)))
    if len(body) == 4 and dice.random() < 0.8:
        body = b"\0" + bytes((dice.randrange(12), 0, dice.randrange(1, 5)))
    data = bytearray(frame(scheme, dice.choice((0, 1, 1, 2, 2, 3, 255)), bytes((code,)) + body, dice))
    for _ in range(dice.choice((0, 0, 0, 1, 3))):
        data[dice.randrange(len(data))] = dice.randrange(256)
    if dice.random() < 0.1:
        data = data[: dice.randrange(len(data))]
    return dice.randbytes(dice.randrange(1, 300)) if dice.random() < 0.1 else bytes(data)


@pytest.mark.parametrize("scheme", ["tcp", "udp", "rtu+tcp", "ascii+tcp"])
@pytest.mark.parametrize("pieces", part_or_whole(1500, 60_000))
def test_nothing_that_arrives_ends_the_gateway_or_gets_past_the_policy(scheme: str, pieces: int) -> None:
    dice, seen = random.Random(scheme), []  # type: ignore[var-annotated]

    async def main() -> Gateway:
        units = {unit: Witness(unit, seen) for unit in (1, 2, 3)}
        async with AsyncModbusServer("tcp://127.0.0.1:0", units) as behind:
            backend = f'[[backend]]\nname = "b"\nurl = "{behind.url}"\nunits = "1-3"\ntimeout = 5\n'
            patience = "?patience=0.002" if scheme == "rtu+tcp" else ""
            text = f'[[listen]]\nurl = "{scheme}://127.0.0.1:0{patience}"\n{backend}{POLICY}'
            async with Gateway(read_config(text)) as gateway:
                await send(gateway)
                # A datagram for which a busy machine has no room is lost.
                patient = {"timeout": 1, "retries": 100} if scheme == "udp" else {"timeout": WAIT}
                async with asyncio.timeout(4 * WAIT), AsyncModbusClient(gateway.urls[0], unit=1, **patient) as client:
                    while await client.read_holding_registers(0, 1) != (7,):
                        pass
                return gateway

    async def send(gateway: Gateway) -> None:
        host, port = gateway.urls[0].partition("://")[2].split(":")
        loop = asyncio.get_running_loop()
        if scheme == "udp":
            transport, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=(host, int(port)))
            for place in range(pieces):
                transport.sendto(junk(scheme, dice))
                if place % 20 == 0:
                    await asyncio.sleep(0.001)
            transport.close()
            return
        writer: asyncio.StreamWriter | None = None
        for _ in range(pieces):
            if writer is None or writer.is_closing() or dice.random() < 0.02:
                if writer is not None:
                    writer.close()
                reader, writer = await asyncio.open_connection(host, int(port))
                reading = asyncio.ensure_future(discard(reader))
                reading.add_done_callback(lambda done, writer=writer: writer.close())  # type: ignore[misc]
            try:
                writer.write(junk(scheme, dice))
                await writer.drain()
            except OSError:
                writer = None
            # RTU needs silences, or nothing after the first damaged frame is heard.
            await asyncio.sleep(0.01 if scheme == "rtu+tcp" and dice.random() < 0.3 else 0)
        if writer is not None:
            writer.close()

    async def discard(reader: asyncio.StreamReader) -> None:
        try:
            while await reader.read(4096):
                pass
        except OSError:
            pass

    gateway = asyncio.run(main())
    policy = gateway.policy
    assert len(seen) > 5
    for unit, pdu in seen:
        assert policy.refusal(Caller(), unit, RawRequest(pdu)) is None
    for unit, pdu in seen:
        assert pdu[0] in (3, 6, 16)
        assert unit in (1, 2)
        assert pdu[0] == 3 or unit == 1
        assert int.from_bytes(pdu[1:3], "big") <= 9
    assert gateway.refusals > 100
    (backend,) = gateway.backends
    assert backend.dispatcher.size == len(backend.under_way) == 0


def test_errors_of_a_client_are_those_of_its_requests_only() -> None:
    """A client that is refused keeps its connection, and its next request is answered."""

    async def main() -> None:
        seen: list[tuple[int, bytes]] = []
        async with AsyncModbusServer("tcp://127.0.0.1:0", {1: Witness(1, seen)}) as behind:
            text = f'[[listen]]\nurl = "tcp://127.0.0.1:0"\n[[backend]]\nname = "b"\nurl = "{behind.url}"\nunits = 1\n'
            async with (
                Gateway(read_config(text + POLICY)) as gateway,
                AsyncModbusClient(gateway.urls[0], unit=1, timeout=WAIT) as client,
            ):
                for _ in range(50):
                    with pytest.raises(BarewireError):
                        await client.read_holding_registers(10, 1)
                    assert await client.read_holding_registers(0, 1) == (7,)
                assert gateway.listeners[0].statistics.opened == 1

    asyncio.run(main())
