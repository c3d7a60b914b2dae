"""Wrong arguments and wrong order of calls at the front door: one clear error, the same with and without asyncio, and
nothing stays open."""

from __future__ import annotations

import asyncio
import copy
import gc
import pickle
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import barewire
from barewire.errors import EncodeError, PortError
from barewire.modbus import ReadCoils, ReadHoldingRegisters, Table
from tests.helpers import every_case, refused

CLIENTS: list[Any] = [barewire.ModbusClient, barewire.AsyncModbusClient]
SERVERS: list[Any] = [barewire.ModbusServer, barewire.AsyncModbusServer]
CAN_CLIENTS: list[Any] = [barewire.CanopenClient, barewire.AsyncCanopenClient]
CAN_SERVERS: list[Any] = [barewire.CanopenServer, barewire.AsyncCanopenServer]
CONNECT: list[Any] = [barewire.connect, barewire.connect_async]
NAN = float("nan")


class Waiting:
    """A unit with a method that nothing awaits."""

    async def handle(self, request: Any, now: float) -> Any:
        return None


def readers() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("reader of virtual/use")]


class Seven:
    """A whole number that is not an `int`, as those of numpy."""

    def __index__(self) -> int:
        return 7

    def __hash__(self) -> int:
        return hash(7)

    def __eq__(self, other: object) -> bool:
        return other == 7

    def __le__(self, other: int) -> bool:
        return other >= 7

    def __ge__(self, other: int) -> bool:
        return other <= 7


def test_a_unit_of_a_server_may_be_a_whole_number_of_any_type() -> None:
    units: Any = {Seven(): barewire.Table(holding_registers=[42])}
    with (
        barewire.ModbusServer("tcp://127.0.0.1:0", units) as server,
        barewire.ModbusClient(server.url, unit=7, timeout=20) as client,
    ):
        assert client.read_holding_registers(0, 1) == (42,)


@pytest.mark.parametrize("client", CLIENTS)
def test_a_unit_may_be_a_whole_number_of_any_type(client: Any) -> None:
    one = client("tcp://127.0.0.1:1", lazy=True)
    other = client("tcp://127.0.0.1:1", lazy=True, unit=Seven())
    assert (one.at(unit=Seven()).unit, other.unit, one.unit_for(Seven())) == (7, 7, 7)
    assert type(one.unit_for(Seven())) is int


@pytest.mark.parametrize("client", CLIENTS)
def test_unit_and_time_out_of_a_modbus_client_are_checked_at_once(client: Any) -> None:
    one = client("tcp://127.0.0.1:1", lazy=True)
    for unit in (300, -1, "7", 1.5, True):
        kind = "" if unit in (300, -1) else "a whole number in "
        for use in (one.at, lambda unit: client(one.url, unit=unit), lambda unit: one.ask(ReadCoils(0, 1), unit=unit)):
            with refused(EncodeError, f"unit {unit!r}: expected {kind}0..255"):
                use(unit=unit)
    for timeout in (-1, NAN, "1"):
        with refused(EncodeError, f"time-out {timeout!r}: expected 0 or more seconds"):
            client(one.url, timeout=timeout)
        with refused(EncodeError, f"time-out {timeout!r}: expected 0 or more seconds"):
            one.at(timeout=timeout)
        with refused(EncodeError, f"time-out {timeout!r}: expected 0 or more seconds"):
            one.ask(ReadCoils(0, 1), timeout=timeout)
    for use in (one.at, lambda timeout: one.ask(ReadCoils(0, 1), timeout=timeout)):
        with refused(EncodeError, "time-out inf s: expected 0 or more seconds, and finite"):
            use(timeout=float("inf"))
    with refused(EncodeError, "a number of 3322 bits"):
        client("tcp://127.0.0.1:1", unit=10**1000, lazy=True)
    with refused(EncodeError, "cannot be the name of a host"):
        client("tcp://plc\n7:502", lazy=True)


@pytest.mark.parametrize("in_flight", [0, 17, "4", 1.5, None])
def test_requests_in_flight_are_a_whole_number(in_flight: Any) -> None:
    with refused(EncodeError, f"in_flight {in_flight!r}: expected 1..16"):
        barewire.AsyncModbusClient("tcp://127.0.0.1:1", in_flight=in_flight)


@every_case("server", SERVERS)
@every_case(
    ("units", "text"),
    [
        ({300: Table()}, "address 300: expected 0..255"),
        ({"1": Table()}, "address '1': expected 0..255"),
        ({1: 5}, "unit 1: 5: expected a Table"),
        ({1: None}, "unit 1: None: expected a Table"),
        ({1: {}}, "unit 1: {}: expected a Table"),
        ({1: Table}, "unit 1: the class Table: expected an instance, Table(...)"),
        ({1: Waiting()}, "unit 1: its method handle is a coroutine: expected one that returns the response"),
        ([Table()], "expected a dict of unit address and unit"),
        (Table(), "expected a dict of unit address and unit"),
        ({True: Table()}, "address True: expected 0..255"),
    ],
)
@every_case("url", ["tcp://127.0.0.1:0", "udp://127.0.0.1:0", "rtu+tcp://127.0.0.1:0", "rtu://pty"])
def test_units_are_objects_by_address(server: Any, url: str, units: Any, text: str) -> None:
    with refused(EncodeError, text):
        server(url, units)


