"""Reading and writing by name over CANopen: conversations with the SDO server of a node, with values in the unit.

    ["STATUS WORD", "DC BUS"]      names
        | find, access, range      all of the call, before anything is sent: UnknownName, EncodeError
        | upload, download         one transfer for each object
        v decode                   [Reading("STATUS WORD", 0x0637), Reading("DC BUS", 320.0)]   in this order

One bit of an object is read, changed and written back, as parts of registers are; `force` is as on Modbus.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from barewire.canopen import CanFrame, Channel, SdoDialect, download, fit, upload
from barewire.canopen.sdo.channel import channel_to
from barewire.codecs import Value
from barewire.conversation import DEFAULT_TIMEOUT, Conversation, Listen
from barewire.devices.device import Device
from barewire.devices.parameter import ObjectAt, Parameter, Reading
from barewire.devices.request_checks import (
    NameOrParameter,
    ValuesByName,
    may_not_answer,
    naming,
    reading_note,
    to_read,
    to_write,
    writing,
)
from barewire.errors import BarewireError, EncodeError


def read_canopen(
    node: int | Channel,
    device: Device,
    names: Iterable[NameOrParameter],
    *,
    timeout: float = DEFAULT_TIMEOUT,
    dialect: SdoDialect | None = None,
) -> Conversation[CanFrame, list[Reading]]:
    """Read parameters of `node`, which is a `device`: one Reading for each name, in the order of the names.

    `node` is a node-ID or a channel to it; `dialect` is that of the standard if it is not given; `timeout` (seconds) is
    that of each transfer. Several bits of one object are one transfer.

    Raises at once UnknownName, and EncodeError for a parameter that is write only or not on CANopen. The conversation
    raises the errors of `upload`, and DecodeError.
    """
    placed = [(parameter, _object(device, parameter)) for parameter in to_read(device, names)]
    return _read_canopen(channel_to(node, dialect), placed, timeout)


def _read_canopen(
    channel: Channel, placed: Sequence[tuple[Parameter, ObjectAt]], timeout: float
) -> Conversation[CanFrame, list[Reading]]:
    contents: dict[tuple[int, int, int | None], bytes] = {}  # several bits of one object are one transfer
    readings = []
    for parameter, place in placed:
        key = (place.index, place.sub, parameter.object_size)
        if key not in contents:
            try:
                contents[key] = yield from _upload(channel, parameter, place, timeout)
            except BarewireError as error:
                error.add_context(reading_note([parameter]))
                raise
        readings.append(Reading(parameter, parameter.from_object(contents[key])))
    return readings


def write_canopen(
    node: int | Channel,
    device: Device,
    values: ValuesByName,
    *,
    timeout: float = DEFAULT_TIMEOUT,
    dialect: SdoDialect | None = None,
    force: bool = False,
) -> Conversation[CanFrame, None]:
    """Write parameters of `node`, which is a `device`, one after the other in the order of `values`.

    Raises at once UnknownName, and EncodeError for a parameter that is read only, out of range or not on CANopen. The
    conversation raises the errors of `download`, with a note of what was written before.
    """
    writes: list[tuple[Parameter, ObjectAt, Value]] = []
    for parameter, value in to_write(device, values, force):
        place = _object(device, parameter)
        with naming(parameter, value):  # encoded once before anything is sent: no value is refused after others
            parameter.to_object(value, bytes(2))
        if place.bit is not None and not parameter.readable and not force:
            raise EncodeError(f"{parameter.name} is one bit of an object that cannot be read: the rest would be lost")
        writes.append((parameter, place, value))
    return _write_canopen(channel_to(node, dialect), writes, timeout)


def _write_canopen(
    channel: Channel, writes: Sequence[tuple[Parameter, ObjectAt, Value]], timeout: float
) -> Conversation[CanFrame, None]:
    done: list[str] = []
    for parameter, place, value in writes:
        with writing([parameter], done):
            old = b""
            if place.bit is not None:
                old = yield from _upload(channel, parameter, place, timeout)
            data = parameter.to_object(value, old)
            if channel.dialect.lengths == "in four":
                data = data.ljust(4, b"\0")
            with may_not_answer([parameter]):
                yield from download(channel, place.index, place.sub, data, timeout=timeout)
        done.append(parameter.name)


def _upload(channel: Channel, parameter: Parameter, place: ObjectAt, timeout: float) -> Conversation[CanFrame, bytes]:
    """Upload the object, and return as many bytes as the type has."""
    size = parameter.object_size
    data = yield from upload(channel, place.index, place.sub, timeout=timeout, size=size)
    # If only one bit of an object is described, its size is assumed, so nothing is cut off.
    return data if place.bit is not None or size is None else fit(data, size)


def _object(device: Device, parameter: Parameter) -> ObjectAt:
    """Return the object of a parameter. Raises EncodeError, with its Modbus address, if it has none."""
    if parameter.object is None or device.canopen is None:
        where = parameter.modbus
        elsewhere = f"it is {where.table} {where.address} on Modbus (from 0)" if where else "it has no other address"
        raise EncodeError(f"{parameter.name} has no object on CANopen: {elsewhere}", parameter.name)
    return parameter.object


class CanopenAccess:
    """Access to the drive at the other end of an SDO channel."""

    def __init__(self, channel: Channel, device: Device, *, timeout: float = DEFAULT_TIMEOUT) -> None:
        self.channel, self.device, self.timeout = channel, device, timeout

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.device.name}, {self.channel!r}>"

    def read(self, names: Sequence[str]) -> Conversation[CanFrame, list[Reading]]:
        """Read with one upload for each object."""
        return read_canopen(self.channel, self.device, names, timeout=self.timeout)

    def write(self, values: Mapping[str, Value]) -> Conversation[CanFrame, None]:
        """Check all values, then write them."""
        return write_canopen(self.channel, self.device, values, timeout=self.timeout)

    def wait(self, until: float) -> Conversation[CanFrame, float]:
        """Wait, and pass received frames to the channel."""
        while True:
            received = yield Listen(until)
            if received.item is not None:
                self.channel.receive(received.item)
            if received.now >= until:
                return received.now
