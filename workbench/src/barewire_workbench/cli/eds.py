"""`barewire eds`: export a device of the catalogue as an EDS, and check an EDS or DCF."""

from __future__ import annotations

from pathlib import Path

import click

from barewire.canopen.eds import lint, parse
from barewire.devices import load
from barewire.errors import PortError
from barewire_workbench.cli.arguments import CommandGroup, check_not_overwritten, file_content, json_option, print_json


@click.group("eds", cls=CommandGroup)
def eds_command() -> None:
    """Export or check electronic data sheets (CiA 306)."""


@eds_command.command("export")
@click.argument("device")
@click.argument("file", required=False, type=click.Path(dir_okay=False, path_type=Path))
def export_command(device: str, file: Path | None) -> None:
    """Write DEVICE as an EDS to FILE, or to stdout."""
    from barewire.devices.description.export_eds import export

    if file is not None:
        check_not_overwritten("FILE", file, device)
    document = export(load(device), "" if file is None else file.name)
    if file is None:
        print(document.encode().decode(document.encoding).replace("\r\n", "\n"), end="")
        return
    try:
        file.write_bytes(document.encode())
    except OSError as error:
        raise PortError(f"{file}: {error.strerror or error}") from None
    print(f"{file}: {len(document.objects)} objects")


@eds_command.command("lint")
@click.argument("file", type=click.Path(path_type=Path))
@json_option
def lint_command(file: Path, as_json: bool) -> int:
    """Print every mistake in FILE, one a line.

    Exit status 1 if there is a mistake.
    """
    found = lint(parse(file_content(file)))
    for finding in found:
        if as_json:
            print_json({"file": str(file), **finding._asdict()})
        else:
            print(f"{file}:{finding}")
    if not found:
        if as_json:
            print_json({"file": str(file), "ok": True})
        else:
            print(f"{file}: no findings")
    return int(bool(found))
