"""A program for the guest kernel of the interop tests: the gateway on a CAN bus that is in trouble, with SocketCAN.

    vcan0     node 5, a simulated AZ3     the gateway: unit 5, and unit 6, which no node has     cangen, another node

    quiet             nothing else on the bus
    babbling          a node that fills a bus of 125 kbit/s with frames of the identifier 001h
    same identifier   a node that sends random data with that of the answers of node 5, twenty times a second
    bus-off           the controller reports it, and the interface is down for a second; then it is up again
    after it          nothing else on the bus

A client reads objects of known values by 2B/0D, and now and then one of the dead unit. Prints a row for each phase, in
JSON.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from barewire import AsyncModbusClient
from barewire.errors import NoAnswer, PortError
from barewire.modbus import CanopenReference, ModbusException
from tools.gateway_lab.programs import free_port, peak_memory, program

URL = "can://socketcan/vcan0"
OBJECTS = ((0x1000, 0, 4), (0x6041, 0, 2), (0x6081, 0, 4), (0x60FF, 0, 4), (0x1017, 0, 2))
"""Objects with values of their own: index, sub-index, bytes."""
SECONDS = 6.0
"""Of a phase."""
PATIENCE = 30.0
"""Seconds in which a client or the bus must come back."""

NODE = f"""
import signal
from barewire import CanopenServer
with CanopenServer("{URL}?node=5", device="az3"):
    print("ready", flush=True)
    signal.sigwait([signal.SIGTERM])
"""


@contextmanager
def sending(*arguments: str) -> Iterator[None]:
    """Let cangen send on the bus, beside everything else."""
    running = subprocess.Popen(["cangen", "vcan0", "-i", *arguments])
    try:
        yield
    finally:
        running.terminate()
        running.wait(10)


async def ask(client: AsyncModbusClient, seconds: float, expected: dict[Any, bytes]) -> dict[str, Any]:
    """Read objects for so long, and compare their values with those of a quiet bus."""
    counts: Counter[str] = Counter()
    until, number = time.monotonic() + seconds, 0
    while time.monotonic() < until:
        number += 1
        index, sub, size = OBJECTS[number % len(OBJECTS)]
        unit = 6 if number % 50 == 0 else 5
        try:
            answer = await client.ask(CanopenReference.read(unit, index, sub, count=size), unit=unit)
        except ModbusException as declined:
            counts[f"{declined.code:02X}"] += 1
        except (NoAnswer, PortError):
            counts["lost"] += 1
        else:
            is_right = answer.data == expected.setdefault((index, sub), answer.data)
            counts["right" if is_right else "wrong"] += 1
    return {"counts": counts}


async def recovery(client: AsyncModbusClient, expected: dict[Any, bytes]) -> float:
    """Return after how many seconds a read succeeds again."""
    begin = time.monotonic()
    while not (await ask(client, 0.001, expected))["counts"]["right"]:
        if time.monotonic() > begin + PATIENCE:
            raise TimeoutError(f"no answer within {PATIENCE:g} s")
    return time.monotonic() - begin


async def off_and_on() -> None:
    """Bus-off after a second; a second later the controller is restarted."""
    await asyncio.sleep(1.0)
    # As a controller reports it: an error frame, and the interface does not send until it is restarted.
    subprocess.run(["cansend", "vcan0", "20000040#0000000000000000"], check=True)
    subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
    await asyncio.sleep(1.0)
    subprocess.run(["ip", "link", "set", "vcan0", "up"], check=True)


async def phases(port: int) -> dict[str, Any]:
    """Carry out the phases one after the other."""
    expected: dict[Any, bytes] = {}
    rows: dict[str, Any] = {}
    async with AsyncModbusClient(f"tcp://127.0.0.1:{port}", timeout=PATIENCE) as client:
        rows["quiet"] = await ask(client, SECONDS, expected)
        for name, arguments in (
            ("babbling", ("-g", "1", "-I", "001", "-L", "8")),
            ("same identifier", ("-g", "50", "-I", "585", "-L", "8")),
        ):
            with sending(*arguments):
                rows[name] = await ask(client, SECONDS, expected)
            rows[name]["recovery"] = await recovery(client, expected)
        asking = asyncio.create_task(ask(client, 2.0, expected))
        await off_and_on()
        rows["bus-off"] = await asking
        rows["bus-off"]["recovery"] = await recovery(client, expected)
        rows["after it"] = await ask(client, SECONDS, expected)
    return rows


def main() -> None:
    """Run the gateway and the phases."""
    port = free_port()
    with TemporaryDirectory() as folder, program(sys.executable, "-c", NODE):
        file = Path(folder) / "gateway.toml"
        listener = f'[[listen]]\nurl = "tcp://127.0.0.1:{port}"\n'
        file.write_text(f'{listener}[[backend]]\nname = "bus"\nurl = "{URL}"\nunits = "5-6"\ntimeout = 0.5\n')
        with program(sys.executable, "-m", "barewire.gateway", str(file)) as gateway:
            rows = asyncio.run(phases(port))
            sys.stdout.write(json.dumps({**rows, "memory": peak_memory(gateway)}) + "\n")


if __name__ == "__main__":
    main()
