"""Writes docs/reference/speed.md and its plots: `make bench`, or `python tools/bench_page.py build/bench.json`.

The input is the JSON of pytest-benchmark with the additions of `bench/conftest.py`: family, size, contestant, and the
ratios to the floor. A run with some of the families only writes no page. matplotlib draws the plots (extra `plot`).
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from bench.goals import goals as wanted  # noqa: E402
from bench.plots import plot  # noqa: E402
from bench.results import Entry, races, read, show, times  # noqa: E402

PAGE = ROOT / "docs" / "reference" / "speed.md"
PLOTS = ROOT / "docs" / "reference" / "speed"

FAMILIES = {
    "CRC-16": "The checksum of RTU. The floor is a table of 256 entries; ours is [explained](../explanation/crc.md).",
    "RTU response": "A whole answer to register values: checksum, function, byte count, numbers.",
    "ASCII response": "The same in hexadecimal digits with an LRC.",
    "TCP response": "The same behind an MBAP header.",
    "Building a request": "From the values to the bytes on the wire: read 10 holding registers from 107 of unit 1.",
    "RTU chunk": "Many frames in one read, through the line, which must find the end of each.",
    "ASCII chunk": "Many frames in one read, through the line.",
    "TCP chunk": "Many frames in one read, through the line.",
    "Block": "The registers of a planned block to values with names and a scale.",
    "PDO": "Eight bytes on CAN to four named values, and back.",
    "TCP client, blocking": "All clients use the same server, which answers without parsing the request.",
    "TCP client, asyncio": "All clients use the same server, a raw asyncio protocol.",
    "SDO": "Values of that many bytes, in memory and over python-can's virtual bus, which takes most of the time.",
    "CAN bus": "Clients beside a neutral responder, a bare loop; each contestant has a bus of its own.",
    "LSS": "Finding a device without a node-ID: mostly time-outs, the canopen library with the shortest of ours.",
    "TCP server": "One client, a blocking socket, uses all servers: one request at a time, and 16 in one send.",
    "TCP server, connections": "One request on each of the connections, then all the answers.",
    "Import": "Time and resident memory of an import in a new interpreter. The floor is pymodbus.client.",
    "Start": "Loading a device of the catalogue, and `barewire read` up to its first line, beside `import click`.",
    "Named read": "Values of a device by name; the floor is the raw read of the same registers, with the same client.",
    "Idle connections": "Opening a connection, with clients in the same program, and the memory of Python for it.",
}


def table(rows: list[Entry]) -> list[str]:
    """Return one race as a table: contestant, median, ratio to the floor with quartiles, ratio to ours."""
    floor, kept = rows[0].floor, any(row.memory is not None for row in rows)
    ours = next((row.contestant for row in rows if row.contestant == "barewire" != floor), None)
    head = ["", "median", f"x {floor} (quartiles)"] + ([f"x {ours}"] if ours else []) + (["memory"] if kept else [])
    lines = ["| " + " | ".join(head) + " |", "|---" + "|---:" * (len(head) - 1) + "|"]
    for row in rows:
        to_floor = row.ratios.get(floor)
        spread = f"{times(to_floor['median'])} ({times(to_floor['q1'])} to {times(to_floor['q3'])})" if to_floor else ""
        cells = [row.contestant, show(row.seconds), spread]
        if ours:
            cells.append(times(row.ratios[ours]["median"]) if ours in row.ratios else "")
        if kept:
            cells.append("" if row.memory is None else f"{row.memory / 1024:.1f} KiB")
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def goals(entries: list[Entry]) -> list[str]:
    """Return the goals with the ratios of this run."""
    by_place = {(row.family, row.what, row.size, row.contestant): row for row in entries}
    lines = ["| goal | wanted | measured | |", "|---|---:|---:|---|"]
    for goal in wanted():
        mine = by_place.get((goal.family, goal.what, goal.size, goal.contestant))
        other = by_place.get((goal.family, goal.what, goal.size, goal.other))
        if mine is None or other is None:
            lines.append(f"| {goal.text} | {goal.limit:.3g} | | not measured |")
            continue
        if goal.memory:
            ratio = (mine.memory or 0.0) / (other.memory or 1.0)
        elif goal.other in mine.ratios:
            ratio = mine.ratios[goal.other]["median"]
        else:
            ratio = mine.seconds / other.seconds
        lines.append(
            f"| {goal.text} | {goal.limit:.3g} | {ratio:.3g} | {'met' if ratio <= goal.limit else '**missed**'} |"
        )
    return lines + _absolute(by_place)


def _absolute(by_place: dict[tuple[str, str, int | str, str], Entry]) -> list[str]:
    """Return the goals that are absolute numbers."""
    lines = []
    tpdo = by_place.get(("PDO", "TPDO of the AZ3 to named values", 4, "barewire"))
    if tpdo is not None:
        a_second = 1 / tpdo.seconds
        met = "met" if a_second > 100_000 else "**missed**"
        lines.append(f"| TPDOs of the AZ3 a second | above 100000 | {a_second:.0f} | {met} |")
    for contestant, kind in (("barewire, asyncio", "asyncio server"), ("barewire", "server in a thread")):
        mine, bare = (by_place.get(("Idle connections", "one more", 400, one)) for one in (contestant, "asyncio"))
        if mine is not None and bare is not None:
            more = ((mine.memory or 0.0) - (bare.memory or 0.0)) / 1024
            met = "met" if more < 10 else "**missed**"
            text = f"KiB for an idle connection, {kind}, on top of asyncio's own"
            lines.append(f"| {text} | below 10 | {more:.1f} | {met} |")
    return lines


def page(data: dict[str, Any]) -> str:
    """Return the whole page, and write the plots beside it."""
    machine, entries = data["machine_info"], read(data)
    python = f"{machine['python_implementation']} {machine['python_version']}"
    cpu = machine.get("cpu", {}).get("brand_raw") or machine.get("processor") or machine.get("machine")
    there = [f"{name} {version}" for name, version in machine["versions"].items() if version]
    missing = [name for name, version in machine["versions"].items() if not version]
    lines = ["# Speed", "", "<!-- Written by tools/bench_page.py (make bench); edit that, not this. -->", ""]
    lines += [
        "The same work by barewire, by hand-written code and by other libraries, in turns, in one run: `make bench`.",
        "The ratios within a round are what counts; microseconds alone depend on the machine.",
        "[bench](../../bench/README.md) explains the measurement.",
        "",
        f"- machine: {cpu}, {machine['cores']} cores, {machine['system']}",
        f"- {python}; {', '.join(there)}",
        f"- missing in this run: {', '.join(missing) or 'none'}",
        f"- date: {data['datetime'][:10]}",
        "",
        "## Goals",
        "",
        "Each number is our time (or memory) divided by that of the other: below 1 is faster.",
        "[bench](../../bench/README.md#limits) explains the missed goals.",
        "",
        *goals(entries),
        "",
    ]
    for family, groups in races(entries).items():
        lines += [f"## {family}", "", FAMILIES.get(family, ""), ""]
        lines += [f"![{family}](speed/{plot(family, groups, PLOTS)})", ""]
        for (what, size), rows in groups.items():
            lines += [f"**{what}, {size}**", "", *table(rows), ""]
            absent: dict[str, str] = data.get("absent", {}).get(f"{family}: {what}, {size}", {})
            lines += [line for contestant, why in absent.items() for line in (f"Missing: {contestant}, {why}", "")]
    return "\n".join(lines)


def verdicts(text: str) -> dict[str, tuple[str, str]]:
    r"""Return the results on a page: goal -> met or missed, and the number.

    >>> verdicts("| Server: 0.8 | 1.25 | 1.05 | met |\n| ... ahead of it | 1 | 1.1 | **missed** |")
    {'Server: 0.8': ('met', '1.05'), 'Server ... ahead of it': ('missed', '1.1')}
    """
    found, of = {}, ""
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 4 and (verdict := cells[3].strip("*")) in ("met", "missed"):
            is_more = cells[0].startswith("...")
            of = of if is_more else cells[0].partition(":")[0]
            found[f"{of} {cells[0]}" if is_more else cells[0]] = verdict, cells[2]
    return found


def main(arguments: list[str]) -> int:
    data = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
    lacking = sorted(FAMILIES.keys() - {entry.family for entry in read(data)})
    if lacking:
        sys.stdout.write(f"docs/reference/speed.md is unchanged: this run lacks {'; '.join(lacking)}\n")
        return 0
    before = verdicts(PAGE.read_text(encoding="utf-8")) if PAGE.exists() else {}
    PAGE.write_text(page(data), encoding="utf-8")
    sys.stdout.write("docs/reference/speed.md and docs/reference/speed/*.svg are written\n")
    for goal, (verdict, ratio) in verdicts(PAGE.read_text(encoding="utf-8")).items():
        if verdict == "missed":
            sys.stdout.write(f"missed: {goal}, {ratio} (before: {', '.join(before.get(goal, ['not measured']))})\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
