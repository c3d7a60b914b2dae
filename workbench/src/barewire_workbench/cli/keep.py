"""`barewire save`, `restore` and `diff`: the settings of a device in a file, back in a device, and compared."""

from __future__ import annotations

import csv
import shlex
import sys
from pathlib import Path

import click

from barewire.devices import Device
from barewire.errors import BarewireError, EncodeError
from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.arguments import device_argument, endpoint_argument, endpoint_url, no_wait_option
from barewire_workbench.cli.output import Output, file_content, note, output_option, replace_file, text_with_notes
from barewire_workbench.cli.raw_address import device_with
from barewire_workbench.cli.read_write import connected
from barewire_workbench.cli.shown_frames import frames_option
from barewire_workbench.live.restore_settings import Restore
from barewire_workbench.live.save_settings import contradiction, save_settings
from barewire_workbench.settings.compare import COLUMNS, SettingDifference, differences
from barewire_workbench.settings.rules import SettingRules
from barewire_workbench.settings.saved import SavedSettings

_check_option = click.option("--no-check", is_flag=True, help="Go on with another device than the one that is named.")


def described(name: str, endpoint: str) -> Device:
    """Return the device of this name. Raises EncodeError if it has no settings on this kind of bus."""
    device = device_with(name)
    is_can = Endpoint.parse(endpoint).scheme == "can"
    if not SettingRules.of(device).settings(is_can=is_can):
        bus = "CANopen" if is_can else "Modbus"
        raise EncodeError(f"{device.name} has no settings on {bus}: its description marks none (kind), or is `raw`")
    return device


@click.command("save")
@endpoint_argument
@device_argument
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--partial", is_flag=True, help="Replace FILE also if some values could not be read.")
@_check_option
@no_wait_option
@frames_option
@click.pass_context
def save_command(
    context: click.Context, /, endpoint: str, device: str, file: Path, partial: bool, no_check: bool, no_wait: bool,
    frames: bool,
) -> None:  # fmt: skip
    """Save the settings of a device in a file.

    \b
    barewire save "rtu:///dev/ttyUSB0?unit=1&retries=3" az3 press-3.toml
    barewire save tcp://192.168.1.10 csd-mt -

    FILE has the values that are set, with unit and address, not measurements and not commands; - is stdout. It is
    replaced at once when everything was read: whatever happens, it is the old file or the new one. What the device
    refuses or does not answer is in the file with the reason, and the exit status is 1; such a file replaces an older
    one only with --partial.
    """
    description = described(device, endpoint)
    with connected(description, endpoint, no_wait, frames=frames, output=Output("text")) as machine:
        if not no_check and (text := contradiction(machine)):
            raise BarewireError(f"{text}, not {description.name}; --no-check: save it all the same")
        saved = save_settings(machine, endpoint)
    saved.device = device  # as it was given: a path is found again
    for name, why in saved.not_read.items():
        note(f"{name}: not read: {why}")
    count = len(saved.settings) + len(saved.communication)
    if not count:
        raise BarewireError(f"no setting was read, {file} is not written")
    if saved.not_read and file.is_file() and not partial:
        raise BarewireError(f"{len(saved.not_read)} settings were not read, {file} is kept as it is; see --partial")
    replace_file(file, saved.text().encode())
    if str(file) != "-":
        missing = f", {len(saved.not_read)} not read" if saved.not_read else ""
        print(f"{file}: {count} settings of {description.title}{missing}")
    if saved.not_read:
        context.exit(1)


