"""`barewire conform`: test a Modbus server or a CANopen device against the standard, case by case."""

from __future__ import annotations

import sys
from functools import partial
from typing import TYPE_CHECKING

import click

from barewire.errors import EncodeError, NoAnswer, shown
from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.arguments import (
    endpoint_argument,
    file_content,
    json_option,
    print_json,
    print_timing,
    timing_option,
    unfinished_as_json,
)

if TYPE_CHECKING:
    from barewire.canopen.eds import Eds
    from barewire_workbench.live.canopen_conformance import NodeCaseResult
    from barewire_workbench.live.modbus_conformance import CaseResult


_TWO_DEVICES = 3
"""The exit status if two devices have the node-ID."""


@click.command("conform")
@endpoint_argument
@json_option
@timing_option
@click.option("--gentle", is_flag=True, help="Only cases that change nothing in the device (can:// only).")
@click.option("--large", metavar="INDEX:SUB", help="An object that takes any bytes, for long downloads (can:// only).")
@click.option("--eds", metavar="FILE", help="The EDS of the device: compare every object with it (can:// only).")
@click.option("--save", is_flag=True, help="Also cases that store values in the device's memory (can:// only).")
@click.option("--power-cycle", is_flag=True, help="With --save, and a case in which you switch the device off and on.")
@click.option(
    "--write-application",
    is_flag=True,
    help="With --eds, also write objects from 2000h on with other values: a drive may move, outputs may switch.",
)
@click.option("--only", metavar="NAME,...", default="", help="Only cases whose names begin with NAME (can:// only).")
def conform_command(
    endpoint: str,
    as_json: bool,
    timing: bool,
    gentle: bool,
    large: str | None,
    eds: str | None,
    save: bool,
    power_cycle: bool,
    write_application: bool,
    only: str,
) -> int:
    """Test a server or device against the standard.

    A Modbus server is sent valid and invalid requests, and its responses are compared with the clauses of the standard.
    This writes registers and coils 0 to 9 of the unit: do not run it on a machine that is operating. The timeout of the
    endpoint is how long each response is waited for (1 s; on a CAN bus 0.5 s). If the server stops responding, the run
    ends, and the number of cases that were not run is printed. A run that is interrupted leaves the device as the last
    case has made it, possibly stopped: reset it.

    Cases for which the server does not have the function or the registers and coils 0 to 9 are printed as "-" and not
    judged. Exit status 1 if a case failed or was not run, or if none could be judged.

    \b
    barewire conform tcp://127.0.0.1:502?unit=1
    barewire conform "rtu:///dev/ttyUSB0?baudrate=9600&unit=1&timeout=0.5"
    barewire conform "ascii:///dev/ttyUSB0?baudrate=9600&bytesize=7&unit=1"

    A CANopen device is tested against CiA 301 and CiA 305. It is reset many times, started and stopped, its
    communication objects are written and zeros are sent to its first RPDO: without --gentle, do not run it on a machine
    that is operating.

    \b
    barewire conform "can://socketcan/can0?node=5"
    barewire conform "can://socketcan/can0?node=5" --eds drive.eds

    With --save values are stored in the memory of the device, and afterwards those that it had before; --power-cycle
    adds a case that waits two minutes for you to switch the device off and on.

    With --eds every object is read, written with the value that it has, with values beyond its limits and of another
    length, and mapped into PDOs; the device should have its factory settings. --write-application adds writes of other
    values within the limits to the objects from 2000h on, except controlwords: take the load off a drive, and
    disconnect what outputs switch. Afterwards each object gets the value that it had.

    A case that fails is repeated, twice at most. If it then passes it is printed as "now and then", and counts as not
    passed: the exit status is 1. The status is 3 if two devices answer as this node: then no case is run.
    """
    with unfinished_as_json(as_json):
        if endpoint.startswith("can://"):
            if timing:
                print_timing(endpoint)
            if write_application and eds is None:
                raise EncodeError("--write-application: the limits of values are in the EDS: give it with --eds FILE")
            return _test_node(
                endpoint,
                as_json=as_json,
                gentle=gentle,
                large=large,
                eds=eds,
                save=save,
                power=power_cycle,
                application=write_application,
                only=only,
            )
        if gentle or only or save or power_cycle or write_application or large is not None or eds is not None:
            options = "--gentle, --large, --eds, --save, --power-cycle, --write-application and --only"
            raise EncodeError(f"endpoint {shown(endpoint, 200)}: {options} are for can://")
        if timing:
            print_timing(endpoint)
        return _test_server(endpoint, as_json)


# A Modbus server


def _test_server(endpoint: str, as_json: bool) -> int:
    """Run the cases and print them; 1 if one failed."""
    from barewire_workbench.live.modbus_conformance import conform

    count, failed, not_judged = 0, 0, 0
    for result in conform(Endpoint.parse(endpoint)):
        count += not result.not_judged
        failed += result.failure is not None
        not_judged += bool(result.not_judged)
        if as_json:
            print_json(_case_fields(result))
        else:
            print(_case_line(result), flush=True)
    if not as_json:
        print(f"{count - failed} of {count} passed" + (f", {not_judged} not judged" if not_judged else ""))
        if not_judged:
            print("The cases need registers and coils 0 to 9 of the unit, to read and to write.")
    return int(failed > 0 or not count)


