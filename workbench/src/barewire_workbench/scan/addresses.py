"""Find which registers or bits of a unit can be read: blocks, halved where the unit refuses them.

    0..124     exception 02
    0..61      exception 02    62..124   exception 02
    0..30      values          ...
    '------'   these exist

A block is refused as soon as one address in it does not exist, so only single addresses prove that one is missing. An
area without any address costs two requests for each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from barewire.errors import NoAnswer, PortError
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.messages.base import Request
from barewire.modbus.messages.coils import ReadCoils, ReadDiscreteInputs
from barewire.modbus.messages.registers import ReadHoldingRegisters, ReadInputRegisters

TABLES: dict[str, tuple[Callable[[int, int], Request[Any]], int]] = {
    "holding": (ReadHoldingRegisters, 125),
    "input": (ReadInputRegisters, 125),
    "coil": (ReadCoils, 2000),
    "discrete": (ReadDiscreteInputs, 2000),
}
"""Table -> the request that reads it, and how many addresses one request reads at most [MB-APP 6.1 to 6.4]."""

_NO_SUCH_ADDRESS = (0x02, 0x03)
"""Illegal Data Address; Illegal Data Value, which some devices answer instead for a block that is too long."""

_SILENT = 3
"""Requests in a row without an answer after which the unit is given up: halving a block that it ignores has no end."""


class ConnectionClosed(PortError):
    """The other side closed the connection in place of an answer, as some do for addresses that they do not know."""


class AddressRange(NamedTuple):
    """Addresses next to each other with the same result: "" if they can be read, otherwise why not."""

    first: int
    last: int
    problem: str = ""

    def __str__(self) -> str:
        place = str(self.first) if self.first == self.last else f"{self.first}-{self.last}"
        return place + (f": {self.problem}" if self.problem else "")


def find_addresses(read: Callable[[int, int], object], first: int, last: int, *, limit: int) -> Iterator[AddressRange]:
    """Yield what is known of the addresses `first` to `last`, in their order; those that do not exist are left out.

    `read(address, count)` reads a block of at most `limit` addresses and raises ModbusException, ConnectionClosed or
    NoAnswer. The NoAnswer of a unit that has left three requests in a row unanswered is raised.

    >>> def read(address, count):
    ...     if not set(range(address, address + count)) <= {3, 4, 5}:
    ...         raise ModbusException(2)
    >>> list(map(str, find_addresses(read, 0, 9, limit=125)))
    ['3-5']
    """
    blocks = [(start, min(start + limit - 1, last)) for start in range(first, last + 1, limit)]
    blocks.reverse()
    joined: AddressRange | None = None
    silent = 0
    while blocks:
        start, end = blocks.pop()
        problem = ""
        try:
            read(start, end - start + 1)
            silent = 0
        except ModbusException as exception:
            silent = 0
            problem = "absent" if exception.code in _NO_SUCH_ADDRESS else f"exception {exception.code:02X}"
        except ConnectionClosed:
            problem = "the connection was closed"
        except BaseException as error:
            silent += 1
            if silent == _SILENT or not isinstance(error, NoAnswer):
                if joined is not None:  # whatever ends the search, also Ctrl-C: this was found
                    yield joined
                raise
            problem = "no answer"
        if problem and end > start:
            middle = (start + end) // 2
            blocks += [(middle + 1, end), (start, middle)]
            continue
        if problem == "absent":
            continue
        piece = AddressRange(start, end, problem)
        if joined is not None and joined.last + 1 == start and joined.problem == piece.problem:
            joined = joined._replace(last=end)
        else:
            if joined is not None:
                yield joined
            joined = piece
    if joined is not None:
        yield joined
