"""The parts of `save`, `restore` and `diff` for a DCF as the file."""

from __future__ import annotations

from pathlib import Path

from barewire.canopen.eds import parse
from barewire.errors import EncodeError, shown
from barewire_workbench.cli.arguments import load_device
from barewire_workbench.cli.canopen import configure_node, parsed_file
from barewire_workbench.cli.output import Output, file_content
from barewire_workbench.cli.raw_address import RAW
from barewire_workbench.cli.shown_frames import frames_shown
from barewire_workbench.settings.dcf import dcf_of, settings_of_dcf
from barewire_workbench.settings.saved import SavedSettings


def is_dcf(file: Path) -> bool:
    """Return whether a file is written and read as a DCF."""
    return file.suffix.lower() == ".dcf"


def read_dcf(file: Path) -> SavedSettings:
    """Return the settings of a DCF."""
    return settings_of_dcf(load_device(str(file)))


def as_dcf(saved: SavedSettings, endpoint: str) -> bytes:
    """Return the DCF of settings that were read from an endpoint, whose device is an EDS or DCF."""
    return dcf_of(saved, load_device(saved.device, endpoint), parse(file_content(saved.device))).encode()


def configure(file: Path, endpoint: str, output: Output, *, dry_run: bool, store: bool, frames: bool) -> None:
    """Write the values of a DCF to a node, as `barewire canopen configure`."""
    if not endpoint.startswith("can://"):
        raise EncodeError(f"endpoint {shown(endpoint, 200)}: a DCF is for CANopen: expected can://")
    from barewire import CanopenClient

    dcf = parsed_file(file)
    with (
        frames_shown(endpoint, RAW, frames, output) as options,
        CanopenClient(endpoint, watch=options.get("watch")) as client,
    ):
        configure_node(client.node(dcf=dcf), output, dry_run=dry_run, store=store)
