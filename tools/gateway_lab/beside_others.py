"""Beside others: a relay that understands nothing, a gateway of forty lines, mbusd."""

from __future__ import annotations

from contextlib import nullcontext

from tools.gateway_lab.programs import (
    MBUSD,
    Load,
    free_port,
    gateway,
    line,
    load,
    mbusd,
    median,
    program,
    stand_in,
    together,
)


def measure_relay(runs: int) -> list[str]:
    """Processor time for one request, TCP to TCP, beside a relay of asyncio that understands nothing."""
    lines = ["| clients | relay | gateway | ratio |", "|---|---:|---:|---:|"]
    behind, relayed = free_port(), free_port()
    backend = f'name = "b"\nurl = "tcp://127.0.0.1:{behind}"\nunits = "1-10"\nin_flight = 16'
    with (
        program(*stand_in("unit", behind)),
        program(*stand_in("relay", relayed, behind)) as relay,
        gateway(backend) as own,
    ):
        for count in (1, 32):
            costs: dict[str, list[float]] = {"relay": [], "gateway": []}
            for _ in range(runs):
                costs["relay"].append(load(relay, relayed, 2.0, count).cost)
                costs["gateway"].append(load(*own, 2.0, count).cost)
            one, other = (1e6 * median(costs[name]) for name in ("relay", "gateway"))
            lines.append(f"| {count} | {one:.1f} us | {other:.1f} us | {other / one:.2f} |")
    return ["### TCP to TCP: processor time for a request", "", *lines, ""]


def measure_line(runs: int) -> list[str]:
    """A serial line: requests in a second and processor time, 1 and 32 clients."""
    lines = ["| clients | | requests in a second | processor time for a request |", "|---|---|---:|---:|"]
    with (
        program(*stand_in("field", "-", 10, 0)) as first,
        program(*stand_in("field", "-", 10, 0)) as second,
        program(*stand_in("field", "-", 10, 0)) as third,
    ):
        bare_port = free_port()
        with (
            gateway(line(first.first, 0.5)) as own,
            program(*stand_in("bare", second.first, bare_port)) as bare,
            mbusd(third.first, wait=500) if MBUSD else nullcontext(own) as other,
        ):
            for count in (1, 32):
                results: dict[str, list[Load]] = {}
                for _ in range(runs):
                    results.setdefault("barewire", []).append(load(*own, 3.0, count))
                    results.setdefault("forty lines", []).append(load(bare, bare_port, 3.0, count))
                    if MBUSD:
                        results.setdefault("mbusd, pause 2 ms", []).append(load(*other, 3.0, count))
                for name, rows in results.items():
                    rate, cost = median([row.rate for row in rows]), 1e6 * median([row.cost for row in rows])
                    lines.append(f"| {count} | {name} | {rate:.0f} | {cost:.0f} us |")
    return ["### A serial line at 115200 bit/s, units that answer at once", "", *lines, ""]


def measure_late(runs: int) -> list[str]:
    """One answer in nine is late: right and wrong answers."""
    lines = ["| | right | **wrong** | exceptions | lost |", "|---|---:|---:|---:|---:|"]
    results: dict[str, list[Load]] = {}
    for _ in range(runs):
        late = stand_in("field", "late:0.111", 10, 0)
        with program(*late) as field, gateway(line(field.first, 0.1), more="dead_after = 0") as own:
            results.setdefault("barewire", []).append(load(*own, 10.0, 8))
        if MBUSD:
            with program(*late) as field, mbusd(field.first, wait=100) as other:
                results.setdefault("mbusd", []).append(load(*other, 10.0, 8))
    for name, rows in results.items():
        total = together(rows)
        lines.append(f"| {name} | {total.right:,} | {total.wrong:,} | {total.declined:,} | {total.lost:,} |")
    text = f"Eight clients, ten units, {10 * runs} s; answers are late by 0.15 s, the time-out is 0.1 s."
    return ["### One answer in nine is late", "", text, "", *lines, ""]
