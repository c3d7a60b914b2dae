"""The parts of `save`, `restore` and `diff` for a CANopen device that has an EDS or DCF."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from barewire.canopen.configuration.settings import device_configuration
from barewire.errors import EncodeError, shown
from barewire_workbench.cli.canopen import configure_node, parsed_file
from barewire_workbench.cli.output import Output
from barewire_workbench.cli.raw_address import RAW
from barewire_workbench.cli.shown_frames import frames_shown
from barewire_workbench.live.save_objects import save_objects
from barewire_workbench.settings.objects import dcf_of, saved_dcf
from barewire_workbench.settings.saved import SavedSettings

if TYPE_CHECKING:
    from barewire import CanopenClient


def is_dcf(file: Path) -> bool:
    """Return whether a file is written and read as a DCF."""
    return file.suffix.lower() == ".dcf"


def dcf_settings(file: Path) -> SavedSettings:
    """Return the settings of a DCF."""
    return saved_dcf(parsed_file(file), str(file))


def present_objects(
    endpoint: str, file: str, *, only_of_dcf: bool = False, check: bool = True, frames: bool = False
) -> SavedSettings:
    """Return the settings of a node that has this EDS or DCF; with `only_of_dcf` those for which that has a value."""
    eds = parsed_file(Path(file))
    with _client(endpoint, frames=frames) as client:
        entries = [setting.entry for setting in device_configuration(eds).settings] if only_of_dcf else None
        return save_objects(client, eds, file, endpoint, entries=entries, check=check)


def as_dcf(saved: SavedSettings, endpoint: str) -> bytes:
    """Return the DCF of settings that were read from this endpoint."""
    eds = parsed_file(Path(saved.device))
    with _client(endpoint) as client:
        return dcf_of(saved, eds, client.node_id or eds.node_id or 1).encode()


def restore_objects(
    saved: SavedSettings | None, file: str, endpoint: str, output: Output, *, communication: bool, dry_run: bool,
    store: bool, frames: bool,
) -> None:  # fmt: skip
    """Write settings to the node with the EDS `file`; without settings, write those of the DCF `file`."""
    eds = parsed_file(Path(file))
    with _client(endpoint, frames=frames, output=output) as client:
        if saved is not None:
            eds = dcf_of(saved, eds, client.node_id or eds.node_id or 1, communication=communication)
        configure_node(client.node(dcf=eds), output, dry_run=dry_run, store=store)


@contextmanager
def _client(endpoint: str, *, frames: bool = False, output: Output | None = None) -> Iterator[CanopenClient]:
    if not endpoint.startswith("can://"):
        raise EncodeError(f"endpoint {shown(endpoint, 200)}: an EDS or DCF is for CANopen: expected can://")
    from barewire import CanopenClient

    with (
        frames_shown(endpoint, RAW, frames, output or Output("text")) as options,
        CanopenClient(endpoint, watch=options.get("watch")) as client,
    ):
        yield client
