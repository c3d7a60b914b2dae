"""`barewire vendor`: a client or server as one file, to paste into another project; updated and checked."""

from __future__ import annotations

import shlex
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import click

from barewire import __version__
from barewire.errors import EncodeError, PortError
from barewire_workbench.cli.output import Output, file_content, replace_file
from barewire_workbench.cli.vectors import check_command
from barewire_workbench.vendor.changes import changes
from barewire_workbench.vendor.head import read_head, sealed
from barewire_workbench.vendor.make import make
from barewire_workbench.vendor.recipes import RECIPES
from barewire_workbench.vendor.sources import folder_of

_FORMAT = [sys.executable, "-m", "ruff", "format", "--isolated", "--line-length=120", "--target-version=py311", "-"]
_file = click.Path(dir_okay=False, path_type=Path)


@click.command("vendor")
@click.argument("name", required=False)
@click.option("--with", "families", multiple=True, metavar="FAMILY", help="Further messages: coils, combined, ...")
@click.option("--update", type=_file, metavar="FILE", help="Make FILE again, and say what changed.")
@click.option("--force", is_flag=True, help="With --update: also if FILE was edited by hand.")
@click.option("--check", type=_file, metavar="FILE", help="Run the reference vectors against FILE.")
@click.option(
    "--python", default=shlex.quote(sys.executable), metavar="COMMAND", help="With --check: the Python that runs FILE."
)
@click.pass_context
def vendor_command(
    context: click.Context,
    name: str | None,
    families: tuple[str, ...],
    update: Path | None,
    force: bool,
    check: Path | None,
    python: str,
) -> int:
    """Print NAME as one file that needs the standard library only.

    Without arguments, list the names. The file is made of the modules of barewire, without what it does not need. It
    has the licence, and the command that made it: --update makes it again with the barewire that is installed. --check
    needs nothing but the file in the Python that runs it.

    \b
    barewire vendor modbus-rtu-client > modbus_rtu.py
    barewire vendor --update modbus_rtu.py
    barewire vendor --check modbus_rtu.py --python /usr/bin/python3
    """
    if sum(given is not None for given in (name, update, check)) > 1:
        raise EncodeError("vendor: give one of NAME, --update FILE and --check FILE")
    if check is not None:
        return _check(context, check, python)
    if update is not None:
        return _update(update, families, force)
    if name is None:
        for known, recipe in RECIPES.items():
            print(f"{known:20} {recipe.subject[0].lower()}{recipe.subject[1:]}; as {recipe.file}")
        return 0
    print(_made(name, families), end="")
    return 0


def _made(name: str, families: tuple[str, ...]) -> str:
    """Return a file, formatted and sealed."""
    text = make(name, families, __version__)
    if find_spec("ruff") is None:
        raise PortError("vendor formats the file with ruff: pip install 'barewire-workbench[vendor]'")
    done = subprocess.run(_FORMAT, input=text.encode(), capture_output=True, check=True)
    return sealed(done.stdout.decode())


def _update(path: Path, families: tuple[str, ...], force: bool) -> int:
    """Make a file again, and print what changed."""
    before = file_content(path).decode(errors="replace")
    head = read_head(before)
    if head.is_edited and not force:
        raise EncodeError(f"{path}: it was edited since it was made, which would be lost: --force makes it again")
    after = _made(head.name, families or head.families)
    if after == before:
        print(f"{path}: {head.name} {head.version}, no change")
        return 0
    replace_file(path, after.encode())
    print(f"{path}: {head.name} {head.version} -> {__version__}")
    try:
        print(changes(before, after))
    except SyntaxError:
        print("  all of it: it was not Python any more")
    return 0


def _check(context: click.Context, path: Path, python: str) -> int:
    """Run the vectors against a file: see `live/one_file/adapter.py`."""
    head = read_head(file_content(path).decode(errors="replace"))
    if head.name not in RECIPES:
        raise EncodeError(f"{path}: it is {head.name}, which this version does not make")
    workbench, stack = folder_of("barewire_workbench"), folder_of("barewire")
    adapter = workbench / "live" / "one_file" / "adapter.py"
    kinds = RECIPES[head.name].kinds
    arguments = shlex.join(map(str, [adapter, path, head.name, workbench, stack, ",".join(kinds)]))
    status: int = context.invoke(check_command, kinds=kinds, adapter=f"{python} -I {arguments}", output=Output("text"))
    return status
