"""What a shell completes behind `barewire`: the names of parameters. Commands and options are those of click, devices
are in `arguments`; docs/how-to/install.md says how a shell is told.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable

import click
from click.shell_completion import CompletionItem

from barewire.errors import BarewireError
from barewire_workbench.cli.arguments import load_device


def complete_name(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the names of the parameters of the device that begin with this, in upper or lower case."""
    device, is_written = context.params.get("device"), parameter.name == "assignments"
    if not isinstance(device, str) or device == "raw":
        return []
    try:
        parameters = load_device(device).parameters
    except BarewireError:
        return []
    usable = [row.name for row in parameters if (row.writable if is_written else row.readable)]
    return [_item(name + "=" * is_written) for name in usable if name.casefold().startswith(incomplete.casefold())]


def _item(text: str) -> CompletionItem:
    """Return an item. Bash inserts it as it is, so outside of quotes its blanks need a backslash, and a second one for
    the `read` in the script of click; zsh and fish do that by themselves."""
    if os.environ.get("_BAREWIRE_COMPLETE", "").startswith("bash") and not _in_quotes(os.environ.get("COMP_WORDS", "")):
        text = re.sub(r"([^\w=./:%+-])", r"\\\\\1", text)
    return CompletionItem(text)


def _in_quotes(words: Iterable[str]) -> bool:
    quote = ""
    for letter in words:
        if letter == quote:
            quote = ""
        elif letter in "'\"" and not quote:
            quote = letter
    return bool(quote)
