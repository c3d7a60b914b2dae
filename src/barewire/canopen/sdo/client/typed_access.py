"""Read and write the objects of another device as values: an object dictionary gives their names and types.   [CiA 301]

        "speed"  --find-->  60FFh:00 i32        DC 05 00 00  <--encode--  1500        write_object
                                                DC 05 00 00  --decode-->  1500        read_object

The dictionary may be your own, or come from an EDS. The device checks access rights and limits, and refuses by an abort
code. Only a value that the type cannot have is refused here, before anything is sent.
"""

from __future__ import annotations

from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import Entry, ObjectDictionary, ObjectRef
from barewire.canopen.sdo import Channel, SdoDialect, download, upload
from barewire.canopen.sdo.client.block_options import BlockMode
from barewire.canopen.sdo.client.plain import NotPlain, UploadExchange
from barewire.canopen.sdo.stream import LIMIT
from barewire.codecs import Value
from barewire.conversation import DEFAULT_TIMEOUT, Conversation
from barewire.errors import DecodeError, EncodeError


def read_object(
    node: int | Channel,
    objects: ObjectDictionary,
    place: ObjectRef,
    *,
    timeout: float = DEFAULT_TIMEOUT,
    dialect: SdoDialect | None = None,
    block: BlockMode = False,
) -> Conversation[CanFrame, Value]:
    """Read the value of an object, given by its name, its index, or (index, sub-index).

    >>> from barewire.canopen.object_dictionary import Entry
    >>> from barewire.conversation import play
    >>> objects = ObjectDictionary([Entry(0x60FF, 0, "speed", "i32")])
    >>> server = lambda frame, now: [(now + 0.001, CanFrame.parse("585#43FF600024FAFFFF"))]
    >>> play(read_object(5, objects, "speed"), server)
    (-1500, 0.001)

    Raise EncodeError for an object that the dictionary does not have; in the conversation SdoAbort, NoAnswer, and
    DecodeError for bytes that are not a value of the type.
    """
    entry = objects.at(place)
    size = entry.codec.size
    transfer = upload(node, entry.index, entry.sub, size=size, timeout=timeout, dialect=dialect, block=block)

    return _decoded(entry, transfer)


def _decoded(entry: Entry, transfer: Conversation[CanFrame, bytes]) -> Conversation[CanFrame, Value]:
    data = yield from transfer
    return _value_of(entry, data)


def _value_of(entry: Entry, data: bytes) -> Value:
    try:
        return entry.codec.decode(data)
    except DecodeError as error:
        error.add_note(f"{entry.name} is {entry.type} in the dictionary, but the device sent this")
        raise


class PlainRead(UploadExchange[Value]):
    """The same as `read_object`, without a conversation as long as nothing irregular happens."""

    __slots__ = ("entry",)

    def __init__(self, channel: Channel, entry: Entry, timeout: float) -> None:
        super().__init__(channel, entry.index, entry.sub, timeout, entry.codec.size, LIMIT)
        self.entry = entry

    def answer_in(self, frame: CanFrame) -> Value | NotPlain:
        """Return the value, if the frame is an expedited response with a size. Raise DecodeError if it has the bytes of
        another type."""
        data = self._value_in(frame)
        return data if isinstance(data, NotPlain) else _value_of(self.entry, data)

    def whole(self) -> Conversation[CanFrame, Value]:
        """Return the conversation of the read."""
        return _decoded(self.entry, self._upload())

    def rest(self, sent_at: float) -> Conversation[CanFrame, Value]:
        """Return the conversation of the read from the point where it listens."""
        return _decoded(self.entry, self._rest_of_upload(sent_at))


def write_object(
    node: int | Channel,
    objects: ObjectDictionary,
    place: ObjectRef,
    value: Value,
    *,
    timeout: float = DEFAULT_TIMEOUT,
    dialect: SdoDialect | None = None,
    block: BlockMode = False,
) -> Conversation[CanFrame, None]:
    """Write a value to an object. Raise EncodeError at once for a value that its type cannot have."""
    entry = objects.at(place)
    data = encoded_value(entry, value)
    return download(node, entry.index, entry.sub, data, timeout=timeout, dialect=dialect, block=block)


def encoded_value(entry: Entry, value: Value) -> bytes:
    """Return the bytes of a value of this object. Raise EncodeError for a value that its type cannot have."""
    try:
        return entry.codec.encode(value)
    except EncodeError as error:
        raise EncodeError(f"{entry.name}: {error}", entry.name) from None
