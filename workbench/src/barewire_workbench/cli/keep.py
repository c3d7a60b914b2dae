"""`barewire save`, `restore` and `diff`: the settings of a device in a file, back in a device, and compared."""

from __future__ import annotations

import csv
import shlex
import sys
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import click

from barewire.devices import Device, Parameter
from barewire.errors import BarewireError, EncodeError
from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.arguments import (
    check_machine,
    device_argument,
    endpoint_argument,
    endpoint_url,
    is_eds,
    no_check_option,
    no_wait_option,
)
from barewire_workbench.cli.dry_run import frames_of
from barewire_workbench.cli.keep_dcf import as_dcf, configure, is_dcf, read_dcf
from barewire_workbench.cli.output import Output, file_content, note, output_option, replace_file
from barewire_workbench.cli.raw_address import device_with
from barewire_workbench.cli.read_write import connected
from barewire_workbench.cli.shown_frames import ShownFrames, frames_option, is_verbose
from barewire_workbench.live.check_device import WrongDevice
from barewire_workbench.live.restore_settings import Change, Restore
from barewire_workbench.live.results import text_with_notes
from barewire_workbench.live.save_settings import save_settings
from barewire_workbench.settings.compare import COLUMNS, SettingDifference, differences
from barewire_workbench.settings.rules import SettingRules
from barewire_workbench.settings.saved import SavedSettings

_STDOUT = Path("-")


@click.command("save")
@endpoint_argument
@device_argument
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--partial", is_flag=True, help="Replace FILE also if some values could not be read.")
@no_check_option
@no_wait_option
@frames_option
def save_command(
    endpoint: str, device: str, file: Path, partial: bool, no_check: bool, no_wait: bool, frames: bool
) -> int:
    """Save the settings of a device in a file.

    \b
    barewire save "rtu:///dev/ttyUSB0?unit=1&retries=3" az3 press-3.toml
    barewire save tcp://192.168.1.10 csd-mt -
    barewire save "can://socketcan/can0?node=5" drive.eds press-3.dcf

    FILE has the values that are set, with unit and address, and no measurements and commands; `-` is stdout. With an
    EDS or DCF as DEVICE, FILE may be a DCF. FILE is the old one or the new one at any moment, whatever happens.

    What the device refuses or does not answer is in FILE with the reason, and the exit status is 1. Such a file takes
    the place of an older one only with --partial.
    """
    if is_dcf(file) and not is_eds(device):
        raise EncodeError(f"{file}: a DCF is made of an EDS: expected one as DEVICE, such as of barewire eds export")
    saved = _present(endpoint, device, no_wait, check=not no_check, frames=frames, names=None)
    for name, why in saved.not_read.items():
        note(f"{name}: not read: {why}")
    left_out: dict[str, str] = {}
    if is_dcf(file):
        data, left_out = as_dcf(saved, endpoint)
    else:
        data = saved.text().encode()
        SavedSettings.parse(data, str(file))  # a file that could not be read again takes no other one's place
    for name, why in left_out.items():
        note(f"{name}: left out: a DCF cannot have it: {why}")
    count = len(saved.settings) + len(saved.communication) - len(left_out)
    if not count:
        raise BarewireError(f"no setting was read: {file} is not written")
    if saved.not_read and file.is_file() and not partial:
        raise BarewireError(f"{len(saved.not_read)} settings were not read: {file} is kept as it is; see --partial")
    replace_file(file, data)
    if file != _STDOUT:
        missing = f", {len(saved.not_read)} not read" if saved.not_read else ""
        missing += f", {len(left_out)} left out" if left_out else ""
        print(f"{file}: {count} settings of {saved.title or device}{missing}")
    return 1 if saved.not_read or left_out else 0


