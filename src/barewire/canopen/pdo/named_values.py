"""The PDOs of other devices as named values: sent to them, and heard of them.   [CiA 301, PDO]

        {"controlword": 15, "velocity": 25000}  --encode-->  205#0F00A8610000
        185#3706A8610000                        --decode-->  {"statusword": 0x0637, "velocity": 25000}

A `RemotePdo` is what `read_pdo` told (or what one knows anyway) with the names that a dictionary has for the objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Self

from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.pdo.config import PdoConfig, PdoDirection
from barewire.canopen.pdo.mapping import PdoMapping
from barewire.canopen.pdo.remote_config import mapping_of, read_pdo
from barewire.canopen.sdo.client.channel import Channel
from barewire.codecs import Value
from barewire.conversation import Conversation
from barewire.errors import DecodeError, EncodeError


@dataclass(frozen=True, slots=True)
class RemotePdo:
    """One PDO of one node, with names.

    >>> remote = RemotePdo.of(5, PdoConfig("RPDO", 1, (0x60400010,)))
    >>> str(remote.encode({"6040h:00": 15}))
    '205#0F00'
    """

    node: int
    pdo: PdoConfig
    mapping: PdoMapping
    key: tuple[int, bool]

    @classmethod
    def of(cls, node: int, pdo: PdoConfig, objects: ObjectDictionary | None = None) -> Self:
        """With the names and types of a dictionary. EncodeError if the PDO is switched off and has no identifier, or is
        multiplexed: then each of its frames says itself what it carries (`Mpdo`)."""
        entry = pdo.cob_entry(node)
        if pdo.multiplexed is not None:
            what = f"{pdo.direction}{pdo.number} of node {node} is a multiplexed PDO ({pdo.multiplexed})"
            raise EncodeError(f"{what}: it has no mapping, each frame names its object; Mpdo.decode reads one")
        if entry.bit31:
            raise EncodeError(f"{pdo.direction}{pdo.number} of node {node} is switched off")
        return cls(node, pdo, mapping_of(pdo, objects), (entry.identifier, entry.extended))

    def encode(self, values: Mapping[str, Value]) -> CanFrame:
        """The frame that carries these values. Raises EncodeError."""
        return CanFrame(self.key[0], self.mapping.pack(values), self.key[1])

    def decode(self, frame: CanFrame) -> dict[str, Value]:
        """The values in a frame of this PDO. Raises DecodeError."""
        if frame.key != self.key or frame.remote:
            raise DecodeError("mismatch", frame.data, 0, f"{frame} is not {self.pdo.direction}{self.pdo.number}")
        return self.mapping.unpack(frame.data)


def remote_pdo(
    channel: Channel,
    direction: PdoDirection,
    number: int,
    objects: ObjectDictionary | None = None,
    *,
    timeout: float = 1.0,
) -> Conversation[CanFrame, RemotePdo]:
    """Ask a device for one of its PDOs. Raises SdoAbort if it has none, EncodeError if it is switched off."""
    pdo = yield from read_pdo(channel, direction, number, timeout=timeout)
    return RemotePdo.of(channel.node, pdo, objects)


class PdoReceived(NamedTuple):
    """A PDO came. `values` is None if it has not the length that is mapped, and `why` says so."""

    source: RemotePdo
    values: dict[str, Value] | None
    data: bytes
    at: float
    why: str = ""


class PdoConsumer:
    """Listens to some PDOs. A machine.

    >>> listener = PdoConsumer([RemotePdo.of(5, PdoConfig("TPDO", 1, (0x60410010,)))])
    >>> [(event.source.node, event.values) for event in listener.feed(CanFrame.parse("185#3706"), 0.0)]
    [(5, {'6041h:00': 1591})]
    """

    __slots__ = ("sources",)

    def __init__(self, sources: Iterable[RemotePdo]) -> None:
        self.sources: dict[tuple[int, bool], RemotePdo] = {source.key: source for source in sources}

    @property
    def deadline(self) -> float | None:
        """None: it waits for nothing but PDOs."""
        return None

    def feed(self, frame: CanFrame | None, now: float) -> list[PdoReceived]:
        """The values, if the frame is one of these PDOs."""
        source = None if frame is None or frame.remote else self.sources.get(frame.key)
        if source is None or frame is None:
            return []
        try:
            return [PdoReceived(source, source.mapping.unpack(frame.data), frame.data, now)]
        except DecodeError as error:
            return [PdoReceived(source, None, frame.data, now, error.text)]
