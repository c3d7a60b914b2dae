"""Writes docs/reference/devices.md: run `python tools/devices.py` after every change of the catalogue.

    counts        for each table of the manuals its number of rows, there and in the catalogue
    corrections   every `printed`: the text in the manual, and the value in the catalogue

The numbers of the manuals are constants, as counted on their pages; this tool counts the catalogue. The tests call the
same functions, and fail if the two differ or if the page is out of date.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parent.parent
CATALOG = ROOT / "src" / "barewire" / "devices" / "catalog"
PAGE = ROOT / "docs" / "reference" / "devices.md"

Row = dict[str, Any]


class Count(NamedTuple):
    """One table of a manual: the number of its rows, and a function that counts those of the catalogue."""

    device: str
    table: str
    manual: int
    here: Callable[[], int]
    remark: str = ""


def rows(device: str, *files: str) -> list[Row]:
    """Return the [[parameter]] rows in the given files of a device, or in all its files."""
    found: list[Row] = []
    for file in sorted((CATALOG / device).glob("*.toml")):
        if not files or file.stem in files:
            found += tomllib.loads(file.read_text(encoding="utf-8")).get("parameter", [])
    return found


def head(device: str) -> Row:
    """Return the device.toml of a device."""
    return tomllib.loads((CATALOG / device / "device.toml").read_text(encoding="utf-8"))


def guide_objects() -> list[Row]:
    """Return the rows of chapter 5 of the CANopen guide: those with an object, and those with the printed index of
    another."""
    return [
        row for row in rows("az3", "holding", "input", "coils") if "object" in row or "object" in row.get("printed", {})
    ]


def addresses(device: str) -> int:
    """Return the number of register addresses of all parameters."""
    wide = {"u32": 2, "i32": 2, "f32": 2}
    return len({row["holding"] + word for row in rows(device) for word in range(wide.get(row["type"], 1))})


def commands(number: str) -> int:
    """Return the number of commands in table 3 of the ADXL, or in the table of parameter settings (Save and reboot)."""
    return sum((row["name"] == "Save and reboot") == (number == "setting") for row in rows("adxl", "commands"))


def _row(device: str, name: str) -> Row:
    """Return the row of one parameter."""
    return next(row for row in rows(device) if row["name"] == name)


COUNTS = (
    Count("az3", "holding registers (Modbus guide 7.1)", 167, lambda: len(rows("az3", "holding"))),
    Count("az3", "input registers (7.2)", 57, lambda: len(rows("az3", "input"))),
    Count("az3", "coils (7.3)", 40, lambda: len(rows("az3", "coils"))),
    Count("az3", "monitor variables and their selectors (6.4.1)", 8, lambda: len(rows("az3", "monitor"))),
    Count("az3", "objects (CANopen guide 5.1 to 5.3)", 255, lambda: len(guide_objects()), "see below"),
    Count("az3", "default PDOs (CANopen guide 4.5)", 8, lambda: len(head("az3")["pdo"])),
    Count("adxl", "measures (table 2)", 36, lambda: len(rows("adxl", "measures"))),
    Count("adxl", "status values (table 2)", 15, lambda: len(_row("adxl", "Status")["values"])),
    Count("adxl", "commands (table 3)", 14, lambda: commands("table")),
    Count(
        "adxl",
        "values of the event log (table 4)",
        4,
        lambda: len(rows("adxl", "events")),
        "in two rows; 5030h is counter and pointer when it is read, and the index when it is written",
    ),
    Count("adxl", "parameter setting", 5, lambda: len(rows("adxl", "settings")) + commands("setting")),
    Count("adxl", "bits of function 07", 9, lambda: len(head("adxl")["exception_status"]["bits"])),
    Count("adxl", "models of function 17", 11, lambda: len(head("adxl")["report_slave_id"]["type"])),
    Count("adxl", "error codes", 5, lambda: len(head("adxl")["errors"])),
    Count("csd_mt", "parameters (tables 13, 14, 18, 25, 26)", 114, lambda: len(rows("csd_mt"))),
    Count(
        "csd_mt",
        "addresses that they take",
        138,
        lambda: addresses("csd_mt"),
        "the row of 1124 is not legible, its text is",
    ),
    Count("csd_mt", "alarms (ch. 14)", 5, lambda: len(head("csd_mt")["alarm"]), "one of them from register 1007 only"),
    Count("csd_mt", "motors (table 24)", 16, lambda: len(head("csd_mt")["motor"])),
)

DEVICES = tuple(dict.fromkeys(count.device for count in COUNTS))


def page() -> str:
    """Return the whole of docs/reference/devices.md."""
    lines = ["# The three machines, counted and corrected", "", "Made by `tools/devices.py`; do not edit.", ""]
    lines += [*_counts(), "", *_placed(), "", "## Corrections", "", *_CORRECTIONS]
    for device in DEVICES:
        lines += ["", f"### {head(device)['title']}", "", *_corrections(device)]
    return "\n".join(lines) + "\n"


def _counts() -> Iterator[str]:
    yield "## Every table of the manuals"
    yield ""
    yield "| device | table | in the manual | here | |"
    yield "|---|---|--:|--:|---|"
    for count in COUNTS:
        yield f"| {_name(count.device)} | {count.table} | {count.manual} | {count.here()} | {count.remark} |"


def _placed() -> Iterator[str]:
    found = guide_objects()
    placed = [row for row in found if "object" in row]
    lost = ", ".join(f"{row['name']} ({row['printed']['object']})" for row in found if "object" not in row)
    pdo, others = rows("az3", "pdo"), rows("az3", "canopen_only")
    yield f"Of the {len(found)} rows of the CANopen guide {len(placed)} have their object here, each as one parameter"
    yield "with the register or coil of the same value. One has none, because its printed index is that of another"
    yield f"object: {lost}. There are also {len(pdo)} rows of the PDO records (4.5) and {len(others)} objects that"
    yield f"the guide uses but does not list: {', '.join(row['name'] for row in others)}."


_CORRECTIONS = (
    "Errors of a manual, and differences between two guides, are kept in `printed`. `barewire devices NAME --json`",
    "shows them with every parameter, and the note beside them explains how the right value is known. `canopen_` or",
    "`modbus_` before a field names the guide.",
)


def _corrections(device: str) -> Iterator[str]:
    corrected = [*_own_tables(device), *(row for row in rows(device) if "printed" in row)]
    yield f"{sum(len(row['printed']) for row in corrected)} in {len(corrected)} rows."
    yield ""
    yield "| parameter | field | printed | here | how it is known |"
    yield "|---|---|---|---|---|"
    for row in corrected:
        for place, (field, text) in enumerate(row["printed"].items()):
            note = row.get("note", "") if place == 0 else ""
            cells = (row["name"], field, text, _here(row, field), note)
            yield f"| {' | '.join(map(_cell, cells))} |"


def _own_tables(device: str) -> Iterator[Row]:
    """Yield the corrected tables of device.toml other than parameters, such as [serial] or [[motor]]."""
    for name, table in head(device).items():
        for row in table if isinstance(table, list) else [table]:
            if isinstance(row, dict) and "printed" in row:
                yield {"name": f"{name} {row.get('model', '')}".strip(), **row}


def _here(row: Row, field: str) -> str:
    """Return the value of the row in place of the printed one."""
    key = field.removeprefix("canopen_").removeprefix("modbus_")
    if key == "range":
        return f"{row.get('min', '')}..{row.get('max', '')}" if "min" in row or "max" in row else ""
    if key in ("holding", "input"):
        return f"{row.get(key, '')} {row.get('half', '')}".strip()
    value = row.get(key, "")
    if key == "object":
        return f"{value:04X}h" if value else "not known"
    if isinstance(value, dict):
        return "; ".join(f"{number}: {text}" for number, text in value.items())
    if isinstance(value, bool):
        return str(value).lower()
    return str(value)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _name(device: str) -> str:
    return device.replace("_", "-")


def main() -> None:
    """Write the page if it is out of date, and print its name."""
    after = page()
    if not PAGE.exists() or PAGE.read_text(encoding="utf-8") != after:
        PAGE.write_text(after, encoding="utf-8")
        sys.stdout.write("docs/reference/devices.md\n")


if __name__ == "__main__":
    main()
