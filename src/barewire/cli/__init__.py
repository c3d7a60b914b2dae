"""The command `barewire`: one file for each of its words.

demo       watch it work               devices    the machines and their parameters      simulate   be one of them
read       named values                write      named values                           watch      them, periodically
drive      enable, move, stop          explain    any frame, in words

I know: words on a command line, tables on a terminal, exit statuses (0 done, 1 it went wrong, 2 that is no command).
I never know: anything that a program could not do without me. Nobody imports me.
"""

from __future__ import annotations

import sys


def main() -> None:
    """The entry point. Without the extra `cli` it says so in one line."""
    try:
        import click  # noqa: F401
        import rich  # noqa: F401
    except ModuleNotFoundError:
        print("barewire: the command needs the extra 'cli': pip install 'barewire[cli]'", file=sys.stderr)
        sys.exit(1)
    from barewire.cli.app import run

    sys.exit(run(sys.argv[1:]))
