"""`barewire explain`: paste a frame, learn something."""

from __future__ import annotations

import click

from barewire.cli.arguments import json_option, print_json
from barewire.errors import BarewireError, DecodeError
from barewire.explain import explain_text


@click.command()
@click.argument("protocol", type=click.Choice(["rtu", "ascii", "tcp", "can"]))
@click.argument("frame", nargs=-1, required=True, metavar="HEX")
@click.option("--check", is_flag=True, help="Exit with status 1 if the frame is not valid.")
@click.option("--role", type=click.Choice(["request", "response"]), help="Who says it; guessed if not given.")
@json_option
def explain(protocol: str, frame: tuple[str, ...], role: str | None, as_json: bool, check: bool) -> int:
    """Explain a frame byte by byte, and say whether it is valid.

    HEX may have blanks, commas or 0x. ASCII frames may be pasted as they are, CAN frames as candump prints them.

    \b
    barewire explain rtu "01 04 0F B1 00 02 22 F8"
    barewire explain rtu "01 04 04 00 00 01 10 3B C3" --role response
    barewire explain ascii ":01040FB1000239"
    barewire explain can "605#4041600000000000"
    """
    try:
        explanation = explain_text(protocol, " ".join(frame), role)
    except DecodeError as error:
        # Its place and bytes are for programs; the sentence says the place in the text that was typed.
        raise BarewireError(error.text) from None
    if as_json:
        print_json(explanation.as_dict())
    else:
        print("\n".join(explanation.lines()))
    return int(check and not explanation.valid)
