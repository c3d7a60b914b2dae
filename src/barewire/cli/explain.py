"""`barewire explain`: paste a frame, learn something."""

from __future__ import annotations

import json

import click

from barewire.cli.arguments import json_option
from barewire.explain import explain_text


@click.command()
@click.argument("protocol", type=click.Choice(["rtu", "ascii", "tcp", "can"]))
@click.argument("frame", nargs=-1, required=True, metavar="HEX")
@click.option("--role", type=click.Choice(["request", "response"]), help="Who says it; guessed if not given.")
@json_option
def explain(protocol: str, frame: tuple[str, ...], role: str | None, as_json: bool) -> None:
    """Explain a frame byte by byte, and say whether it is valid.

    HEX may have blanks, commas or 0x. ASCII frames may be pasted as they are, CAN frames as candump prints them.

    \b
    barewire explain rtu "01 04 0F B1 00 02 22 F8"
    barewire explain rtu "01 04 04 00 00 01 10 3B C3" --role response
    barewire explain ascii ":01040FB1000239"
    barewire explain can "605#4041600000000000"
    """
    explanation = explain_text(protocol, " ".join(frame), role)
    if as_json:
        print(json.dumps(explanation.as_dict(), ensure_ascii=False))
    else:
        print("\n".join(explanation.lines()))
