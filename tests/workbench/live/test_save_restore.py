"""Settings out of a simulated machine and into another: the order of the manual, lost answers, what is refused, what is
left when it ends early."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from typing import Any

import pytest

from barewire import CanopenClient, CanopenServer, ModbusServer, connect, load
from barewire.codecs import Value
from barewire.devices import Device, ModbusAt, ModbusSettings, Parameter
from barewire.devices.sim import adxl, simulator
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.machine import MachineClient
from barewire_workbench.live.check_device import WrongDevice
from barewire_workbench.live.restore_settings import Change, NotAtRest, Restore
from barewire_workbench.live.save_settings import save_settings
from barewire_workbench.settings.compare import differences
from barewire_workbench.settings.rules import SettingRules
from barewire_workbench.settings.saved import BadFile, SavedSettings, SavedValue
from tests.helpers import part_or_whole

CHANGED: dict[str, dict[str, Value]] = {
    "csd-mt": {
        "Current Ratio": 55,
        "Homing Method": 35,
        "Enable SW bit 15": 1,
        "Auto Sync Enable": 2,
        "Motor Code": 5444,
    },
    "adxl": {},
    "az3": {"ID KP": 0.7, "BRAKE ENGAGE TIME": 12, "OUTPUT 2 SELECTOR": 3, "REVERT ENCODER DIRECTION": True},
}


@pytest.fixture(autouse=True)
def no_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    """The CSD MT takes five seconds to store, and the ADXL three to reboot."""
    rules = SettingRules.of
    monkeypatch.setattr(SettingRules, "of", lambda device: rules(device)._replace(store_takes=0.0))
    monkeypatch.setattr(adxl, "REBOOT_TAKES", 0.2)


def changed(name: str) -> Any:
    """Return a simulated machine with other settings than as delivered."""
    machine: Any = simulator(name)
    for parameter, value in CHANGED[name].items():
        machine.store[parameter] = value
    if name == "adxl":
        machine.menus.values[1, 0, 4] = 33
    return machine


@contextmanager
def connected(name: str | Device, machine: Any, **options: Any) -> Iterator[tuple[MachineClient, str]]:
    """Serve a simulated machine, and yield a client for it with its URL. With faults, the line is a serial one."""
    serial = "faults" in options
    with ModbusServer("rtu://pty" if serial else "tcp://127.0.0.1:0", {1: machine.modbus}, **options) as server:
        # The store command of the ADXL has no answer, and takes the whole time-out.
        tcp = "timeout=1&retries=9" if name == "adxl" else ""
        # On a busy computer an answer may be later than the time-out: the window says how late, and costs nothing here.
        url = f"{server.url}?{'timeout=0.15&late_window=1.5&retries=9' if serial else tcp}"
        with connect(name, url, unit=1) as client:
            yield client, url


def saved_from(name: str | Device, machine: Any) -> SavedSettings:
    with connected(name, machine) as (client, url):
        return save_settings(client, url)


def restored(name: str | Device, machine: Any, saved: SavedSettings, **options: Any) -> tuple[Restore, list[Change]]:
    with connected(name, machine) as (client, url):
        restore = Restore(client, saved, url, **options)
        return restore, list(restore.run())


METER = Device(
    "meter",
    title="Energy meter",
    modbus=ModbusSettings(),
    parameters=(
        Parameter("Limit", "u32", unit="kWh", scale=Fraction(1, 1000), modbus=ModbusAt("holding", 0, 2)),
        Parameter("Energy", "f64", unit="kWh", modbus=ModbusAt("holding", 2, 4)),
        Parameter("Ratio", "f32", modbus=ModbusAt("holding", 6, 2)),
        Parameter("Label", "text", modbus=ModbusAt("holding", 8, 2)),
    ),
)


def test_a_value_is_saved_compared_and_restored_to_its_last_digit() -> None:
    """As a 32-bit float each of the first two has a shorter text, which is another number on the wire."""
    first, second = simulator(METER), simulator(METER)
    for machine, energy in ((first, 300000.125), (second, 300000.12)):
        for name, value in {"Limit": energy, "Energy": energy, "Ratio": 0.2}.items():
            machine.store[name] = value
    saved = saved_from(METER, first)
    assert [value.value for value in saved.settings.values()] == [300000.125, 300000.125, 0.2, ""]
    assert [found.name for found in differences(saved, saved_from(METER, second))] == ["Limit", "Energy"]
    _, changes = restored(METER, second, SavedSettings.parse(saved.text().encode(), "file"))
    assert [change.parameter.name for change in changes] == ["Limit", "Energy"]
    assert list(differences(saved, saved_from(METER, second))) == []
    assert restored(METER, second, saved)[1] == []


def test_a_text_that_is_too_long_is_refused_before_the_first_write() -> None:
    saved = saved_from(METER, machine := simulator(METER))
    watched = Watched(machine)
    saved.settings |= {"Ratio": SavedValue(0.5), "Label": SavedValue("Hall 4")}
    with pytest.raises(EncodeError, match=r"Label: .*'Hall 4'"):
        restored(METER, machine, saved)
    assert watched.names == []


@pytest.mark.parametrize("name", ["csd-mt", "adxl", "az3"])
def test_a_saved_machine_restored_to_a_fresh_one_is_equal(name: str) -> None:
    first, second = changed(name), simulator(name)
    saved = saved_from(name, first)
    assert list(differences(saved, saved_from(name, second)))
    restore, changes = restored(name, second, SavedSettings.parse(saved.text().encode(), "file"))
    assert (restore.failed, restore.stopped, restore.stored) == ([], None, True)
    assert [change.parameter.name for change in changes] == restore.written
    assert list(differences(saved, saved_from(name, second))) == []
    again, none = restored(name, second, saved)
    assert (none, again.equal) == ([], len(saved.settings))


@pytest.mark.parametrize("seed", [4, *(pytest.param(seed, marks=pytest.mark.proof) for seed in range(20))])
@pytest.mark.parametrize("name", ["csd-mt", "adxl", "az3"])
def test_with_a_fifth_of_the_answers_lost_or_damaged_the_result_is_the_same(name: str, seed: int) -> None:
    first, second = changed(name), simulator(name)
    right = saved_from(name, first)
    with connected(name, first, faults="drop:0.1,flip:0.1", fault_seed=seed) as (client, url):
        saved = save_settings(client, url)
    assert saved.not_read == {}
    assert list(differences(right, saved)) == []
    with connected(name, second, faults="drop:0.1,flip:0.1", fault_seed=seed) as (client, url):
        restore = Restore(client, saved, url)
        list(restore.run())
    assert (restore.failed, restore.stopped, restore.stored) == ([], None, True)
    assert list(differences(right, saved_from(name, second))) == []


def test_what_a_machine_does_not_answer_is_in_the_file_with_the_reason() -> None:
    machine = changed("csd-mt")
    with connected("csd-mt", machine, faults="exception=04@1080") as (client, url):
        saved = save_settings(client, url)
    assert list(saved.not_read) == ["Current Ratio"]
    assert "exception 04" in saved.not_read["Current Ratio"]
    restore, _ = restored("csd-mt", simulator("csd-mt"), saved)
    assert list(restore.left_out) == ["Current Ratio"]
    assert restore.is_complete


class Watched:
    """Keeps the order in which parameters are written to a simulated machine."""

    def __init__(self, machine: Any) -> None:
        self.names: list[str] = []
        for cell in machine.store:
            cell.after = self._noted(cell.name, cell.after)

    def _noted(self, name: str, after: Callable[[Value], None] | None) -> Callable[[Value], None]:
        def note(value: Value) -> None:
            self.names.append(name)
            if after is not None:
                after(value)

        return note


def test_modes_are_written_first_and_the_store_command_last() -> None:
    saved = saved_from("csd-mt", changed("csd-mt"))
    machine = simulator("csd-mt")
    watched = Watched(machine)
    restored("csd-mt", machine, saved)
    assert watched.names[0] == "Motor Code"
    assert watched.names[-1] == "Save All Parameters"
    assert set(watched.names[:-1]) == set(CHANGED["csd-mt"])


def test_a_command_of_the_file_is_refused_before_the_first_write() -> None:
    saved = saved_from("csd-mt", changed("csd-mt"))
    saved.settings["Control Word"] = SavedValue(15)
    machine = simulator("csd-mt")
    watched = Watched(machine)
    with pytest.raises(EncodeError, match="Control Word: it is no setting"):
        restored("csd-mt", machine, saved)
    restore, _ = restored("csd-mt", machine, saved, check=False)
    assert "Control Word" in restore.left_out
    assert "Control Word" not in watched.names


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("Current Ratio", SavedValue(55, "A"), "Current Ratio: 'A': expected %"),
        ("Current Ratio", SavedValue(500, "%"), "Current Ratio = 500: expected 0..120 %"),
        ("Current Ratio", SavedValue(55.5, "%"), "Current Ratio: .*whole number"),
        ("Current Ratio", SavedValue(True, "%"), "Current Ratio = True: expected a number"),
        ("Current Ratio", SavedValue(float("inf"), "%"), "Current Ratio = inf: expected 0..120 %"),
        ("Current Ratio", SavedValue("much", "%"), "Current Ratio = 'much': expected a number"),
        ("Currant Ratio", SavedValue(5, "%"), "Currant Ratio: csd-mt has no such setting"),
    ],
)
def test_names_units_and_ranges_are_checked_before_the_first_write(name: str, value: SavedValue, message: str) -> None:
    saved = saved_from("csd-mt", changed("csd-mt"))
    saved.settings[name] = value
    machine = simulator("csd-mt")
    watched = Watched(machine)
    with pytest.raises(EncodeError, match=message):
        restored("csd-mt", machine, saved)
    assert watched.names == []


def test_settings_that_exclude_each_other_come_in_any_order() -> None:
    """1105 and 1107 are never both 1: the first write is refused until the second has been written."""
    first, second = simulator("csd-mt"), simulator("csd-mt")
    first.store["Enable SW bit 7"] = 1
    second.store["Enable SW bit 15"] = 1
    saved = saved_from("csd-mt", first)
    restore, changes = restored("csd-mt", second, saved)
    assert [change.parameter.name for change in changes] == ["Enable SW bit 15", "Enable SW bit 7"]
    assert (restore.failed, restore.stored) == ([], True)


def test_a_value_that_is_no_finite_number_is_refused_also_where_there_is_no_range() -> None:
    saved = saved_from("az3", changed("az3"))
    for wrong in ("nan", "inf"):
        saved.settings["TORQUE LIMIT"] = saved.settings["TORQUE LIMIT"]._replace(value=float(wrong))
        with pytest.raises(EncodeError, match=f"TORQUE LIMIT = {wrong}: expected a finite number"):
            restored("az3", simulator("az3"), saved)


def test_a_file_without_a_setting_is_refused_and_nothing_is_stored() -> None:
    watched = Watched(machine := simulator("csd-mt"))
    with pytest.raises(BadFile, match="there is no setting to write"):
        restored("csd-mt", machine, SavedSettings("csd-mt"))
    assert watched.names == []


def test_a_refused_setting_is_named_and_nothing_is_stored() -> None:
    saved = saved_from("csd-mt", changed("csd-mt"))
    saved.settings["Counter Watchdog"] = SavedValue(50, "ms")  # below its shortest time-out
    restore, changes = restored("csd-mt", simulator("csd-mt"), saved)
    (failed,) = restore.failed
    assert failed.parameter.name == "Counter Watchdog"
    assert "exception 03" in failed.problem
    assert len(changes) == len(CHANGED["csd-mt"])
    assert (restore.stored, restore.is_complete) == (False, False)


def test_a_value_that_the_machine_does_not_keep_is_found_by_reading_it_again() -> None:
    saved = saved_from("csd-mt", changed("csd-mt"))
    machine = simulator("csd-mt")
    machine.store.after("Current Ratio", lambda value: machine.store.cell("Current Ratio").set(70))
    restore, _ = restored("csd-mt", machine, saved)
    assert [str(change) for change in restore.failed] == ["Current Ratio = 55 % (was 70 %): not written: it is 70 %"]
    blind, _ = restored("csd-mt", machine, saved, verify=False, store=False)
    assert (blind.failed, blind.stored) == ([], False)


def test_a_dry_run_writes_nothing() -> None:
    saved = saved_from("csd-mt", changed("csd-mt"))
    machine = simulator("csd-mt")
    watched = Watched(machine)
    with connected("csd-mt", machine) as (client, url):
        changes = list(Restore(client, saved, url).run(dry_run=True))
    assert {change.parameter.name for change in changes} == set(CHANGED["csd-mt"])
    assert watched.names == []


def test_another_machine_is_refused() -> None:
    saved = saved_from("adxl", changed("adxl"))
    saved.identity["type"] = "ADXL0320600"
    with pytest.raises(WrongDevice, match="another model: its type is ADXL0030600, the file is of ADXL0320600"):
        restored("adxl", simulator("adxl"), saved)
    assert restored("adxl", simulator("adxl"), saved, check=False)[0].is_complete


def test_a_machine_whose_motor_is_on_is_refused() -> None:
    saved = saved_from("csd-mt", changed("csd-mt"))
    with connected("csd-mt", simulator("csd-mt")) as (client, url):
        client.drive.enable()
        with pytest.raises(NotAtRest, match="the drive is in OPERATION ENABLED"):
            list(Restore(client, saved, url).run())
        assert list(Restore(client, saved, url).run(dry_run=True))
    starter = simulator("adxl")
    other = saved_from("adxl", changed("adxl"))
    with connected("adxl", starter) as (client, url):
        client.write("Motor start command", 1)
        with pytest.raises(NotAtRest, match=r"Status = .*: expected the machine at rest"):
            list(Restore(client, other, url).run())


def test_how_a_machine_is_reached_is_written_on_demand_and_last() -> None:
    first = changed("csd-mt")
    first.store["IP Address fourth octet"] = 44
    saved = saved_from("csd-mt", first)
    machine = simulator("csd-mt")
    watched = Watched(machine)
    restored("csd-mt", machine, saved)
    assert "IP Address fourth octet" not in watched.names
    watched.names.clear()
    restore, (change,) = restored("csd-mt", machine, saved, communication=True)
    assert change.parameter.name == "IP Address fourth octet"
    assert watched.names == ["IP Address fourth octet", "Save All Parameters", "Save All Parameters"]
    assert restore.stored


class Killed(BaseException):
    """Ends a restore at once, as the end of its process does."""


def fails_after(client: MachineClient, moment: int, error: BaseException) -> dict[str, Callable[..., Any]]:
    """Return methods for a client that raise the error at a call, counted over all of them."""
    left = moment

    def counted(act: Callable[..., Any]) -> Callable[..., Any]:
        def carry_out(*arguments: Any, **options: Any) -> Any:
            nonlocal left
            left -= 1
            if left == 0:
                raise error
            return act(*arguments, **options)

        return carry_out

    return {name: counted(getattr(client, name)) for name in ("read", "read_all", "write")}


@pytest.mark.parametrize("step", part_or_whole(5, 1))
@pytest.mark.parametrize("name", ["csd-mt", "adxl", "az3"])
def test_killed_at_any_of_a_hundred_moments_the_same_restore_goes_on(
    name: str, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is stored here: the ADXL would restart a hundred times. A part is every fifth moment, from the first."""
    saved = saved_from(name, changed(name))
    for moment in range(1, 101, step):
        machine = simulator(name)
        with connected(name, machine) as (client, url):
            with monkeypatch.context() as patched:
                for method, act in fails_after(client, moment, Killed()).items():
                    patched.setattr(client, method, act)
                try:
                    list(Restore(client, saved, url, store=False).run())
                except Killed:
                    pass
                else:  # it came to its end before this moment
                    break
            list(Restore(client, saved, url, store=False).run())
        assert list(differences(saved, saved_from(name, machine))) == []
    assert moment > 10


