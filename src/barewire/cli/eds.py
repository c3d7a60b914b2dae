"""`barewire eds`: what is odd about an EDS or DCF, and a device of the catalogue as one."""

from __future__ import annotations

from pathlib import Path

import click

from barewire.canopen.eds import lint, parse
from barewire.cli.arguments import json_option, print_json
from barewire.devices.description.load import load
from barewire.errors import PortError


@click.group()
def eds() -> None:
    """Electronic data sheets (CiA 306): export one, check one."""


@eds.command("export")
@click.argument("device")
@click.argument("file", required=False, type=click.Path(dir_okay=False, path_type=Path))
def export_command(device: str, file: Path | None) -> None:
    """Write DEVICE as an EDS to FILE, or to the terminal."""
    from barewire.devices.description.export_eds import export

    document = export(load(device), "" if file is None else file.name)
    if file is None:
        print(document.encode().decode(document.encoding).replace("\r\n", "\n"), end="")
        return
    try:
        file.write_bytes(document.encode())
    except OSError as error:
        raise PortError(f"{file}: {error.strerror or error}") from None
    print(f"{file}: {len(document.objects)} objects")


@eds.command("lint")
@click.argument("file", type=click.Path(path_type=Path))
@json_option
def lint_command(file: Path, as_json: bool) -> None:
    """List everything odd in FILE, one a line; exit status 1 if there is anything."""
    try:
        found = lint(parse(file.read_bytes()))
    except OSError as error:
        raise PortError(f"{file}: {error.strerror or error}") from None
    for one in found:
        if as_json:
            print_json({"file": str(file), **one._asdict()})
        else:
            print(f"{file}:{one}")
    if not found:
        if as_json:
            print_json({"file": str(file), "fine": True})
        else:
            print(f"{file}: nothing to say against it")
        return
    raise SystemExit(1)