@pytest.mark.parametrize("server", SERVERS)
def test_a_serial_line_has_no_unit_0(server: Any) -> None:
    for url in ("rtu://pty", "ascii+tcp://127.0.0.1:0"):
        with refused(
            EncodeError, "units: address 0: a serial line has no unit 0, its requests are broadcasts: expected 1..255"
        ):
            server(url, {0: Table()})
    assert "ModbusServer" in repr(barewire.AsyncModbusServer("tcp://127.0.0.1:0", {0: Table()}))


@every_case("server", [*SERVERS, *CAN_SERVERS])
@every_case("faults", [5, {"drop": 5}, {"drop": "often"}, {"drop": NAN}, "drop:2"])
def test_faults_are_kinds_with_probabilities(server: Any, faults: Any) -> None:
    url = "can://virtual/use" if server in CAN_SERVERS else "tcp://127.0.0.1:0"
    served: Any = {"device": "az3"} if server in CAN_SERVERS else {"units": {}}
    with refused(EncodeError, "fault"):
        server(url, **served, faults=faults)


@pytest.mark.parametrize("connect", CONNECT)
@pytest.mark.parametrize("device", [None, 5])
def test_an_object_other_than_a_device_is_refused(connect: Any, device: Any) -> None:
    with refused(EncodeError, f"device {device}: expected the name or the path of a description"):
        connect(device, "tcp://127.0.0.1:1")
    with refused(EncodeError, f"device {device}: expected the name or the path of a description"):
        barewire.load(device)


@pytest.mark.parametrize("client", CAN_CLIENTS)
def test_settings_of_a_canopen_client_are_checked_at_once(client: Any) -> None:
    for timeout in ("soon", -1, NAN, float("inf")):
        with refused(EncodeError, f"timeout='{timeout}' is not a number of seconds"):
            client("can://virtual/use", timeout=timeout)
    with refused(EncodeError, "dialect 5: expected its name"):
        client("can://virtual/use", dialect=5)
    assert not readers()


def test_a_text_is_a_time_out_as_in_the_url() -> None:
    with barewire.CanopenClient("can://virtual/use", timeout="0.5") as client:  # type: ignore[arg-type]
        assert client.timeout == 0.5


def test_an_eds_without_objects_and_a_number_for_a_path_are_refused(tmp_path: Path) -> None:
    text = tmp_path / "hosts.txt"
    text.write_text("127.0.0.1 localhost\n")
    with barewire.CanopenClient("can://virtual/use") as client:
        with refused(EncodeError, "the file describes no object"):
            client.node(5, eds=text)
        with refused(EncodeError, "eds 0: expected a path"):  # not file descriptor 0
            client.node(5, eds=0)  # type: ignore[call-overload]
        with refused(EncodeError, "device 5: expected the name"):
            client.node(5, device=5)  # type: ignore[call-overload]


@pytest.mark.parametrize("server", CAN_SERVERS)
def test_a_device_without_canopen_is_named(server: Any) -> None:
    with refused(EncodeError, "adxl has no CANopen"):
        server("can://virtual/use", device="adxl")


def test_named_values_cannot_be_iterated_over() -> None:
    with barewire.CanopenClient("can://virtual/use") as client:
        node: Any = client.node(5, device="az3")
        with pytest.raises(TypeError):
            list(node)
        with pytest.raises(TypeError):
            "STATUS WORD" in node  # noqa: B015


def made(kind: Any) -> Any:
    if kind is barewire.AsyncModbusServer:
        return kind("tcp://127.0.0.1:0", units={})
    return kind("can://virtual/use?node=5", device="az3")


@pytest.mark.parametrize("kind", [barewire.AsyncModbusServer, barewire.AsyncCanopenServer])
def test_an_asyncio_server_serves_once(kind: Any) -> None:
    async def main() -> None:
        async with made(kind) as server:
            with refused(PortError, "a server serves once"):
                await server.start()
        with refused(PortError, "a server serves once"):
            await server.start()
        await server.close()
        server = made(kind)
        await server.close()
        with refused(PortError, "a server serves once"):
            await server.start()

    asyncio.run(main())
    assert not readers()


def test_an_asyncio_server_names_the_server_that_makes_pseudo_terminals() -> None:
    with refused(EncodeError, "pseudo-terminals are made by ModbusServer"):
        barewire.AsyncModbusServer("rtu://pty", units={})


def test_a_port_in_use_is_reported_in_the_same_words() -> None:
    with barewire.ModbusServer("tcp://127.0.0.1:0", units={}) as server:
        texts = []
        with pytest.raises(PortError) as blocking:
            barewire.ModbusServer(server.url, units={})
        texts.append(str(blocking.value))
        with pytest.raises(PortError) as waiting:
            asyncio.run(barewire.AsyncModbusServer(server.url, units={}).start())
        texts.append(str(waiting.value))
    assert texts == [f"127.0.0.1:{server.port}: address already in use"] * 2


