"""Write saved settings to a machine, in the order that its manual requires.

    restore = Restore(drive, saved, url)
    for change in restore.run():
        print(change)
    restore.failed, restore.stored, restore.stopped

    1  check     the file against the description: names, units; the machine: is it this one, is it at rest
    2  read      what the machine has: what is equal is not written; ranges of the rest, before the first write
    3  write     modes first, one by one; the communication objects of CANopen in the order of CiA 301
    4  read      everything again: one setting can change another, or be refused until another is written; what differs
                 is written again, as long as that helps
    5  write     with `communication`, how the machine is reached
    6  store     by the command of the manual, if nothing has failed

Whatever ends it, the same restore can be carried out again: it goes on with what is not equal.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import NamedTuple

from barewire import CanopenClient
from barewire.canopen.configuration.configure import STORE_TIMEOUT, configure_device
from barewire.canopen.configuration.settings import DeviceConfiguration, Setting, pdo_of
from barewire.canopen.object_dictionary import Entry
from barewire.codecs import Value
from barewire.devices import Parameter
from barewire.devices.cia402 import State, state_of
from barewire.errors import BarewireError, DecodeError, EncodeError, NoAnswer, PortError, Refused, shown
from barewire.io.canopen.operations import sdo_transfer
from barewire.io.endpoint import Endpoint
from barewire.io.machine import MachineClient
from barewire_workbench.live.check_device import WrongDevice, check_device
from barewire_workbench.live.save_settings import (
    confirmed_write,
    is_model,
    machine_identity,
    read_settings,
    select,
)
from barewire_workbench.settings.compare import same_setting
from barewire_workbench.settings.rules import KeptSetting, SettingRules
from barewire_workbench.settings.saved import BadFile, SavedSettings, value_of

_APPLICATION = 0x2000
"""The index behind the communication objects."""
_PASSES = 3
_SILENT = 3
"""Settings in a row whose write is not answered before it ends."""
_RESTART = 60.0
"""Seconds that a machine has to answer again after a store command that restarts it."""
_ENABLED = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE)


class NotAtRest(BarewireError):
    """The machine is not in a state in which its settings are written."""


class Change(NamedTuple):
    """A setting with the value that the machine had, the one of the file, and what became of it.

    problem     why it was not written, or not read back; empty if it was, or would be
    is_unread   whether the machine did not tell at the end what it has
    """

    parameter: Parameter
    before: Value | None
    after: Value
    problem: str = ""
    is_unread: bool = False

    def __str__(self) -> str:
        before = "" if self.before is None else f" (was {self.parameter.text(self.before)})"
        problem = f": not {'read back' if self.is_unread else 'written'}: {self.problem}" if self.problem else ""
        return f"{self.parameter.name} = {self.parameter.text(self.after)}{before}{problem}"

    def as_dict(self) -> dict[str, object]:
        """The change, for JSON."""
        fields: dict[str, object] = {
            "name": self.parameter.name,
            "before": self.before,
            "value": self.after,
            "unit": self.parameter.unit,
        }
        if self.problem:
            fields["error"] = f"not read back: {self.problem}" if self.is_unread else self.problem
        return fields


@dataclass(slots=True)
class Restore:
    """The settings of a file on their way into a machine.

    communication    also write how the machine is reached, at the end
    check            refuse a file for another machine, a machine that is not at rest, and values out of range
    verify           read everything again at the end
    store            let the machine store what it has then
    tell             called with a sentence before the machine takes its time to store or restart
    written          the names of the settings that were written
    failed           the settings that were not written, or not read back at the end
    left_out         names of the file, with the reason: not on this bus, not saved; with `check` off also unknown ones
    stored           whether the store command was carried out
    stopped          the error that ended it early; None if it came to its end
    """

    machine: MachineClient
    saved: SavedSettings
    url: str
    communication: bool = False
    check: bool = True
    verify: bool = True
    store: bool = True
    tell: Callable[[str], object] = str
    written: list[str] = field(default_factory=list)
    failed: list[Change] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)
    stored: bool = False
    stopped: BarewireError | None = None
    _wanted: list[tuple[KeptSetting, Value]] = field(default_factory=list)
    _pending: list[Change] = field(default_factory=list)

    @property
    def equal(self) -> int:
        """How many settings the machine had already; each is counted as equal, as written or as failed."""
        others = (change.parameter.name for change in (*self._pending, *self.failed))
        return len(self._wanted) - len({*self.written, *others})

    @property
    def is_complete(self) -> bool:
        """Whether the machine has all settings of the file that were to be written."""
        return not (self.failed or self.stopped)

    def run(self, *, dry_run: bool = False) -> Iterator[Change]:
        """Write what differs, and yield it; with `dry_run` yield it only.

        Raises, before anything is written, BadFile for one without settings, EncodeError for a file with other names,
        units or ranges, NotAtRest, WrongDevice for another machine or model, NoAnswer, PortError.
        """
        rules = SettingRules.of(self.machine.device)
        self._match(rules)
        if not self._wanted:
            raise BadFile("there is no setting to write in the file: expected names below [settings]")
        if self.check:
            self._check_machine(rules)
            if not dry_run:
                self._check_state(rules)
        changes = [change._replace(problem="", is_unread=False) for change in self._differing(self._wanted)]
        self._pending = changes
        if self.check:
            self._check_ranges(changes)
        if dry_run:
            yield from changes
            return
        try:
            plain = [change for change in changes if not self._setting(change).communication]
            yield from self._write_and_verify(plain)
            if self.failed:
                self._leave_pending()
            else:
                yield from self._write_communication(changes[len(plain) :])
            if self.store and not self.failed:
                self._store(rules)
        except Refused as error:  # the store command: what was written is lost when the machine is switched off
            self.stopped = error
        except (PortError, NoAnswer) as error:
            self.stopped = error
            self._leave_pending()

    @property
    def not_storable(self) -> int:
        """How many of the settings of the file the machine does not keep when it is switched off."""
        return sum(setting.parameter.storable is False for setting, _ in self._wanted)

    # Before the first write

    def _match(self, rules: SettingRules) -> None:
        """Find the settings of the file in the description."""
        device = self.machine.device
        is_can = _is_can(self.url)
        known = {setting.name: setting for setting in rules.settings(is_can=is_can)}
        elsewhere = {setting.name for setting in rules.settings(is_can=not is_can)}
        wanted = self.saved.settings | (self.saved.communication if self.communication else {})
        problems = [
            f"{name}: in [settings] and [communication]"
            for name in self.saved.settings.keys() & self.saved.communication
        ]
        for name, value in wanted.items():
            setting = known.get(name)
            if setting is None and name in elsewhere:
                self.left_out[name] = f"it has no address on {'CANopen' if is_can else 'Modbus'}"
            elif setting is None:
                is_known = any(parameter.name == name for parameter in device.parameters)
                self.left_out[name] = "it is no setting" if is_known else f"{device.name} has no such setting"
                problems.append(f"{name}: {self.left_out[name]}")
            elif value.unit != setting.parameter.unit:
                expected = setting.parameter.unit or "no unit"
                problems.append(f"{name}: {shown(value.unit)}: expected {expected}")
        if self.check and problems:
            raise EncodeError(f"not for {device.name} here: {_listed(problems)}")
        self.left_out |= {name: f"not saved: {why}" for name, why in self.saved.not_read.items()}
        self._wanted = [
            (setting, value_of(setting.parameter, wanted[name])) for name, setting in known.items() if name in wanted
        ]

    def _check_machine(self, rules: SettingRules) -> None:
        check_device(self.machine, before_write=True)
        present = machine_identity(self.machine, rules)
        for name, saved in self.saved.identity.items():
            if is_model(name, rules) and name in present and present[name] != saved:
                raise WrongDevice(f"another model: its {name} is {present[name]}, the file is of {saved}")

    def _check_state(self, rules: SettingRules) -> None:
        for name, values in rules.idle.items():
            reading = self.machine.read(name)
            if reading.value not in values:
                raise NotAtRest(f"{reading}: expected the machine at rest, since restoring restarts it")
        if (roles := self.machine.device.drive) is not None:
            check_at_rest(int(self.machine.read(roles.status_word).value))

    def _differing(self, wanted: Sequence[tuple[KeptSetting, Value]]) -> list[Change]:
        """Read settings, and return those that the machine has otherwise, or does not tell, with that as the problem.

        Raises NoAnswer if it tells none."""
        values = {setting.name: value for setting, value in wanted}
        changes = []
        for present in read_settings(self.machine, self.url, [setting for setting, _ in wanted]):
            parameter, value = present.setting.parameter, values[present.setting.name]
            if present.value is None:
                changes.append(Change(parameter, None, value, present.problem, is_unread=True))
            elif not same_setting(parameter, present.value, value):
                changes.append(Change(parameter, present.value, value, f"it is {parameter.text(present.value)}"))
        if wanted and len(changes) == len(wanted) and all(change.before is None for change in changes):
            raise NoAnswer(f"no setting could be read: {changes[-1].problem}")
        return changes

    def _check_ranges(self, changes: Iterable[Change]) -> None:
        is_can, problems = _is_can(self.url), []
        for change in changes:
            try:
                raw = change.parameter.to_raw(change.after)
                if isinstance(raw, float) and not isfinite(raw):
                    raise EncodeError(f"{change.parameter.name} = {raw}: expected a finite number")
                if is_can:
                    change.parameter.to_object(change.after, bytes(8))  # of a bit, the present content
                elif (place := change.parameter.modbus) is not None:
                    change.parameter.to_registers(change.after, (0,) if place.partial else ())
            except EncodeError as error:
                named = "" if change.parameter.name in str(error) else f"{change.parameter.name}: "
                problems.append(f"{named}{error}")
        if problems:
            raise EncodeError(_listed(problems))

    # Writing

    def writes(self, change: Change) -> dict[str, Value]:
        """Return what is written for a setting, in this order: the numbers that select it, and its value."""
        setting = self._setting(change)
        return {**setting.select, setting.read_as: change.after}

    def _setting(self, change: Change) -> KeptSetting:
        return next(setting for setting, _ in self._wanted if setting.name == change.parameter.name)

    def _write_and_verify(self, changes: list[Change]) -> Iterator[Change]:
        plain = [(setting, value) for setting, value in self._wanted if not setting.communication]
        communication = self._pending[len(changes) :]
        wrong = changes
        for _ in range(_PASSES):
            refused = yield from self._write(wrong)
            tried = {change.parameter.name for change in wrong}
            if self.verify:
                wrong = [refused.get(change.parameter.name, change) for change in self._differing(plain)]
            else:
                wrong = list(refused.values())
            names = {change.parameter.name for change in wrong}
            self.written = [name for name in self.written if name not in names]
            self._pending = [*wrong, *communication]
            if not wrong or names == tried:
                break
        self.failed = wrong

    def _write(self, changes: Iterable[Change]) -> Generator[Change, None, dict[str, Change]]:
        """Write settings one by one, and yield each that is written. Return the others by name."""
        refused: dict[str, Change] = {}
        silent = 0
        objects = []
        for change in changes:
            if _is_can(self.url) and (place := change.parameter.object) and place.index < _APPLICATION:
                objects.append(change)
                continue
            try:
                setting = self._setting(change)
                select(self.machine, self.url, setting)
                confirmed_write(self.machine, self.url, setting.read_as, change.after, force=not self.check)
            except (Refused, DecodeError, EncodeError, NoAnswer) as error:
                refused[change.parameter.name] = change._replace(problem=str(error))
                silent = silent + 1 if isinstance(error, NoAnswer) else 0
                if silent == _SILENT:
                    self.failed = list(refused.values())
                    raise
                continue
            silent = 0
            yield self._done(change)
        if objects:
            try:
                self._configure(objects)
            except (PortError, NoAnswer):
                raise
            except BarewireError as error:
                refused |= {change.parameter.name: change._replace(problem=str(error)) for change in objects}
            else:
                for change in objects:
                    yield self._done(change)
        return refused

    def _done(self, change: Change) -> Change:
        if change.parameter.name not in self.written:
            self.written.append(change.parameter.name)
        return change._replace(problem="")

    def _configure(self, changes: Sequence[Change]) -> None:
        """Write communication objects in an order that CiA 301 permits: a PDO is off while its mapping changes."""
        client = self.machine.client
        assert isinstance(client, CanopenClient)
        node = client.node(device=self.machine.device)
        configuration = DeviceConfiguration(node.number, tuple(self._object_settings(changes)))
        configuring = configure_device(node.channel, configuration, timeout=node.timeout)
        node.runner.carry_out(sdo_transfer(node.channel, configuring, node.timeout))

    def _object_settings(self, changes: Sequence[Change]) -> Iterator[Setting]:
        """Yield the changes, and the equal entries of a mapping that changes: it is written as a whole."""
        changed = {change.parameter.name for change in changes}
        places = [change.parameter.object for change in changes]
        mappings = {
            place.index for place in places if place and (pdo := pdo_of(place.index)) and place.index == pdo.map
        }
        for setting, value in self._wanted:
            parameter, place = setting.parameter, setting.parameter.object
            if place is not None and (setting.name in changed or place.index in mappings):
                entry = Entry(place.index, place.sub, setting.name, parameter.object_type)
                yield Setting(entry, parameter.to_raw(value))

    def _leave_pending(self) -> None:
        """Add what is still to be written to what failed."""
        done = {*self.written, *(change.parameter.name for change in self.failed)}
        left = [change for change in self._pending if change.parameter.name not in done]
        self.failed += [change._replace(problem="not reached", is_unread=False) for change in left]

    def _write_communication(self, changes: list[Change]) -> Iterator[Change]:
        for change in changes:
            refused = yield from self._write([change])
            self.failed += refused.values()

    def _store(self, rules: SettingRules) -> None:
        commands: list[Mapping[str, Value]] = [rules.store]
        if self.communication:
            commands.append(rules.store_communication)
        for name, value in (pair for command in commands for pair in command.items()):
            if _is_can(self.url):  # many write to a slow memory before they respond
                client = self.machine.client
                assert isinstance(client, CanopenClient)
                client.node(device=self.machine.device, timeout=max(client.timeout, STORE_TIMEOUT)).write(name, value)
            else:
                confirmed_write(self.machine, self.url, name, value)
            if rules.store_takes:
                self.tell(f"the device stores for {rules.store_takes:g} s, and must stay on meanwhile")
                time.sleep(rules.store_takes)
            if not self.machine.device.find(name).answered:
                self.tell("the device stores and restarts")
                self._await_restart(rules)
            self.stored = True

    def _await_restart(self, rules: SettingRules) -> None:
        """Wait until a machine answers again."""
        end = time.monotonic() + _RESTART
        name = next(iter((*rules.idle, *rules.model)), rules.settings(is_can=_is_can(self.url))[0].read_as)
        while True:
            try:
                self.machine.read(name)
                return
            except (Refused, NoAnswer, DecodeError):
                if time.monotonic() > end:
                    raise
                time.sleep(0.1)


def check_at_rest(status_word: int) -> None:
    """Raise NotAtRest if the motor of a CiA 402 drive may have current."""
    state = state_of(status_word)
    if state in _ENABLED:
        text = "settings are written while the motor has no current: `barewire drive ... disable`"
        raise NotAtRest(f"the drive is in {state.name.replace('_', ' ')}: {text}")


def _is_can(url: str) -> bool:
    return Endpoint.parse(url).scheme == "can"


def _listed(problems: Sequence[str]) -> str:
    more = f"; and {len(problems) - 5} more" if len(problems) > 5 else ""
    return "; ".join(problems[:5]) + more
