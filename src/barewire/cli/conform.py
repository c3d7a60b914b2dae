"""`barewire conform`: hold any server against the standard, case by case."""

from __future__ import annotations

import json

import click

from barewire.cli.arguments import ending, endpoint_argument, json_option, say_timing, timing_option
from barewire.errors import EncodeError
from barewire.io.endpoint import Endpoint
from barewire.io.modbus.conformance import CaseResult, conform as run_battery
from barewire.modbus.conformance.model import answer_text


@click.command()
@endpoint_argument
@json_option
@timing_option
@click.option("--gentle", is_flag=True, help="Only what changes nothing in the device (can:// only).")
@click.option("--large", metavar="INDEX:SUB", help="An object that takes any bytes, for long downloads (can:// only).")
@click.option("--only", metavar="NAME,...", default="", help="Only cases whose names begin so (can:// only).")
def conform(endpoint: str, as_json: bool, timing: bool, gentle: bool, large: str | None, only: str) -> int:
    """Ask a server what every server must know how to answer, and compare with the clauses of the standard.

    Registers and coils 0 to 9 of the unit are written to: not for a machine that is running. The endpoint's timeout is
    how long silence is waited for (1 s). A server that falls silent for good ends the run, and it is said how many
    cases were not run. Exit status 1 if a case failed or was not run.

    \b
    barewire conform tcp://127.0.0.1:502?unit=1
    barewire conform "rtu:///dev/ttyUSB0?baudrate=9600&unit=1&timeout=0.5"
    barewire conform "ascii:///dev/ttyUSB0?baudrate=9600&bytesize=7&unit=1"

    A CANopen device is held against CiA 301 and 305. It is reset many times, started and stopped, its communication
    objects are written and zeros are sent to its first RPDO: not for a machine that is running, unless --gentle.

    \b
    barewire conform "can://socketcan/can0?node=5"
    """
    if endpoint.startswith("can://"):
        from barewire.cli.conform_can import hold

        return hold(endpoint, as_json=as_json, gentle=gentle, large=large, only=only)
    if gentle or only or large is not None:
        raise EncodeError(f"endpoint {endpoint!r}: --gentle, --large and --only are for can://")
    say_timing(endpoint, timing)
    count, failed = 0, 0
    with ending(as_json):
        for result in run_battery(Endpoint.parse(endpoint)):
            count += 1
            failed += result.failure is not None
            print(json.dumps(_as_dict(result), ensure_ascii=False) if as_json else _line(result), flush=True)
    if not as_json:
        print(f"{count - failed} of {count} as the standard says")
    return int(failed > 0)


def _line(result: CaseResult) -> str:
    start = f"{'FAILED' if result.failure else 'ok':6}  {result.case.clause:18}  "
    return start + (result.failure or result.case.name)


def _as_dict(result: CaseResult) -> dict[str, object]:
    return {
        "case": result.case.name,
        "clause": result.case.clause,
        "ok": result.failure is None,
        "heard": [answer_text(one) for one in result.heard],
        "failure": result.failure,
    }