@click.command("restore")
@click.argument("file", type=click.Path(path_type=Path))
@endpoint_argument
@click.option("--device", metavar="DEVICE", help="The description, instead of the one that FILE names.")
@click.option("--dry-run", is_flag=True, help="Write nothing: print what would be written.")
@click.option("--verify/--no-verify", default=True, help="Read everything again at the end; this is the default.")
@click.option("--store/--no-store", default=True, help="Let the device store it at the end; this is the default.")
@click.option("--communication", is_flag=True, help="Write also how the device is reached: addresses, baud rate.")
@click.option("--no-check", is_flag=True, help="Go on with another device, names, units or ranges than expected.")
@output_option
@no_wait_option
@frames_option
@click.pass_context
def restore_command(
    context: click.Context, /, file: Path, endpoint: str, device: str | None, dry_run: bool, verify: bool, store: bool,
    communication: bool, no_check: bool, output: Output, no_wait: bool, frames: bool,
) -> None:  # fmt: skip
    """Write the settings of a file to a device.

    \b
    barewire restore press-3.toml "rtu:///dev/ttyUSB0?unit=1&retries=3" --dry-run
    barewire restore press-3.toml "rtu:///dev/ttyUSB0?unit=1&retries=3"

    Only what differs is written, in the order of the manual, and read back; at the end the device stores it. A file of
    another device, a unit or range that does not fit, and a motor that is on are refused before the first write. After
    a failure the exit status is 1, and the last line is the command that goes on: what is equal is not written again.
    """
    saved = read_file(file)
    description = described(device or saved.device, endpoint)
    with connected(description, endpoint, no_wait, frames=frames, output=output) as machine:
        restore = Restore(machine, saved, endpoint, communication, not no_check, verify, store)
        try:
            for change in restore.run(dry_run=dry_run):
                output.show(f"{change}, {'would be written' if dry_run else 'written'}", change.as_dict())
        except EncodeError as error:
            error.add_context("nothing was written; --no-check goes on")
            raise
    for name, why in restore.left_out.items():
        note(f"{name}: left out: {why}")
    if dry_run:
        return
    for change in restore.failed:
        output.show(change, change.as_dict())
    if restore.stopped is not None:
        note(text_with_notes(restore.stopped))
    stored = "stored in the device" if restore.stored else "not stored: lost when the device is switched off"
    failed = f", {len(restore.failed)} not written" if restore.failed else ""
    output.text(f"{len(restore.written)} settings written, {restore.equal} were equal{failed}; {stored}")
    if saved.communication and not communication:
        output.text(f"{len(saved.communication)} that change how the device is reached are left: --communication")
    if not restore.is_complete:
        note(f"to go on: {shlex.join(['barewire', *sys.argv[1:]])}")
        context.exit(1)


def read_file(file: Path) -> SavedSettings:
    """Return the settings of a file of `barewire save`."""
    return SavedSettings.parse(file_content(file), str(file))


@click.command("diff")
@click.argument("a")
@click.argument("b")
@click.option("--device", metavar="DEVICE", help="The description of an ENDPOINT, where no file names it.")
@click.option("--no-communication", is_flag=True, help="Leave out what changes how a device is reached.")
@click.option("--csv", "as_csv", is_flag=True, help="Print a table for a spreadsheet.")
@output_option
@no_wait_option
def diff_command(
    a: str, b: str, device: str | None, no_communication: bool, as_csv: bool, output: Output, no_wait: bool
) -> int:
    """Compare the settings of two devices or files.

    \b
    barewire diff press-3.toml press-4.toml
    barewire diff press-3.toml "rtu:///dev/ttyUSB0?unit=1"
    barewire diff "rtu:///dev/ttyUSB0?unit=1" "rtu:///dev/ttyUSB0?unit=2" --device az3

    A and B are files of `barewire save`, or endpoints. Exit status as that of diff(1): 0 if they are equal, 1 if
    something differs, 2 if something could not be read.
    """
    if as_csv and output.as_json:
        raise click.UsageError("--csv and --json: give one of them")
    try:
        files = {name: read_file(Path(name)) for name in (a, b) if "://" not in name}
        device = device or next((saved.device for saved in files.values()), None)
        sides = [files.get(name) or _present(name, device, no_wait) for name in (a, b)]
        devices = [side.title or side.device for side in sides]
        if devices[0] != devices[1]:
            raise BarewireError(f"{a} is of {devices[0]}, {b} of {devices[1]}")
    except BarewireError as error:
        note(text_with_notes(error))
        return 2
    found = list(differences(*sides, communication=not no_communication))
    _print(found, (a, b), as_csv, output)
    if any(difference.problem for difference in found):
        return 2
    return int(bool(found))


def _present(endpoint: str, device: str | None, no_wait: bool) -> SavedSettings:
    endpoint = endpoint_url(endpoint)
    if device is None:
        raise EncodeError(f"{endpoint}: no file names its device: expected --device")
    description = described(device, endpoint)
    with connected(description, endpoint, no_wait, frames=False, output=Output("text")) as machine:
        if text := contradiction(machine):
            raise BarewireError(f"{endpoint}: {text}, not {description.name}")
        return save_settings(machine, endpoint)


def _print(found: list[SettingDifference], sides: tuple[str, str], as_csv: bool, output: Output) -> None:
    if as_csv:
        table = csv.DictWriter(sys.stdout, COLUMNS, restval="", lineterminator="\n")
        table.writeheader()
        table.writerows(difference.as_dict() for difference in found)
        return
    if output.as_json:
        for difference in found:
            output.show("", difference.as_dict())
        return
    rows = [("", *sides), *map(_row, found)]
    widths = [max(map(len, column)) for column in zip(*rows)]
    for row in rows if found else ():
        print("  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths)).rstrip())


def _row(difference: SettingDifference) -> tuple[str, str, str]:
    missing = f"not read: {difference.problem}" if difference.problem else "-"
    first, second = (missing if side is None else str(side) for side in (difference.first, difference.second))
    return difference.name, first, second
