"""Writes docs/speed.md and docs/speed/*.svg of one run: `python tools/bench_page.py build/bench.json` or `make bench`.

The input is the JSON of pytest-benchmark with what `bench/conftest.py` adds: family, size, who, and the ratios to the
floor, round by round. A run of some families only is not made into a page. matplotlib draws (extra `plot`).
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from bench.goals import goals as wanted  # noqa: E402

PAGE = ROOT / "docs" / "speed.md"
PLOTS = ROOT / "docs" / "speed"

FAMILIES = {
    "CRC-16": "The checksum of RTU. The floor is the usual table of 256 entries; how ours works: [crc](crc.md).",
    "RTU response": "A whole answer to registers: checksum, function, byte count, numbers.",
    "ASCII response": "The same in hexadecimal digits with an LRC.",
    "TCP response": "The same behind an MBAP header.",
    "Building a request": "From the values to the bytes on the wire: read 10 holding registers from 107 of unit 1.",
    "RTU chunk": "Many frames in one read, through the line, which has to find out where each ends.",
    "ASCII chunk": "Many frames in one read, through the line.",
    "TCP chunk": "Many frames in one read, through the line.",
    "Block": "The registers of a planned block as values with names and a scale.",
    "PDO": "Eight bytes on CAN to four named values, and back.",
    "TCP client, blocking": "Everybody asks the same server, which looks at nothing.",
    "TCP client, asyncio": "Everybody asks the same server, a raw asyncio protocol.",
    "SDO": "A mebibyte in blocks, in memory and over python-can's virtual bus, which takes most of the time there.",
    "LSS": "Who is on the bus? The waits are the standard's.",
    "TCP server": "The same client, a blocking socket, asks everybody: one request at a time, and 16 in one send.",
    "TCP server, connections": "One question on each of so many connections, then all the answers.",
    "Import": "Time and resident memory of an import in a new interpreter. The floor here is pymodbus.client.",
    "Idle connections": "What a server keeps for a connection on which nothing happens, beside asyncio's own.",
}


class Entry(NamedTuple):
    """One contestant of one race."""

    family: str
    what: str
    size: int | str
    who: str
    floor: str
    seconds: float
    ratios: dict[str, dict[str, float]]
    memory: float | None


def read(data: dict[str, Any]) -> list[Entry]:
    """The races of a run, in their order."""
    found = []
    for row in data["benchmarks"]:
        extra = row["extra_info"]
        if "family" in extra:
            told = {key: extra[key] for key in ("family", "what", "size", "who", "floor", "ratios")}
            found.append(Entry(**told, seconds=row["stats"]["median"], memory=extra.get("memory")))
    return found


def races(entries: list[Entry]) -> dict[str, dict[tuple[str, int | str], list[Entry]]]:
    """By family, then by what and size."""
    found: dict[str, dict[tuple[str, int | str], list[Entry]]] = defaultdict(lambda: defaultdict(list))
    for entry in entries:
        found[entry.family][entry.what, entry.size].append(entry)
    return found


def show(seconds: float) -> str:
    """A time with three digits and the unit that fits.

    >>> show(2.345e-6), show(0.0123)
    ('2.35 µs', '12.3 ms')
    """
    number, unit = next(
        (seconds * k, u) for k, u in ((1, "s"), (1e3, "ms"), (1e6, "µs")) if seconds * k >= 1 or k == 1e6
    )
    return f"{number:.3g} {unit}" if number < 1000 else f"{number:.0f} {unit}"


def table(rows: list[Entry]) -> list[str]:
    """One race as a table: who, how long, times the floor with quartiles, times ours."""
    floor, kept = rows[0].floor, any(row.memory is not None for row in rows)
    ours = next((row.who for row in rows if row.who == "barewire"), None)
    head = ["", "median", f"x {floor} (quartiles)"] + ([f"x {ours}"] if ours else []) + (["memory"] if kept else [])
    lines = ["| " + " | ".join(head) + " |", "|---" + "|---:" * (len(head) - 1) + "|"]
    for row in rows:
        to_floor = row.ratios.get(floor)
        spread = f"{to_floor['median']:.2f} ({to_floor['q1']:.2f} to {to_floor['q3']:.2f})" if to_floor else ""
        cells = [row.who, show(row.seconds), spread]
        if ours:
            cells.append(f"{row.ratios[ours]['median']:.2f}" if ours in row.ratios else "")
        if kept:
            cells.append("" if row.memory is None else f"{row.memory / 1024:.1f} KiB")
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def goals(entries: list[Entry]) -> list[str]:
    """What was to be shown, and what this run shows."""
    by_place = {(row.family, row.what, row.size, row.who): row for row in entries}
    lines = ["| goal | wanted | measured | |", "|---|---:|---:|---|"]
    for goal in wanted():
        mine = by_place.get((goal.family, goal.what, goal.size, goal.who))
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
    """The two goals that are no ratios."""
    lines = []
    tpdo = by_place.get(("PDO", "TPDO of the AZ3 to named values", 4, "barewire"))
    if tpdo is not None:
        a_second = 1 / tpdo.seconds
        met = "met" if a_second > 100_000 else "**missed**"
        lines.append(f"| TPDOs of the AZ3 a second | above 100000 | {a_second:.0f} | {met} |")
    mine, bare = (by_place.get(("Idle connections", "one more", 400, who)) for who in ("barewire", "asyncio"))
    if mine is not None and bare is not None:
        more = ((mine.memory or 0.0) - (bare.memory or 0.0)) / 1024
        met = "met" if more < 10 else "**missed**"
        lines.append(f"| KiB for an idle connection, on top of asyncio's own | below 10 | {more:.1f} | {met} |")
    return lines


def plot(family: str, groups: dict[tuple[str, int | str], list[Entry]]) -> str | None:
    """One SVG for a family: cost against size where sizes are numbers, bars otherwise. Its file name."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams |= {"svg.hashsalt": "barewire", "svg.fonttype": "none", "font.size": 9}
    from matplotlib import pyplot

    lines: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for (what, size), rows in groups.items():
        for row in rows:
            cost = row.memory if family == "Idle connections" and row.memory else row.seconds * 1e6
            label = row.who if len({what for what, _ in groups}) == 1 else f"{row.who}: {what}"
            lines[label].append((float(size), cost) if isinstance(size, int) else (0.0, cost))
    figure, axes = pyplot.subplots(figsize=(8, 4.5))
    if all(isinstance(size, int) for _, size in groups) and len({size for _, size in groups}) > 1:
        for who, points in lines.items():
            ours = who.startswith("barewire")
            axes.plot(*zip(*sorted(points)), label=who, marker="o", markersize=3, linewidth=2.2 if ours else 1.0)
        axes.set(xscale="log", yscale="log", xlabel="size")
        axes.set_ylabel("bytes a connection" if family == "Idle connections" else "µs, median")
        axes.grid(True, which="major", alpha=0.3)
        axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    else:
        bars = [(f"{row.who} ({what}, {size})", row) for (what, size), rows in groups.items() for row in rows]
        colours = ["#1f77b4" if row.who.startswith("barewire") else "#bbbbbb" for _, row in bars]
        axes.barh([name for name, _ in bars], [row.seconds * 1e6 for _, row in bars], color=colours)
        axes.set(xlabel="µs, median", xscale="log")
        axes.tick_params(axis="y", labelsize=6)
        axes.invert_yaxis()
        figure.set_size_inches(8, max(3.0, 0.17 * len(bars) + 1))
    axes.set_title(family)
    PLOTS.mkdir(parents=True, exist_ok=True)
    name = f"{family.lower().replace(',', '').replace(' ', '-')}.svg"
    figure.savefig(PLOTS / name, bbox_inches="tight", metadata={"Date": None})
    pyplot.close(figure)
    return name


