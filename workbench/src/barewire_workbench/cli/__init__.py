"""The command `barewire`. Files in reading order:

    app               the main command: loads a command when it is used; errors and exit statuses
    arguments         arguments and options that several commands share
    completion        what a shell completes: names of parameters
    output            things as text or JSON, notes, a line that counts, files
    ending            signals, and the wait for a late response
    demo              `demo`: simulated machines read and written on every wire
    devices           `devices`: the catalogue, and every parameter of a device
    simulate          `simulate`: a machine or a table on real ports
    ports, scan       `ports`: those of this machine; `scan`: units, nodes and addresses
    read_write        `read`, `write`: named values
    dry_run           what `write --dry-run` shows: addresses, raw words, frames
    value_text        the VALUE of NAME=VALUE
    raw_address       names that are addresses: holding:0, 40001, object:6041h:u16
    keep              `save`, `restore`, `diff`: the settings of a device; keep_dcf: a DCF as the file
    watch             `watch`: named values periodically, as a table, lines, JSON or CSV
    log_file, plot    the log of `watch --to`; `plot`: a log as curves
    drive             `drive`: enable, move and stop a drive
    panel, panels/    `panel`: the page of a machine for browsers
    terminal/         the screens of `panel --terminal` and `sniff --live`
    shown_frames      `--frames` of read, write, drive and demo: the frames of a command as they pass
    explain           `explain`: frames and recordings
    send, steps       `send`: a frame typed by hand, its answer explained; `steps`: calculations step by step
    lab, labs/        `lab`: the labs of the course, and their exercises
    sources           the line, bus or recording that the next three commands read
    sniff             `sniff`: the traffic of a line or bus
    diagnose          `diagnose`: what is wrong in a recording, or on a line
    record            `record`: traffic of a line -> a file that `simulate` serves
    replay            `replay`: a recording of a CAN bus against a device or a client
    conform           `conform`: a server or a CANopen device against the standard
    canopen           `canopen`: a device compared with its DCF, and configured; a network booted
    canopen_services  `canopen nmt`, `heartbeat`, `sync`, `lss`, `emcy`, `pdo`: the services of a bus by hand
    canopen_gateway   `canopen-gateway`: a CANopen network as text over TCP
    eds               `eds`: export and check electronic data sheets
    vectors           `vectors`: the reference vectors, listed and run against any implementation
    vectors_show      one case of them, explained and drawn
    vendor            `vendor`: a client or server as one file, updated and checked

Exit status: 0 done, 1 failed, 2 wrong usage, 128 + n ended by signal n.
"""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module

from barewire_workbench import __version__


def main() -> None:
    """Run the command. Without the stack, click or rich, print one line that says how to get them."""
    _end_at_interrupt(True)
    try:
        from barewire import __version__ as stack

        for name in ("click", "rich"):
            import_module(name)
    except ModuleNotFoundError as error:
        needed = f"barewire {__version__}" if error.name == "barewire" else "click and rich"
        print(f"barewire: the command needs {needed}: pip install 'barewire[cli]=={__version__}'", file=sys.stderr)
        sys.exit(1)
    if stack != __version__:  # pip refuses that, unless it is told otherwise
        both = f"barewire {stack} and barewire-workbench {__version__}"
        print(f"barewire: installed are {both}: the command needs one version of both", file=sys.stderr)
    from barewire_workbench.cli.app import run_command_line

    status = run_command_line(sys.argv[1:], loaded=lambda: _end_at_interrupt(False))
    _end_at_interrupt(True)
    sys.exit(status)


def _end_at_interrupt(at_once: bool) -> None:
    """Let Ctrl-C end the process `at_once`, or raise KeyboardInterrupt again.

    While modules are loaded, KeyboardInterrupt would be printed as a traceback: Python does not let it pass everywhere.
    A signal that is ignored, as in background jobs of a shell, stays ignored.
    """
    handlers = signal.default_int_handler, _end
    if signal.getsignal(signal.SIGINT) is handlers[not at_once]:
        signal.signal(signal.SIGINT, handlers[at_once])


def _end(number: int, frame: object) -> None:
    os._exit(128 + number)
