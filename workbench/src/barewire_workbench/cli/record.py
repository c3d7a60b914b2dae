"""`barewire record`: traffic of a line -> a file with what each unit answered, which `barewire simulate` serves."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import click

from barewire.errors import BarewireError, DecodeError, EncodeError
from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.arguments import duration
from barewire_workbench.cli.output import check_not_overwritten, replace_file
from barewire_workbench.cli.sources import Source, ports_option, protocol_option, stopped_by_interrupt
from barewire_workbench.frames.modbus_exchanges import Exchanges
from barewire_workbench.live.listen import listen
from barewire_workbench.recordings.modbus_replay import SerialProtocol, replay_log
from barewire_workbench.replay.recorded import ANSWERS_LIMIT, READS, RecordedLine, RecordedRequest, learn_line, to_toml
from barewire_workbench.sniffer import WINDOW, SnifferEvent

_FOR_CAN = "`barewire sniff --write` records a bus, `barewire replay` plays the recording against a device"


@click.command("record")
@click.argument("source", metavar="ENDPOINT|FILE")
@click.option(
    "--to", "target", type=click.Path(dir_okay=False), metavar="FILE", help="The .toml to write; else it is printed."
)
@click.option(
    "--unit", "units", type=click.IntRange(0, 255), multiple=True, help="Only this unit; may be given several times."
)
@click.option("--seconds", type=duration, metavar="S", help="A live line: stop after this time; without it, at Ctrl-C.")
@click.option(
    "--limit",
    type=click.IntRange(1),
    default=ANSWERS_LIMIT,
    show_default=True,
    metavar="N",
    help="The most different answers of a request.",
)
@click.option(
    "--window",
    type=duration,
    metavar="S",
    default=WINDOW,
    show_default=True,
    help="Longest time from a request to its response, in seconds.",
)
@protocol_option
@ports_option
def record_command(
    source: str,
    target: str | None,
    units: tuple[int, ...],
    seconds: float | None,
    limit: int,
    window: float,
    protocol: SerialProtocol | None,
    ports: tuple[int, ...],
) -> None:
    """Make a simulated device of the traffic of a Modbus line.

    The source is a FILE as `barewire sniff` takes it, such as one that `sniff --write` wrote, or the ENDPOINT of a
    serial line, to which nothing is sent. The result is a TOML file with each unit: which registers are read and
    written, how often, and the answers in their order: values, exceptions, missing ones, and how long each took.

    \b
    barewire sniff "rtu:///dev/ttyUSB0?baudrate=9600" --write bus.pcapng
    barewire record bus.pcapng --to pump.toml
    barewire simulate pump.toml rtu:///tmp/line
    """
    if target is not None:
        check_not_overwritten("--to", target, source)
    traffic = Source(source, seconds, ports, protocol, whole=True)
    if traffic.is_can:
        kind = "a recording of a CAN bus" if traffic.endpoint is None else "a CAN bus"
        raise EncodeError(f"{source}: {kind}; `record` is for Modbus: {_FOR_CAN}")
    traffic.check_options({}, {})
    if traffic.endpoint is None:
        events = _replayed(traffic, window)
    else:
        events = _live(traffic.endpoint, seconds, window, shown=target is not None)
    line = learn_line(events, limit=limit)
    for unit in units:
        if unit not in line.units:
            known = ", ".join(map(str, line.units)) or "none"
            raise EncodeError(f"--unit {unit}: no request to it in {source}; there are: {known}")
    if units:
        line.units = {address: unit for address, unit in line.units.items() if address in units}
    if not line.units:
        seen = f"{line.strays} frames without their request, {line.noise} pieces of noise"
        raise BarewireError(f"{source}: no request to a unit in it ({seen})")
    text = to_toml(line, source)
    if target is None:
        print(text, end="")
        return
    replace_file(target, text.encode())
    for row in _summary(line):
        print(row)
    print(f"{target} written; to serve it: barewire simulate {target} ENDPOINT")


def _live(endpoint: Endpoint, seconds: float | None, window: float, *, shown: bool) -> Iterator[SnifferEvent]:
    """Yield the events of a line, and print its exchanges if they are `shown`."""
    stop, lines = threading.Event(), Exchanges()
    with stopped_by_interrupt(stop):
        for event in listen(endpoint, stop, seconds=seconds, window=window):
            for row in lines.feed(event) if shown else ():
                print(row, flush=True)
            yield event


def _replayed(traffic: Source, window: float) -> Iterator[SnifferEvent]:
    """Yield the events of a recording."""
    try:
        recording = replay_log(traffic.recording.whole(), window=window, ports=traffic.ports, protocol=traffic.protocol)
    except DecodeError as error:
        raise traffic.not_a_recording(error) from None
    yield from recording.events


def _summary(line: RecordedLine) -> Iterator[str]:
    """Yield a line of text for each request, and one for what belongs to none."""
    for unit in line.units.values():
        for request in unit.requests:
            yield f"unit {unit.address}: {_request_text(request)}"
    if line.broadcasts or line.strays or line.noise:
        yield (
            f"left out: {line.broadcasts} broadcasts, {line.strays} frames without their request, "
            f"{line.noise} pieces of noise"
        )


def _request_text(request: RecordedRequest) -> str:
    end = request.address + request.quantity - 1
    place = f"{request.table}:{request.address}{f'-{end}' if end > request.address else ''}"
    if not request.table:
        what = f"function {request.function:02X}"
    else:
        what = f"{'read' if request.function in READS else 'write'} {place}"
    times = "once" if request.count == 1 else f"{request.count} times"
    often = f"{times}, every {request.period:g} s" if request.period else times
    exceptions = sum(answer.times for answer in request.answers if answer.exception is not None)
    silent = sum(answer.times for answer in request.answers if answer.silent)
    parts = [
        f"{exceptions} exception{'s' * (exceptions != 1)}" if exceptions else "",
        f"{silent} without an answer" if silent else "",
        f"{request.left_out} left out" if request.left_out else "",
    ]
    return ": ".join([f"{what} {often}", ", ".join(filter(None, parts))]).removesuffix(": ")
