"""The gateway between real ports: every listener, every kind of line, faults of lines and of clients, reload, drain."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from barewire import AsyncModbusClient, ModbusServer
from barewire.errors import PortError
from barewire.gateway.backend import ModbusBackend
from barewire.gateway.config import read_config
from barewire.gateway.gateway import Gateway
from barewire.gateway.status import in_words
from barewire.io.server import asyncio_network
from barewire.modbus import Functions, ModbusException, RawRequest, Request, Response, Table
from tests.certificates import authority, leaf, tls_url
from tests.helpers import free_port

WAIT = 30.0
"""Seconds: far more than any exchange of these tests takes, also on a busy machine."""


def numbers() -> Table:
    return Table(200, holding_registers=list(range(200)))


@pytest.fixture
def servers() -> Iterator[Callable[..., ModbusServer]]:
    """Starts servers, which end with the test."""
    with ExitStack() as stack:

        def serve(url: str, units: dict[int, Any], **options: Any) -> ModbusServer:
            return stack.enter_context(ModbusServer(url, units, **options))

        yield serve


def config(*backends: str, listen: str = "tcp://127.0.0.1:0", more: str = "") -> str:
    return "\n".join([more, f'[[listen]]\nurl = "{listen}"', *(f"[[backend]]\n{backend}" for backend in backends)])


def backend(url: str, units: str, more: str = "", name: str = "line") -> str:
    return f'name = "{name}"\nurl = "{url}"\nunits = "{units}"\n{more}'


def through(text: str, act: Callable[[Gateway, AsyncModbusClient], Awaitable[Any]], **options: Any) -> Any:
    """Run a gateway, and act with a client of its first listener."""

    async def main() -> Any:
        async with (
            Gateway(read_config(text)) as gateway,
            AsyncModbusClient(gateway.urls[0], timeout=WAIT, **options) as client,
        ):
            return await act(gateway, client)

    return asyncio.run(main())


async def answer(client: AsyncModbusClient, unit: int, pdu: str) -> str:
    """The PDU with which a unit answers, in hex; also that of an exception."""
    try:
        return (await client.ask(RawRequest(bytes.fromhex(pdu)), unit=unit)).pdu.hex(" ")
    except ModbusException as declined:
        return (declined.pdu or b"").hex(" ")


async def submitted(gateway: Gateway, requests: int) -> None:
    """Wait until so many requests wait for their backend or are under way there."""
    async with asyncio.timeout(WAIT):
        while sum(line.dispatcher.size + len(line.under_way) for line in gateway.backends) < requests:
            await asyncio.sleep(0.001)


@pytest.mark.parametrize("scheme", ["rtu://pty", "ascii://pty", *(f"{name}://127.0.0.1:0" for name in
                         ("tcp", "udp", "rtu+tcp", "ascii+tcp"))])  # fmt: skip
def test_every_kind_of_line(servers: Callable[..., ModbusServer], scheme: str) -> None:
    line = servers(scheme, {5: numbers()})

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        assert await client.at(unit=1).read_holding_registers(7, 2) == (7, 8)
        await client.at(unit=1).write_single_register(7, 99)
        assert await answer(client, 1, "03 00 07 00 01") == "03 02 00 63"
        assert await answer(client, 1, "03 00 C8 00 01") == "83 02"
        assert await answer(client, 2, "03 00 00 00 01") == "83 0a"

    through(config(backend(line.url, "1", "[backend.unit.1]\nas = 5")), act)


@pytest.mark.parametrize("host", ["127.0.0.1:0", "[::1]:0"])
@pytest.mark.parametrize("scheme", ["tcp", "udp", "rtu+tcp", "ascii+tcp"])
def test_every_listener(servers: Callable[..., ModbusServer], scheme: str, host: str) -> None:
    line = servers("tcp://127.0.0.1:0", {1: numbers()})

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        for first in range(5):
            assert await client.at(unit=1).read_holding_registers(first, 2) == (first, first + 1)
        assert await answer(client, 1, "03 00 C8 00 01") == "83 02"

    through(config(backend(line.url, "1"), listen=f"{scheme}://{host}"), act)


class Opaque:
    """A unit with a function of its own, and an odd answer to others."""

    def handle_pdu(self, pdu: bytes, caller: object) -> bytes:
        return pdu[:1] + pdu[:0:-1] if pdu[0] == 0x41 else bytes((pdu[0] | 0x80, 0x55))


@pytest.mark.parametrize("scheme", ["tcp://127.0.0.1:0", "rtu://pty", "ascii://pty"])
def test_any_function_code_passes(servers: Callable[..., ModbusServer], scheme: str) -> None:
    line = servers(scheme, {1: Opaque()})

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        assert await answer(client, 1, "41 01 02 03") == "41 03 02 01"
        assert await answer(client, 1, "42 01") == "c2 55"
        assert await answer(client, 1, "03 00 00 00 FF") == "83 55"  # more registers than the standard allows

    through(config(backend(line.url, "1")), act)


def test_a_gap_that_ends_during_an_exchange_of_another_unit_is_noticed_once(
    servers: Callable[..., ModbusServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The gateway used a whole core until the exchange was over."""
    line, rounds = servers("rtu+tcp://127.0.0.1:0", {1: numbers()}), []
    go_on = ModbusBackend._go_on

    def counted(self: ModbusBackend) -> None:
        rounds.append(self)
        go_on(self)

    monkeypatch.setattr(ModbusBackend, "_go_on", counted)

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        assert await answer(client, 1, "03 00 00 00 01") == "03 02 00 00"
        async with AsyncModbusClient(gateway.urls[0], timeout=WAIT) as other:
            read, silence = await asyncio.gather(
                answer(client, 1, "03 00 01 00 01"), answer(other, 2, "03 00 00 00 01")
            )
        assert (read, silence) == ("03 02 00 01", "83 0b")

    through(config(backend(line.url, "1-2", "gap = 0.2\ntimeout = 30\n[backend.unit.2]\ntimeout = 0.5")), act)
    assert len(rounds) < 20


