"""The file of `barewire save`: the settings of one device, as TOML.

    device = "csd-mt"
    time = 2026-06-28T14:03:11+02:00

    [identity]
    "Product Code" = "148"

    [settings]
    "Current Ratio" = { value = 65, unit = "%", address = "holding 1080" }

    [communication]                        how the device is reached: restored on demand only
    [not_read]                             name = why
    # end

The order is that of restoring, so two files can be compared line by line. `value` is in the unit; `unit` is checked
when the file is restored; `address` is for people.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, NamedTuple

from barewire.canopen.datatypes import TimeCodec, TimeDifference, TimeOfDay
from barewire.codecs import Value
from barewire.devices.parameter import Parameter, show
from barewire.errors import BarewireError, EncodeError, shown

FORMAT = 1
_HEAD = "# Settings of a device, by `barewire save`, down to `# end`. To write them: barewire restore FILE ENDPOINT"
_END = "# end"
"""A file that was cut behind a line is TOML too, of fewer settings. A file that people write needs neither comment."""
_KINDS = (bool, int, float, str)


class BadFile(BarewireError, ValueError):
    """A file does not have the form of `barewire save`."""


class SavedValue(NamedTuple):
    """A setting as it is in the file."""

    value: Value
    unit: str = ""
    address: str = ""

    def __str__(self) -> str:
        return show(self.value) + (f" {self.unit}" if self.unit else "")


def saved_value(parameter: Parameter, value: Value, address: str = "") -> SavedValue:
    """Return a value as it is in a file: bytes are text in hexadecimal, times are numbers of milliseconds, 32-bit
    floats have no binary tail.

    >>> saved_value(Parameter("Ratio", "f32"), 0.20000000298023224).value
    0.2
    """
    value = parameter.shortened(value)
    if isinstance(value, bytes):
        value = value.hex(" ").upper()
    elif isinstance(value, int) and not isinstance(value, bool):
        value = int(value)
    return SavedValue(value, parameter.unit, address)


def value_of(parameter: Parameter, saved: SavedValue) -> Value:
    """Return the value of a parameter that is in a file. Raises EncodeError for a text that is not of bytes, and for
    true or false that is not of a bit."""
    if isinstance(saved.value, bool) and parameter.type != "bool":
        raise EncodeError(f"{parameter.name} = {shown(saved.value)}: expected a number")
    time = _TIMES.get(parameter.type)
    if time is not None and isinstance(saved.value, int) and TimeCodec.minimum <= saved.value < TimeCodec.maximum:
        return time(saved.value)
    if parameter.type not in ("octets", "domain") or not isinstance(saved.value, str):
        return saved.value
    try:
        return bytes.fromhex(saved.value)
    except ValueError:
        raise EncodeError(f"{parameter.name} = {shown(saved.value)}: expected bytes in hexadecimal") from None


_TIMES: dict[str, type[int]] = {"time_of_day": TimeOfDay, "time_difference": TimeDifference}


@dataclass(slots=True)
class SavedSettings:
    """The settings of one device at one time.

    device      the name of its description, or the path of that or of an EDS
    source      the endpoint from which they were read, or the file
    identity    what the device said about itself
    settings, communication, not_read       by name
    """

    device: str
    source: str = ""
    title: str = ""
    time: datetime | None = None
    identity: dict[str, str] = field(default_factory=dict)
    settings: dict[str, SavedValue] = field(default_factory=dict)
    communication: dict[str, SavedValue] = field(default_factory=dict)
    not_read: dict[str, str] = field(default_factory=dict)

    def text(self) -> str:
        """Return the file.

        >>> print(SavedSettings("mine", settings={"Limit": SavedValue(2.5, "A", "holding 4")}).text())
        # Settings of a device, by `barewire save`, down to `# end`. To write them: barewire restore FILE ENDPOINT
        format = 1
        device = "mine"
        <BLANKLINE>
        [settings]
        "Limit" = { value = 2.5, unit = "A", address = "holding 4" }
        # end
        <BLANKLINE>
        """
        return "\n".join(self._lines()) + "\n"

    def _lines(self) -> Iterator[str]:
        yield _HEAD
        yield f"format = {FORMAT}"
        for key in ("device", "title", "source"):
            if text := getattr(self, key):
                yield f"{key} = {_toml(text)}"
        if self.time is not None:
            yield f"time = {self.time.isoformat(timespec='seconds')}"
        for title, texts in (("identity", self.identity), ("not_read", self.not_read)):
            if title == "not_read":
                yield from self._values("settings", self.settings)
                yield from self._values("communication", self.communication)
            if texts:
                yield from ("", f"[{title}]")
                yield from (f"{_toml(name)} = {_toml(text)}" for name, text in texts.items())
        yield _END

    @staticmethod
    def _values(title: str, values: Mapping[str, SavedValue]) -> Iterator[str]:
        if not values:
            return
        if title == "communication":
            yield from ("", "# How the device is reached: `restore` writes this with --communication only.")
        yield from ([f"[{title}]"] if title == "communication" else ["", f"[{title}]"])
        for name, saved in values.items():
            fields = [f"value = {_toml(saved.value)}"]
            fields += [
                f"{key} = {_toml(text)}" for key, text in (("unit", saved.unit), ("address", saved.address)) if text
            ]
            yield f"{_toml(name)} = {{ {', '.join(fields)} }}"

    @classmethod
    def parse(cls, data: bytes, name: str) -> SavedSettings:
        """Return the settings in the bytes of a file. Raises BadFile with what was expected."""
        try:
            text = data.decode("utf-8-sig")
            table = tomllib.loads(text)
            lines = {line.strip() for line in text.splitlines()}
            if _HEAD in lines and _END not in lines:
                raise BadFile(
                    f"{name}: cut: expected the line `{_END}` behind the last value. Add it if none is missing"
                )
            return cls._of_table(table, name)
        except BadFile:
            raise
        except RecursionError:
            raise BadFile(f"{name}: no TOML of `barewire save`: nested too deeply") from None
        except ValueError as error:  # no TOML, no UTF-8, or a number of thousands of digits
            raise BadFile(f"{name}: no TOML: {error}") from None

    @classmethod
    def _of_table(cls, table: Mapping[str, Any], name: str) -> SavedSettings:
        if table.get("format") != FORMAT:
            raise BadFile(
                f"{name}: format = {shown(table.get('format'))}: expected {FORMAT}, as `barewire save` writes"
            )
        texts = {key: table.get(key, "") for key in ("device", "source", "title")}
        for key, text in texts.items():
            if not isinstance(text, str) or (key == "device" and not text):
                raise BadFile(f"{name}: {key} = {shown(text)}: expected text")
        time = table.get("time")
        if not isinstance(time, datetime | None):
            raise BadFile(f"{name}: time = {shown(time)}: expected a date and time")
        saved = cls(**texts, time=time)
        for title, target in (("identity", saved.identity), ("not_read", saved.not_read)):
            for key, text in _table(table, title, name).items():
                if not isinstance(text, str):
                    raise BadFile(f"{name}: [{title}] {shown(key)} = {shown(text)}: expected text")
                target[key] = text
        for title, values in (("settings", saved.settings), ("communication", saved.communication)):
            for key, item in _table(table, title, name).items():
                values[key] = _saved_value(item, f"{name}: [{title}] {shown(key)}")
        return saved


def _table(table: Mapping[str, Any], title: str, name: str) -> Mapping[str, Any]:
    found = table.get(title, {})
    if not isinstance(found, Mapping):
        raise BadFile(f"{name}: {title} = {shown(found)}: expected a table")
    return found


def _saved_value(item: object, where: str) -> SavedValue:
    if not isinstance(item, Mapping) or "value" not in item:
        raise BadFile(f"{where} = {shown(item)}: expected {{ value = ..., unit = ... }}")
    if unknown := item.keys() - {"value", "unit", "address"}:
        raise BadFile(f"{where}: {shown(min(unknown))}: expected value, unit or address")
    if not isinstance(item["value"], _KINDS):
        raise BadFile(f"{where}: value = {shown(item['value'])}: expected a number, true or false, or text")
    unit, address = item.get("unit", ""), item.get("address", "")
    if not (isinstance(unit, str) and isinstance(address, str)):
        raise BadFile(f"{where}: expected unit and address as text")
    return SavedValue(item["value"], unit, address)


def _toml(value: Value) -> str:
    """Return a value as TOML has it.

    >>> [_toml(value) for value in (True, 3000, 300000.125, 1e21, 4.0, "5 µm")]
    ['true', '3000', '300000.125', '1e+21', '4.0', '"5 µm"']
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, int):
        return str(int(value))  # the text of a time is that of its date
    # A basic string of TOML has the escapes of JSON, and none of the control characters, of which JSON leaves one.
    text = value if isinstance(value, str) else value.hex(" ").upper()
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
