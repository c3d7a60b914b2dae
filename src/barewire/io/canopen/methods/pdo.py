"""`node.pdo`: the process data of a node.   [CiA 301, PDO]

    rpdo = node.pdo.remote("RPDO", 1)                  the PDO as it is configured in the node, with names
    node.pdo.send(rpdo, {"controlword": 15})
    node.pdo.receive(tpdo1, tpdo2)                     a stream of named values
    node.pdo.read_config("TPDO", 1)                    PdoConfig('TPDO', 1, (0x60410010,), type=1, cob_id=0x185)
    node.pdo.write_config(PdoConfig("TPDO", 1, (0x60410010,), type=1))              in the safe order

The names are those of the device or the EDS of the node, or of `objects`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from barewire import canopen
from barewire.errors import EncodeError, shown
from barewire.io.canopen.methods.operations import (
    BusOperation,
    Methods,
    R,
    Subscription,
    operation,
    sdo_transfer,
    send_frame,
    subscription,
)
from barewire.io.canopen.methods.sdo import SdoMethods

if TYPE_CHECKING:
    from barewire.canopen import ObjectDictionary, PdoConfig, PdoConfigPolicy, PdoReceived, RemotePdo
    from barewire.canopen.pdo.config import PdoDirection
    from barewire.codecs import Value
    from barewire.devices.device import Device

_TYPES = {"u8": 1, "i8": 1, "u16": 2, "i16": 2, "u32": 4, "i32": 4, "f32": 4}


def objects_of(names: ObjectDictionary | Device | None) -> ObjectDictionary | None:
    """Return the names and types for the objects in a PDO: a dictionary, or one made from a description."""
    if names is None or isinstance(names, canopen.ObjectDictionary):
        return names
    entries: dict[tuple[int, int], canopen.Entry] = {}
    for parameter in names.parameters:
        place = parameter.object
        if place is not None and place.bit is None and parameter.type in _TYPES:
            entry = canopen.Entry(place.index, place.sub, parameter.name, parameter.type)
            entries.setdefault((place.index, place.sub), entry)
    return canopen.ObjectDictionary(entries.values())


class PdoMethods(Methods[R]):
    """The process data of one node. `objects` has the names, where a call gives no others."""

    def __init__(self, sdo: SdoMethods[R], objects: ObjectDictionary | Device | None = None) -> None:
        super().__init__(sdo.runner)
        self._sdo = sdo
        self._objects = objects

    @operation
    def read_config(
        self, direction: PdoDirection, number: int, *, timeout: float | None = None
    ) -> BusOperation[PdoConfig]:
        """Read the configuration of one PDO from its records."""
        channel, wait = self._sdo.channel, self._wait(timeout)
        return sdo_transfer(channel, canopen.read_pdo(channel, direction, number, timeout=wait), wait)

    @operation
    def write_config(
        self, pdo: PdoConfig, *, policy: PdoConfigPolicy | None = None, timeout: float | None = None
    ) -> BusOperation[None]:
        """Configure a PDO in the safe order: off, the mapping, the times, on. The node should be pre-operational."""
        if not isinstance(pdo, canopen.PdoConfig):
            raise EncodeError(f"{shown(pdo)}: expected a PdoConfig")
        channel, wait, policy = self._sdo.channel, self._wait(timeout), policy or canopen.PdoConfigPolicy()
        writing = canopen.write_pdo(channel, pdo, policy=policy, timeout=wait)
        return sdo_transfer(channel, writing, wait)

    @operation
    def remote(
        self,
        direction: PdoDirection,
        number: int,
        *,
        objects: ObjectDictionary | Device | None = None,
        timeout: float | None = None,
    ) -> BusOperation[RemotePdo]:
        """Read the configuration of one PDO, and return the PDO with names for its objects."""
        channel, wait, names = self._sdo.channel, self._wait(timeout), objects_of(objects or self._objects)
        return sdo_transfer(channel, canopen.remote_pdo(channel, direction, number, names, timeout=wait), wait)

    @operation
    def send(self, pdo: RemotePdo, values: Mapping[str, Value]) -> BusOperation[None]:
        """Send an RPDO with these values by name. An object without a value is sent as 0."""
        if not isinstance(values, Mapping):
            raise EncodeError(f"{shown(values)}: expected a mapping of names to values")
        return send_frame(_checked(pdo).encode(values))

    @subscription
    def receive(self, *pdos: RemotePdo) -> Subscription[PdoReceived]:
        """Return a stream of the values of these PDOs, which may be those of several nodes."""
        return pdo_subscription(*pdos)

    def _wait(self, timeout: float | None) -> float:
        return self._sdo.timeout if timeout is None else timeout


def pdo_subscription(*pdos: RemotePdo) -> Subscription[PdoReceived]:
    """Return the subscription to the values of these PDOs."""
    listener = canopen.PdoConsumer(map(_checked, pdos))
    return Subscription(listener, frozenset(listener.sources))


def _checked(pdo: RemotePdo) -> RemotePdo:
    """Return the PDO. Raises EncodeError for any other object."""
    if not isinstance(pdo, canopen.RemotePdo):
        raise EncodeError(f'{shown(pdo)}: expected a RemotePdo, such as node.pdo.remote("TPDO", 1) returns')
    return pdo