def test_many_clients_read_and_write_at_once_and_each_gets_its_own_answers(
    servers: Callable[..., ModbusServer],
) -> None:
    """One answer in nine is late, on a line without transaction numbers: nobody gets the answer of another request."""
    faults = "late:0.11"
    line = servers("rtu+tcp://127.0.0.1:0", {unit: numbers() for unit in (1, 2, 3)}, faults=faults, fault_seed=7,
                   fault_delay=0.2)  # fmt: skip
    right = wrong = 0

    async def act(gateway: Gateway, _: AsyncModbusClient) -> None:
        nonlocal right, wrong

        async def one_client(number: int) -> None:
            nonlocal right, wrong
            async with AsyncModbusClient(gateway.urls[0], timeout=WAIT, in_flight=2) as client:
                for turn in range(12):
                    first = (7 * number + turn) % 100
                    try:
                        values = await client.at(unit=1 + turn % 3).read_holding_registers(first, 2)
                    except ModbusException:
                        continue
                    right += values == (first, first + 1)
                    wrong += values != (first, first + 1)

        await asyncio.gather(*(one_client(number) for number in range(8)))

    through(config(backend(line.url, "1-3", "timeout = 0.1\ndead_after = 0")), act)
    assert wrong == 0
    assert right > 10


def test_a_line_that_cannot_be_opened_is_0a_and_works_when_it_can(servers: Callable[..., ModbusServer]) -> None:
    port = free_port()

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        assert await answer(client, 1, "03 00 00 00 01") == "83 0a"
        servers(f"tcp://127.0.0.1:{port}", {1: numbers()})
        async with asyncio.timeout(WAIT):
            while await answer(client, 1, "03 00 07 00 01") != "03 02 00 07":
                await asyncio.sleep(0.05)

    through(config(backend(f"tcp://127.0.0.1:{port}?reconnect_first=0.05", "1")), act)


