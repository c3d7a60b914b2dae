"""The asyncio client itself, with tasks that begin and are cancelled at any time, in virtual time.

    tasks  -->  AsyncModbusClient: queue, lanes, mailboxes, fast path  -->  units on a line (`one_line`)

Here nothing but the port and the clock is replaced: the event loop is asyncio's, in virtual time (`virtual_loop`). Each
question reads the register with its own number, which the unit answers with that number; a response to a read does not
say which register it is of, so a value that belongs to another question is visible.

What is checked, in every run:

    own value       a question returns its own number, or raises
    no repetition   each request is sent once, and a read `retries` times more
    bounded         all questions end within the time that they would need one after the other
    usable          after the trouble, when the window is over, a question is answered
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

from barewire.errors import NoAnswer
from barewire.io.modbus import async_connection
from barewire.io.modbus.async_client import AsyncModbusClient
from barewire.modbus import ModbusException, ReadHoldingRegisters, Request, WriteSingleRegister
from tests.model.choices import Choices
from tests.model.one_line import ECHO, SLOW_ECHO, Fate, Setup, Tally, UnitsOnLine
from tests.model.virtual_loop import VirtualLoop, VirtualSelector


@dataclass(frozen=True)
class Tasks:
    """The alphabet of a scenario: `line` has the choices of the line, of which `length` is the number of questions."""

    line: Setup
    in_flight: tuple[int, ...] = (1,)
    begin_after: tuple[float, ...] = (0.0, 0.0, 0.05, 0.4)
    cancel_after: tuple[float | None, ...] = (None, None, 0.0, 0.001, 0.1, 0.31)
    writes: tuple[bool, ...] = (False, False, True)


ON_TCP = Tasks(
    Setup(
        framing="tcp",
        length=12,
        fates=(
            Fate.ARRIVES,
            Fate.ARRIVES,
            Fate.LOST,
            Fate.IS_AN_EXCEPTION,
            Fate.DOUBLED_LATER,
            Fate.AFTER_ANOTHER_NUMBER,
        ),
        delays=(0.002, 0.1, 0.35, 0.8),
        probing=("ignores",),
    ),
    in_flight=(1, 2, 4),
)
ON_RTU = Tasks(replace(ON_TCP.line, framing="rtu", fates=ON_TCP.line.fates[:4], probing=Setup.probing))
WITH_ECHO = replace(ON_RTU, line=replace(ON_RTU.line, adapters=(ECHO, SLOW_ECHO)))


class NumberedUnits(UnitsOnLine):
    """Units that answer a read with the number of its register."""

    def transmit(self, data: bytes) -> None:
        """Take the number of the question from the request."""
        pdu = self._decoded(data)[1]
        if not self.is_probe(data):
            self.number = int.from_bytes(pdu[1:3] if pdu[0] == 3 else pdu[3:5], "big")
        super().transmit(data)


class VirtualLink:
    """The connection of the client: see `AsyncLink`."""

    def __init__(self, line: UnitsOnLine) -> None:
        self._line = line

    def write(self, item: bytes) -> None:
        """Send bytes, which may be several requests on TCP."""
        if self._line.setup.framing != "tcp":
            self._line.transmit(item)
            return
        while item:
            end = 6 + int.from_bytes(item[4:6], "big")
            self._line.transmit(item[:end])
            item = item[end:]

    write_together = write

    def sent(self) -> None:
        """Return None: everything is on the wire."""

    def close(self) -> None:
        """Do nothing."""


def tasks_scenario(setup: Tasks, tally: Tally) -> Callable[[Choices], NumberedUnits]:
    """The scenario of one setup: `setup.line.length` questions of tasks that begin and are cancelled at any time."""

    def play(choices: Choices) -> NumberedUnits:
        line = NumberedUnits(choices, setup.line)
        selector = VirtualSelector(line)
        loop = VirtualLoop(selector)

        async def connect(endpoint: object, receive: Callable[[bytes], object], lose: object) -> VirtualLink:
            selector.received = lambda data: loop.call_soon(receive, data)
            return VirtualLink(line)

        try:
            with patch.object(async_connection, "connect", connect):
                loop.run_until_complete(_play(loop, line, setup, tally))
        finally:
            loop.close()
        return line

    return play


async def _play(loop: VirtualLoop, line: NumberedUnits, setup: Tasks, tally: Tally) -> None:
    take, limits = line.choices.take, setup.line
    in_flight, retries = take(setup.in_flight), take(limits.retries)
    url = "tcp://unit:502" if limits.framing == "tcp" else "rtu:///dev/virtual?baudrate=19200"
    url += "&echo=1" if line.adapter.expects else ""
    options: dict[str, Any] = {"recovery": take(limits.recovery), "late_window": limits.late_window}
    client = AsyncModbusClient(url, unit=1, timeout=limits.timeout, in_flight=in_flight, retries=retries, **options)
    await client.open()
    begin = line.now
    tasks = []
    for number in range(1, limits.length + 1):
        await asyncio.sleep(take(setup.begin_after))
        is_write = take(setup.writes)
        request: Request[Any] = WriteSingleRegister(7, number) if is_write else ReadHoldingRegisters(number, 1)
        task = asyncio.ensure_future(client.ask(request))
        cancel_after = take(setup.cancel_after)
        if cancel_after is not None:
            loop.call_later(cancel_after, task.cancel)
        tasks.append((number, is_write, task))
        tally.questions += 1
    for number, is_write, task in tasks:
        try:
            response = await task
        except ModbusException:
            tally.exceptions += 1
        except NoAnswer:
            tally.no_answer += 1
        except asyncio.CancelledError:
            tally.cancelled += 1
        else:
            value = response.value if is_write else response.registers[0]
            if value == number:
                tally.right += 1
            else:
                tally.wrong.append(f"question {number} of {line.choices.script}: {value}")
        most = 1 + (0 if is_write else retries)
        assert line.sent.get(number, 0) <= most, (
            f"question {number} of {line.choices.script}: sent {line.sent[number]} times"
        )
    slowest = limits.length * (max(setup.begin_after) + limits.longest * (1 + retries))
    assert line.now - begin <= slowest, f"{line.choices.script}: {line.now - begin:.3f} s"
    await asyncio.sleep(limits.late_window)
    line.setup = Setup(framing=limits.framing, fates=(Fate.ARRIVES,), delays=(0.002,))
    assert (await client.ask(ReadHoldingRegisters(99, 1))).registers == (99,), line.choices.script
    counters = client.bus.counters
    assert counters.asked == counters.answered + counters.lost, (line.choices.script, counters)
    await client.close()
