"""Authorization: roles and their permissions, as data. A request that no permission covers is refused.

    {"Viewer":   [{"functions": [1, 2, 3, 4]}],
     "Operator": [{"functions": [1, 2, 3, 4, 23]},
                  {"functions": [5, 6, 15, 16], "units": "1-10", "addresses": "0-99,200"}],
     "":         []}                                     the role of a certificate without a role

A request is permitted if one permission of its role covers it completely: its function, its unit, and every address it
touches. A permission with `addresses` covers a request without addresses (files, diagnostics) only if it also lists the
function: permission for registers 0 to 9 does not imply access to files.
There is no default table, and a role that is not in the table has no permissions [MB-TLS R-23, R-27, R-28]. A refused
request gets exception 01 [MB-TLS R-31].

The role of a client, an extension of its certificate.                                    [MB-TLS R-21, R-22, R-65]

    Certificate > TBSCertificate > [3] > Extensions > Extension { OID, critical?, OCTET STRING > UTF8String }

    30 19  06 0B 2B 06 01 04 01 83 89 0C 86 22 01  04 0A  0C 08 4F 70 65 72 61 74 6F 72
           OID 1.3.6.1.4.1.50316.802.1             octets UTF8String "Operator"

There is at most one role, and the whole text is its name. A certificate without a role is valid: its role is None.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from barewire.errors import DecodeError, EncodeError
from barewire.modbus.messages.base import Request

ROLE = bytes.fromhex("2B0601040183890C862201")
"""1.3.6.1.4.1.50316.802.1 in DER."""

_EXTENSIONS, _OID, _UTF8 = 0xA3, 0x06, 0x0C


def role_of(certificate: bytes) -> str | None:
    """Return the role in a certificate (DER), or None. Raises DecodeError for several roles, or one that is no text."""
    _, certificate_body = next(_parts(certificate))
    _, signed = next(_parts(certificate_body))
    for tag, extensions in _parts(signed):
        if tag == _EXTENSIONS:
            return role_in(extensions)
    return None


def role_in(extensions: bytes) -> str | None:
    """Return the role in the extensions of a certificate, a SEQUENCE in DER, or None. Raises as `role_of`."""
    roles = []
    _, rows = next(_parts(extensions))
    for _, extension in _parts(rows):
        fields = list(_parts(extension))
        if fields[0] == (_OID, ROLE):
            roles.append(_text(extensions, fields[-1][1]))
    if len(roles) > 1:
        raise DecodeError("value", extensions, 0, f"{len(roles)} roles in one certificate, there may be one")
    return roles[0] if roles else None


def _text(certificate: bytes, inside: bytes) -> str:
    values = list(_parts(inside))
    if len(values) != 1 or values[0][0] != _UTF8:
        raise DecodeError("value", certificate, 0, "the role in the certificate is not one UTF8String")
    try:
        return values[0][1].decode()
    except UnicodeDecodeError:
        raise DecodeError("value", certificate, 0, "the role in the certificate is not UTF-8") from None


def _parts(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the values in a row of DER: tag and content."""
    place = 0
    while place < len(data) or not data:
        if place + 2 > len(data):
            raise DecodeError("short", data, len(data), "DER ends within a value")
        tag, size, start = data[place], data[place + 1], place + 2
        if size == 0x80:
            raise DecodeError("value", data, place + 1, "a length that is not given: DER has only known lengths")
        if size & 0x80:
            start += size & 0x7F
            size = int.from_bytes(data[place + 2 : start], "big")
        if start + size > len(data):
            raise DecodeError("short", data, len(data), "DER ends within a value")
        yield tag, data[start : start + size]
        place = start + size


_NUMBERS = "numbers and ranges, such as 0-99,200"
_PLACES = (
    ("address", "quantity"),
    ("read_address", "read_quantity"),
    ("write_address", "write_quantity"),
)
"""The fields of a request that hold an address and a quantity. Without a quantity field it is 1."""


class Permission(NamedTuple):
    """One permission of a role. None means all: all functions, all units, all addresses."""

    functions: frozenset[int] | None = None
    units: tuple[range, ...] | None = None
    addresses: tuple[range, ...] | None = None

    def allows(self, unit: int, request: Request[Any]) -> bool:
        """Whether this permission covers the request completely."""
        if self.functions is not None and request.function_code not in self.functions:
            return False
        if self.units is not None and not any(unit in span for span in self.units):
            return False
        if self.addresses is None:
            return True
        if getattr(request, "is_malformed", False):  # a `RawRequest`: a device may carry it out, at any address
            return False
        touched = _touches(request)
        return all(map(self._covers, touched)) if touched else self.functions is not None

    def _covers(self, touched: range) -> bool:
        assert self.addresses is not None
        return all(any(address in span for span in self.addresses) for address in touched)


