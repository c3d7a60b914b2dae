"""Authorization: requests without a permission are refused; invalid tables are an error."""

from __future__ import annotations

from typing import Any

from barewire.errors import EncodeError
from barewire.modbus import (
    Authorization,
    Diagnostics,
    MaskWriteRegister,
    ReadHoldingRegisters,
    ReadWriteMultipleRegisters,
    ReportServerId,
    Request,
    WriteFileRecord,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleRegister,
)
from tests.helpers import every_case, refused

TABLE = Authorization.parse(
    """{"Viewer": [{"functions": [3, 4, 17]}],
        "Operator": [{"functions": [3]}, {"functions": [6, 15, 16, 22, 23], "units": "1-3,7", "addresses": "10-19,30"}],
        "Engineer": [{}],
        "Corner": [{"addresses": "0-9"}],
        "Files": [{"functions": [8, 20, 21], "addresses": "0-9"}],
        "": [{"functions": [17]}]}"""
)


@every_case(
    ("role", "unit", "request_", "allowed"),
    [
        ("Viewer", 1, ReadHoldingRegisters(0, 125), True),
        ("Viewer", 1, WriteSingleRegister(0, 0), False),
        ("Viewer", 1, ReportServerId(), True),
        ("Operator", 1, WriteSingleRegister(10, 0), True),
        ("Operator", 1, WriteSingleRegister(30, 0), True),
        ("Operator", 1, WriteSingleRegister(20, 0), False),
        ("Operator", 7, WriteSingleRegister(10, 0), True),
        ("Operator", 4, WriteSingleRegister(10, 0), False),
        ("Operator", 1, WriteMultipleRegisters(18, (1, 2)), True),
        ("Operator", 1, WriteMultipleRegisters(18, (1, 2, 3)), False),
        ("Operator", 1, WriteMultipleCoils(18, (True, True, True)), False),
        ("Operator", 1, MaskWriteRegister(20, 0, 0), False),
        ("Operator", 1, ReadWriteMultipleRegisters(10, 2, 18, (1, 2)), True),
        ("Operator", 1, ReadWriteMultipleRegisters(9, 2, 18, (1, 2)), False),
        ("Operator", 1, ReadWriteMultipleRegisters(10, 2, 18, (1, 2, 3)), False),
        ("Engineer", 200, WriteSingleRegister(9999, 0), True),
        ("Engineer", 200, WriteFileRecord(((1, 0, (5,)),)), True),
        ("Corner", 1, WriteSingleRegister(9, 0), True),
        ("Corner", 1, WriteFileRecord(((1, 0, (5,)),)), False),
        ("Corner", 1, Diagnostics(0x04), False),
        ("Files", 1, WriteFileRecord(((1, 0, (5,)),)), True),
        ("Files", 1, Diagnostics(0x04), True),
        (None, 1, ReportServerId(), True),
        (None, 1, ReadHoldingRegisters(0, 1), False),
        ("viewer", 1, ReadHoldingRegisters(0, 1), False),
        ("Unknown", 1, ReadHoldingRegisters(0, 1), False),
    ],
)
def test_requests_that_are_permitted_and_refused(
    role: str | None, unit: int, request_: Request[Any], allowed: bool
) -> None:
    assert TABLE.allows(role, unit, request_) is allowed


@every_case(
    ("text", "error"),
    [
        ("{", "a table of roles is JSON"),
        ("[]", "a table of roles is JSON, role -> list of permissions: this is a list"),
        ("[" * 100_000, "a table of roles is JSON"),
        ('{"Viewer": [1]}', "role 'Viewer': expected a list of permissions, each {...}"),
        ('{"Viewer": {"functions": [3]}}', "role 'Viewer': expected a list of permissions, each {...}"),
        ('{"Viewer": [], "Viewer": [{}]}', "'Viewer' is given twice"),
        ('{"Viewer": [{"units": "1", "units": "1-9"}]}', "'units' is given twice"),
        ('{"Viewer": [{"functions": [true]}]}', "expected a list of 1..127"),
        ('{"Viewer": [{"functions": 3}]}', "expected a list of 1..127"),
        ('{"Viewer": [{"addresses": "9-0"}]}', "addresses '9-0': expected numbers and ranges"),
        ('{"Viewer": [{"addresses": "٣"}]}', "expected numbers and ranges"),
        ('{"Viewer": [{"function": [3]}]}', "role 'Viewer': unknown 'function', expected functions, units, addresses"),
        ('{"Viewer": [{"functions": [300]}]}', "expected a list of 1..127"),
        ('{"Viewer": [{"units": "1-300"}]}', "expected numbers and ranges, such as 0-99,200, up to 255"),
        ('{"Viewer": [{"addresses": "1-"}]}', "expected numbers and ranges"),
    ],
)
def test_an_invalid_table_is_refused(text: str, error: str) -> None:
    with refused(EncodeError, error):
        Authorization.parse(text)
