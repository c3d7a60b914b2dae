"""`barewire conform`: hold any server against the standard, case by case."""

from __future__ import annotations

import json

import click

from barewire.cli.arguments import endpoint_argument, json_option
from barewire.modbus.conform import shown
from barewire.shells.conform import Result
from barewire.shells.conform import conform as run_battery
from barewire.shells.endpoint import Endpoint


@click.command()
@endpoint_argument
@json_option
def conform(endpoint: str, as_json: bool) -> int:
    """Ask a server what every server must know how to answer, and compare with the clauses of the standard.

    Registers and coils 0 to 9 of the unit are written to: not for a machine that is running. The endpoint's timeout is
    how long silence is waited for (1 s). Exit status 1 if a case failed.

    \b
    barewire conform tcp://127.0.0.1:502?unit=1
    barewire conform "rtu:///dev/ttyUSB0?baudrate=9600&unit=1&timeout=0.5"
    """
    count, failed = 0, 0
    for result in run_battery(Endpoint.parse(endpoint)):
        count += 1
        failed += result.failure is not None
        print(json.dumps(_as_dict(result), ensure_ascii=False) if as_json else _line(result), flush=True)
    if not as_json:
        print(f"{count - failed} of {count} as the standard says")
    return int(failed > 0)


def _line(result: Result) -> str:
    start = f"{'FAILED' if result.failure else 'ok':6}  {result.case.clause:18}  "
    return start + (result.failure or result.case.name)


def _as_dict(result: Result) -> dict[str, object]:
    return {
        "case": result.case.name,
        "clause": result.case.clause,
        "ok": result.failure is None,
        "heard": [shown(one) for one in result.heard],
        "failure": result.failure,
    }
