"""The PDOs of other devices as named values, sent and received.   [CiA 301, PDO]

        {"controlword": 15, "velocity": 25000}  --encode-->  205#0F00A8610000
        185#3706A8610000                        --decode-->  {"statusword": 0x0637, "velocity": 25000}

A `RemotePdo` is a PDO configuration (read by `read_pdo`, or known) with the names of its objects in a dictionary.
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
from barewire.canopen.sdo.channel import Channel
from barewire.codecs import Value
from barewire.conversation import DEFAULT_TIMEOUT, Conversation
from barewire.errors import DecodeError, EncodeError


@dataclass(frozen=True, slots=True)
class RemotePdo:
    """One PDO of another node, with the names of its objects.

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
        """Make one from a configuration, with the names and types of a dictionary.

        Raise EncodeError if the PDO is switched off, or multiplexed: then each frame names its object (`Mpdo`).
        """
        entry = pdo.cob_entry(node)
        if pdo.multiplexed is not None:
            raise EncodeError(
                f"{pdo.direction}{pdo.number} of node {node} is a multiplexed PDO ({pdo.multiplexed}): "
                "it has no mapping, each frame names its object; Mpdo.decode reads one"
            )
        if entry.bit31:
            raise EncodeError(f"{pdo.direction}{pdo.number} of node {node} is switched off")
        return cls(node, pdo, mapping_of(pdo, objects), (entry.identifier, entry.extended))

    def encode(self, values: Mapping[str, Value]) -> CanFrame:
        """Return the frame with these values. Raise EncodeError."""
        return CanFrame(self.key[0], self.mapping.pack(values), self.key[1])

    def decode(self, frame: CanFrame) -> dict[str, Value]:
        """Return the values of a frame of this PDO. Raise DecodeError."""
        if frame.key != self.key or frame.remote:
            raise DecodeError("mismatch", frame.data, 0, f"{frame} is not {self.pdo.direction}{self.pdo.number}")
        return self.mapping.unpack(frame.data)


def remote_pdo(
    channel: Channel,
    direction: PdoDirection,
    number: int,
    objects: ObjectDictionary | None = None,
    *,
    timeout: float = DEFAULT_TIMEOUT,
) -> Conversation[CanFrame, RemotePdo]:
    """Read a PDO configuration of a device. Raise SdoAbort if it does not exist, EncodeError if it is switched off."""
    pdo = yield from read_pdo(channel, direction, number, timeout=timeout)
    return RemotePdo.of(channel.node, pdo, objects)


class PdoReceived(NamedTuple):
    """A received PDO. If its length is not the mapped one, `values` is None and `why` is the reason."""

    source: RemotePdo
    values: dict[str, Value] | None
    data: bytes
    at: float
    why: str = ""

    @property
    def node(self) -> int:
        """The node-ID of the device whose PDO it is."""
        return self.source.node


class PdoConsumer:
    """A machine that receives PDOs of other nodes.

    >>> consumer = PdoConsumer([RemotePdo.of(5, PdoConfig("TPDO", 1, (0x60410010,)))])
    >>> [(event.source.node, event.values) for event in consumer.feed(CanFrame.parse("185#3706"), 0.0)]
    [(5, {'6041h:00': 1591})]
    """

    __slots__ = ("sources",)

    def __init__(self, sources: Iterable[RemotePdo]) -> None:
        self.sources: dict[tuple[int, bool], RemotePdo] = {source.key: source for source in sources}

    @property
    def deadline(self) -> float | None:
        """None: nothing is timed."""
        return None

    def feed(self, frame: CanFrame | None, now: float) -> list[PdoReceived]:
        """Return the values, if the frame is one of these PDOs."""
        source = None if frame is None or frame.remote else self.sources.get(frame.key)
        if source is None or frame is None:
            return []
        try:
            return [PdoReceived(source, source.mapping.unpack(frame.data), frame.data, now)]
        except DecodeError as error:
            return [PdoReceived(source, None, frame.data, now, error.text)]
