"""A parameter as JSON: the same row, for whoever does not speak Python. Addresses are those on the wire, from 0."""

from __future__ import annotations

from typing import Any

from barewire.devices.parameter import Parameter


def describe(parameter: Parameter) -> dict[str, Any]:
    """The parameter as a dict that `json.dumps` takes. Every key is always there; None is "not told" or "nowhere".

    >>> from barewire.devices import load
    >>> told = describe(load("az3").find("STATUS WORD"))
    >>> told["modbus"]
    {'table': 'input', 'address': 24, 'words': 1, 'half': None, 'bit': None, 'order': 'CDAB'}
    >>> told["object"], told["scale"], told["access"]
    ({'index': 24641, 'sub': 0, 'bit': None}, 1, 'ro')
    """
    scale, place = parameter.scale, parameter.object
    return {
        "name": parameter.name,
        "type": parameter.type,
        "unit": parameter.unit,
        "scale": float(scale) if scale.denominator != 1 else int(scale),
        "default": parameter.default,
        "min": parameter.minimum,
        "max": parameter.maximum,
        "access": parameter.access,
        "values": {str(number): text for number, text in parameter.values.items()},
        "firmware": parameter.firmware,
        "note": parameter.note,
        "modbus": None if parameter.modbus is None else parameter.modbus._asdict(),
        "object": None if place is None else {"index": place.index, "sub": place.sub, "bit": place.bit},
        "bits": {str(number): text for number, text in parameter.bits.items()},
        "storable": parameter.storable,
        "answered": parameter.answered,
        "printed": dict(parameter.printed),
    }