def _case_line(result: CaseResult) -> str:
    status = "FAILED" if result.failure else "-" if result.not_judged else "ok"
    reason = f" (not judged: {result.not_judged})" if result.not_judged else ""
    return f"{status:6}  {result.case.clause:18}  {result.failure or result.case.name}{reason}"


def _case_fields(result: CaseResult) -> dict[str, object]:
    from barewire_workbench.conform.modbus import answer_text

    return {
        "case": result.case.name,
        "clause": result.case.clause,
        "ok": None if result.not_judged else result.failure is None,
        "not_judged": result.not_judged or None,
        "received": [answer_text(answer) for answer in result.received],
        "failure": result.failure,
    }


# A CANopen device


def _test_node(
    endpoint: str,
    *,
    as_json: bool,
    gentle: bool,
    large: str | None,
    eds: str | None,
    save: bool,
    power: bool,
    application: bool,
    only: str,
) -> int:
    """Run the cases and print them; 1 if one failed."""
    from barewire.canopen.eds import parse
    from barewire_workbench.live.canopen_conformance import conform_can
    from barewire_workbench.live.unfinished import TwoDevices

    count, failed, now_and_then, left_out = 0, 0, 0, 0
    document = None if eds is None else parse(file_content(eds))
    if document is not None and not document.objects:
        raise EncodeError(f"--eds {eds}: describes no objects: expected sections like [1000]")
    where, address, names = Endpoint.parse(endpoint), _object_address(large), _beginnings(only, document)
    note = partial(print, file=sys.stderr, flush=True)
    ask = partial(note, "switch the device off and on") if power else None
    woken = partial(note, "the device did not answer before it got NMT 80h, enter pre-operational: it was STOPPED")
    last = ""
    try:
        for result in conform_can(
            where,
            gentle=gentle,
            large=address,
            only=names,
            eds=document,
            save=save,
            write_application=application,
            on_power_cycle=ask,
            on_stopped=woken,
        ):
            last = f" after {result.case.name}"
            count += result.outcome is not None
            failed += result.failure is not None
            now_and_then += result.now_and_then
            left_out += result.outcome is None
            if as_json:
                print_json(node_case_fields(result))
            else:
                print(node_case_line(result), flush=True)
    except TwoDevices as error:
        if as_json:
            print_json({"unfinished": str(error), "not_run": None})
        click.echo(f"barewire: {error}; give them different node-IDs", err=True)
        return _TWO_DEVICES
    except NoAnswer as error:
        if gentle:
            hint = "a device in STOPPED does not answer: without --gentle it is switched to PRE-OPERATIONAL"
            raise NoAnswer(f"{error}; {hint}") from None
        raise
    except KeyboardInterrupt:
        click.echo(f"interrupted{last}: the device is as the last case made it, possibly stopped: reset it", err=True)
        raise
    if not count + left_out:
        raise EncodeError(f"--only {only}: this device has no case with a name that begins so")
    if not as_json:
        sometimes = f", {now_and_then} now and then" if now_and_then else ""
        print(f"{count - failed} of {count} passed{sometimes}" + (f", {left_out} left out" if left_out else ""))
    return int(failed > 0)


def _beginnings(only: str, eds: Eds | None) -> tuple[str, ...]:
    """Return the beginnings of names of cases that `--only` gives. Raises EncodeError for one that no case has."""
    from barewire_workbench.live.canopen_conformance import case_names

    wanted = tuple(name.strip().upper() for name in only.split(","))
    names = case_names() if eds is None else case_names(eds.objects, eds.dummies)
    for beginning in wanted:
        if eds is None and beginning.startswith("OD"):
            raise EncodeError(
                f"--only {beginning}: the cases OD- compare the device with its EDS: give it with --eds FILE"
            )
        if not any(name.startswith(beginning) for name in names):
            groups = ", ".join(sorted({f"{name.partition('-')[0]}-" for name in names}))
            raise EncodeError(f"--only {beginning}: no case has a name that begins so; expected {groups} and a number")
    return wanted


def _object_address(text: str | None) -> tuple[int, int] | None:
    """INDEX:SUB in hexadecimal digits, as in candump and data sheets."""
    if text is None:
        return None
    index, _, sub = text.partition(":")
    try:
        address = int(index, 16), int(sub or "0", 16)
    except ValueError:
        address = -1, -1
    if not (0x2000 <= address[0] <= 0xFFFF and 0 <= address[1] <= 0xFF):
        raise EncodeError(f"--large {shown(text)}: expected INDEX:SUB from 2000:00 on, in hexadecimal digits")
    return address


def node_case_line(result: NodeCaseResult) -> str:
    case, status = result.case, {"failed": "FAILED", "left out": "-"}.get(_verdict(result), _verdict(result))
    text = f"{case.title}: {result.failure}" if result.failure else case.title
    return f"{status:6}  {case.name:6}  {text}" + (f" ({result.left_out})" if result.left_out else "")


def _verdict(result: NodeCaseResult) -> str:
    if result.now_and_then:
        return "now and then"
    return "left out" if result.outcome is None else "failed" if result.failure else "ok"


def node_case_fields(result: NodeCaseResult) -> dict[str, object]:
    case = result.case
    return {
        "case": case.name,
        "title": case.title,
        "clause": case.clause,
        "effect": case.effect,
        "ok": None if result.outcome is None else result.failure is None,
        "verdict": _verdict(result),
        "left_out": result.left_out or None,
        "received": [] if result.outcome is None else [list(step) for step in result.outcome.received],
        "failure": result.failure,
    }
