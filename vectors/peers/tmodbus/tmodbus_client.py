"""Part of the adapter of tmodbus: its protocols on the line of kind `client`, in an event loop with virtual time."""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

from adapter import NotOffered, octets
from adapter_client import ExceptionAnswer
from client_line import BEGIN, Line, needs, told
from tmodbus.exceptions import ModbusResponseError
from tmodbus.transport.async_ascii import ModbusAsciiProtocol
from tmodbus.transport.async_rtu import ModbusRtuProtocol, compute_interframe_delay
from tmodbus.transport.async_tcp import ModbusTcpProtocol

MODULES = {"rtu": "tmodbus.transport.async_rtu", "ascii": "tmodbus.transport.async_ascii"}


class Wire(asyncio.WriteTransport):
    """What a protocol writes to, and what the line hands it."""

    def __init__(self, line: Any) -> None:
        super().__init__()
        self.line, self.closing, self.protocol = line, False, made(line)
        self.protocol.connection_made(self)

    def write(self, data: Any) -> None:
        self.line.write(bytes(data))

    def is_closing(self) -> bool:
        return self.closing

    def close(self) -> None:
        self.closing = True
        self.line.close()

    abort = close

    def deliver(self) -> None:
        """Hand over each piece that has come."""
        while not self.closing and self.line.peer.coming and self.line.peer.coming[0][0] <= self.line.microseconds():
            self.protocol.data_received(self.line.peer.coming.pop(0)[1])


def made(line: Any) -> Any:
    """Return the protocol of the library for a line."""
    settings = {"on_connection_lost": lambda _error: None, "timeout": line.timeout}
    if not line.is_serial:
        return ModbusTcpProtocol(**settings)
    delay = compute_interframe_delay(11 / line.baudrate)
    kind = ModbusRtuProtocol if line.setup["framing"] == "rtu" else ModbusAsciiProtocol
    return kind(**settings, **({"interframe_delay": delay} if kind is ModbusRtuProtocol else {}))


class Clock(selectors.SelectSelector):
    """The selector of the loop: instead of waiting it lets the time of the line pass."""

    def __init__(self, line: Any, wire: Wire) -> None:
        super().__init__()
        self.line, self.wire = line, wire

    def select(self, timeout: float | None = None) -> list[Any]:
        if timeout is None or timeout > 0:
            until, due = self.line.now + (3600.0 if timeout is None else timeout), self.line.due()
            self.line.now = max(self.line.now, until if due is None or due > until else due)
        self.wire.deliver()
        return []


def client(class_of: Callable[[bytes], Any]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Return the function that answers client.run; `class_of` finds the class of a message."""

    def run(case: dict[str, Any]) -> dict[str, Any]:
        line = Line(case)
        at_once = line.setup.pop("at_once", 1)
        needs(line, "rtu", "ascii", "tcp")
        if at_once > 1 and line.is_serial:
            raise NotOffered("one question at a time on a serial line")
        with ExitStack() as patches:
            if line.is_serial:
                patches.enter_context(patch(f"{MODULES[line.setup['framing']]}.time", line))
            wire = Wire(line)
            loop = asyncio.SelectorEventLoop(Clock(line, wire))
            patches.callback(loop.close)
            loop.time = line.monotonic  # type: ignore[method-assign]
            outcomes = loop.run_until_complete(questions(line, wire, case["ask"], at_once, class_of))
        return {"ask": [{"outcome": one, "seen": seen} for one, seen in zip(outcomes, line.peer.seen)]}

    return run


async def questions(line: Any, wire: Wire, rows: list[dict[str, Any]], at_once: int, class_of: Any) -> list[str]:
    """Ask each question as soon as it is due and no more than so many are open."""
    places = asyncio.Semaphore(at_once)
    tasks = []
    for place, row in enumerate(rows):
        await places.acquire()
        if (pause := BEGIN + row["at"] / 1e6 - line.now) > 0:
            await asyncio.sleep(pause)
        line.peer.begin(place)
        tasks.append(asyncio.ensure_future(one(line, wire, place, row, places, class_of)))
        await asyncio.sleep(0)
    return await asyncio.gather(*tasks)


async def one(line: Any, wire: Wire, place: int, row: dict[str, Any], places: Any, class_of: Any) -> str:
    """Ask one question, and return the text of its outcome."""
    pdu = octets(row["pdu"])
    try:
        found = await wire.protocol.send_and_receive(row["unit"], class_of(pdu).decode_request(pdu))
    except NotOffered:
        raise
    except ModbusResponseError as error:
        return told(pdu[0], ExceptionAnswer(int(error.error_code)), row, line.is_serial)
    except Exception:
        return "no answer"
    finally:
        line.peer.end(place)
        places.release()
    return told(pdu[0], found, row, line.is_serial)
