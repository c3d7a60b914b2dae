"""The PDOs of other devices: their configuration, and their frames as named values.   [CiA 301, PDO]

        {"controlword": 15, "velocity": 25000}  --encode-->  205#0F00A8610000
        185#3706A8610000                        --decode-->  {"statusword": 0x0637, "velocity": 25000}

A configuration is written in the safe order:

        1  communication :01    the COB-ID with bit 31: off, so no half-configured PDO is ever sent
        2  mapping :00          0
        3  mapping :01 ...      the entries
        4  mapping :00          their number
        5  communication :02    type, then :03 inhibit time, :05 event timer, :06 SYNC start value
        6  communication :01    the COB-ID without bit 31: on

A multiplexed PDO has FEh or FFh in step 4, no entries, and its type (254 or 255) is written first.

`PdoConfigPolicy` is for devices that deviate, for example because their mapping cannot be changed. A missing sub-index
(:05, :06) is accepted if its value would be 0.

If a step fails, the PDO is left off and the error reports that: half a mapping is worse than none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, Self

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.pdo.config import PdoConfig, PdoDirection
from barewire.canopen.pdo.mapping import ENTRIES_MAX, MappedObject, PdoMapping
from barewire.canopen.pdo.multiplexed import MPDO_COUNTS, Addressing
from barewire.canopen.sdo import Channel, upload
from barewire.canopen.sdo.channel import channel_to
from barewire.canopen.sdo.client import write_setting
from barewire.codecs import Value
from barewire.conversation import DEFAULT_TIMEOUT, Conversation
from barewire.errors import BarewireError, DecodeError, EncodeError

_COB_ID, _TYPE, _INHIBIT, _EVENT_TIMER, _SYNC_START = 1, 2, 3, 5, 6
_SIZES = {_COB_ID: 4, _TYPE: 1, _INHIBIT: 2, _EVENT_TIMER: 2, _SYNC_START: 1}
_OFF = 1 << 31
_Content = tuple[tuple[int, ...], Addressing | None]
"""The content of a PDO: its mapping entries, or the addressing of an MPDO."""
_ABSENT = frozenset({AbortCode.NO_SUB, AbortCode.NO_OBJECT})
_LOCKED = frozenset({AbortCode.READ_ONLY, AbortCode.UNSUPPORTED_ACCESS})


class PdoConfigPolicy(NamedTuple):
    """How the PDOs of a device are configured.

    mapping      "variable": it is written; "fixed": it is compared instead; "try": it is written, and compared if
                 the device reports it as read-only
    order        type and timers are written "last", or "first", before the mapping
    skip_equal   values that the device has already are not written, because some devices refuse that
    """

    mapping: Literal["try", "variable", "fixed"] = "try"
    order: Literal["last", "first"] = "last"
    skip_equal: bool = False


_DEFAULT_POLICY = PdoConfigPolicy()


def read_pdo(
    node: int | Channel, direction: PdoDirection, number: int, *, timeout: float = DEFAULT_TIMEOUT
) -> Conversation[CanFrame, PdoConfig]:
    """Read the configuration of a PDO, with its COB-ID as stored in the device. Time-out in seconds for each SDO.

    Raise SdoAbort if the PDO does not exist, NoAnswer, and DecodeError("value") if the reported mapping is invalid.
    """
    channel = channel_to(node, None)
    blank = PdoConfig(direction, number, ())
    values = {}
    for sub in _SIZES:
        values[sub] = yield from _read(channel, blank.communication, sub, timeout, needed=sub in (_COB_ID, _TYPE))
    mapping, multiplexed = yield from _read_mapping(channel, blank, timeout)
    return PdoConfig(
        direction,
        number,
        mapping,
        type=values[_TYPE] or 0,
        cob_id=values[_COB_ID],
        inhibit=values[_INHIBIT] or 0,
        event_timer=values[_EVENT_TIMER] or 0,
        sync_start=values[_SYNC_START] or 0,
        multiplexed=multiplexed,
    )


def write_pdo(
    node: int | Channel, pdo: PdoConfig, *, policy: PdoConfigPolicy = _DEFAULT_POLICY, timeout: float = DEFAULT_TIMEOUT
) -> Conversation[CanFrame, None]:
    """Write the configuration of a PDO. The device should be pre-operational. Time-out in seconds for each SDO.

    Without a `cob_id` the PDO gets the identifier of the predefined connection set. Raise SdoAbort or NoAnswer, and
    EncodeError if the mapping is a different one and cannot be changed.
    """
    channel = channel_to(node, None)
    entry = pdo.cob_entry(channel.node)
    PdoMapping(MappedObject.of_word(word) for word in pdo.mapping)  # fails here if it has more than 64 bits
    return _write_pdo(channel, pdo, entry, policy, timeout)


def _write_pdo(
    channel: Channel, pdo: PdoConfig, entry: CobEntry, policy: PdoConfigPolicy, timeout: float
) -> Conversation[CanFrame, None]:
    record = pdo.communication
    # Switched off with its present identifier: some devices refuse another one in the same write.
    stored = (yield from _read(channel, record, _COB_ID, timeout, needed=True)) or 0
    if not (policy.skip_equal and stored & _OFF):
        yield from _write(channel, record, _COB_ID, stored | _OFF, 4, timeout)
    try:
        parameters_first = policy.order == "first" or pdo.multiplexed is not None
        if parameters_first:
            yield from _write_parameters(channel, pdo, policy, timeout)
        yield from _write_mapping(channel, pdo, policy, timeout)
        if not parameters_first:
            yield from _write_parameters(channel, pdo, policy, timeout)
        if not (policy.skip_equal and entry.pack() == stored | _OFF):
            yield from _write(channel, record, _COB_ID, entry.pack(), 4, timeout)
    except BarewireError as error:
        error.add_note(f"{pdo.direction}{pdo.number} of node {channel.node} is left switched off")
        raise


def _write_mapping(
    channel: Channel, pdo: PdoConfig, policy: PdoConfigPolicy, timeout: float
) -> Conversation[CanFrame, None]:
    if policy.skip_equal or policy.mapping == "fixed":
        present = yield from _read_mapping(channel, pdo, timeout)
        if present == (pdo.mapping, pdo.multiplexed):
            return
        if policy.mapping == "fixed":
            raise _other_mapping(pdo, present)
    try:
        yield from _write(channel, pdo.map, 0, 0, 1, timeout)
    except SdoAbort as refusal:
        if policy.mapping == "variable" or refusal.code not in _LOCKED:
            raise
        present = yield from _read_mapping(channel, pdo, timeout)
        if present != (pdo.mapping, pdo.multiplexed):
            raise _other_mapping(pdo, present) from refusal
        return
    for sub, word in enumerate(pdo.mapping, start=1):
        yield from _write(channel, pdo.map, sub, word, 4, timeout)
    if pdo.count:
        yield from _write(channel, pdo.map, 0, pdo.count, 1, timeout)


def _write_parameters(
    channel: Channel, pdo: PdoConfig, policy: PdoConfigPolicy, timeout: float
) -> Conversation[CanFrame, None]:
    parameters = {_TYPE: pdo.type, _INHIBIT: pdo.inhibit, _EVENT_TIMER: pdo.event_timer, _SYNC_START: pdo.sync_start}
    for sub, value in parameters.items():
        if policy.skip_equal:
            present = yield from _read(channel, pdo.communication, sub, timeout, needed=False)
            if (present or 0) == value:
                continue
        try:
            yield from _write(channel, pdo.communication, sub, value, _SIZES[sub], timeout)
        except SdoAbort as refusal:
            if value or sub == _TYPE or refusal.code not in _ABSENT:
                raise


def _read(
    channel: Channel, index: int, sub: int, timeout: float, *, needed: bool
) -> Conversation[CanFrame, int | None]:
    """Return a value of a communication record; None if the device does not have it and it is not `needed`."""
    try:
        data = yield from upload(channel, index, sub, timeout=timeout, size=_SIZES[sub])
    except SdoAbort as refusal:
        if needed or refusal.code not in _ABSENT:
            raise
        return None
    return int.from_bytes(data[: _SIZES[sub]], "little")


def _read_mapping(channel: Channel, pdo: PdoConfig, timeout: float) -> Conversation[CanFrame, _Content]:
    data = yield from upload(channel, pdo.map, 0, timeout=timeout, size=1)
    multiplexed = MPDO_COUNTS.get(data[0])
    if multiplexed is not None:
        return (), multiplexed
    if data[0] > ENTRIES_MAX:
        raise DecodeError("value", data, 0, f"{pdo.map:04X}h:00 = {data[0]}: expected 0..{ENTRIES_MAX}, FEh or FFh")
    words = []
    for sub in range(1, data[0] + 1):
        word = yield from upload(channel, pdo.map, sub, timeout=timeout, size=4)
        words.append(int.from_bytes(word[:4], "little"))
    return tuple(words), None


def _write(
    channel: Channel, index: int, sub: int, value: int, size: int, timeout: float
) -> Conversation[CanFrame, None]:
    yield from write_setting(channel, index, sub, value.to_bytes(size, "little"), timeout=timeout)


def _other_mapping(pdo: PdoConfig, present: _Content) -> EncodeError:
    mapped, expected = (
        addressing or " ".join(f"{word:08X}" for word in words) or "nothing"
        for words, addressing in (present, (pdo.mapping, pdo.multiplexed))
    )
    return EncodeError(f"{pdo.direction}{pdo.number} maps {mapped} and cannot be changed; expected {expected}")


def mapping_of(pdo: PdoConfig, objects: ObjectDictionary | None = None) -> PdoMapping:
    """Return the mapping of a PDO, with the names and types of a dictionary.

    An object that the dictionary does not have, or has with another width, is named by index and sub-index.

    >>> mapping_of(PdoConfig("TPDO", 1, (0x60410010, 0x20050010))).unpack(bytes.fromhex("3706 18FC"))
    {'6041h:00': 1591, '2005h:00': 64536}
    """
    return PdoMapping(_mapped(pdo.mapping, objects))


def _mapped(words: tuple[int, ...], objects: ObjectDictionary | None) -> Iterator[MappedObject]:
    names: set[str] = set()
    for word in words:
        plain = MappedObject.of_word(word)
        if objects is None or plain.is_dummy or (plain.index, plain.sub) not in objects:
            yield plain
            continue
        entry = objects.entry(plain.index, plain.sub)
        named = MappedObject.of_word(word, entry.type, "" if entry.name in names else entry.name)
        names.add(entry.name)
        try:
            PdoMapping([named])
        except EncodeError:
            # The dictionary has it with another width: its bits are a number, named by index and sub-index.
            named = plain
        yield named


@dataclass(frozen=True, slots=True)
class RemotePdo:
    """One PDO of another node: a configuration, read by `read_pdo` or known, with the names of its objects.

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

        Raise EncodeError if the PDO is switched off, or multiplexed: then each frame names its object (`Mpdo`); and for
        an RPDO with a restricted COB-ID, since 000h with the controlword 0080h is an NMT command. A TPDO is received
        wherever the node sends it.
        """
        entry = pdo.cob_entry(node)
        if pdo.multiplexed is not None:
            raise EncodeError(
                f"{pdo.direction}{pdo.number} of node {node} is a multiplexed PDO ({pdo.multiplexed}): "
                "it has no mapping, each frame names its object; Mpdo.decode reads one"
            )
        if entry.bit31:
            raise EncodeError(f"{pdo.direction}{pdo.number} of node {node} is switched off")
        if entry.is_restricted and pdo.direction == "RPDO":
            text = f"its COB-ID {entry.identifier:03X}h is restricted [CiA 301], so it would be another message"
            raise EncodeError(f"RPDO{pdo.number} of node {node} cannot be sent: {text}")
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
    """A received PDO. If it is not as long as mapped, or has a time of 24 hours or more, `values` is None, and `why`
    is the reason."""

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
    deadline = None  # nothing is timed

    def __init__(self, sources: Iterable[RemotePdo]) -> None:
        self.sources: dict[tuple[int, bool], RemotePdo] = {source.key: source for source in sources}

    def feed(self, frame: CanFrame | None, now: float) -> list[PdoReceived]:
        """Return the values, if the frame is one of these PDOs."""
        source = None if frame is None or frame.remote else self.sources.get(frame.key)
        if source is None or frame is None:
            return []
        try:
            return [PdoReceived(source, source.mapping.unpack(frame.data), frame.data, now)]
        except DecodeError as error:
            return [PdoReceived(source, None, frame.data, now, error.text)]
