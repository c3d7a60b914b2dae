"""`barewire eds`: export a device of the catalogue as an EDS, and check an EDS or DCF."""

from __future__ import annotations

from pathlib import Path

import click

from barewire.canopen.eds import parse
from barewire.devices import load
from barewire.errors import EncodeError
from barewire_workbench.cli.arguments import CommandGroup
from barewire_workbench.cli.output import Output, check_not_overwritten, file_content, output_option, replace_file
from barewire_workbench.eds.lint import REQUIRED_SECTIONS, lint


@click.group("eds", cls=CommandGroup)
def eds_command() -> None:
    """Export or check electronic data sheets (CiA 306)."""


@eds_command.command("export")
@click.argument("device")
@click.argument("file", required=False, type=click.Path(dir_okay=False, path_type=Path))
def export_command(device: str, file: Path | None) -> None:
    """Write DEVICE as an EDS to FILE, or to stdout."""
    from barewire_workbench.eds.export import export

    if file is not None:
        check_not_overwritten("FILE", file, device)
    document = export(load(device), "" if file is None else file.name)
    if file is None:
        print(document.encode().decode(document.encoding).replace("\r\n", "\n"), end="")
        return
    replace_file(file, document.encode())
    print(f"{file}: {len(document.objects)} objects")


@eds_command.command("lint")
@click.argument("file", type=click.Path(path_type=Path))
@output_option
def lint_command(file: Path, output: Output) -> int:
    """Print every mistake in FILE, one a line.

    Exit status 1 if there is a mistake.
    """
    document = parse(file_content(file))
    if not document.objects and REQUIRED_SECTIONS.isdisjoint(document.sections):
        raise EncodeError(f"{file} is no EDS: it has no object and none of the sections that CiA 306 requires")
    findings = lint(document)
    for finding in findings:
        output.show(f"{file}:{finding}", {"file": str(file), **finding._asdict()})
    if not findings:
        output.show(f"{file}: no findings", {"file": str(file), "ok": True})
    return int(bool(findings))
