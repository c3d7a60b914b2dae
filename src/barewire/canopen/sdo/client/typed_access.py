"""Read and write the objects of another device as values: an object dictionary gives their names and types.   [CiA 301]

        "speed"  --find-->  60FFh:00 i32        DC 05 00 00  <--encode--  1500        write_object
                                                DC 05 00 00  --decode-->  1500        read_object

The dictionary may be your own, or come from an EDS. The device checks access rights and limits, and refuses by an abort
code. Only a value that the type cannot have is refused here, before anything is sent.
"""

from __future__ import annotations

from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectDictionary, ObjectRef
from barewire.canopen.sdo import Channel, SdoDialect, download, upload
from barewire.canopen.sdo.client.block_options import BlockMode
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

    def reading() -> Conversation[CanFrame, Value]:
        data = yield from transfer
        try:
            return entry.codec.decode(data)
        except DecodeError as error:
            error.add_note(f"{entry.name} is {entry.type} in the dictionary, but the device sent this")
            raise

    return reading()


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
    try:
        data = entry.codec.encode(value)
    except EncodeError as error:
        raise EncodeError(f"{entry.name}: {error}", entry.name) from None
    return download(node, entry.index, entry.sub, data, timeout=timeout, dialect=dialect, block=block)
