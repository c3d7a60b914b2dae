"""The page of the commands: the help of each, as the command itself prints it.

## barewire canopen            a group, then its commands
### barewire canopen boot
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from unittest.mock import patch

import click

PATH = "reference/commands.md"

_HEAD = """# Commands

Made by the commands themselves: `barewire COMMAND --help` prints the same. Options stand behind the command; `-v` and
`-vv` stand before it. An ENDPOINT is a [URL](endpoints.md).

| exit status | |
|---|---|
| 0 | done |
| 1 | failed: one line on stderr says why |
| 2 | wrong usage: one line on stderr says what was expected |
| 130 | ended by Ctrl-C |
"""


def commands() -> Iterator[tuple[str, click.Command, click.Context]]:
    """Yield every command below `barewire`, by its words, in the order of the help."""
    from barewire_workbench.cli.app import barewire_command

    yield from _below("barewire", barewire_command, None)


def _below(
    words: str, command: click.Command, parent: click.Context | None
) -> Iterator[tuple[str, click.Command, click.Context]]:
    # With its own settings, as on the command line: a command keeps the help option of its first context.
    settings = {**command.context_settings, "max_content_width": 88}
    context = click.Context(command, info_name=words.rpartition(" ")[2], parent=parent, **settings)
    context.terminal_width = 88
    yield words, command, context
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None, name
            yield from _below(f"{words} {name}", inner, context)


def page() -> str:
    """Return the whole page."""
    lines = [_HEAD]
    with patch.dict(os.environ, {"NO_COLOR": "1"}):
        for words, command, context in commands():
            depth = min(words.count(" ") + 2, 3)
            lines += [f"{'#' * depth} {words}", "", "```text", command.get_help(context).rstrip(), "```", ""]
    return "\n".join(lines)
