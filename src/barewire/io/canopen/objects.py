"""`node.sdo` and `node.pdo`: the objects of a node, by index and sub-index, and its process data.   [CiA 301, SDO, PDO]

    node.sdo.upload(0x6041)                            b"7\\x06": the bytes, little-endian
    node.sdo.download(0x60FF, 0, (1500).to_bytes(4, "little"))
    node.sdo.read_object(objects, "speed")             1500: the value, in the type that a dictionary gives it
    node.sdo.over(node.sdo.find_channel(2))            the same methods, on another SDO server of the node

    rpdo = node.pdo.remote("RPDO", 1)                  the PDO as it is configured in the node, with names
    node.pdo.send(rpdo, {"controlword": 15})
    node.pdo.receive(tpdo1, tpdo2)                     a stream of named values
    node.pdo.read_config("TPDO", 1)                    PdoConfig('TPDO', 1, (0x60410010,), type=1, cob_id=0x185)
    node.pdo.write_config(PdoConfig("TPDO", 1, (0x60410010,), type=1))              in the safe order

The time-out is that of the node where a call gives none. A download is never repeated. The names of PDOs are those of
the device or the EDS of the node, or of `objects`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from barewire import canopen
from barewire._callbacks import check_callbacks, check_function
from barewire.canopen import download, upload, upload_to
from barewire.canopen.sdo.client import encoded_value, find_channel, read_object
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.canopen.sdo.plain import PlainDownload, PlainUpload, plain_read
from barewire.canopen.sdo.stream import LIMIT
from barewire.errors import EncodeError, shown
from barewire.io.canopen.operations import (
    AnyOperation,
    BusOperation,
    Methods,
    R,
    Subscription,
    operation,
    sdo_transfer,
    send_frame,
    subscription,
)

if TYPE_CHECKING:
    from barewire.canopen import PdoConfig, PdoConfigPolicy, PdoReceived, RemotePdo
    from barewire.canopen.object_dictionary import ObjectDictionary, ObjectRef
    from barewire.canopen.pdo.config import PdoDirection
    from barewire.canopen.sdo.channel import Channel
    from barewire.canopen.sdo.client import BlockMode
    from barewire.canopen.sdo.stream import SdoProgress
    from barewire.codecs import Value
    from barewire.devices.device import Device


_TYPES = ("u8", "i8", "u16", "i16", "u32", "i32", "f32")
"""The types that an object in a PDO can have."""


class SdoMethods(Methods[R]):
    """SDO transfers with one node, on its default SDO server or on the one of `channel`."""

    def __init__(
        self, runner: R, node: int, *, timeout: float, dialect: SdoDialect, channel: Channel | None = None
    ) -> None:
        super().__init__(runner)
        self.node = node
        self.timeout = timeout
        self.dialect = dialect
        self._channel = channel

    @property
    def channel(self) -> Channel:
        """The channel of these transfers. The bus keeps it, to recognize late responses of earlier transfers."""
        channel = self._channel
        if channel is None:
            channel = self._channel = self.runner.bus.channel(self.node, self.dialect, self.timeout)
            channel.retries = max(channel.retries, self.runner.retries)
        return channel

    def over(self, channel: Channel) -> SdoMethods[R]:
        """Return the same methods on another channel, see `find_channel`."""
        return SdoMethods(self.runner, self.node, timeout=self.timeout, dialect=self.dialect, channel=channel)

    @operation
    def upload(
        self,
        index: int,
        sub: int = 0,
        *,
        size: int | None = None,
        block: BlockMode = False,
        limit: int | None = LIMIT,
        progress: SdoProgress | None = None,
        timeout: float | None = None,
    ) -> AnyOperation[bytes]:
        """Read an object, and return its bytes, little-endian.

        size        the number of bytes that the type of the object has, for servers that do not report it
        block       a block transfer: True, False, "auto" or a `BlockSettings`
        limit       the number of bytes above which the value is refused, None for any; by default 16 MiB
        progress    called as progress(done, size) with numbers of bytes
        timeout     seconds that each response may take; by default the node's

        Raises SdoAbort, NoAnswer, PortError.
        """
        channel = self._channel or self.channel
        wait = self.timeout if timeout is None else timeout
        if block is False and progress is None:
            return PlainUpload(channel, index, sub, wait, size, limit, bytes)
        check_callbacks("upload", progress=progress)
        options: dict[str, Any] = {"size": size, "block": block, "limit": limit, "progress": progress, "timeout": wait}
        return sdo_transfer(channel, upload(channel, index, sub, **options), wait)

    @operation
    def upload_to(
        self,
        index: int,
        sub: int,
        sink: Callable[[bytes], object],
        *,
        block: BlockMode = "auto",
        progress: SdoProgress | None = None,
        timeout: float | None = None,
    ) -> BusOperation[int]:
        """Read an object of any length, call `sink` with each piece, and return the number of bytes."""
        check_function("upload_to: sink", sink, "sink")
        check_callbacks("upload_to", progress=progress)
        channel, wait = self.channel, self._wait(timeout)
        options: dict[str, Any] = {"block": block, "progress": progress, "timeout": wait}
        return sdo_transfer(channel, upload_to(channel, index, sub, sink, **options), wait)

    @operation
    def download(
        self,
        index: int,
        sub: int,
        data: bytes | Iterable[bytes],
        *,
        size: int | None = None,
        block: BlockMode = False,
        progress: SdoProgress | None = None,
        timeout: float | None = None,
    ) -> AnyOperation[None]:
        """Write an object, once.

        data        its bytes, little-endian, as many as its type has; or pieces, which are taken as they are sent
        size        the number of bytes of all pieces, if it is known
        block, progress, timeout      as those of `upload`
        """
        channel, wait = self.channel, self._wait(timeout)
        if type(data) is bytes and 1 <= len(data) <= 4 and block in (False, "auto") and progress is None:
            return PlainDownload(channel, index, sub, wait, data)
        check_callbacks("download", progress=progress)
        options: dict[str, Any] = {"size": size, "block": block, "progress": progress, "timeout": wait}
        return sdo_transfer(channel, download(channel, index, sub, data, **options), wait)

    @operation
    def find_channel(self, server: int, *, timeout: float | None = None) -> BusOperation[canopen.Channel]:
        """Read the channel of a further SDO server from the node, for `over`. Server 1 is the default server."""
        channel, wait = self.channel, self._wait(timeout)
        return sdo_transfer(channel, find_channel(channel, server, timeout=wait), wait)

    @operation
    def read_object(
        self, objects: ObjectDictionary, place: ObjectRef, *, block: BlockMode = False, timeout: float | None = None
    ) -> AnyOperation[Value]:
        """Read the value of an object that `objects` has by name, by index, or by (index, sub-index)."""
        return read_by_name(self.channel, checked_dictionary(objects), place, block, self._wait(timeout))

    @operation
    def write_object(
        self,
        objects: ObjectDictionary,
        place: ObjectRef,
        value: Value,
        *,
        block: BlockMode = False,
        timeout: float | None = None,
    ) -> AnyOperation[None]:
        """Write the value of an object, once, in the type that `objects` has for it."""
        return write_by_name(self.channel, checked_dictionary(objects), place, value, block, self._wait(timeout))

    def _wait(self, timeout: float | None) -> float:
        return self.timeout if timeout is None else timeout


def read_by_name(
    channel: Channel, objects: ObjectDictionary, place: ObjectRef, block: BlockMode, timeout: float
) -> AnyOperation[Value]:
    """Return the operation that reads the value of an object of a dictionary."""
    if block is False:
        return plain_read(channel, objects.at(place), timeout)
    return sdo_transfer(channel, read_object(channel, objects, place, block=block, timeout=timeout), timeout)


def write_by_name(
    channel: Channel, objects: ObjectDictionary, place: ObjectRef, value: Value, block: BlockMode, timeout: float
) -> AnyOperation[None]:
    """Return the operation that writes the value of an object of a dictionary."""
    entry = objects.at(place)
    data = encoded_value(entry, value)
    if 1 <= len(data) <= 4 and block in (False, "auto"):
        return PlainDownload(channel, entry.index, entry.sub, timeout, data)
    writing = download(channel, entry.index, entry.sub, data, block=block, timeout=timeout)
    return sdo_transfer(channel, writing, timeout)


def checked_dictionary(objects: object) -> ObjectDictionary:
    """Return an ObjectDictionary as it is. For anything else raise EncodeError, with the method for descriptions."""
    from barewire.canopen.object_dictionary import ObjectDictionary

    if not isinstance(objects, ObjectDictionary):
        raise EncodeError(
            f"{objects!r} is not an ObjectDictionary; a described device is read by name: bus.node(5, device=...).read"
        )
    return objects


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