def test_an_address_of_another_machine_is_reported_in_the_same_words() -> None:
    url, expected = "tcp://192.0.2.1:1502", "192.0.2.1:1502: cannot assign requested address"
    with refused(PortError, expected):
        barewire.ModbusServer(url, units={})
    with refused(PortError, expected):
        asyncio.run(barewire.AsyncModbusServer(url, units={}).start())


@pytest.mark.parametrize("url", ["tcp://localhost", "tcp://127.0.0.1:1", "tcp://[::1]:1"])
def test_a_refused_connection_is_reported_in_the_same_words(url: str) -> None:
    with pytest.raises(PortError) as blocking:
        barewire.ModbusClient(url)
    with pytest.raises(PortError) as waiting:
        asyncio.run(barewire.AsyncModbusClient(url).open())
    assert str(blocking.value) == str(waiting.value)


def test_a_client_that_is_cancelled_while_it_connects_leaves_no_bus_open(monkeypatch: pytest.MonkeyPatch) -> None:
    from barewire.io.canopen.bus.shared_bus import CanBus

    opening, go_on, opened = threading.Event(), threading.Event(), CanBus.open

    def slow(*args: Any, **options: Any) -> CanBus:
        opening.set()
        assert go_on.wait(10.0)
        return opened(*args, **options)

    monkeypatch.setattr(CanBus, "open", slow)

    async def main() -> None:
        client = barewire.AsyncCanopenClient("can://virtual/use")
        connecting = asyncio.create_task(client.open())
        assert await asyncio.to_thread(opening.wait, 10.0)
        connecting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await connecting
        go_on.set()

    asyncio.run(main())
    assert not readers()


def test_two_tasks_that_connect_at_once_open_one_bus() -> None:
    async def main() -> None:
        client = barewire.AsyncCanopenClient("can://virtual/use")
        await asyncio.gather(client.open(), client.open())
        assert len(readers()) == 1
        await client.close()

    asyncio.run(main())
    assert not readers()


def test_an_asyncio_machine_that_connected_by_itself_can_be_closed() -> None:
    async def main(url: str) -> None:
        machine = barewire.connect_async("adxl", url, unit=1)
        await machine.read(machine.readable[0])
        await machine.close()
        with refused(PortError, "the client was closed"):
            await machine.read(machine.readable[0])

    from barewire.devices.sim import simulator

    units: dict[int, Any] = {1: simulator("adxl").modbus}
    with barewire.ModbusServer("tcp://127.0.0.1:0", units=units) as server:
        asyncio.run(main(server.url))


def test_a_client_in_another_event_loop_is_explained() -> None:
    with barewire.ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as server:

        async def main() -> None:
            client = barewire.AsyncModbusClient(server.url)
            assert await client.read_coils(0, 1) == (False,)

            def elsewhere() -> None:
                with refused(PortError, "the client is connected in another event loop"):
                    asyncio.run(client.read_coils(0, 1))

            await asyncio.to_thread(elsewhere)
            assert await client.read_coils(0, 1) == (False,)
            await client.close()

        asyncio.run(main())


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_client_connects_again_after_its_event_loop_has_ended() -> None:
    # The loop ends without closing the client, so Python warns of the connections.
    with barewire.ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as server:
        client = barewire.AsyncModbusClient(server.url, in_flight=4)
        for _ in range(3):
            assert asyncio.run(_read(client)) == (False,)
        asyncio.run(client.close())
    del client
    gc.collect()


async def _read(client: barewire.AsyncModbusClient) -> tuple[bool, ...]:
    return await client.read_coils(0, 1)


def test_a_simulator_is_not_a_description() -> None:
    from barewire.devices.sim import simulator

    with refused(EncodeError, "expected the name or the path of a description, or a Device"):
        barewire.connect(simulator("az3"), "tcp://127.0.0.1:1")  # type: ignore[arg-type]


def test_a_node_with_faults_in_asyncio() -> None:
    async def main() -> None:
        url = "can://virtual/use?node=5"
        seen: list[str] = []
        async with (
            barewire.AsyncCanopenServer(url, device="az3", faults="drop:1", on_fault=seen.append),
            barewire.AsyncCanopenClient(url, timeout=0.1) as client,
        ):
            with pytest.raises(barewire.NoAnswer):
                await client.node(5).sdo.upload(0x1000)
        assert "drop" in seen

    asyncio.run(main())


@pytest.mark.parametrize(
    "again",
    [copy.deepcopy, copy.copy, lambda table: pickle.loads(pickle.dumps(table))],
    ids=["deep", "shallow", "pickle"],
)
def test_a_table_that_is_served_can_be_copied(again: Callable[[Table], Table]) -> None:
    table = Table()
    with barewire.ModbusServer("tcp://127.0.0.1:0", units={1: table}) as server, barewire.ModbusClient(server.url) as c:
        c.write_single_register(3, 7)
        assert again(table).handle(ReadHoldingRegisters(3, 1), 0.0) == table.handle(ReadHoldingRegisters(3, 1), 0.0)
