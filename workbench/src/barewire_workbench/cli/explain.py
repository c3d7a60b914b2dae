"""`barewire explain`: explain a frame byte by byte, or a recording frame by frame."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import Any

import click

from barewire.errors import BarewireError, DecodeError, EncodeError, shown
from barewire_workbench import Explanation, explain_exchange, explain_text
from barewire_workbench.api import explain_can_text
from barewire_workbench.cli.arguments import Choice, format_option, json_option, known_nodes, nodes_option
from barewire_workbench.cli.output import Output, file_content, output_form
from barewire_workbench.monitor import event_as_dict, event_line
from barewire_workbench.monitor.events import Gap, Loss, Violation
from barewire_workbench.monitor.pdos import PdoTracker
from barewire_workbench.monitor.recording import BusMonitors, read_recording
from barewire_workbench.recordings.candump import log_line, parse_any_can
from barewire_workbench.recordings.model import Recorded, Unread


class _Protocol(Choice):
    """The first word; a frame without it is an error that says where it belongs."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the word."""
        if re.match(r"[:\d]|[0-9A-Fa-f]{2}\b", str(value)):
            words = ", ".join(self.choices)
            self.fail(
                f'{shown(value)}: expected one of {words} before it: explain rtu "01 04 0F B1 00 02 22 F8"', param, ctx
            )
        return super().convert(value, param, ctx)


@click.command("explain")
@click.argument("protocol", type=_Protocol(["rtu", "ascii", "tcp", "can"]), metavar="rtu|ascii|tcp|can")
@click.argument("frame", nargs=-1, required=True, metavar="HEX")
@click.option("--check", is_flag=True, help="Exit with status 1 if the frame is not valid.")
@click.option("--role", type=Choice(["request", "response"]), help="The direction; guessed if not given.")
@click.option("--request", metavar="HEX", help="Modbus: the request that the frame answers.")
@click.option("--floats", type=Choice(["f32", "f64"]), help="With --request: the type of all values.")
@click.option(
    "--device",
    "devices",
    multiple=True,
    metavar="NAME|EDS",
    help="CAN: the device of a node, for PDO names. With --request: that of the unit, for its addresses and floats.",
)
@nodes_option
@json_option
@format_option
@click.option("--picture", type=Choice(["fields", "levels"]), help="Bytes and fields, or the levels on the wire.")
@click.option(
    "--line", metavar="9600,8N1", help="Of the levels: baud rate and character format; 19200,8E1 if not given."
)
def explain_command(
    protocol: str,
    frame: tuple[str, ...],
    role: str | None,
    as_json: bool,
    check: bool,
    devices: tuple[str, ...],
    nodes: tuple[int, ...],
    request: str | None,
    floats: str | None,
    form: str | None,
    picture: str | None,
    line: str | None,
) -> int:
    """Explain a frame byte by byte and check it.

    HEX may have blanks, commas or 0x; it may be a list or string of C or Python, or the output of xxd, hexdump -C or
    tshark -x. Paste ASCII frames as they are, and CAN frames as candump prints them. For can, HEX may be the name of a
    recording: each of its frames is explained in one line.

    \b
    barewire explain rtu "01 04 0F B1 00 02 22 F8"
    barewire explain rtu "01 04 04 00 00 01 10 3B C3" --role response
    barewire explain rtu "01 83 02 C0 F1" --request "01 03 9C 41 00 01 FA 4E"
    barewire explain ascii ":01040FB1000239"
    barewire explain can "605#4041600000000000"
    barewire explain can "185#3706000000000000" --device az3 --node 5
    barewire explain can bus.log
    barewire explain rtu "01 03 00 00 00 02 C4 0B" --format html > frame.html
    barewire explain can "605#4041600000000000" --picture levels
    """
    form = output_form(form, as_json=as_json)
    if line is not None and (protocol not in ("rtu", "ascii") or (picture or form) not in ("levels", "html")):
        raise EncodeError("--line is for the levels of rtu and ascii: add --picture levels")
    if protocol == "can" and len(frame) == 1 and Path(frame[0]).is_file():
        if picture is not None or form not in ("text", "json"):
            option = f"--format {form}" if picture is None else "--picture"
            name = frame[0]
            raise EncodeError(f"{option} is for one frame, {name} is a recording: barewire sniff {name} --format svg")
        return _explain_recording(frame[0], devices, nodes, Output(form), check=check)
    if floats is not None and request is None:
        raise EncodeError("--floats needs --request: a request says where the values begin")
    if protocol != "can" and devices and request is None:
        raise EncodeError("--device is for can, or for a response with its --request")
    known = known_nodes(devices, nodes) if request is None else []
    try:
        if request is not None:
            explanation = _explain_exchange(protocol, " ".join(frame), request, role, devices, nodes, floats)
        elif known:
            dialects = {node.node: node.commands for node in known}
            explanation = explain_can_text(" ".join(frame), role, PdoTracker(tuple(known)), dialects)
        else:
            explanation = explain_text(protocol, " ".join(frame), role)
    except DecodeError as error:
        # The text names the position in the input; that of the exception, in the frame, is for programs.
        no_file = f"; there is no file {frame[0]!r} either" if protocol == "can" and len(frame) == 1 else ""
        raise click.UsageError(error.text + no_file) from None
    if picture is not None or form in ("html", "svg"):
        _print_picture(explanation, " ".join(frame), form, picture, line)
    else:
        Output(form).show("\n".join(explanation.lines()), explanation.as_dict)
    return int(check and not explanation.valid)


