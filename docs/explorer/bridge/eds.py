"""An electronic data sheet or device configuration file for the page: its objects, and what is wrong with it."""

from __future__ import annotations

from typing import Any

from barewire.canopen.eds.eds_file import parse
from barewire.canopen.eds.objects import every_item
from barewire.errors import EncodeError
from barewire_workbench.eds.lint import lint

_ROWS = 1000
"""The most objects that are shown."""


def eds(text: str) -> dict[str, Any]:
    """Return the objects of a file as rows, and its findings as sentences."""
    if not text.strip():
        raise EncodeError("no file: paste the text of an EDS or DCF, or drop the file")
    file = parse(text.encode())
    rows = [
        [f"{described.index:04X}h:{item.sub:02X}", item.name, item.type or "", item.access or "", _text(item.default)]
        for described, item in every_item(file.objects.values())
    ]
    return {
        "title": file.get("DeviceInfo", "ProductName") or "a device without a name",
        "rows": rows[:_ROWS],
        "more": max(0, len(rows) - _ROWS),
        "findings": [str(finding) for finding in lint(file)],
    }


def _text(value: object) -> str:
    return "" if value is None else str(value)
