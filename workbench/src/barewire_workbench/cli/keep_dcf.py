"""The parts of `save`, `restore` and `diff` for a DCF as the file."""

from __future__ import annotations

from pathlib import Path

from barewire.canopen.configuration.settings import check_readable
from barewire.canopen.eds import Eds, parse
from barewire.devices import Device
from barewire.errors import EncodeError, shown
from barewire_workbench.cli.arguments import load_device
from barewire_workbench.cli.canopen import configure_node, parsed_file
from barewire_workbench.cli.output import Output, file_content, note
from barewire_workbench.cli.raw_address import RAW
from barewire_workbench.cli.shown_frames import frames_shown
from barewire_workbench.eds.device import configured_values
from barewire_workbench.live.restore_settings import check_at_rest
from barewire_workbench.settings.dcf import dcf_of, settings_of_dcf
from barewire_workbench.settings.rules import SettingRules
from barewire_workbench.settings.saved import SavedSettings

_STATUS_WORD = 0x6041
"""Of a drive of CiA 402."""


def is_dcf(file: Path) -> bool:
    """Return whether a file is written and read as a DCF."""
    return file.suffix.lower() == ".dcf"


def read_dcf(file: Path, endpoint: str = "") -> SavedSettings:
    """Return the settings of a DCF, for the node of an endpoint if there is one, otherwise for that of the file."""
    _parsed(file)
    return settings_of_dcf(load_device(str(file), endpoint))


def as_dcf(saved: SavedSettings, endpoint: str) -> tuple[bytes, dict[str, str]]:
    """Return the DCF of settings that were read from an endpoint, whose device is an EDS or DCF, and why it has not all
    of them, by name."""
    dcf, left_out = dcf_of(saved, load_device(saved.device, endpoint), parse(file_content(saved.device)))
    return dcf.encode(), left_out


def configure(file: Path, endpoint: str, output: Output, *, dry_run: bool, store: bool, frames: bool) -> None:
    """Write the values of a DCF to a node, as `barewire canopen configure`."""
    if not endpoint.startswith("can://"):
        raise EncodeError(f"endpoint {shown(endpoint, 200)}: a DCF is for CANopen: expected can://")
    from barewire import CanopenClient

    dcf = _parsed(file)
    left_out = _without_commands(dcf, load_device(str(file)))
    with (
        frames_shown(endpoint, RAW, frames, output) as options,
        CanopenClient(endpoint, watch=options.get("watch")) as client,
    ):
        node = client.node(dcf=dcf)
        if not dry_run and _STATUS_WORD in dcf.objects:
            check_at_rest(int.from_bytes(node.sdo.upload(_STATUS_WORD), "little"))
        configure_node(node, output, dry_run=dry_run, store=store)
    output.text(*(f"left out: {name}: it is no setting" for name in left_out))


def _parsed(file: Path) -> Eds:
    """Return a DCF. Raises EncodeError for a value that cannot be read; notes what a file that was cut has lost."""
    dcf = parsed_file(file)
    try:
        check_readable(dcf)
    except EncodeError as error:
        error.add_context(str(file))
        raise
    missing = [finding for finding in dcf.diagnostics if finding.rule == "no-object"]
    if missing:
        more = f", and {len(missing) - 1} more" if len(missing) > 1 else ""
        note(f"{file}: line {missing[0]}{more}: is the file whole?")
    return dcf


def _without_commands(dcf: Eds, device: Device) -> list[str]:
    """Remove the values of a DCF that are no settings, such as control words and targets, and return their names."""
    settings = {setting.name for setting in SettingRules.of(device).settings(is_can=True)}
    left_out = [name for name in configured_values(device) if name not in settings]
    for name in left_out:
        place = device.find(name).object
        assert place is not None
        dcf.set(place.index, place.sub, "ParameterValue", None)
    return left_out