class Authorization:
    """The table: role -> its permissions.

    >>> table = Authorization.parse('{"Viewer": [{"functions": [3, 4], "addresses": "0-99"}]}')
    >>> from barewire.modbus import ReadHoldingRegisters, WriteSingleRegister
    >>> [table.allows("Viewer", 1, ReadHoldingRegisters(address, 2)) for address in (98, 99)]
    [True, False]
    >>> table.allows("Viewer", 1, WriteSingleRegister(0, 0)), table.allows(None, 1, ReadHoldingRegisters(0, 1))
    (False, False)
    """

    def __init__(self, roles: Mapping[str, Sequence[Permission]]) -> None:
        self.roles = dict(roles)

    def __repr__(self) -> str:
        return f"<Authorization: roles {', '.join(self.roles) or 'none'}>"

    @classmethod
    def parse(cls, text: str) -> Authorization:
        """Read the table from JSON text. Raises EncodeError, with the reason, if it is not valid."""
        import json  # here, because every server loads this file, and few have such a table

        form = "a table of roles is JSON, role -> list of permissions"
        try:
            table = json.loads(text, object_pairs_hook=_once)
        except EncodeError:
            raise
        except (ValueError, RecursionError) as error:
            raise EncodeError(f"{form}: {error}") from None
        if not isinstance(table, dict):
            raise EncodeError(f"{form}: this is a {type(table).__name__}")
        return cls({role: _permissions(role, rows) for role, rows in table.items()})

    def allows(self, role: str | None, unit: int, request: Request[Any]) -> bool:
        """Whether a client with this role may send this request to this unit. None: a certificate without a role."""
        return any(permission.allows(unit, request) for permission in self.roles.get(role or "", ()))


def _touches(request: Request[Any]) -> list[range]:
    """Return the addresses that a request reads or writes; none for a request that has no addresses."""
    ranges = []
    for address_field, quantity_field in _PLACES:
        first = getattr(request, address_field, None)
        if first is not None:
            registers: Sequence[int] = getattr(request, "registers", (0,))
            ranges.append(range(first, first + getattr(request, quantity_field, len(registers))))
    return ranges


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object as a dict. Raises EncodeError for a name that occurs twice: `json` would drop the first."""
    table: dict[str, Any] = {}
    for name, value in pairs:
        if name in table:
            raise EncodeError(f"a table of roles: {name!r} is given twice")
        table[name] = value
    return table


def _permissions(role: str, rows: Any) -> list[Permission]:
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise EncodeError(f"role {role!r}: expected a list of permissions, each {{...}}")
    return [_permission(role, row) for row in rows]


def _permission(role: str, row: Mapping[str, Any]) -> Permission:
    unknown = set(row) - {"functions", "units", "addresses"}
    if unknown:
        raise EncodeError(f"role {role!r}: unknown {min(unknown)!r}, expected functions, units, addresses")
    functions = row.get("functions")
    if functions is not None and not (isinstance(functions, list) and all(map(_is_code, functions))):
        raise EncodeError(f"role {role!r}: functions {functions!r}: expected a list of 1..127", "functions")
    return Permission(
        None if functions is None else frozenset(functions),
        _spans(role, "units", row.get("units"), 0xFF),
        _spans(role, "addresses", row.get("addresses"), 0xFFFF),
    )


def _is_code(code: Any) -> bool:
    return type(code) is int and 1 <= code <= 0x7F  # True is an int too, but not a function code


def _spans(role: str, name: str, text: Any, last: int) -> tuple[range, ...] | None:
    if text is None:
        return None
    spans = []
    for part in str(text).split(","):
        low, dash, high = (number.strip() for number in part.partition("-"))
        high = high if dash else low
        if not (_is_number(low) and _is_number(high) and int(low) <= int(high) <= last):
            raise EncodeError(f"role {role!r}: {name} {text!r}: expected {_NUMBERS}, up to {last}", name)
        spans.append(range(int(low), int(high) + 1))
    return tuple(spans)


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdecimal()
