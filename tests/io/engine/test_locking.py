"""One machine on several ports: one thread at a time is in it."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack
from typing import Any

from barewire import CanopenClient, CanopenServer, ModbusClient, ModbusServer, connect
from barewire.canopen import CanFrame
from barewire.devices import load
from barewire.devices.sim import Az3, simulator
from barewire.io.engine.locking import SharedUnits, exclusive
from barewire.modbus import Table
from barewire.modbus.messages.base import Response
from tests.helpers import free_port


class Watched(Table):
    """A unit and a node that count calls which overlap."""

    def __init__(self) -> None:
        super().__init__(16)
        self.inside, self.overlaps, self.calls = 0, 0, 0
        self.deadline: float | None = None

    def _enter(self) -> None:
        self.inside += 1
        self.calls += 1
        self.overlaps += self.inside > 1
        time.sleep(0.002)  # long enough for another thread to enter
        self.inside -= 1

    def handle(self, request: Any, now: float) -> Response | None:
        self._enter()
        return super().handle(request, now)

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        self._enter()
        return []


def test_several_servers_of_one_machine_enter_it_one_at_a_time() -> None:
    machine = Watched()
    with ExitStack() as stack:
        urls = [
            stack.enter_context(ModbusServer(u, units={1: machine})).url for u in ("tcp://127.0.0.1:0", "rtu://pty")
        ]
        bus = f"can://socketcand/127.0.0.1:{free_port()}/can0"
        stack.enter_context(CanopenServer(bus, device=machine))
        port = CanopenClient(bus)
        stack.callback(port.close)

        def ask(url: str) -> None:
            with ModbusClient(url) as client:
                for _ in range(15):
                    client.read_holding_registers(0, 1)

        threads = [threading.Thread(target=ask, args=(url,)) for url in urls]
        for thread in threads:
            thread.start()
        for number in range(15):
            port.send(CanFrame(number, b""))
            with exclusive(machine):
                before = machine.calls
                time.sleep(0.001)
                assert (machine.inside, machine.calls) == (0, before)
        for thread in threads:
            thread.join()
    assert machine.overlaps == 0
    assert machine.calls >= 30


def test_both_adapters_of_a_simulator_have_the_lock_of_the_machine() -> None:
    machine = simulator("az3")
    assert exclusive(machine) is exclusive(machine.modbus) is exclusive(machine.canopen)
    assert exclusive(machine) is not exclusive(simulator("az3"))


def locks_taken_at_once(machine: Table) -> set[int]:
    """The identities of the locks that four threads find at the same time."""
    start = threading.Barrier(4)
    found: list[object] = []

    def take() -> None:
        start.wait()
        found.append(exclusive(machine))

    threads = [threading.Thread(target=take) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return {id(lock) for lock in found}


def test_a_machine_has_one_lock_for_all_threads() -> None:
    for _ in range(50):
        machine = Table()
        assert locks_taken_at_once(machine) == {id(exclusive(machine))}


def test_objects_without_attributes_share_one_lock() -> None:
    assert exclusive(object()) is exclusive(5)
    assert exclusive(Table()) is not exclusive(5)


def test_a_shared_unit_has_the_other_attributes_of_its_unit() -> None:
    units = SharedUnits({1: Table(), 2: simulator("adxl").modbus})
    assert getattr(units[2], "diagnostics", True) is False
    assert getattr(units[1], "diagnostics", None) is None
    assert list(units) == [1, 2]
    assert units[1] is units[1]


def test_values_written_on_one_bus_are_read_on_the_other_at_the_same_time() -> None:
    """One AZ3 in two threads: values written on one wire are read on the other, hundreds of times."""
    machine, az3 = simulator("az3", time.monotonic()), load("az3")
    assert isinstance(machine, Az3)
    assert machine.modbus is not None
    with ExitStack() as stack:
        host = stack.enter_context(ModbusServer("rtu://pty?pace=0", units={1: machine.modbus}))
        bus = stack.enter_context(
            CanopenServer(f"can://socketcand/127.0.0.1:{free_port()}/can0", device=machine.canopen)
        )
        serial = stack.enter_context(connect(az3, host.url))
        can = stack.enter_context(connect(az3, bus.url))
        for number in range(40):
            serial.write({"TARGET VELOCITY": number})
            assert can["TARGET VELOCITY"].value == number
            can.write({"TARGET POSITION": -number})
            readings = serial.read("TARGET POSITION", "STATUS WORD")
            assert readings[0].value == -number
            assert readings[1].value == can["STATUS WORD"].value
