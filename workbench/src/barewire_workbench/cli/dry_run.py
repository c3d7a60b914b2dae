"""`barewire write --dry-run`: what would be written, where, and in which frames; nothing is sent.

Target Velocity = 1500 step/s, would be written: raw 05DC 0000 to holding:1017-1018
would send  00 01 00 00 00 0B 01 10 03 F9 00 02 04 05 DC 00 00  valid: a request to unit 1, ...        with --frames
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

from barewire.codecs import Value
from barewire.conversation import Heard, Listen
from barewire.devices import Device, Parameter
from barewire.io.endpoint import Endpoint

if TYPE_CHECKING:
    from barewire.modbus.client.bus import Bus
    from barewire.modbus.messages.base import Request


def address_text(parameter: Parameter, *, is_can: bool) -> str:
    """Return the address of a parameter in the form that a NAME may have, with the part that it is.

    >>> from barewire import load
    >>> [address_text(load("az3").find(name), is_can=False) for name in ("TARGET VELOCITY", "BRAKE 1 POW VALUE")]
    ['holding:156-157', 'the high byte of holding:265']
    >>> address_text(load("az3").find("TARGET VELOCITY"), is_can=True)
    'object:60FFh'
    """
    if is_can:
        assert parameter.object is not None
        sub = f".{parameter.object.sub:X}" if parameter.object.sub else ""
        bit = "" if parameter.object.bit is None else f"bit {parameter.object.bit} of "
        return f"{bit}object:{parameter.object.index:04X}h{sub}"
    place = parameter.modbus
    assert place is not None
    last = f"-{place.address + place.words - 1}" if place.words > 1 else ""
    part = "" if place.half is None else f"the {'low' if place.half == 'L' else 'high'} byte of "
    part = part if place.bit is None else f"bit {place.bit} of "
    return f"{part}{place.table}:{place.address}{last}"


def raw_text(parameter: Parameter, value: Value, *, is_can: bool) -> str:
    """Return what is on the wire for a value: registers, or bytes in their order, in hexadecimal.

    >>> from barewire import load
    >>> target = load("az3").find("TARGET VELOCITY")
    >>> raw_text(target, 1500, is_can=False), raw_text(target, 1500, is_can=True)
    ('05DC 0000', 'DC 05 00 00')
    """
    place = parameter.object if is_can else parameter.modbus
    if place is not None and (place.bit is not None or parameter.type == "bool"):
        return str(int(bool(value)))
    if is_can:
        return parameter.to_object(value).hex(" ").upper()
    if parameter.modbus is not None and parameter.modbus.half is not None:
        return f"{parameter.to_registers(value, [0])[0] >> (8 if parameter.modbus.half == 'H' else 0):02X}"
    return " ".join(f"{register:04X}" for register in parameter.to_registers(value))


def frames_of(endpoint: str, device: Device, values: Mapping[str, Value], *, force: bool) -> Iterator[Any]:
    """Yield the frames that write the values: bytes of Modbus, frames of a CAN bus. Where a part of a register or of an
    object is written, only the request that reads it: the next one depends on its answer. Of a transfer in segments,
    only the first."""
    place = Endpoint.parse(endpoint)
    if place.scheme == "can":
        yield from _can_frames(place, device, values, force)
        return
    from barewire.devices.modbus_access import write_modbus
    from barewire.io.modbus.carriers import modbus_line

    recorder = _Recorder()
    unit = place.integer("unit", device.modbus.unit if device.modbus else 1)
    for _ in write_modbus(cast("Bus", recorder), unit, device, values, force=force):
        pass
    line = modbus_line(place, "client")
    for request in recorder.requests:
        yield line.request(unit, request.encode())


@dataclass
class _Recorder:
    """In place of a bus: keeps requests instead of sending them."""

    requests: list[Request[Any]] = field(default_factory=list)
    _is_after_read: bool = False

    def ask(self, unit: int, request: Request[Any], **_: object) -> Generator[Any, Any, Any]:
        """Keep a request, unless it writes back what was read."""
        if not (self._is_after_read and request.writes):
            self.requests.append(request)
        self._is_after_read = not request.writes
        return SimpleNamespace(registers=(0,))
        yield  # not reached: makes this a conversation


def _can_frames(place: Endpoint, device: Device, values: Mapping[str, Value], force: bool) -> Iterator[Any]:
    from barewire.devices.canopen_access import write_canopen
    from barewire.devices.sdo_dialects import DIALECTS

    assert device.canopen is not None
    node = place.integer("node", device.canopen.node)
    for name, value in values.items():
        conversation = write_canopen(node, device, {name: value}, dialect=DIALECTS[device.canopen.dialect], force=force)
        step = next(conversation)
        while isinstance(step, Listen):  # for what may still arrive: nothing
            step = conversation.send(Heard(None, step.until))
        conversation.close()
        yield from step.items
