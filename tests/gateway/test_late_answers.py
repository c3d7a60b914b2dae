"""Answers that are late over the end of a backend: a reload, the end of the gateway. No client gets that of another."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from uuid import uuid4

import pytest

from barewire import AsyncModbusClient
from barewire.gateway.backend import Backend, ModbusBackend
from barewire.gateway.canopen_backend import CanopenBackend
from barewire.gateway.config import read_config
from barewire.gateway.gateway import Gateway
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire.modbus import CanopenReference, ModbusException
from barewire.rtu import crc16

WAIT = 30.0


class LateUnit:
    """Unit 1 behind a serial server. Register N holds 1000 + N. The answer about register 0 comes only before that to
    another request, or when `be_late` is called."""

    async def __aenter__(self) -> LateUnit:
        self.held: list[bytes] = []
        self.asked: list[str] = []
        self.heard = asyncio.Event()
        """Set when register 0 was asked for."""
        self.writer: asyncio.StreamWriter | None = None
        self.server = await asyncio.start_server(self.serve, "127.0.0.1", 0)
        self.port = self.server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        self.server.close()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.writer = writer
        while len(frame := await reader.read(8)) == 8:
            self.asked.append(frame[:6].hex(" "))
            if frame[1] == 8:
                answer = frame
            else:
                body = frame[:2] + b"\x02" + (1000 + int.from_bytes(frame[2:4], "big")).to_bytes(2, "big")
                answer = body + crc16(body).to_bytes(2, "little")
            if frame[1:4] == b"\x03\0\0":
                self.held.append(answer)
                self.heard.set()
            else:
                self.be_late()
                writer.write(answer)
        writer.close()

    def be_late(self) -> None:
        assert self.writer is not None
        self.writer.write(b"".join(self.held))
        self.held.clear()


def config(place: str, more: str, drain: float = WAIT) -> str:
    line = f'name = "line"\nurl = "{place}"\nunits = 1\n{more}'
    return f'drain = {drain}\n[[listen]]\nurl = "tcp://127.0.0.1:0"\n[[backend]]\n{line}'


async def read(client: AsyncModbusClient, address: int) -> int:
    """The content of a register, or the exception code, negative."""
    try:
        return (await client.at(unit=1).read_holding_registers(address, 1))[0]
    except ModbusException as declined:
        return -declined.code


def with_a_late_unit(act: Callable[[LateUnit], Awaitable[None]]) -> None:
    async def main() -> None:
        async with LateUnit() as unit:
            await act(unit)

    asyncio.run(main())


@pytest.mark.parametrize("other", ["", "tcp", "name"])
@pytest.mark.parametrize("is_under_way", [False, True])
def test_a_reload_gives_no_client_the_answer_to_another_request(is_under_way: bool, other: str) -> None:
    """The answer of the old backend is late: its request timed out, or was under way when the drain was over."""

    async def act(unit: LateUnit) -> None:
        old = new = f"rtu+tcp://127.0.0.1:{unit.port}?late_window=600"
        if other == "name":
            new = old.replace("127.0.0.1", "LOCALHOST")
        patient, quick = "timeout = 20\n", "timeout = 0.2\n"
        text = config(old, patient if is_under_way else quick, drain=0.05)
        async with (
            Gateway(read_config(text)) as gateway,
            AsyncModbusClient(gateway.urls[0], timeout=WAIT) as first,
            AsyncModbusClient(gateway.urls[0], timeout=WAIT) as second,
        ):
            asked = asyncio.ensure_future(read(first, 0))
            await unit.heard.wait()
            if not is_under_way:
                assert await asked == -0x0B
            listen = gateway.config.listeners[0]
            if other == "tcp":  # the line is left, and comes back
                between = config("tcp://127.0.0.1:1", "", drain=0.05)
                await gateway.reload(read_config(between.replace("tcp://127.0.0.1:0", listen, 1)))
            text = config(new, patient + "queue = 500", drain=0.05)
            await gateway.reload(read_config(text.replace("tcp://127.0.0.1:0", listen, 1)))
            assert await asked == -0x0B
            assert await read(second, 100) == 1100
            (backend,) = gateway.backends
            assert isinstance(backend, ModbusBackend)
            assert (backend.bus.counters.probes, backend.bus.counters.late) == (1, 1)

    with_a_late_unit(act)


def test_a_gateway_that_ends_waits_for_answers_that_are_late() -> None:
    """Otherwise the next program on this line could take one for the answer to its own request."""

    async def act(unit: LateUnit) -> None:
        text = config(f"rtu+tcp://127.0.0.1:{unit.port}?late_window=600", "timeout = 0.2", drain=600)
        async with Gateway(read_config(text)) as gateway:
            async with AsyncModbusClient(gateway.urls[0], timeout=WAIT) as client:
                assert await read(client, 0) == -0x0B
            (backend,) = gateway.backends
            closing = asyncio.ensure_future(gateway.close())
            for _ in range(100):
                await asyncio.sleep(0)
            assert backend.is_draining
            assert not closing.done()
            unit.be_late()
            async with asyncio.timeout(WAIT):
                await closing
            assert isinstance(backend, ModbusBackend)
            assert (backend.bus.counters.late, backend.bus.state.pending) == (1, [])

    with_a_late_unit(act)


def test_a_gateway_that_ends_waits_no_longer_than_drain() -> None:
    async def act(unit: LateUnit) -> None:
        text = config(f"rtu+tcp://127.0.0.1:{unit.port}?late_window=600", "timeout = 0.2", drain=0.1)
        async with Gateway(read_config(text)) as gateway, asyncio.timeout(WAIT):
            async with AsyncModbusClient(gateway.urls[0], timeout=WAIT) as client:
                assert await read(client, 0) == -0x0B
            await gateway.close()

    with_a_late_unit(act)


def test_a_backend_that_ends_waits_for_no_other() -> None:
    """A successor may use its port before another backend is drained."""

    async def act(unit: LateUnit) -> None:
        async with LateUnit() as slow:
            lines = "".join(
                f'[[backend]]\nname = "{name}"\nurl = "rtu+tcp://127.0.0.1:{port}"\nunits = {number}\n'
                for number, (name, port) in enumerate((("quick", unit.port), ("slow", slow.port)), 1)
            )
            text = f'drain = 20\n[[listen]]\nurl = "tcp://127.0.0.1:0"\n{lines}timeout = 20\n[backend.unit.2]\nas = 1'
            async with (
                Gateway(read_config(text)) as gateway,
                AsyncModbusClient(gateway.urls[0], timeout=WAIT, in_flight=2) as client,
            ):
                asked = asyncio.ensure_future(client.at(unit=2).read_holding_registers(0, 1))
                await slow.heard.wait()
                old: Backend = gateway.backends[0]
                text = text.replace("units", "queue = 99\nunits")
                text = text.replace("tcp://127.0.0.1:0", gateway.config.listeners[0], 1)
                reloading = asyncio.ensure_future(gateway.reload(read_config(text)))
                async with asyncio.timeout(WAIT):
                    await old.is_closed.wait()
                assert not reloading.done()
                assert await read(client, 7) == 1007
                slow.be_late()
                assert await asked == (1000,)
                await reloading

    with_a_late_unit(act)


def test_a_reload_opens_a_can_bus_when_no_answer_of_before_can_come_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[float] = []
    open_bus = AsyncCanopenClient.open

    async def recorded(self: AsyncCanopenClient) -> None:
        opened.append(asyncio.get_running_loop().time())
        await open_bus(self)

    monkeypatch.setattr(AsyncCanopenClient, "open", recorded)
    bus = f"can://memory/{uuid4().hex}"

    async def main() -> None:
        async with Gateway(read_config(config(bus, "timeout = 0.2"))) as gateway:
            async with AsyncModbusClient(gateway.urls[0], timeout=WAIT) as client:
                request = CanopenReference.read(1, 0x6041, count=2)
                for _ in range(2):
                    with pytest.raises(ModbusException):
                        await client.ask(request, unit=1)
                    (old,) = gateway.backends
                    text = config(bus, "timeout = 0.1").replace("tcp://127.0.0.1:0", gateway.config.listeners[0])
                    await gateway.reload(read_config(text))
            assert isinstance(old, CanopenBackend)
        assert opened[1] >= opened[0] + 0.4

    asyncio.run(main())
