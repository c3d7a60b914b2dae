"""`node.sdo`: the objects of a node, by index and sub-index.   [CiA 301, SDO]

    node.sdo.upload(0x6041)                            b"7\\x06": the bytes, little-endian
    node.sdo.download(0x60FF, 0, (1500).to_bytes(4, "little"))
    node.sdo.read_object(objects, "speed")             1500: the value, in the type that a dictionary gives it
    node.sdo.over(node.sdo.find_channel(2))            the same methods, on another SDO server of the node

The time-out is that of the node where a call gives none. A download is never repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from barewire import canopen
from barewire._callbacks import check_callbacks, check_function
from barewire.canopen import download, upload, upload_to
from barewire.canopen.sdo.client import encoded_value, find_channel, read_object
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.canopen.sdo.plain import PlainDownload, PlainUpload, plain_read
from barewire.canopen.sdo.stream import LIMIT
from barewire.errors import EncodeError
from barewire.io.canopen.methods.operations import AnyOperation, BusOperation, Methods, R, operation, sdo_transfer

if TYPE_CHECKING:
    from barewire.canopen.object_dictionary import ObjectDictionary, ObjectRef
    from barewire.canopen.sdo.channel import Channel
    from barewire.canopen.sdo.client import BlockMode
    from barewire.canopen.sdo.stream import SdoProgress
    from barewire.codecs import Value


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
