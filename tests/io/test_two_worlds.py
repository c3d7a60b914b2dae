"""The public faces of blocking and asyncio code: the same names, and the same parameters behind each name."""

from __future__ import annotations

import asyncio
import inspect
from typing import Any

import pytest

import barewire

# What one world has for a reason: a thread to run in and its end, a port that only this world opens, await.
ONLY_BLOCKING = {
    "ModbusServer": {"run", "is_over", "on_end"},
    "CanopenServer": {"run", "is_over", "on_end", "port"},
}
ONLY_ASYNCIO = {
    "ModbusServer": {"authorization"},  # of the running server; in both worlds it is an argument
    "CanopenClient": {"open", "open_and_carry_out"},  # the constructor of a blocking client opens the bus
}


def face(found: Any) -> set[str]:
    return {name for name in dir(found) if not name.startswith("_")}


def parameters(function: Any) -> list[str]:
    found = inspect.signature(getattr(function, "__func__", function)).parameters.values()
    return [f"{one.kind.name} {one.name} = {one.default}" for one in found]


def differences(name: str, blocking: Any, with_asyncio: Any) -> list[str]:
    """Return what one of two objects has and the other has not, apart from what is listed above."""
    found = [
        f"{name}.{one}: no asyncio" for one in face(blocking) - face(with_asyncio) - ONLY_BLOCKING.get(name, set())
    ]
    found += [
        f"{name}.{one}: asyncio only" for one in face(with_asyncio) - face(blocking) - ONLY_ASYNCIO.get(name, set())
    ]
    for one in sorted(face(blocking) & face(with_asyncio)):
        here, there = getattr(blocking, one), getattr(with_asyncio, one)
        if inspect.isroutine(here) and parameters(here) != parameters(there):
            found.append(f"{name}.{one}: {parameters(here)} and {parameters(there)}")
    return found


def test_every_class_of_the_front_door_has_a_counterpart_with_the_same_arguments() -> None:
    names = [name for name in barewire.__all__ if name.endswith(("Client", "Server")) and not name.startswith("Async")]
    assert names == ["ModbusClient", "ModbusServer", "CanopenClient", "CanopenServer"]
    for name in names:
        blocking, with_asyncio = parameters(getattr(barewire, name)), parameters(getattr(barewire, f"Async{name}"))
        extra = {"AsyncModbusServer": ["KEYWORD_ONLY listener = None"], "AsyncModbusClient": ["in_flight"]}
        allowed = extra.get(f"Async{name}", [])
        assert [one for one in blocking if one not in with_asyncio] == []
        assert [one for one in with_asyncio if one not in blocking and not any(word in one for word in allowed)] == []
    assert parameters(barewire.connect) == parameters(barewire.connect_async)


def test_modbus_clients_servers_machines_and_drives_have_one_face() -> None:
    async def main() -> list[str]:
        units = {1: barewire.Table()}
        found = []
        async with barewire.AsyncModbusServer("tcp://127.0.0.1:0", units) as other:
            with barewire.ModbusServer("tcp://127.0.0.1:0", units) as server:
                found += differences("ModbusServer", server, other)
        blocking = barewire.ModbusClient("tcp://127.0.0.1:1", lazy=True)
        with_asyncio = barewire.AsyncModbusClient("tcp://127.0.0.1:1")
        found += differences("ModbusClient", blocking, with_asyncio)
        found += differences("ModbusClient.at", blocking.at(unit=3), with_asyncio.at(unit=3))
        machine = barewire.connect("csd-mt", "tcp://127.0.0.1:1", lazy=True)
        async_machine = barewire.connect_async("csd-mt", "tcp://127.0.0.1:1")
        found += differences("MachineClient", machine, async_machine)
        return found + differences("DriveClient", machine.drive, async_machine.drive)

    assert asyncio.run(main()) == []


def test_canopen_clients_nodes_groups_and_streams_have_one_face() -> None:
    async def main() -> list[str]:
        url = "can://virtual/two-worlds"
        found = []
        async with barewire.AsyncCanopenServer(f"{url}?node=5", device="az3") as other:
            with barewire.CanopenServer("can://virtual/another-world?node=5", device="az3") as server:
                found += differences("CanopenServer", server, other)
            with barewire.CanopenClient(url) as blocking:
                async with barewire.AsyncCanopenClient(url) as with_asyncio:
                    found += differences("CanopenClient", blocking, with_asyncio)
                    clients: list[Any] = [blocking, with_asyncio]
                    for options in ({}, {"device": "az3"}):
                        nodes = [client.node(5, **options) for client in clients]
                        found += differences("Node", *nodes)
                        for group in ("sdo", "nmt", "pdo", *(["drive"] if options else [])):
                            found += differences(f"Node.{group}", *(getattr(node, group) for node in nodes))
                    for group in ("nmt", "lss", "sync", "time"):
                        found += differences(group, getattr(blocking, group), getattr(with_asyncio, group))
                    with blocking.frames() as stream, with_asyncio.frames() as async_stream:
                        found += differences("Stream", stream, async_stream)
                    with blocking.sync.start(9.0) as running, with_asyncio.sync.start(9.0) as async_running:
                        found += differences("Running", running, async_running)
        return found

    assert asyncio.run(main()) == []


@pytest.mark.parametrize("missing", ["move", "read"])
def test_the_comparison_notices_what_is_missing(missing: str) -> None:
    class Blocking:
        def move(self, target: int) -> None: ...
        def read(self, name: str) -> None: ...

    class Asyncio:
        async def move(self, target: int) -> None: ...
        async def read(self, name: str) -> None: ...

    assert differences("x", Blocking, Asyncio) == []
    delattr(Asyncio, missing)
    assert differences("x", Blocking, Asyncio) == [f"x.{missing}: no asyncio"]


class Breaking:
    """A machine that sends one frame that no bus carries."""

    deadline = 0.0

    def feed(self, frame: object, now: float) -> list[Any]:
        raise barewire.EncodeError("no such frame")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_the_error_that_ended_a_machine_is_kept_in_both_worlds() -> None:
    async def main() -> None:
        async with barewire.AsyncCanopenClient("can://virtual/breaking") as client:
            running = client.host(Breaking())
            while running.failure is None:
                await asyncio.sleep(0.001)
            assert str(running.failure) == "no such frame"

    asyncio.run(asyncio.wait_for(main(), 30))
    with barewire.CanopenClient("can://virtual/breaking") as client:
        hosted = client.host(Breaking())
        hosted._thread.join(30)
        assert str(hosted.failure) == "no such frame"
