"""Which device of the catalogue a unit or node is, by what it says about itself.

A description may have a table [identity], with what the device answers, for those that answer anything:

    server_id    function 11h: bytes in hexadecimal, ?? for any; more may follow          "?? ?? ?? ?? 05"
    texts        function 2B/0Eh: words that stand in the objects                         ["AZ3"]
    device_type  object 1000h; vendor, product: 1018h:01 and :02                          0x00020192

An empty table is that of a device which says nothing that its manual prints: it is known by not being another one.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from barewire.devices import Device, load, names
from barewire.errors import EncodeError, shown

_KEYS = ("server_id", "texts", "device_type", "vendor", "product")

_QUESTIONS = {"server_id": "function 11h", "texts": "function 2B/0Eh"}
"""What a unit may refuse, and what that is called."""

_PROFILE = 0xFFFF
"""The bits of 1000h with the device profile."""
_DRIVES = 402
_PROFILES = {
    401: "inputs and outputs",
    _DRIVES: "drives",
    404: "measuring devices",
    405: "programmable controllers",
    406: "encoders",
    408: "hydraulic valves",
    410: "inclinometers",
    418: "batteries",
    419: "battery chargers",
}
"""Device profiles of CiA, the low word of 1000h; 0 is a device without a profile."""


@dataclass(slots=True)
class DeviceIdentity:
    """What a unit or node says about itself; what it does not answer is empty.

    texts       the objects of 2B/0Eh by name; of a node 1008h, 1009h and 100Ah
    server_id   the data of function 11h
    numbers     of a node: device_type, vendor, product, revision, serial
    """

    texts: dict[str, str] = field(default_factory=dict)
    server_id: bytes = b""
    numbers: dict[str, int] = field(default_factory=dict)

    def __str__(self) -> str:
        """What is known, in words.

        >>> str(DeviceIdentity({"VendorName": "TEM", "ProductCode": "AZ3"}, numbers={"device_type": 0x20192}))
        'TEM AZ3, profile 402 (drives)'
        """
        words = (_words(text) for text in self.texts.values())
        parts = [" ".join(word for word in words if word)]
        if self.server_id:
            parts.append(f"server ID {self.server_id.hex(' ').upper()}")
        if "device_type" in self.numbers:
            parts.append(profile_text(self.numbers["device_type"]))
        parts += [f"{name} {number:08X}h" for name, number in self.numbers.items() if name != "device_type" and number]
        return ", ".join(part for part in parts if part)

    def as_dict(self) -> dict[str, object]:
        """What is known, for JSON."""
        server_id = {"server_id": self.server_id.hex(" ").upper()} if self.server_id else {}
        return {**self.texts, **server_id, **self.numbers}


def _words(text: str) -> str:
    # Without control characters: devices fill the end of their texts with zeros.
    return "".join(letter for letter in text if letter.isprintable()).strip()


def profile_text(device_type: int) -> str:
    """Return the profile of object 1000h in words.   [CiA 301 7.5.2.1]

    >>> profile_text(0x0002_0192), profile_text(0), profile_text(0x1F0)
    ('profile 402 (drives)', 'no device profile', 'profile 496')
    """
    number = device_type & _PROFILE
    if number == 0:
        return "no device profile"
    return f"profile {number}" + (f" ({_PROFILES[number]})" if number in _PROFILES else "")


def known_devices(descriptions: Iterable[str] = ()) -> list[Device]:
    """Return the devices with an identity: those of the catalogue, and those of `descriptions`. Raises EncodeError for
    a table [identity] that is not as described above."""
    devices = [load(name) for name in (*names(), *descriptions)]
    known = [device for device in devices if "identity" in device.extra]
    for device in known:
        check_identity_table(device)
    return known


def device_of(identity: DeviceIdentity, devices: Iterable[Device]) -> Device | None:
    """Return the device that gives these answers; None if none does.

    >>> device_of(DeviceIdentity(server_id=bytes.fromhex("0102000005000000")), known_devices()).name
    'adxl'
    >>> device_of(DeviceIdentity({"VendorName": "TEM", "ProductCode": "AZ3"}), known_devices()).name
    'az3'
    """
    return next((device for device in devices if _fits(identity, device.extra["identity"])), None)


def contradiction(identity: DeviceIdentity, refused: Collection[str], device: Device) -> str:
    """Return why a unit or node that says this is another device, in words; empty if nothing speaks against it.

    `refused` has the keys of the questions that it does not know (exception 01).

    >>> from barewire import load
    >>> contradiction(DeviceIdentity({"VendorName": "TEM", "ProductCode": "AZ3"}), (), load("adxl"))
    'it says TEM AZ3 (az3: TEM AZ3 servo drive)'
    >>> contradiction(DeviceIdentity(), ["texts"], load("az3"))
    'it refuses function 2B/0Eh, which az3 answers'
    """
    wanted = device.extra["identity"]
    verdicts = _verdicts(identity, wanted)
    profile = identity.numbers.get("device_type", 0) & _PROFILE
    if device.drive is not None and profile not in (0, _DRIVES):
        verdicts.append(False)
    if verdicts and all(verdicts):
        return ""
    other = device_of(identity, known_devices()) if str(identity) else None
    if other is not None and other.name == device.name:
        other = None
    if not all(verdicts) or other is not None:
        return f"it says {identity}" + (f" ({other.name}: {other.title})" if other is not None else "")
    return "".join(
        f"it refuses {question}, which {device.name} answers"
        for key, question in _QUESTIONS.items()
        if key in wanted and key in refused
    )


def _fits(identity: DeviceIdentity, wanted: Mapping[str, Any]) -> bool:
    """Whether everything that the unit has told is as wanted, and it has told something that is wanted."""
    verdicts = _verdicts(identity, wanted)
    return bool(verdicts) and all(verdicts)


def _verdicts(identity: DeviceIdentity, wanted: Mapping[str, Any]) -> list[bool]:
    """Return for each thing that is wanted, and that the unit has told, whether it is as wanted."""
    verdicts = []
    if "server_id" in wanted and identity.server_id:
        pattern = wanted["server_id"].split()
        told = identity.server_id.hex(" ").upper().split()
        fits = all(byte in ("??", value) for byte, value in zip(pattern, told))
        verdicts.append(len(told) >= len(pattern) and fits)
    if "texts" in wanted and identity.texts:
        text = " ".join(identity.texts.values()).upper()
        verdicts.append(all(word.upper() in text for word in wanted["texts"]))
    verdicts += [
        identity.numbers[key] == wanted[key]
        for key in ("device_type", "vendor", "product")
        if key in wanted and key in identity.numbers
    ]
    return verdicts


def check_identity_table(device: Device) -> None:
    """Raise EncodeError if the table [identity] of a description is not as described above."""
    table = device.extra["identity"]
    if not isinstance(table, Mapping):
        raise EncodeError(f"{device.name}: identity: expected a table with {', '.join(_KEYS)}")
    for key, value in table.items():
        if key not in _KEYS:
            raise EncodeError(f"{device.name}: [identity] {shown(key)}: expected {', '.join(_KEYS)}")
        if key == "server_id":
            fits, expected = isinstance(value, str) and all(map(_is_byte, value.split())), 'bytes such as "?? 05"'
        elif key == "texts":
            fits = isinstance(value, list) and all(isinstance(word, str) for word in value)
            expected = "a list of texts"
        else:
            fits, expected = type(value) is int, "a number"
        if not fits:
            raise EncodeError(f"{device.name}: [identity] {key} = {shown(value)}: expected {expected}")


def _is_byte(text: str) -> bool:
    return text == "??" or (len(text) == 2 and all(digit in "0123456789ABCDEF" for digit in text))