@click.command("restore")
@click.argument("file", type=click.Path(path_type=Path))
@endpoint_argument
@click.option("--device", metavar="DEVICE", help="The description, instead of the one that FILE names.")
@click.option("--dry-run", is_flag=True, help="Write nothing: print what would be written.")
@click.option("--verify/--no-verify", default=True, help="Read everything again at the end, as is the default.")
@click.option("--store/--no-store", default=True, help="Let the device store it at the end, as is the default.")
@click.option("--communication", is_flag=True, help="Write also how the device is reached: addresses, baud rate.")
@click.option("--no-check", is_flag=True, help="Go on with another device, names, units or ranges than expected.")
@output_option
@no_wait_option
@frames_option
def restore_command(
    file: Path, endpoint: str, device: str | None, dry_run: bool, verify: bool, store: bool, communication: bool,
    no_check: bool, output: Output, no_wait: bool, frames: bool,
) -> int:  # fmt: skip
    """Write the settings of a file to a device.

    \b
    barewire restore press-3.toml "rtu:///dev/ttyUSB0?unit=1&retries=3" --dry-run
    barewire restore press-3.toml "rtu:///dev/ttyUSB0?unit=1&retries=3"
    barewire restore press-3.dcf "can://socketcan/can0?node=5"

    Only what differs is written, in the order of the manual, and read back; at the end the device stores it. A file of
    another device, a name, unit or range that does not fit, and a motor that is on are refused before the first write.

    After a failure the exit status is 1, and the last line is the command that goes on: what is equal is not written
    again. FILE may be a DCF: see `barewire canopen configure`.
    """
    if is_dcf(file):
        _check_options_of_dcf()
        configure(file, endpoint, output, dry_run=dry_run, store=store, frames=frames)
        return 0
    given = None if device is None else _described(device, endpoint)  # a wrong name is reported first
    saved = _saved(file)
    try:
        description = given or _described(saved.device, endpoint)
    except BarewireError as error:
        error.add_context(f"{file} names it; --device names another description")
        raise
    flags = {"--no-verify": not verify, "--no-store": not store, "--communication": communication}
    flags |= {"--no-check": no_check, f"--device={device}": device is not None}
    again = shlex.join(["barewire", "restore", str(file), endpoint, *(flag for flag, given in flags.items() if given)])
    with connected(description, endpoint, no_wait, frames=frames, output=output) as machine:
        restore = Restore(machine, saved, endpoint, communication, not no_check, verify, store, note)
        try:
            for change in restore.run(dry_run=dry_run):
                output.show(f"{change}, {'would be written' if dry_run else 'written'}", change.as_dict())
                if dry_run and frames:
                    _show_frames(restore, change, output)
        except (EncodeError, WrongDevice) as error:
            error.add_context("nothing was written" + ("" if no_check else "; --no-check goes on"))
            raise
        except KeyboardInterrupt as error:
            if restore.written:
                error.add_note(f"{len(restore.written)} written; {_stored(restore)}; to go on: {again}")
            raise
    for name, why in restore.left_out.items():
        note(f"{name}: left out: {why}")
    if dry_run:
        return 0
    for change in restore.failed:
        output.show(change, change.as_dict())
    if restore.stopped is not None:
        note(text_with_notes(restore.stopped))
    unread = sum(change.is_unread for change in restore.failed)
    counts = ((len(restore.failed) - unread, "not written"), (unread, "not read back"))
    failed = "".join(f", {number} {what}" for number, what in counts if number)
    count = f"{len(restore.written)} setting{'s' if len(restore.written) != 1 else ''}"
    output.text(f"{count} written, {restore.equal} equal already{failed}; {_stored(restore)}")
    if saved.communication and not communication:
        output.text(f"{len(saved.communication)} that say how the device is reached are left out: --communication")
    if restore.is_complete:
        return 0
    note(f"to go on: {again}")
    return 1


def _check_options_of_dcf() -> None:
    """Raise UsageError for an option of `restore` that has no effect on a DCF."""
    context = click.get_current_context()
    for name in ("device", "no_check", "verify", "communication"):
        if context.get_parameter_source(name) is not click.core.ParameterSource.DEFAULT:
            flag = "no-verify" if name == "verify" and not context.params[name] else name.replace("_", "-")
            raise click.UsageError(f"--{flag} has no meaning for a DCF")


def _show_frames(restore: Restore, change: Change, output: Output) -> None:
    """Print the frames that would write a setting."""
    shown_frames = ShownFrames(restore.url, restore.machine.device, every_field=is_verbose(), output=output)
    for name, value in restore.writes(change).items():
        for frame in frames_of(restore.url, restore.machine.device, {name: value}, force=not restore.check):
            shown_frames.show("would send", frame)


def _stored(restore: Restore) -> str:
    if not SettingRules.of(restore.machine.device).store:
        return "not stored: the description names no command for that"
    if not restore.stored:
        return "not stored: what was written is lost when the device is switched off"
    volatile = restore.not_storable
    return "stored" + (
        f", but for {volatile} that the device does not keep when it is switched off" if volatile else ""
    )


def _saved(file: Path) -> SavedSettings:
    return SavedSettings.parse(file_content(file), str(file))


def _described(name: str, endpoint: str) -> Device:
    """Return the device of this name. Raises EncodeError if it has no settings on this kind of bus."""
    device = device_with(name, endpoint=endpoint)
    is_can = Endpoint.parse(endpoint).scheme == "can"
    if not SettingRules.of(device).settings(is_can=is_can):
        raise EncodeError(f"{device.name} has no settings on {'CANopen' if is_can else 'Modbus'} in its description")
    return device


