"""Who may do what: roles, and what each of them is permitted. Data, and nothing is permitted that it does not say.

    {"Viewer":   [{"functions": [1, 2, 3, 4]}],
     "Operator": [{"functions": [1, 2, 3, 4, 23]},
                  {"functions": [5, 6, 15, 16], "units": "1-10", "addresses": "0-99,200"}],
     "":         []}                                     the role of a certificate that names none

A request is permitted if one line of its role permits it whole: its function, its unit, and every address it touches.
The table is the user's: there is no default, and a role that is not in it may do nothing [MB-TLS R-23, R-27, R-28].
What is refused gets exception 01 [MB-TLS R-31].
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from barewire.errors import EncodeError
from barewire.modbus.message import Request

_NUMBERS = "numbers and ranges, such as 0-99,200"
_PLACES = (
    ("address", "quantity"),
    ("read_address", "read_quantity"),
    ("write_address", "write_quantity"),
)
"""The fields of a request that say what it touches. Without a quantity it is one."""


class Permission(NamedTuple):
    """One line of the table. None stands for all: all functions, all units, all addresses."""

    functions: frozenset[int] | None = None
    units: tuple[range, ...] | None = None
    addresses: tuple[range, ...] | None = None

    def allows(self, unit: int, request: Request[Any]) -> bool:
        """Whether this line permits the request whole."""
        if self.functions is not None and request.function_code not in self.functions:
            return False
        if self.units is not None and not any(unit in span for span in self.units):
            return False
        return self.addresses is None or all(self._covers(touched) for touched in touches(request))

    def _covers(self, touched: range) -> bool:
        assert self.addresses is not None
        return all(any(address in span for span in self.addresses) for address in touched)


class Authorisation:
    """The whole table: role -> its permissions.

    >>> table = Authorisation.parse('{"Viewer": [{"functions": [3, 4], "addresses": "0-99"}]}')
    >>> from barewire.modbus import ReadHoldingRegisters, WriteSingleRegister
    >>> [table.allows("Viewer", 1, ReadHoldingRegisters(at, 2)) for at in (98, 99)]
    [True, False]
    >>> table.allows("Viewer", 1, WriteSingleRegister(0, 0)), table.allows(None, 1, ReadHoldingRegisters(0, 1))
    (False, False)
    """

    def __init__(self, roles: Mapping[str, Sequence[Permission]]) -> None:
        self.roles = dict(roles)

    @classmethod
    def parse(cls, text: str) -> Authorisation:
        """The table from JSON. EncodeError says what is wrong with it."""
        try:
            table = json.loads(text)
            return cls({str(role): [_permission(role, row) for row in rows] for role, rows in table.items()})
        except (ValueError, AttributeError, TypeError) as error:
            if isinstance(error, EncodeError):
                raise
            raise EncodeError(f"a table of roles is JSON, role -> list of permissions: {error}") from None

    def allows(self, role: str | None, unit: int, request: Request[Any]) -> bool:
        """Whether somebody of this role may ask this of that unit."""
        return any(line.allows(unit, request) for line in self.roles.get(role or "", ()))


def touches(request: Request[Any]) -> list[range]:
    """The addresses that a request reads or writes; none for a request that has no addresses."""
    found = []
    for at, count in _PLACES:
        first = getattr(request, at, None)
        if first is not None:
            registers: Sequence[int] = getattr(request, "registers", (0,))
            quantity = getattr(request, count, len(registers) if at == "write_address" else 1)
            found.append(range(first, first + quantity))
    return found


def _permission(role: str, row: Mapping[str, Any]) -> Permission:
    unknown = set(row) - {"functions", "units", "addresses"}
    if unknown:
        raise EncodeError(f"role {role!r}: unknown {min(unknown)!r}, expected functions, units, addresses")
    functions = row.get("functions")
    if functions is not None and not all(isinstance(code, int) and 1 <= code <= 127 for code in functions):
        raise EncodeError(f"role {role!r}: functions {functions!r}: expected a list of 1..127", "functions")
    return Permission(
        None if functions is None else frozenset(functions),
        _spans(role, "units", row.get("units"), 0xFF),
        _spans(role, "addresses", row.get("addresses"), 0xFFFF),
    )


def _spans(role: str, name: str, text: Any, last: int) -> tuple[range, ...] | None:
    if text is None:
        return None
    spans = []
    for part in _parts(text):
        low, dash, high = part.partition("-")
        if not low.strip().isdecimal() or (dash and not high.strip().isdecimal()) or int(high or low) > last:
            raise EncodeError(f"role {role!r}: {name} {text!r}: expected {_NUMBERS}, up to {last}", name)
        spans.append(range(int(low), int(high or low) + 1))
    return tuple(spans)


def _parts(text: Any) -> Iterable[str]:
    return str(text).split(",")
