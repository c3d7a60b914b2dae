"""`barewire conform`: test a Modbus server or a CANopen device against the standard, case by case."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from barewire.errors import EncodeError, NoAnswer, shown
from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.arguments import endpoint_argument, print_timing, timing_option
from barewire_workbench.cli.output import Output, file_content, note, output_option, print_json

if TYPE_CHECKING:
    from barewire.canopen.eds import Eds
    from barewire_workbench.live.canopen_conformance import NodeCaseResult
    from barewire_workbench.live.modbus_conformance import CaseResult

_TWO_DEVICES = 3
"""The exit status if two devices have the node-ID."""


@click.command("conform")
@endpoint_argument
@output_option
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
    output: Output,
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
    is_can = endpoint.startswith("can://")
    for_can = (gentle, large is not None, eds is not None, save, power_cycle, write_application, only)
    if not is_can and any(for_can):
        options = "--gentle, --large, --eds, --save, --power-cycle, --write-application and --only"
        raise EncodeError(f"endpoint {shown(endpoint, 200)}: {options} are for can://")
    if timing:
        print_timing(endpoint)
    if write_application and eds is None:
        raise EncodeError("--write-application: the limits of values are in the EDS: give it with --eds FILE")
    from barewire_workbench.live.results import Unfinished

    settings = {"gentle": gentle, "save": save, "write_application": write_application}
    try:
        if not is_can:
            return _test_server(endpoint, output)
        return _test_node(endpoint, output, settings, large=large, eds=eds, only=only, power_cycle=power_cycle)
    except Unfinished as error:
        if output.as_json:
            print_json({"unfinished": str(error), "not_run": error.not_run})
        raise


def _print_results(results: Iterable[CaseResult | NodeCaseResult], output: Output) -> Counter[str]:
    """Print each result as it comes, and return how many cases have each verdict."""
    verdicts: Counter[str] = Counter()
    for result in results:
        verdicts[result.verdict] += 1
        output.show(result.line, result.as_dict)
    return verdicts


def _judged(verdicts: Counter[str]) -> int:
    return verdicts["ok"] + verdicts["failed"] + verdicts["now and then"]


def _total(verdicts: Counter[str]) -> str:
    others = ("now and then", "not judged", "left out")
    rest = "".join(f", {verdicts[verdict]} {verdict}" for verdict in others if verdicts[verdict])
    return f"{verdicts['ok']} of {_judged(verdicts)} passed{rest}"


def _test_server(endpoint: str, output: Output) -> int:
    """Run the cases of a Modbus server and print them; 1 if one failed, or none could be judged."""
    from barewire_workbench.live.modbus_conformance import conform

    verdicts = _print_results(conform(Endpoint.parse(endpoint)), output)
    output.text(_total(verdicts))
    if verdicts["not judged"]:
        output.text("The cases need registers and coils 0 to 9 of the unit, to read and to write.")
    return int(verdicts["ok"] < _judged(verdicts) or not _judged(verdicts))


def _test_node(
    endpoint: str,
    output: Output,
    settings: dict[str, Any],
    *,
    large: str | None,
    eds: str | None,
    only: str,
    power_cycle: bool,
) -> int:
    """Run the cases of a CANopen device and print them; 1 if one failed."""
    from barewire.canopen.eds import parse
    from barewire_workbench.live.canopen_conformance import conform_can
    from barewire_workbench.live.results import TwoDevices

    document = None if eds is None else parse(file_content(eds))
    if document is not None and not document.objects:
        raise EncodeError(f"--eds {eds}: describes no objects: expected sections like [1000]")
    tell = partial(print, file=sys.stderr, flush=True)
    results = conform_can(
        Endpoint.parse(endpoint),
        large=_object_address(large),
        only=_beginnings(only, document),
        eds=document,
        on_power_cycle=partial(tell, "switch the device off and on") if power_cycle else None,
        on_stopped=partial(
            tell, "the device did not answer before it got NMT 80h, enter pre-operational: it was STOPPED"
        ),
        **settings,
    )
    after = ""

    def remembered() -> Iterator[NodeCaseResult]:
        nonlocal after
        for result in results:
            after = f" after {result.case.name}"
            yield result

    try:
        verdicts = _print_results(remembered(), output)
    except TwoDevices as error:
        if output.as_json:
            print_json({"unfinished": str(error), "not_run": None})
        note(f"{error}; give them different node-IDs")
        return _TWO_DEVICES
    except NoAnswer as error:
        if settings["gentle"]:
            hint = "a device in STOPPED does not answer: without --gentle it is switched to PRE-OPERATIONAL"
            raise NoAnswer(f"{error}; {hint}") from None
        raise
    except KeyboardInterrupt:
        tell(f"interrupted{after}: the device is as the last case made it, possibly stopped: reset it")
        raise
    if not verdicts:
        raise EncodeError(f"--only {only}: this device has no case with a name that begins so")
    output.text(_total(verdicts))
    return int(verdicts["ok"] < _judged(verdicts))


def _beginnings(only: str, eds: Eds | None) -> tuple[str, ...]:
    """Return the beginnings of names of cases that `--only` gives. Raises EncodeError for one that no case has."""
    from barewire_workbench.live.canopen_conformance import case_names

    beginnings = tuple(name.strip().upper() for name in only.split(","))
    names = case_names() if eds is None else case_names(eds.objects, eds.dummies)
    for beginning in beginnings:
        if eds is None and beginning.startswith("OD"):
            raise EncodeError(
                f"--only {beginning}: the cases OD- compare the device with its EDS: give it with --eds FILE"
            )
        if not any(name.startswith(beginning) for name in names):
            groups = ", ".join(sorted({f"{name.partition('-')[0]}-" for name in names}))
            raise EncodeError(f"--only {beginning}: no case has a name that begins so; expected {groups} and a number")
    return beginnings


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
