"""Topics and payloads.

    barewire/SITE/status                     online, or offline (the last will), retained
    barewire/SITE/MACHINE/status             whether the machine responds, retained
    barewire/SITE/MACHINE/description        names, units, types and ranges of its parameters, retained
    barewire/SITE/MACHINE/PARAMETER          {"value": 27.2, "unit": "°C", "at": 1764278400.125, "sequence": 18}
    barewire/SITE/MACHINE/PARAMETER/set      a command: the value as JSON
    barewire/SITE/MACHINE/PARAMETER/result   {"value": 30, "ok": true} or {"value": 300, "ok": false, "error": "…"}

`at` is when the value was read, in seconds since 1970. `again` is true if the reading was sent before and may have
arrived: it has the same `sequence` then. A value that is no number of JSON (an infinity, not-a-number) is null.
"""

from __future__ import annotations

import json
import math
import re
import unicodedata
from collections.abc import Iterable
from fractions import Fraction
from typing import Any

from barewire.codecs import Value, codec
from barewire.devices.parameter import Parameter, Reading

ONLINE, OFFLINE = "online", "offline"


def topic_part(name: str) -> str:
    """Return a name as a part of a topic: small letters, digits and underscores.

    >>> topic_part("Motor temperature (°C)"), topic_part("TARGET/VELOCITY +#")
    ('motor_temperature_c', 'target_velocity')
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "_", plain).strip("_") or "_"


def parameter_part(name: str) -> str:
    """Return the name of a parameter as a part of a topic, other than the two parts that each machine has.

    >>> parameter_part("Status"), parameter_part("Status Word")
    ('status_value', 'status_word')
    """
    part = topic_part(name)
    return f"{part}_value" if part in ("status", "description") else part


class Topics:
    """The topics of a site."""

    def __init__(self, site: str) -> None:
        self.root = f"barewire/{topic_part(site)}"
        self.status = f"{self.root}/status"
        self.commands = f"{self.root}/+/+/set"

    def machine(self, name: str) -> str:
        """Return the topic under which everything of a machine is."""
        return f"{self.root}/{topic_part(name)}"

    def machine_status(self, name: str) -> str:
        """Return the topic that says whether a machine responds."""
        return f"{self.machine(name)}/status"

    def parameter(self, machine: str, name: str) -> str:
        """Return the topic of a value."""
        return f"{self.machine(machine)}/{parameter_part(name)}"


def _json_value(value: Value) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value.hex() if isinstance(value, bytes) else value


def reading_payload(reading: Reading, at: float) -> str:
    """Return the payload of a reading, without what is known only when it is sent."""
    parameter = reading.parameter
    content: dict[str, Any] = {"value": _json_value(parameter.shortened(reading.value))}
    if parameter.unit:
        content["unit"] = parameter.unit
    if isinstance(reading.value, int) and (word := parameter.values.get(int(reading.value))) is not None:
        content["text"] = word
    return json.dumps({**content, "at": round(at, 3)}, ensure_ascii=False)


def with_sequence(payload: str, sequence: int, *, again: bool) -> str:
    """Return a payload with its number, and whether it was sent before.

    >>> with_sequence('{"value": 1}', 18, again=True)
    '{"value": 1, "sequence": 18, "again": true}'
    """
    return f'{payload[:-1]}, "sequence": {sequence}{", " + chr(34) + "again" + chr(34) + ": true" if again else ""}}}'


def description(machine: str, parameters: Iterable[Parameter], commands: Iterable[str]) -> str:
    """Return the retained description of a machine."""
    writable = set(commands)
    rows = [
        {
            "name": row.name,
            "topic": parameter_part(row.name),
            "type": row.type,
            "unit": row.unit,
            "minimum": row.minimum,
            "maximum": row.maximum,
            "values": {str(number): text for number, text in row.values.items()},
            "command": row.name in writable,
        }
        for row in parameters
    ]
    return json.dumps({"name": machine, "parameters": rows}, ensure_ascii=False)


def discovery(
    prefix: str, topics: Topics, machine: str, title: str, parameter: Parameter, *, is_command: bool
) -> tuple[str, str]:
    """Return topic and payload of the discovery of Home Assistant for one parameter, retained.

    https://www.home-assistant.io/integrations/mqtt: a sensor or a binary sensor; a command is a number, a switch or a
    text, or a button if there is only one value to write.

    The id is the topic with "-", which no part has, so two values have one id only if they have one topic.
    """
    state = topics.parameter(machine, parameter.name)
    identity = state.replace("/", "-")
    config: dict[str, Any] = {
        "name": parameter.name,
        "unique_id": identity,
        "availability": [{"topic": topics.status}, {"topic": topics.machine_status(machine)}],
        "availability_mode": "all",
        "device": {"identifiers": [topics.machine(machine).replace("/", "-")], "name": machine, "model": title},
    }
    if is_command:
        config["command_topic"] = f"{state}/set"
    low, high = _limits(parameter)
    if is_command and parameter.type != "bool" and low is not None and low == high:
        kind = "button"
        config["payload_press"] = json.dumps(low)
    else:
        config |= {"state_topic": state, "value_template": "{{ value_json.value }}"}
        if parameter.type == "bool":
            kind = "switch" if is_command else "binary_sensor"
            config["value_template"] = "{{ 'true' if value_json.value else 'false' }}"
            config |= {"payload_on": "true", "payload_off": "false"}
            config |= {"state_on": "true", "state_off": "false"} if is_command else {}
        elif is_command and parameter.type == "text":
            kind = "text"
            config["command_template"] = "{{ value | tojson }}"
        else:
            kind = "number" if is_command else "sensor"
            config |= {"unit_of_measurement": parameter.unit} if parameter.unit else {}
            config |= {"min": low, "max": high, "step": _step(parameter), "mode": "box"} if is_command else {}
    return f"{prefix}/{kind}/{identity}/config", json.dumps(config, ensure_ascii=False)


def _limits(parameter: Parameter) -> tuple[float | None, float | None]:
    """Return the lowest and the highest value, those of the type where the description has none; None for no number."""
    if parameter.type in ("bool", "text"):
        return None, None
    number = codec(parameter.type)
    low = number.minimum * parameter.scale if parameter.minimum is None else parameter.minimum
    high = number.maximum * parameter.scale if parameter.maximum is None else parameter.maximum
    return _exact(low), _exact(high)


def _step(parameter: Parameter) -> float:
    """Return between which values a number can be typed. Home Assistant takes no step below 0.001."""
    return 0.001 if codec(parameter.type).is_float else max(0.001, float(parameter.scale))


def _exact(limit: float | Fraction) -> float:
    """Return a limit that a browser, which counts to 2**53, takes as it is: a whole number without a point."""
    near = max(-(2**53), min(limit, 2**53))
    return int(near) if near == int(near) else float(near)
