"""Read many values of a machine so that a bad one costs only itself.

    A B C D E F G H        one request for all of them: exception 02
    A B C D | E F G H      the first half: values           the second half: exception 02
              E F | G H    ...                              down to the single value, whose row has the error

Of more than eight values the first three are asked for one by one: a machine that answers none of them is not asked for
the rest, whose rows say so. One that stops answering later is given up after eight values in a row.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from itertools import chain
from typing import NamedTuple

from barewire.codecs import Value
from barewire.devices import Device, Parameter, Reading, UnknownName
from barewire.errors import DecodeError, EncodeError, NoAnswer, Refused, shown, suggest
from barewire.io.endpoint import Endpoint
from barewire.io.machine import MachineClient
from barewire_workbench.settings.compare import same_setting
from barewire_workbench.value_log.sample import plain_value

_BLOCK = 64
"""Values that are asked for in one call, so that the first appear while the others are read."""
_ALONE = 3
"""Values that are asked for one by one at the beginning: if none of them is answered, the machine is off."""
_UNANSWERED = 8
"""Later, values in a row without an answer after which the rest is not asked for. Of so few all are asked for."""

COLUMNS = ("name", "value", "unit", "text", "error")
"""The keys of `ReadValue.as_dict`; a value that was read has no error."""


class ReadValue(NamedTuple):
    """A parameter with what was read, or why it was not; `configured` is the value of a DCF."""

    parameter: Parameter
    reading: Reading | None
    problem: str = ""
    configured: Value | None = None

    def __str__(self) -> str:
        if self.reading is None:
            return f"{self.parameter.name}: not read: {self.problem}"
        wanted = self.configured
        if wanted is None or same_setting(self.parameter, wanted, self.reading.value):
            return str(self.reading)
        return f"{self.reading}; the DCF has {self.parameter.text(wanted)}"

    def as_dict(self) -> dict[str, object]:
        """The value, for JSON and CSV."""
        parameter = self.parameter
        fields: dict[str, object] = {"name": parameter.name, "value": None, "unit": parameter.unit, "text": ""}
        if self.reading is None:
            fields["error"] = self.problem
        else:
            fields |= {"value": plain_value(self.reading.value), "text": parameter.text(self.reading.value)}
        if self.configured is not None:
            fields["configuration"] = plain_value(self.configured)
        return fields


def read_values(machine: MachineClient, names: Sequence[str]) -> Iterator[ReadValue]:
    """Yield each of these parameters, in their order, with its value or its error. Raises PortError if the port fails.

    >>> from barewire import ModbusServer, connect
    >>> from barewire.devices.sim import simulator
    >>> with ModbusServer("tcp://127.0.0.1:0", {1: simulator("csd-mt").modbus}) as server:
    ...     with connect("csd-mt", server.url) as drive:
    ...         [str(value) for value in read_values(drive, ["Current Ratio", "Homing Method"])]
    ['Current Ratio = 70 %', 'Homing Method = 0']
    """
    parameters = [machine.device.find(name) for name in names]
    alone = _ALONE if len(parameters) > _UNANSWERED else 0
    blocks = [[parameter] for parameter in parameters[:alone]]
    blocks += [parameters[start : start + _BLOCK] for start in range(alone, len(parameters), _BLOCK)]
    blocks.reverse()  # a stack, on which the halves of a block lie above what follows it
    unanswered, limit = 0, _ALONE
    while blocks:
        block = blocks.pop()
        try:
            readings = machine.read_all([parameter.name for parameter in block])
        except (Refused, DecodeError, NoAnswer) as error:
            if len(block) > 1:
                half = len(block) // 2
                blocks += [block[half:], block[:half]]
                continue
            problem = str(error).partition("; while reading ")[0]  # the row has the name already
            yield ReadValue(block[0], None, problem)
            unanswered = unanswered + 1 if isinstance(error, NoAnswer) else 0
            if unanswered == limit:
                for parameter in chain.from_iterable(reversed(blocks)):
                    yield ReadValue(parameter, None, f"not asked for: {problem}")
                return
        else:
            unanswered, limit = 0, _UNANSWERED
            yield from (ReadValue(reading.parameter, reading) for reading in readings)


def readable_names(device: Device, url: str) -> list[str]:
    """Return the names of all parameters that can be read over the wire of a URL."""
    is_can = Endpoint.parse(url).scheme == "can"
    return [row.name for row in device.parameters if row.readable and (row.object if is_can else row.modbus)]


def read_alone(device: Device) -> dict[str, str]:
    """Return the parameters that are read only by their names, not with others, and why: a reading changes something,
    or needs something first. Raises EncodeError for a wrong table [read_alone].

    >>> from barewire import load
    >>> read_alone(load("adxl"))["Event description"]
    'each reading moves the event index on'
    """
    table = device.extra.get("read_alone", {})
    if not isinstance(table, Mapping) or not all(isinstance(why, str) for why in table.values()):
        raise EncodeError(f"{device.name}: [read_alone]: expected names of parameters, each with the reason as a text")
    return {device.find(name).name: why for name, why in table.items()}


def selected(
    device: Device,
    readable: Sequence[str],
    patterns: Sequence[str],
    *,
    groups: Sequence[str] = (),
    access: str | None = None,
) -> list[str]:
    """Return the names that are asked for, each once; without patterns and groups all readable ones.

    `patterns` are names, or have * and ? in them; `access` is ro or rw. Raises UnknownName for a pattern or a group
    that no parameter has.

    >>> from barewire import load
    >>> adxl = load("adxl")
    >>> names = [row.name for row in adxl.parameters if row.readable]
    >>> selected(adxl, names, ["*temperature*"])[:1]
    ['Thyristors temperature']
    """
    # An unknown group is reported before an unknown name.
    in_groups = [name for group in groups for name in _names_in_group(device, group)]
    wanted = [] if patterns or groups else list(readable)
    for pattern in patterns:
        if not is_pattern(pattern):
            wanted.append(device.find(pattern).name)
            continue
        folded = pattern.casefold().replace("[", "[[]")  # names have units in brackets
        matching = [name for name in readable if fnmatchcase(name.casefold(), folded)]
        if not matching:
            raise UnknownName(f"no readable parameter of {device.name} has a name like {shown(pattern)}")
        wanted += matching
    can_be_read = set(readable)
    wanted += [name for name in in_groups if name in can_be_read]
    if access:
        wanted = [name for name in wanted if device.find(name).access == access]
    return list(dict.fromkeys(wanted))


def is_pattern(name: str) -> bool:
    """Return whether a name has a star or a question mark in it."""
    return "*" in name or "?" in name


def _names_in_group(device: Device, group: str) -> list[str]:
    names = [row.name for row in device.parameters if row.group.casefold() == group.casefold()]
    if names:
        return names
    groups = list(dict.fromkeys(row.group for row in device.parameters if row.group))
    expected = f"its groups are {', '.join(groups)}" if groups else "its parameters have no groups"
    raise UnknownName(f"{device.name} has no group {shown(group)}: {expected}{suggest(group, groups)}")
