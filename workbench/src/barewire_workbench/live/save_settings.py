"""Read the settings of a machine, and what it says about itself.

    with connect("csd-mt", url) as drive:
        saved = save_settings(drive, url)
        saved.settings["Current Ratio"].value, saved.not_read

A setting behind the numbers of a menu is read after these are written, so nothing else may use the machine meanwhile.
Of such a write, and of every write here, an answer that is lost is no failure: the value is read back, and written
again if it is not there, as often as the URL has `retries`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from datetime import datetime
from typing import NamedTuple

from barewire import CanopenClient, ModbusClient
from barewire.codecs import Value
from barewire.errors import DecodeError, NoAnswer, Refused
from barewire.io.endpoint import Endpoint
from barewire.io.machine import MachineClient
from barewire_workbench.live import scan_canopen, scan_modbus
from barewire_workbench.live.read_values import read_values
from barewire_workbench.scan.identity import DeviceIdentity
from barewire_workbench.settings.compare import same_setting
from barewire_workbench.settings.rules import KeptSetting, SettingRules, without_unmapped
from barewire_workbench.settings.saved import SavedSettings, saved_value
from barewire_workbench.value_log.sample import plain_value


class PresentValue(NamedTuple):
    """A setting and its value in the machine; None if it was not read, with the reason."""

    setting: KeptSetting
    value: Value | None
    problem: str = ""


def save_settings(machine: MachineClient, url: str, names: Collection[str] | None = None) -> SavedSettings:
    """Return the settings of a machine, with the time. Those that it refuses or does not answer are in `not_read`. With
    `names`, only these are read.

    >>> from barewire import ModbusServer, connect
    >>> from barewire.devices.sim import simulator
    >>> with ModbusServer("tcp://127.0.0.1:0", {1: simulator("csd-mt").modbus}) as server:
    ...     with connect("csd-mt", server.url) as drive:
    ...         saved = save_settings(drive, server.url)
    >>> str(saved.settings["Current Ratio"]), saved.identity["Product Code"], saved.not_read
    ('70 %', '148', {})

    Raises PortError if the port fails, EncodeError for a description with a wrong table [settings].
    """
    is_can = Endpoint.parse(url).scheme == "can"
    device, rules = machine.device, SettingRules.of(machine.device)
    saved = SavedSettings(device.name, url, device.title, datetime.now().astimezone(), machine_identity(machine, rules))
    wanted = [setting for setting in rules.settings(is_can=is_can) if names is None or setting.name in names]
    present = {item.setting.name: item for item in read_settings(machine, url, wanted)}
    for setting in without_unmapped(wanted, {name: item.value for name, item in present.items()}):
        value = present[setting.name].value
        if value is None:
            saved.not_read[setting.name] = present[setting.name].problem
            continue
        if isinstance(value, str) and plain_value(value) != value:
            saved.not_read[setting.name] = "its text has half a character of UTF-16, which no file can hold"
            continue
        values = saved.communication if setting.communication else saved.settings
        values[setting.name] = saved_value(setting.parameter, value, setting.place(is_can=is_can))
    return saved


def read_settings(machine: MachineClient, url: str, settings: Sequence[KeptSetting]) -> Iterator[PresentValue]:
    """Yield the present values of settings, in their order."""
    plain = [setting for setting in settings if not setting.select]
    read = {value.parameter.name: value for value in read_values(machine, [setting.read_as for setting in plain])}
    for setting in settings:
        if setting.select:
            yield _read_selected(machine, url, setting)
            continue
        result = read[setting.read_as]
        yield PresentValue(setting, None if result.reading is None else result.reading.value, result.problem)


def _read_selected(machine: MachineClient, url: str, setting: KeptSetting) -> PresentValue:
    try:
        select(machine, url, setting)
        return PresentValue(setting, machine.read(setting.read_as).value)
    except (Refused, DecodeError, NoAnswer) as error:
        return PresentValue(setting, None, str(error).partition("; while reading ")[0])


def select(machine: MachineClient, url: str, setting: KeptSetting) -> None:
    """Write the numbers of a menu, so that its value can be read or written. Raises what `confirmed_write` raises."""
    for name, number in setting.select.items():
        confirmed_write(machine, url, name, number)


def confirmed_write(machine: MachineClient, url: str, name: str, value: Value, *, force: bool = False) -> None:
    """Write a value, and repeat that if neither the answer comes nor the value is there.

    Only for values that may be written twice. Raises NoAnswer after the last attempt, Refused, PortError.
    """
    attempts = 1 + Endpoint.parse(url).integer("retries", 0)
    while True:
        attempts -= 1
        try:
            machine.write(name, value, force=force)
            return
        except (NoAnswer, DecodeError):
            if machine.device.find(name).readable and _has(machine, name, value):
                return
            if not attempts:
                raise


def _has(machine: MachineClient, name: str, value: Value) -> bool:
    try:
        reading = machine.read(name)
    except (NoAnswer, DecodeError, Refused):
        return False
    return same_setting(reading.parameter, reading.value, value)


# What a machine is


def machine_identity(machine: MachineClient, rules: SettingRules) -> dict[str, str]:
    """Return what a machine says about itself, by name; empty if it answers nothing. Raises PortError."""
    told = _told(machine)
    identity = dict(told.texts)
    identity |= _server_id_fields(machine, told.server_id)
    identity |= {name: f"{number:08X}h" for name, number in told.numbers.items() if number}
    for value in read_values(machine, [*rules.model, *rules.versions]):
        if value.reading is not None:
            identity[value.parameter.name] = value.parameter.plain_text(value.reading.value)
    return identity


def _told(machine: MachineClient) -> DeviceIdentity:
    """Ask a machine what it is, if its description says that it answers."""
    client = machine.client
    if not machine.device.extra.get("identity"):
        return DeviceIdentity()
    if isinstance(client, ModbusClient):
        return scan_modbus.identify(client.at(unit=client.unit_for(None, machine.device)), may_close=True)
    identity = DeviceIdentity()
    if isinstance(client, CanopenClient):
        scan_canopen.identify(client, client.node(device=machine.device).number, identity)
    return identity


def _server_id_fields(machine: MachineClient, server_id: bytes) -> dict[str, str]:
    """Return the bytes of function 11h by the names that the description gives them."""
    if not server_id:
        return {}
    table = machine.device.extra.get("report_slave_id", {})
    names = [name for name in table.get("fields", []) if name != "reserved"]
    if not names:
        return {"server ID": server_id.hex(" ").upper()}
    return {name: str(table.get(name, {}).get(str(byte), byte)) for name, byte in zip(names, server_id)}


def is_model(name: str, rules: SettingRules) -> bool:
    """Return whether a part of the identity must be equal in a device that gets the settings of another one."""
    return name in (*rules.model, "VendorName", "ProductCode", "device_type", "vendor", "product", "type", "name")
