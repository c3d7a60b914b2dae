"""The command's frame: its words, and what happens when something goes wrong.

Every error that barewire raises on purpose becomes one line on stderr and exit status 1, and so does a command that
cannot be understood, with status 2. Anything else would be a bug of ours, and is shown as one.
"""

from __future__ import annotations

import io
import os
import sys
from importlib import import_module

import click

from barewire import __version__
from barewire.errors import BarewireError

COMMANDS = {
    "demo": "demo",
    "devices": "devices",
    "simulate": "simulate",
    "read": "values",
    "write": "values",
    "watch": "watch",
    "drive": "drive",
    "explain": "explain",
    "sniff": "sniff",
    "conform": "conform",
    "canopen-gateway": "canopen_gateway",
    "eds": "eds",
}
"""Which file has which command. It is loaded when the command is used: explaining a frame needs no CAN bus."""


class Commands(click.Group):
    """A group whose commands are loaded when they are needed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """In the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name, from its file."""
        if cmd_name not in COMMANDS:
            return None
        module = import_module(f"barewire.cli.{COMMANDS[cmd_name]}")
        command = getattr(module, cmd_name.replace("-", "_"))
        assert isinstance(command, click.Command)
        return command


def run(arguments: list[str]) -> int:
    """Run the command and return its exit status: 0 done, 1 it went wrong, 2 that is no command."""
    # A terminal that has no degree sign still gets the number.
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        status = barewire.main(arguments, prog_name="barewire", standalone_mode=False)
        sys.stdout.flush()
        return status if isinstance(status, int) else 0
    except click.ClickException as error:
        return _say(error.format_message(), error.exit_code)
    except BarewireError as error:
        # A note says what the error could not know: which names were being read, what was written before.
        return _say("; ".join([str(error), *getattr(error, "__notes__", [])]), 1)
    except BrokenPipeError:
        # Whoever read our output has had enough (`| head`): no reason to complain, nor to flush the rest.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return _say(f"output: {error.strerror or error}", 1)
    except (KeyboardInterrupt, click.Abort):
        return 130


def _say(text: str, status: int) -> int:
    print(f"barewire: {' '.join(text.split())}", file=sys.stderr)
    return status


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