def test_a_port_that_fails_leaves_a_list_of_what_was_not_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    saved = saved_from("csd-mt", changed("csd-mt"))
    with connected("csd-mt", simulator("csd-mt")) as (client, url):
        monkeypatch.setattr(client, "write", fails_after(client, 3, PortError("unplugged"))["write"])
        restore = Restore(client, saved, url)
        list(restore.run())
    assert str(restore.stopped) == "unplugged"
    assert len(restore.written) == 2
    assert {change.problem for change in restore.failed} == {"not reached"}
    assert {*restore.written, *(change.parameter.name for change in restore.failed)} == set(CHANGED["csd-mt"])
    assert not restore.stored


@pytest.mark.parametrize("unread", [["Homing Offset"], ["Homing Offset", "Current Ratio"]])
def test_what_is_not_read_back_is_counted_once(unread: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The first was equal already, the second was written."""
    saved = saved_from("csd-mt", changed("csd-mt"))
    with connected("csd-mt", simulator("csd-mt")) as (client, url):
        restore = Restore(client, saved, url)
        read_all = client.read_all

        def lossy(names: Any = None) -> Any:
            if restore.written and set(unread) & set(names):
                raise NoAnswer("lost")
            return read_all(names)

        monkeypatch.setattr(client, "read_all", lossy)
        list(restore.run())
    assert {str(change).partition(": ")[2] for change in restore.failed} == {"not read back: lost"}
    assert len(restore.written) + len(restore.failed) + restore.equal == len(saved.settings)
    assert [change.parameter.name for change in restore.failed] == sorted(unread)
    assert not set(restore.written) & set(unread)


@pytest.mark.parametrize("seed", range(12))
def test_under_heavy_loss_each_setting_is_counted_once(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    saved = saved_from("csd-mt", changed("csd-mt"))
    dice = random.Random(seed)
    with connected("csd-mt", simulator("csd-mt")) as (client, url):
        restore = Restore(client, saved, url, check=False)
        for method in ("read_all", "write"):
            monkeypatch.setattr(client, method, sometimes_lost(getattr(client, method), dice))
        list(restore.run())
    names = [*restore.written, *(change.parameter.name for change in restore.failed)]
    assert len(names) == len(set(names))
    assert len(names) + restore.equal == len(saved.settings)


def sometimes_lost(method: Callable[..., Any], dice: random.Random) -> Callable[..., Any]:
    """Return the method with one request in ten lost."""

    def ask(*arguments: Any, **options: Any) -> Any:
        if dice.random() < 0.1:
            raise NoAnswer("lost")
        return method(*arguments, **options)

    return ask


def test_a_silent_machine_is_an_error_before_anything_is_written() -> None:
    saved = saved_from("csd-mt", changed("csd-mt"))
    machine = simulator("csd-mt")
    watched = Watched(machine)
    with ModbusServer("rtu://pty", {1: machine.modbus}, faults="drop:1") as server:
        url = f"{server.url}?timeout=0.05&late_window=0.05"
        with connect("csd-mt", url, unit=1) as client, pytest.raises(NoAnswer):
            list(Restore(client, saved, url, check=False).run())
    assert watched.names == []


def test_over_canopen_pdos_are_written_in_the_order_of_cia_301() -> None:
    url = "can://memory/restore-pdos"
    with CanopenServer(f"{url}?node=1", device="az3"), connect("az3", url) as drive:
        saved = save_settings(drive, url)
        assert saved.not_read == {}
        pdo = {"TPDO1 TRANSMISSION TYPE": 254, "TPDO1 MAPPING 2": 0x6077_0010, "BRAKE ENGAGE TIME": 9}
        for name, value in pdo.items():
            saved.settings[name] = replace_value(saved.settings[name], value)
        restore = Restore(drive, saved, url)
        changes = list(restore.run())
        assert (restore.failed, restore.stopped, restore.stored) == ([], None, True)
        assert {change.parameter.name: change.after for change in changes} == pdo
        assert list(differences(saved, save_settings(drive, url))) == []
        saved.settings["TPDO1 MAPPING 3"] = replace_value(saved.settings["TPDO1 MAPPING 3"], 0x6064_0020)
        full = Restore(drive, saved, url)
        list(full.run())
        assert "expected at most 64" in full.failed[0].problem


@pytest.mark.parametrize(("before", "after"), [(1, 3), (3, 1)])
def test_over_canopen_the_number_of_mapped_objects_is_a_setting(before: int, after: int) -> None:
    """Objects are mapped while the number is 0, and the number is written behind them."""
    url = f"can://memory/restore-mapped-{before}"
    with CanopenServer(f"{url}?node=1", device="az3"), connect("az3", url) as drive:
        assert isinstance(drive.client, CanopenClient)
        node = drive.client.node(1)

        def map_objects(number: int) -> None:
            for index, sub, value in (
                (0x1801, 1, 0x8000_0281),
                (0x1A01, 0, 0),
                (0x1A01, 0, number),
                (0x1801, 1, 0x281),
            ):
                node.sdo.download(index, sub, value.to_bytes(1 if sub == 0 else 4, "little"))

        map_objects(after)
        saved = save_settings(drive, url)
        map_objects(before)
        assert "TPDO2 NUMBER OF MAPPED OBJECTS" in {
            found.name for found in differences(saved, save_settings(drive, url))
        }
        restore = Restore(drive, saved, url)
        list(restore.run())
        assert (restore.failed, restore.stopped) == ([], None)
        assert node.sdo.upload(0x1A01, 0) == bytes([after])
        assert list(differences(saved, save_settings(drive, url))) == []


def test_what_was_saved_over_modbus_is_restored_over_canopen() -> None:
    url = "can://memory/restore-other-bus"
    saved = saved_from("az3", changed("az3"))
    with CanopenServer(f"{url}?node=1", device="az3"), connect("az3", url) as drive:
        restore = Restore(drive, saved, url)
        list(restore.run())
    assert set(restore.written) == set(CHANGED["az3"])
    assert restore.is_complete
    assert set(restore.left_out.values()) == {"it has no address on CANopen"}
    assert "T ALIGN" in restore.left_out


def replace_value(saved: SavedValue, value: Value) -> SavedValue:
    return saved._replace(value=value)


def test_a_description_of_your_own_without_a_table_is_restored_without_storing() -> None:
    device = replace(load("csd-mt"), extra={})
    saved = saved_from("csd-mt", changed("csd-mt"))
    with ModbusServer("tcp://127.0.0.1:0", {1: simulator("csd-mt").modbus}) as server:  # noqa: SIM117
        with connect(device, server.url) as client:
            restore = Restore(client, replace_communication(saved), server.url)
            list(restore.run())
    assert (restore.is_complete, restore.stored) == (True, False)


def replace_communication(saved: SavedSettings) -> SavedSettings:
    return replace(saved, communication={})
