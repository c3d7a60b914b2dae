"""The main command: the list of commands, and what happens when one fails.

Every exception that barewire raises on purpose becomes one line on stderr and exit status 1; wrong usage becomes one
line and status 2: an option, name, value or address that cannot be understood. Any other exception is a bug of barewire
and shows its traceback.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from importlib import import_module
from pathlib import Path
from typing import TextIO

import click

from barewire import __version__
from barewire.errors import BarewireError, EncodeError
from barewire_workbench.cli.arguments import CommandGroup
from barewire_workbench.cli.output import printable
from barewire_workbench.live.results import text_with_notes

COMMANDS = {
    "demo": ("demo", "Read and write three simulated machines on every wire."),
    "devices": ("devices", "List the devices, or all parameters of one."),
    "simulate": ("simulate", "Simulate a device on real ports until interrupted."),
    "ports": ("ports", "List the serial ports and CAN interfaces of this machine."),
    "scan": ("scan", "Find the units of a line, the nodes of a bus, the addresses of a unit."),
    "read": ("read_write", "Read named values of a device."),
    "write": ("read_write", "Write named values of a device, in the order given."),
    "save": ("keep", "Save the settings of a device in a file."),
    "restore": ("keep", "Write the settings of a file to a device."),
    "diff": ("keep", "Compare the settings of two devices or files."),
    "watch": ("watch", "Read named values periodically, and log them."),
    "plot": ("plot", "Draw a log that `barewire watch --to` wrote."),
    "drive": ("drive", "Enable, move and stop a CiA 402 drive."),
    "panel": ("panel", "Show a machine in a browser: live values, frames, writes."),
    "explain": ("explain", "Explain a frame byte by byte and check it."),
    "send": ("send", "Send the bytes of a frame as they are; explain the answer."),
    "steps": ("steps", "Work out a checksum, a time, a value or a word step by step."),
    "lab": ("lab", "Show the labs of the course, and check answers to their exercises."),
    "sniff": ("sniff", "Decode the traffic of a line or bus; send nothing."),
    "diagnose": ("diagnose", "Say what is wrong in a recording, or on a line or bus."),
    "record": ("record", "Make a simulated device of the traffic of a Modbus line."),
    "replay": ("replay", "Play a recording of a CAN bus against a device or an SDO client."),
    "conform": ("conform", "Test a server or device against the standard."),
    "vectors": ("vectors", "List, show and check the reference vectors."),
    "canopen": ("canopen", "Configure devices, boot a network; NMT, LSS, emergencies, PDOs."),
    "gateway": ("gateway", "Serve lines and buses to many Modbus clients; publish values to MQTT."),
    "canopen-gateway": ("canopen_gateway", "Serve a CANopen network as text over TCP (CiA 309-3)."),
    "eds": ("eds", "Export or check electronic data sheets (CiA 306)."),
    "vendor": ("vendor", "Print NAME as one file that needs the standard library only."),
}
"""Command -> (file, first line of its help). A file is loaded when the command is used: `explain` loads no CAN bus,
and `--help` none of them. In the file, the click command of `canopen-gateway` is `canopen_gateway_command`."""

_WORD_LONGEST = 250
"""Characters of a word in the text of an error."""

_HELP_PAGE = "NoArgsIsHelpError"
"""The error that click raises from 8.2 on for a group without a command; its text is the help page."""


class LazyGroup(CommandGroup):
    """A group whose commands are loaded when they are needed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command of that name, from its file."""
        if cmd_name not in COMMANDS:
            return None
        module = import_module(f"barewire_workbench.cli.{COMMANDS[cmd_name][0]}")
        command = getattr(module, f"{cmd_name.replace('-', '_')}_command")
        assert isinstance(command, click.Command)
        if callable(loaded := ctx.find_root().obj):
            loaded()
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands from the table."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, summary) for name, (_, summary) in COMMANDS.items()])


def run_command_line(arguments: list[str], loaded: Callable[[], None] | None = None) -> int:
    """Run a command and return its exit status: 0 done, 1 failed, 2 wrong usage, 130 after Ctrl-C. `loaded` is called
    when the file of the command is loaded."""
    if sys.stdout is None:  # `>&-`
        return _run_without_output(arguments, loaded)
    if sys.stderr is None:  # `2>&-`: `print` would write errors to stdout
        with Path(os.devnull).open("w", encoding="utf-8") as nowhere, redirect_stderr(nowhere):
            return run_command_line(arguments, loaded)
    if isinstance(sys.stdout, io.TextIOWrapper) and isinstance(sys.stdout.buffer, io.RawIOBase):
        # With PYTHONUNBUFFERED a text is written once, and what a full disk did not take of it is lost without a word.
        sys.stdout = io.TextIOWrapper(io.BufferedWriter(sys.stdout.buffer), sys.stdout.encoding, line_buffering=True)
    # A character that the terminal cannot show, such as a degree sign, is replaced; the value is still printed.
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    status = 1
    try:
        status = _run_command(arguments, loaded)
        sys.stdout.flush()  # what a buffer holds is written here, where a failure can still be reported
        return status
    except OSError as error:
        for stream in (sys.stdout, sys.stderr):
            _flush_or_discard(stream)
        if isinstance(error, BrokenPipeError):  # the reader of the output has ended (`| head`), which is no error
            return status or 1
        text = error.strerror or str(error)
        return _print_error(f"output: {text[:1].lower()}{text[1:]}", status or 1)


def _run_command(arguments: list[str], loaded: Callable[[], None] | None) -> int:
    """Run a command and print its error. Raises OSError if its output cannot be written."""
    try:
        status = barewire_command.main(arguments, prog_name="barewire", standalone_mode=False, obj=loaded)
        return status if isinstance(status, int) else 0
    except click.ClickException as error:
        if type(error).__name__ == _HELP_PAGE:
            return _print_text(error.format_message(), error.exit_code)
        return _print_error(_usage_text(error, arguments), error.exit_code)
    except BarewireError as error:
        return _print_error(text_with_notes(error), 2 if _is_wrong_usage(error) else 1)
    except (KeyboardInterrupt, click.Abort) as error:
        # What a command had done by then is in the notes; click raises Abort from the interrupt.
        notes = getattr(error.__cause__ or error, "__notes__", [])
        return _print_error("; ".join(["interrupted", *notes]), 130) if notes else 130


def _flush_or_discard(stream: TextIO) -> None:
    """Write what the buffer of a stream holds. If that fails it is lost, or it would fail again when Python ends."""
    try:
        stream.flush()
    except OSError:
        with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
            os.dup2(nowhere.fileno(), stream.fileno())


def _usage_text(error: click.ClickException, arguments: list[str]) -> str:
    """Return the text of wrong usage, with what click leaves out: where -v stands, which help explains the rest."""
    text = error.format_message()
    if isinstance(error, click.NoSuchOption) and error.option_name in ("-v", "--verbose"):
        return f"{error.option_name!r} stands before the command: barewire {error.option_name} {arguments[0]} ..."
    if isinstance(error, click.MissingParameter) and error.ctx is not None:
        return f"{text.rstrip('.')}; see {error.ctx.command_path} --help"
    if isinstance(error, click.UsageError) and error.ctx is not None and text == "Missing command.":
        group = error.ctx.command
        names = group.list_commands(error.ctx) if isinstance(group, click.Group) else []
        return f"no command given: expected one of {', '.join(names)}"
    return text


class _Discarded(io.TextIOWrapper):
    """A stdout that discards what is written to it, and notes that there was something."""

    has_lost = False

    def write(self, text: str) -> int:
        self.has_lost = True
        return super().write(text)


def _run_without_output(arguments: list[str], loaded: Callable[[], None] | None) -> int:
    """Run a command whose stdout is closed. What it prints is lost, which is an error at its end, also if the command
    has failed: the status of `diagnose` says that something is wrong, and what was printed."""
    with Path(os.devnull).open("wb") as nowhere, redirect_stdout(_Discarded(nowhere, encoding="utf-8")) as stdout:
        status = run_command_line(arguments, loaded)
    if not stdout.has_lost:
        return status
    return _print_error("output: stdout is closed, what the command printed is lost", status or 1)


def _is_wrong_usage(error: BarewireError) -> bool:
    from barewire.devices.device import UnknownName

    return isinstance(error, (EncodeError, UnknownName))


def _print_error(text: str, status: int) -> int:
    """Print the error as one line, and return the status. click repeats an argument in full: long words are cut."""
    words = (word if len(word) <= _WORD_LONGEST else f"{word[: _WORD_LONGEST - 3]}..." for word in text.split())
    return _print_text(f"barewire: {' '.join(words)}", status)


def _print_text(text: str, status: int) -> int:
    """Print a text on stderr, and return the status, which is all that is left to report where stderr is full."""
    with suppress(OSError):
        print(printable(text), file=sys.stderr)
    _flush_or_discard(sys.stderr)
    return status


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="barewire")
@click.option(
    "-v", "--verbose", count=True, help="Log connections, time-outs and refusals to stderr; -vv: all bytes and frames."
)
def barewire_command(verbose: int) -> None:
    """Read, write, simulate, monitor and test Modbus (RTU, ASCII, TCP) and CANopen devices.

    `barewire COMMAND --help` explains a command.

    \b
    ENDPOINT is a URL:
      tcp://127.0.0.1:1502?unit=1
      rtu:///dev/ttyUSB0?baudrate=19200&parity=E&stopbits=1&unit=1
      ascii:///dev/ttyUSB0?baudrate=9600&bytesize=7&parity=E&unit=1
      can://INTERFACE/CHANNEL?node=1&bitrate=125000      (INTERFACE as python-can names it)

    \b
    Options of every ENDPOINT:   timeout=1            seconds that a request waits for its response
                                 retries=0            how often a read without a response is repeated
    Options for Modbus:          late_window=3        seconds in which a late response is expected
                                 gap=0                seconds between two requests to a unit; gap.7: to unit 7
    All of them are in docs/reference/endpoints.md.
    """
    if verbose:
        import logging  # not at the top: commands without this option do not need it

        logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s: %(message)s")
        logging.getLogger("barewire").setLevel(logging.INFO if verbose == 1 else logging.DEBUG)
