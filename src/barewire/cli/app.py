"""The command's frame: its words, and what happens when something goes wrong.

Every error that barewire raises on purpose becomes one line on stderr and exit status 1. Anything else would be a bug
of ours, and is shown as one.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Any

import click

from barewire import __version__
from barewire.errors import BarewireError

COMMANDS = {
    "demo": "demo",
    "devices": "devices",
    "simulate": "simulate",
    "read": "values",
    "write": "values",
    "explain": "explain",
}
"""Which file has which command. It is loaded when the command is used: explaining a frame needs no CAN bus."""


class Commands(click.Group):
    """A group whose commands are loaded when they are needed, and fail in one line."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """In the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name, from its file."""
        if cmd_name not in COMMANDS:
            return None
        module = import_module(f"barewire.cli.{COMMANDS[cmd_name]}")
        command = getattr(module, cmd_name)
        assert isinstance(command, click.Command)
        return command

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; say what went wrong without a traceback."""
        try:
            return super().invoke(ctx)
        except BarewireError as error:
            print(f"barewire: {error}", file=sys.stderr)
            sys.exit(1)
        except BrokenPipeError:
            # Whoever read our output has had enough (`| head`): no reason to complain, nor to flush the rest.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            sys.exit(1)
        except KeyboardInterrupt:
            sys.exit(130)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="barewire")
def barewire() -> None:
    """Modbus (RTU, ASCII, TCP) and CANopen, from the first bit of a CRC to a named value with its unit.

    \b
    ENDPOINT is a URL:
      tcp://127.0.0.1:1502?unit=1
      rtu:///dev/ttyUSB0?baudrate=19200&parity=E&stopbits=1&unit=1
      ascii:///dev/ttyUSB0?baudrate=9600&bytesize=7&parity=E&unit=1
      can://INTERFACE/CHANNEL?node=1&bitrate=125000      (INTERFACE as python-can names it)
    """