def _present(
    endpoint: str,
    device: str,
    no_wait: bool,
    *,
    check: bool = True,
    frames: bool = False,
    names: Collection[str] | None,
) -> SavedSettings:
    """Return the settings of a device as they are. Raises BarewireError if it says that it is another one."""
    description = _described(device, endpoint)
    with connected(description, endpoint, no_wait, frames=frames, output=Output("text")) as machine:
        check_machine(machine, not check)
        saved = save_settings(machine, endpoint, names)
    saved.device = device  # as it was given: a path is found again
    return saved


# Comparing


@click.command("diff")
@click.argument("a")
@click.argument("b")
@click.option("--device", metavar="DEVICE", help="The description of an ENDPOINT, where no file names it.")
@click.option("--no-communication", is_flag=True, help="Leave out what says how a device is reached.")
@no_check_option
@click.option("--csv", "as_csv", is_flag=True, help="Print a table for a spreadsheet.")
@output_option
@no_wait_option
def diff_command(
    a: str, b: str, device: str | None, no_communication: bool, no_check: bool, as_csv: bool, output: Output,
    no_wait: bool,
) -> int:  # fmt: skip
    """Compare the settings of two devices or files.

    \b
    barewire diff press-3.toml press-4.toml
    barewire diff press-3.toml "rtu:///dev/ttyUSB0?unit=1"
    barewire diff "rtu:///dev/ttyUSB0?unit=1" "rtu:///dev/ttyUSB0?unit=2" --device az3

    A and B are files of `barewire save`, DCFs, or endpoints. Exit status as that of diff(1): 0 if they are equal, 1 if
    something differs, 2 if something could not be read.
    """
    if as_csv and output.as_json:
        raise click.UsageError("--csv and --json: give one of them")
    files = {name: Path(name) for name in (a, b) if "://" not in name}
    try:
        endpoint = next((endpoint_url(name) for name in (a, b) if name not in files), "")
        sides = {name: read_dcf(file, endpoint) if is_dcf(file) else _saved(file) for name, file in files.items()}
        named = device or next((side.device for side in sides.values()), None)
        # A DCF may have values for some of the settings only.
        dcf = next((sides[name] for name, file in files.items() if is_dcf(file)), None)
        names = None if dcf is None else {*dcf.settings, *dcf.communication}
        for name in (a, b):
            if name not in files:
                if named is None:
                    raise EncodeError(f"{name}: no file says which device it is: expected --device")
                url = endpoint_url(name)
                sides[name] = _present(url, named, no_wait, check=not no_check, names=names)
            elif names is not None and not is_dcf(files[name]):
                sides[name] = _only(sides[name], names)
        first, second = sides[a], sides[b]
        if first.title != second.title and not no_check:
            raise BarewireError(f"{a} is of {first.title}, {b} of {second.title}; --no-check compares them")
    except BarewireError as error:
        note(text_with_notes(error))
        return 2
    known = _parameters(first.device)
    found = list(differences(first, second, known, communication=not no_communication))
    _print(found, (a, b), as_csv, output)
    if any(difference.problem for difference in found):
        return 2
    return int(bool(found))


def _only(saved: SavedSettings, names: Collection[str]) -> SavedSettings:
    """Return the settings of these names."""
    settings, communication = (
        {name: value for name, value in part.items() if name in names} for part in (saved.settings, saved.communication)
    )
    not_read = {name: why for name, why in saved.not_read.items() if name in names}
    return replace(saved, settings=settings, communication=communication, not_read=not_read)


def _parameters(name: str) -> dict[str, Parameter]:
    """Return the settings of a device; none if its description is not at hand, since two files are compared without."""
    try:
        rules = SettingRules.of(device_with(name))
    except BarewireError:
        return {}
    return {setting.name: setting.parameter for is_can in (True, False) for setting in rules.settings(is_can=is_can)}


def _print(found: list[SettingDifference], sides: tuple[str, str], as_csv: bool, output: Output) -> None:
    if as_csv:
        table = csv.DictWriter(sys.stdout, COLUMNS, restval="", lineterminator="\n")
        table.writeheader()
        table.writerows(difference.as_dict() for difference in found)
        return
    rows = [("", *sides), *map(_row, found)]
    widths = [max(map(len, column)) for column in zip(*rows)]
    for row in rows if found else ():
        output.text("  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths)).rstrip())
    for difference in found if output.as_json else ():
        output.show(difference, difference.as_dict())


def _row(difference: SettingDifference) -> tuple[str, str, str]:
    missing = f"not read: {difference.problem}" if difference.problem else "-"
    first, second = (missing if side is None else str(side) for side in (difference.first, difference.second))
    return difference.name, first, second
