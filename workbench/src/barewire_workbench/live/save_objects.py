"""Read the settings of a CANopen device that has an EDS or DCF.

    with CanopenClient("can://socketcan/can0?node=5") as bus:
        saved = save_objects(bus, eds.parse(data), "drive.eds", url)
        dcf_of(saved, eds, 5).encode()             as a DCF
        saved.text()                               as a file of `barewire save`

They are written by `bus.node(dcf=...).configure()`.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from barewire import CanopenClient
from barewire.canopen.configuration.settings import object_text
from barewire.canopen.eds import Eds
from barewire.canopen.object_dictionary import Entry
from barewire.codecs import Value
from barewire.errors import DecodeError, NoAnswer, Refused
from barewire_workbench.live.restore_settings import Mismatch
from barewire_workbench.live.scan_canopen import identify
from barewire_workbench.scan.identity import DeviceIdentity
from barewire_workbench.settings.objects import in_commissioning, is_beyond_mapping, saved_value, storable
from barewire_workbench.settings.saved import SavedSettings

_SILENT = 3
"""Objects in a row without an answer after which the others are not asked for."""
_IDENTITY = {"vendor": 1, "product": 2}
"""The sub-indices of 1018h that a file has for every device of a type."""


def save_objects(
    client: CanopenClient, eds: Eds, name: str, url: str, *, entries: Sequence[Entry] | None = None, check: bool = True
) -> SavedSettings:
    """Return the settings of a node with this EDS or DCF, whose file has this `name`; with `entries`, these objects.

    Raises Mismatch, with `check`, if 1018h of the node is not that of the file; PortError.
    """
    node = client.node(_number(client, eds), eds=eds)
    identity = DeviceIdentity()
    identify(client, node.number, identity)
    if check:
        _compare_identity(identity, eds, node.number)
    texts = identity.texts | {key: f"{number:08X}h" for key, number in identity.numbers.items() if number}
    title = " ".join(filter(None, (eds.get("DeviceInfo", key) for key in ("VendorName", "ProductName"))))
    saved = SavedSettings(name, url, title, datetime.now().astimezone(), texts)
    at_node = in_commissioning(eds)
    counts: dict[int, Value] = {}
    silent, problem = 0, ""
    for entry in storable(eds, node.number) if entries is None else entries:
        if is_beyond_mapping(entry, counts):
            continue
        try:
            if silent == _SILENT:
                raise NoAnswer(f"not asked for: {problem}")
            value = node.read((entry.index, entry.sub))
        except (Refused, DecodeError, NoAnswer) as error:
            silent = silent + 1 if isinstance(error, NoAnswer) and silent < _SILENT else silent
            problem = problem or str(error)
            saved.not_read[object_text(entry)] = str(error)
            continue
        silent, problem = 0, ""
        if entry.sub == 0:
            counts[entry.index] = value
        values = saved.communication if (entry.index, entry.sub) in at_node else saved.settings
        values[object_text(entry)] = saved_value(value)
    return saved


def _number(client: CanopenClient, eds: Eds) -> int | None:
    return eds.node_id if client.node_id is None else client.node_id


def _compare_identity(identity: DeviceIdentity, eds: Eds, node: int) -> None:
    objects = eds.dictionary(node)
    for key, sub in _IDENTITY.items():
        wanted = objects.get(0x1018, sub) if (0x1018, sub) in objects else 0
        told = identity.numbers.get(key, 0)
        if wanted and told and told != wanted:
            raise Mismatch(f"node {node} is another device: its {key} is {told:08X}h, the file has {int(wanted):08X}h")
