"""Settings <-> DCF, for a device that has an EDS."""

from __future__ import annotations

from barewire.canopen.eds import Eds, parse, to_dcf
from barewire.canopen.eds.eds_file import set_key
from barewire.canopen.eds.objects import every_item
from barewire.canopen.eds.value_syntax import Expression, Formula
from barewire.devices import Device
from barewire.errors import EncodeError, shown
from barewire_workbench.eds.device import configured_values
from barewire_workbench.eds.storable import formulas
from barewire_workbench.settings.compare import same
from barewire_workbench.settings.rules import SettingRules, without_unmapped
from barewire_workbench.settings.saved import SavedSettings, saved_value, value_of


def settings_of_dcf(device: Device) -> SavedSettings:
    """Return the settings that the DCF of a device has. Raises EncodeError if it has none, which is an EDS."""
    wanted = configured_values(device)
    if not wanted:
        raise EncodeError(f"{device.name}: the file has no ParameterValue: expected a DCF")
    saved = SavedSettings(device.name, device.name, device.title)
    settings = [setting for setting in SettingRules.of(device).settings(is_can=True) if setting.name in wanted]
    for setting in without_unmapped(settings, {setting.name: wanted[setting.name] for setting in settings}):
        values = saved.communication if setting.communication else saved.settings
        values[setting.name] = saved_value(setting.parameter, wanted[setting.name])
    return saved


def dcf_of(saved: SavedSettings, device: Device, eds: Eds) -> tuple[Eds, dict[str, str]]:
    """Return the DCF of a device with these settings: its EDS with a ParameterValue for each, and no other; and by name
    why it has not all of them: a line cannot hold every text, and an empty value is none.

    A COB-ID that is the default for the node remains a formula, so that the DCF suits another node too.
    """
    assert device.canopen is not None
    of_node, node = formulas(eds), device.canopen.node
    values: dict[tuple[int, int] | str, Expression] = {}
    names = {}
    for name, setting in (saved.settings | saved.communication).items():
        parameter = device.find(name)
        assert parameter.object is not None
        place, value = (parameter.object.index, parameter.object.sub), value_of(parameter, setting)
        formula = of_node.get(place)
        values[place] = formula if formula is not None and formula.at(node) == value else value
        names[place] = name
    refused: dict[tuple[int, int], str] = {}
    dcf = to_dcf(eds, node, values, name=saved.title, left_out=refused)
    for described, item in list(every_item(parse(dcf.encode()).objects.values())):
        place = described.index, item.sub
        if place in values and place not in refused and not _same(item.value, values[place]):
            has = "nothing" if item.value is None else shown(item.value)
            refused[place] = f"{shown(values[place])} would be read as {has}"
        if item.value is not None and (place in refused or place not in values):  # an old value, if the EDS is a DCF
            set_key(dcf, described, item, "ParameterValue", None)
    return dcf, {names[place]: why for place, why in refused.items()}


def _same(read: Expression | None, written: Expression) -> bool:
    if read is None or isinstance(read, Formula) or isinstance(written, Formula):
        return read == written
    return same(read, written)