def page(data: dict[str, Any]) -> str:
    """The whole page; the plots are written beside it."""
    machine, entries = data["machine_info"], read(data)
    python = f"{machine['python_implementation']} {machine['python_version']}"
    cpu = machine.get("cpu", {}).get("brand_raw") or machine.get("processor") or machine.get("machine")
    there = [f"{name} {version}" for name, version in machine["versions"].items() if version]
    missing = [name for name, version in machine["versions"].items() if not version]
    lines = ["# Speed", "", "<!-- Written by tools/bench_page.py (make bench); edit that, not this. -->", ""]
    lines += [
        "The same work by barewire, by hand and by others, in turns, in one run: `make bench`. What counts is the",
        "ratio between neighbours of the same round; a number of microseconds alone tells of the machine. How it",
        "is measured: [bench](../bench/README.md).",
        "",
        f"- machine: {cpu}, {machine['cores']} cores, {machine['system']}",
        f"- {python}; {', '.join(there)}",
        f"- missing in this run: {', '.join(missing) or 'nobody'}",
        f"- date: {data['datetime'][:10]}",
        "",
        "## What it had to show",
        "",
        "Each number is our time (or memory) divided by the other's: below 1 is faster. Why some are missed stands in",
        "[bench](../bench/README.md#limits).",
        "",
        *goals(entries),
        "",
    ]
    for family, groups in races(entries).items():
        lines += [f"## {family}", "", FAMILIES.get(family, ""), ""]
        lines += [f"![{family}: cost against size](speed/{plot(family, groups)})", ""]
        for (what, size), rows in groups.items():
            lines += [f"**{what}, {size}**", "", *table(rows), ""]
    alone: list[dict[str, Any]] = [run for run in data["benchmarks"] if "family" not in run["extra_info"]]
    for group in dict.fromkeys(run["group"] for run in alone):
        runs = [run for run in alone if run["group"] == group]
        best = min(run["stats"]["median"] for run in runs)
        lines += [f"## {group}", "", "| | median | x the fastest |", "|---|---:|---:|"]
        for run in runs:
            took = run["stats"]["median"]
            lines.append(f"| {run['name']} | {show(took)} | {took / best:.2f} |")
        lines.append("")
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    data = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
    lacking = sorted(FAMILIES.keys() - {entry.family for entry in read(data)})
    if lacking:
        sys.stdout.write(f"docs/speed.md is left as it was: this run has no {', '.join(lacking)}\n")
        return 0
    PAGE.write_text(page(data), encoding="utf-8")
    sys.stdout.write("docs/speed.md and docs/speed/*.svg are written\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