def test_a_mistake_in_a_url_that_shows_when_the_line_is_opened_is_0a_and_a_line_in_the_log(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The certificate was there when the configuration was read."""
    authority(tmp_path)
    leaf(tmp_path, "client")
    text = config(backend(tls_url(tmp_path, "client", "127.0.0.1:1"), "1"))

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        (tmp_path / "client.crt").unlink()
        assert await answer(client, 1, "03 00 00 00 01") == "83 0a"

    through(text, act)
    rows = [row for row in caplog.records if row.name == "barewire.gateway"]
    assert [(row.levelname, row.exc_info) for row in rows] == [("WARNING", None)]
    assert "there is no file" in rows[0].getMessage()


class Slow:
    """A unit that answers after a while."""

    delays = True

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.requests: list[Request[Any]] = []

    def handle(self, request: Any, now: float) -> Any:
        from barewire.modbus import Delayed

        self.requests.append(request)
        response: Response | None = numbers().handle(request, now)
        assert response is not None
        return Delayed(response, self.seconds)


def test_a_client_that_leaves_disturbs_nobody(servers: Callable[..., ModbusServer]) -> None:
    slow = Slow(0.5)
    line = servers("rtu+tcp://127.0.0.1:0", {1: slow})

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        leaving = AsyncModbusClient(gateway.urls[0], timeout=WAIT, in_flight=4)
        await leaving.open()
        asked = [asyncio.ensure_future(leaving.at(unit=1).read_holding_registers(first, 1)) for first in range(4)]
        await submitted(gateway, 4)
        await leaving.close()
        await asyncio.gather(*asked, return_exceptions=True)
        assert await client.at(unit=1).read_holding_registers(50, 2) == (50, 51)

    through(config(backend(line.url, "1")), act)
    assert len(slow.requests) <= 3  # what waited when the client left was not sent


def test_silence_that_the_standard_demands_is_silence(servers: Callable[..., ModbusServer]) -> None:
    line = servers("rtu://pty", {1: numbers()})

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.7):
                await answer(client, 1, "08 00 04 00 00")

    through(config(backend(line.url, "1", "timeout = 0.2")), act)


def test_broadcasts_reach_every_unit_only_where_they_are_switched_on(servers: Callable[..., ModbusServer]) -> None:
    units = {1: Table(10), 2: Table(10)}
    line = servers("rtu://pty", dict(units))

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        pdu = "06 00 03 00 2A"
        if gateway.config.backends[0].broadcast:
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.3):
                    await answer(client, 0, pdu)
        else:
            assert await answer(client, 0, pdu) == "86 0a"
        await answer(client, 1, "03 00 00 00 01")  # after the broadcast

    through(config(backend(line.url, "1-2")), act)
    assert [table.holding_registers[3] for table in units.values()] == [0, 0]
    through(config(backend(line.url, "1-2", "broadcast = true")), act)
    assert [table.holding_registers[3] for table in units.values()] == [42, 42]


def test_connections_are_closed_when_they_are_old_and_opened_again(servers: Callable[..., ModbusServer]) -> None:
    line = servers("tcp://127.0.0.1:0", {1: numbers()})

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        async with asyncio.timeout(WAIT):
            while line.statistics.left < 2:
                assert await client.at(unit=1).read_holding_registers(3, 1) == (3,)
                await asyncio.sleep(0.01)

    through(config(backend(line.url, "1", "lifetime = 0.1\nsettle = 0.01")), act)


def test_the_policy_holds_by_address_and_by_role(servers: Callable[..., ModbusServer], tmp_path: Path) -> None:
    authority(tmp_path)
    leaf(tmp_path, "server", server=True)
    leaf(tmp_path, "operator", role="Operator")
    leaf(tmp_path, "viewer", role="Viewer")
    line = servers("tcp://127.0.0.1:0", {1: numbers()})
    policy = """
[[policy.allow]]
functions = [3]
addresses = "0-99"
[[policy.allow]]
roles = ["Operator"]
functions = [6]
[[policy.allow]]
clients = ["192.0.2.0/24"]
"""
    text = config(backend(line.url, "1"), listen=tls_url(tmp_path, "server")) + policy

    async def main() -> list[list[str]]:
        async with Gateway(read_config(text)) as gateway:
            place = gateway.urls[0].removeprefix("tls://")
            answers = []
            for name in ("operator", "viewer"):
                async with AsyncModbusClient(tls_url(tmp_path, name, place), timeout=WAIT) as client:
                    requests = ("03 00 63 00 01", "03 00 63 00 02", "06 00 01 00 02", "41 01")
                    answers.append([await answer(client, 1, pdu) for pdu in requests])
            return answers

    assert asyncio.run(main()) == [
        ["03 02 00 63", "83 02", "06 00 01 00 02", "c1 01"],
        ["03 02 00 63", "83 02", "86 01", "c1 01"],
    ]


def test_a_reload_goes_on_with_what_is_the_same(servers: Callable[..., ModbusServer]) -> None:
    kept, changed = servers("tcp://127.0.0.1:0", {1: Slow(0.2)}), servers("tcp://127.0.0.1:0", {2: numbers()})
    first = backend(kept.url, "1", name="kept")

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        asked = asyncio.ensure_future(client.at(unit=1).read_holding_registers(7, 1))
        await submitted(gateway, 1)
        listeners = gateway.config.listeners
        new = config(first, backend(changed.url, "2,3", "[backend.unit.3]\nas = 2", name="changed"))
        await gateway.reload(read_config(new.replace("tcp://127.0.0.1:0", listeners[0], 1)))
        assert await asked == (7,)
        assert await client.at(unit=3).read_holding_registers(7, 1) == (7,)
        assert await client.at(unit=1).read_holding_registers(8, 1) == (8,)
        assert kept.statistics.opened == 1

    text = config(first, backend(changed.url, "2", name="changed"))
    through(text, act, in_flight=2)


def test_a_publisher_that_takes_its_time_to_end_keeps_no_line_from_its_new_backend(
    servers: Callable[..., ModbusServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    server = servers("tcp://127.0.0.1:0", {2: numbers()})

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        ended, (listener,) = asyncio.Event(), gateway.config.listeners
        monkeypatch.setattr(gateway, "_swap", lambda *_: ended.wait())
        new = config(backend(server.url, "2,3", "[backend.unit.3]\nas = 2"))
        reloading = asyncio.ensure_future(gateway.reload(read_config(new.replace("tcp://127.0.0.1:0", listener, 1))))
        await asyncio.sleep(0)
        assert await client.at(unit=3).read_holding_registers(7, 1) == (7,)
        assert not reloading.done()
        ended.set()
        await reloading
        monkeypatch.undo()

    through(config(backend(server.url, "2")), act)


def test_a_unit_that_never_answered_is_not_said_to_answer() -> None:
    """The other side closes each connection: no unit is dead for that."""

    async def close(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(100)
        writer.close()

    async def main() -> dict[str, Any]:
        line = await asyncio.start_server(close, "127.0.0.1", 0)
        port = line.sockets[0].getsockname()[1]
        text = config(backend(f"tcp://127.0.0.1:{port}", "1"))
        async with (
            Gateway(read_config(text)) as gateway,
            AsyncModbusClient(gateway.urls[0], timeout=WAIT) as client,
        ):
            assert await answer(client, 1, "03 00 00 00 01") == "83 0b"
            line.close()
            return gateway.status()

    state = asyncio.run(main())
    (unit,) = state["backends"][0]["units"]
    assert (unit["state"], unit["no_responses"]) == ("has not answered", 1)
    assert "  unit 1: has not answered, 1 exchanges, 0 exceptions, 1 unanswered" in in_words(state)


def test_a_policy_holds_as_soon_as_it_is_read(servers: Callable[..., ModbusServer]) -> None:
    """It does not wait for the backends that end with the reload."""
    kept, changed = servers("tcp://127.0.0.1:0", {1: numbers()}), servers("tcp://127.0.0.1:0", {2: Slow(0.5)})
    first = backend(kept.url, "1", name="kept")

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        await client.at(unit=1).write_single_register(1, 5)
        asked = [asyncio.ensure_future(client.at(unit=2).read_holding_registers(at, 1)) for at in range(4)]
        await submitted(gateway, 4)
        second = backend(changed.url, "2", "timeout = 30", name="changed")
        new = config(first, second, listen=gateway.config.listeners[0], more="[policy]\nread_only = true")
        reloading = asyncio.ensure_future(gateway.reload(read_config(new)))
        await asyncio.sleep(0)
        assert await answer(client, 1, "06 00 01 00 06") == "86 01"
        assert not reloading.done()
        await reloading
        assert await asyncio.gather(*asked) == [(0,), (1,), (2,), (3,)]

    through(config(first, backend(changed.url, "2", "timeout = 20", name="changed")), act, in_flight=8)


def test_options_of_a_listener_change_at_its_port(servers: Callable[..., ModbusServer]) -> None:
    line = servers("tcp://127.0.0.1:0", {1: numbers()})
    port, taken = free_port(), servers("tcp://127.0.0.1:0", {1: numbers()}).url.partition("?")[0]
    old, new = (f"tcp://127.0.0.1:{port}?connections={number}" for number in (3, 4))

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        async def reload(*listeners: str) -> None:
            more = "".join(f'[[listen]]\nurl = "{url}"\n' for url in listeners[1:])
            await gateway.reload(read_config(config(backend(line.url, "1"), listen=listeners[0], more=more)))

        async def check(listener: str) -> None:
            assert list(gateway._listeners) == [listener]
            async with AsyncModbusClient(f"tcp://127.0.0.1:{port}", timeout=WAIT) as other:
                assert await other.at(unit=1).read_holding_registers(7, 1) == (7,)

        await reload(new)
        await check(new)
        with pytest.raises(PortError, match="in use"):
            await reload(old, taken)
        await check(new)

    through(config(backend(line.url, "1"), listen=old), act)


def test_ports_that_are_written_otherwise_are_opened_again(servers: Callable[..., ModbusServer]) -> None:
    line, port, page = servers("tcp://127.0.0.1:0", {1: numbers()}), free_port(), free_port()

    def text(host: str, end: str) -> str:
        more = f'[status]\nurl = "http://127.0.0.1:{page}{end}"\n'
        return config(backend(line.url, "1"), listen=f"tcp://{host}:{port}", more=more)

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        before = gateway.page
        for host, end in (("0.0.0.0", "/"), ("127.0.0.1", ""), ("0.0.0.0", "/")):
            await gateway.reload(read_config(text(host, end)))
            assert gateway.page is before
            async with AsyncModbusClient(f"tcp://127.0.0.1:{port}", timeout=WAIT) as other:
                assert await other.at(unit=1).read_holding_registers(7, 1) == (7,)

    through(text("127.0.0.1", ""), act)


def test_every_client_of_a_datagram_listener_gets_its_answer(
    servers: Callable[..., ModbusServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also if more of them wait than the listener knows."""
    monkeypatch.setattr(asyncio_network, "_CALLERS", 2)
    line = servers("tcp://127.0.0.1:0", {1: Slow(0.1)})

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        async def ask(number: int) -> tuple[int, ...]:
            async with AsyncModbusClient(gateway.urls[0], timeout=WAIT) as one:
                return await one.at(unit=1).read_holding_registers(number, 1)

        assert await asyncio.gather(*map(ask, range(6))) == [(number,) for number in range(6)]

    through(config(backend(line.url, "1"), listen="udp://127.0.0.1:0"), act)


def test_a_gateway_that_closes_answers_what_is_under_way_first(servers: Callable[..., ModbusServer]) -> None:
    line = servers("rtu+tcp://127.0.0.1:0", {1: Slow(0.1)})

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        asked = [asyncio.ensure_future(client.at(unit=1).read_holding_registers(first, 1)) for first in range(3)]
        await submitted(gateway, 3)
        await gateway.close()
        assert await asyncio.gather(*asked) == [(0,), (1,), (2,)]

    through(config(backend(line.url, "1")), act, in_flight=4)


def test_a_failure_of_a_unit_is_passed_on(servers: Callable[..., ModbusServer]) -> None:
    def fail(address: int, quantity: int) -> list[int]:
        raise ModbusException(0x05)

    line = servers("tcp://127.0.0.1:0", {1: Functions(read_holding_registers=fail)})

    async def act(gateway: Gateway, client: AsyncModbusClient) -> None:
        assert await answer(client, 1, "03 00 00 00 01") == "83 05"

    through(config(backend(line.url, "1")), act)


# The program


def gateway_program(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "barewire.gateway", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_the_program_serves_reloads_and_ends(servers: Callable[..., ModbusServer], tmp_path: Path) -> None:
    line = servers("tcp://127.0.0.1:0", {1: numbers()})
    file = tmp_path / "gateway.toml"
    file.write_text(config(backend(line.url, "1")))
    with gateway_program(str(file)) as program:
        try:
            assert program.stdout is not None
            assert program.stderr is not None
            url = program.stdout.readline().split()[-1]

            async def act() -> None:
                async with AsyncModbusClient(url, timeout=WAIT) as client:
                    assert await answer(client, 1, "03 00 07 00 01") == "03 02 00 07"
                    assert await answer(client, 2, "03 00 07 00 01") == "83 0a"
                    file.write_text(config(backend(line.url, "1-2", "[backend.unit.2]\nas = 1")))
                    program.send_signal(signal.SIGHUP)
                    async with asyncio.timeout(WAIT):
                        while await answer(client, 2, "03 00 07 00 01") != "03 02 00 07":
                            await asyncio.sleep(0.02)
                    file.write_text("[[listen")
                    program.send_signal(signal.SIGHUP)
                    assert await answer(client, 2, "03 00 07 00 01") == "03 02 00 07"

            asyncio.run(act())
            program.send_signal(signal.SIGTERM)
            assert program.wait(WAIT) == 0
            assert "stays as it was" in program.stderr.read()
        finally:
            program.kill()


def test_a_port_that_is_taken_is_one_line_and_status_1(servers: Callable[..., ModbusServer], tmp_path: Path) -> None:
    line, taken = (servers("tcp://127.0.0.1:0", {1: numbers()}) for _ in range(2))
    file = tmp_path / "gateway.toml"
    file.write_text(config(backend(line.url, "1"), listen=taken.url))
    with gateway_program(str(file)) as program:
        out, err = program.communicate(timeout=WAIT)
    assert (program.returncode, out, err.count("\n")) == (1, "", 1)
    assert "in use" in err
