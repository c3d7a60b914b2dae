"""A read by name compared with the raw read of the same registers: blocking client and our server, on the loopback."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

import pytest

from barewire import ModbusClient, ModbusServer, Table
from barewire.devices import load, plan_reads
from bench.race import Factory, Race, Work, entries

ADXL = load("adxl")
NAMES = {
    1: ["L1 current"],
    3: ["L1 current", "L2 current", "L3 current"],
    10: [parameter.name for parameter in ADXL.parameters if parameter.modbus and parameter.modbus.table == "input"][
        :10
    ],
}


def _client(closing: ExitStack) -> ModbusClient:
    server = closing.enter_context(ModbusServer("tcp://127.0.0.1:0", units={1: Table()}))
    return closing.enter_context(ModbusClient(server.url))


def _race(count: int) -> Race:
    names = NAMES[count]
    blocks = plan_reads(ADXL, [ADXL.find(name) for name in names])

    def raw(closing: ExitStack) -> Work:
        client = _client(closing)

        def read() -> None:
            for block in blocks:
                client.read_input_registers(block.address, block.quantity)

        return read

    def by_name(closing: ExitStack) -> Work:
        client = _client(closing)

        def read() -> None:
            client.read(ADXL, *names)

        return read

    contestants: dict[str, Factory] = {"raw read": raw, "barewire": by_name}
    return Race("Named read", "values of the ADXL", count, contestants, rounds=61, turn=0.01)


@pytest.mark.parametrize(("race", "contestant"), entries(*map(_race, NAMES)))
def test_named_read(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)
