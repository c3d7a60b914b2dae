"""Measures the gateway beside others and under faults, and writes docs/reference/gateway.md: `make gateway-lab`.

    relay        processor time for one request, TCP to TCP, beside a relay of asyncio that understands nothing
    line         a serial line: requests in a second and processor time, 1 and 32 clients, beside mbusd and a gateway
                 of forty lines
    late         one answer in nine is late: right and wrong answers, beside mbusd
    dead         two units of ten are dead: what the living keep; a greedy client beside polite ones
    faults       loss, noise, late and damaged answers at once
    adapters     an adapter is pulled out and put in again, beside a line that stays
    can          a CAN bus with a babbling node and bus-off, in a guest kernel
    publish      values in a second from ten machines to Mosquitto
    outages      the broker and the publisher are killed at random
    week         seven days in virtual time, with a fault every few seconds
    memory       a control group with little memory and a fifth of a processor; needs root

All of them are programs of their own, on pseudo-terminals and loopback; the CAN bus is in a guest (user-mode-linux).
mbusd is used if its program is in PATH or named by the variable MBUSD. Each number is the median of RUNS runs, which
alternate.

    python -m tools.gateway_lab [RUNS] [SCENARIO ...]

A scenario writes its own part of the page, and its plot in docs/reference/gateway/; without RUNS there are five.

In reading order: `programs` and `stand_ins` (what runs), `beside_others`, `faults` and `can_guest`, `broker`,
`week` with `virtual_time`, `simulated_units` and `mqtt_broker`, `control_group` with tools/small_machine.py, `plots`.
"""

from __future__ import annotations

import os
import platform
import sys
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter

from tools import small_machine
from tools.gateway_lab import beside_others, broker, faults, week
from tools.gateway_lab.programs import MBUSD, ROOT

PAGE = ROOT / "docs" / "reference" / "gateway.md"

SCENARIOS = {
    "relay": beside_others.measure_relay,
    "line": beside_others.measure_line,
    "late": beside_others.measure_late,
    "dead": faults.measure_dead,
    "faults": faults.measure_faults,
    "adapters": faults.measure_adapters,
    "can": faults.measure_can,
    "publish": broker.measure_publish,
    "outages": broker.measure_outages,
    "week": week.measure_week,
    "memory": small_machine.measure_memory,
}


def _with_part(page: str, name: str, lines: list[str]) -> str:
    """Return the page with this part in place of the present one of its scenario."""
    begin, end = f"<!-- gateway_lab {name} -->\n", "<!-- end -->\n"
    before, found, after = page.partition(begin)
    if not found:
        raise ValueError(f"{PAGE}: expected a line {begin.strip()}")
    return f"{before}{begin}\n" + "\n".join(lines) + f"\n{end}" + after.partition(end)[2]


def main() -> None:
    """Measure and write the page."""
    parser = ArgumentParser("gateway_lab", description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="?", type=int, default=5)
    parser.add_argument("scenarios", nargs="*", choices=[*SCENARIOS, []], help="default: all")
    given = parser.parse_args()
    for name in given.scenarios or SCENARIOS:
        lines = SCENARIOS[name](given.runs)
        conditions = f"CPython {platform.python_version()}, {os.cpu_count()} processors, {time.strftime('%Y-%m-%d')}"
        if any("mbusd" in line for line in lines):
            conditions += ", mbusd 0.5.3"
        elif name in ("line", "late") and not MBUSD:
            conditions += ", without mbusd, which was not installed"
        lines += [f"({conditions}; {given.runs} run{'' if given.runs == 1 else 's'})", ""]
        sys.stdout.write("\n".join(lines) + "\n")
        sys.stdout.flush()
        PAGE.write_text(_with_part(PAGE.read_text(encoding="utf-8"), name, lines), encoding="utf-8")


if __name__ == "__main__":
    main()