def _explain_exchange(
    protocol: str,
    response: str,
    request: str,
    role: str | None,
    devices: tuple[str, ...],
    nodes: tuple[int, ...],
    floats: str | None,
) -> Explanation:
    """Explain a response to a request."""
    from barewire.devices import load

    if role == "request":
        raise EncodeError("--role request: with --request the frame is the response")
    if nodes or len(devices) > 1:
        raise EncodeError("--request needs one --device, and no --node: the unit is in the request")
    if devices and floats is not None:
        raise EncodeError("--floats: the --device has its own types; give one of the two")
    return explain_exchange(protocol, request, response, device=load(devices[0]) if devices else None, floats=floats)


def _print_picture(explanation: Explanation, text: str, form: str, name: str | None, line: str | None) -> None:
    """Print the picture `name` of a frame: a page without a name has all of them, a drawing the fields."""
    from barewire_workbench.pictures.levels import SerialLine, frame_pictures
    from barewire_workbench.pictures.picture import rendered

    pictures = frame_pictures(
        explanation,
        parse_any_can(text) if explanation.protocol == "can" else None,
        None if line is None else SerialLine.parse(line),
    )
    if name is None:
        chosen = list(pictures.values()) if form == "html" else [pictures["fields"]]
    elif name in pictures:
        chosen = [pictures[name]]
    else:
        kind = "a CAN FD or error frame" if explanation.protocol == "can" else f"a frame of {explanation.protocol}"
        raise EncodeError(f"--picture {name}: {kind} has only the picture fields")
    print(rendered(form, *chosen), end="")


def _explain_recording(
    name: str, devices: tuple[str, ...], nodes: tuple[int, ...], output: Output, *, check: bool
) -> int:
    """Print a line for each frame, and one for each rule that it violates together with earlier frames."""
    data = file_content(name)
    monitors, wrong = BusMonitors(known_nodes(devices, nodes)), 0
    try:
        items = read_recording(data)
    except DecodeError as error:
        raise BarewireError(f"{name}: {error.text}") from None
    for item in items:
        if isinstance(item, Recorded):
            monitor = monitors.monitor(item.bus)
            if monitor is not None:
                explanation = monitor.explain(item.frame)
                wrong += not explanation.valid
                line = f"{log_line(item.at, item.bus or 'can0', item.frame)}  {explanation.verdict}"
                output.show(line, partial(_recorded_fields, item, explanation))
        for _, event in monitors.feed(item):
            if isinstance(event, Violation | Gap | Loss | Unread):
                wrong += isinstance(event, Violation | Unread)
                output.show(f"    {event_line(event)}", partial(event_as_dict, event))
    return int(check and wrong > 0)


def _recorded_fields(item: Recorded, explanation: Explanation) -> dict[str, object]:
    return {"at": item.at, "bus": item.bus, "frame": str(item.frame), **explanation.as_dict()}
