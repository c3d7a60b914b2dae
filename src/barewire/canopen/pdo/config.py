"""The configuration of PDOs: two records each in the object dictionary.   [CiA 301, PDO communication and mapping]

        communication 1400h+ (RPDO), 1800h+ (TPDO)         mapping 1600h+ (RPDO), 1A00h+ (TPDO)

        00  highest sub-index                              00  number of mapped entries; FEh, FFh: `multiplexed`
        01  COB-ID u32, bit 31: switched off               01  index 2 | sub 1 | bits 1
        02  transmission type u8                           02  ...
        03  inhibit time u16, in 100 us
        05  event timer u16, in ms
        06  SYNC start value u8

        type 0        acyclic with SYNC: TPDO at the next SYNC if its data changed     RPDO takes effect
        type 1..240   cyclic with SYNC: TPDO at every n-th                             at the next SYNC
        type 252      TPDO on request, with its data at the last SYNC                  -
        type 253      TPDO on request, with its present data                           -
        type 254/255  TPDO when its data changes, at the latest with the event timer   RPDO at once
                      a multiplexed PDO has one of these two; any other type is refused for it: 0609 0030h

The event timer of an RPDO is the longest time between two receptions. 02 and 05 may be written while the PDO is on: a
TPDO of type 254 or 255 is then sent at once, and its timer runs from there, which CiA 301 leaves open.

To change a mapping: switch the PDO off (bit 31 of 01), set 00 of the mapping to 0, write the entries, set 00 to their
number, switch the PDO on. Any other order is refused with 0601 0000h.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import PDO_SERVICES, CobEntry, cob_id
from barewire.canopen.object_dictionary import Entry, ObjectDictionary
from barewire.canopen.pdo.mapping import BITS_MAX, ENTRIES_MAX, MappedObject, PdoMapping
from barewire.canopen.pdo.multiplexed import MPDO_COUNTS, Addressing
from barewire.codecs import Value
from barewire.errors import EncodeError, shown

PdoDirection = Literal["RPDO", "TPDO"]

PDOS_MAX = 512
"""PDOs of each direction."""
_DUMMY_BITS = {0x0001: 1, 0x0002: 8, 0x0003: 16, 0x0004: 32, 0x0005: 8, 0x0006: 16, 0x0007: 32}
"""The bits of the data types that fill a mapping: BOOLEAN, INTEGER8 to 32, UNSIGNED8 to 32."""
LAST_CYCLIC, RTR_AT_SYNC, RTR_AT_ONCE = 240, 252, 253

_COMMUNICATION: dict[PdoDirection, int] = {"RPDO": 0x1400, "TPDO": 0x1800}
_MAPPING = {"RPDO": 0x1600, "TPDO": 0x1A00}


@dataclass(frozen=True, slots=True)
class PdoConfig:
    """The configuration of one PDO.

        mapping       the mapped objects, as 32-bit entries
        type          transmission type
        cob_id        COB-ID; without it, PDO 1 to 4 have the identifier of the predefined connection set, and any
                      further PDO is switched off
        inhibit       shortest time between two frames, in 100 us
        event_timer   longest time between two frames, in ms
        sync_start    the SYNC with this counter counts as the first one of a synchronous TPDO (CiA 301): with
                      type 3 and 2 here, the TPDO is sent at counters 4, 7 ...; 0: the counter is not regarded
        slots         sub-indices of the mapping record, if not more are mapped
        multiplexed   the addressing of an MPDO, which has no mapping: each frame names its object
        unused        the entries of the mapping record after those in use, which nothing is done with

    >>> PdoConfig("TPDO", 1, (0x60410010, 0x20050010), type=1).cob_entry(5).identifier == 0x185
    True
    >>> PdoConfig("TPDO", 1, (0x60410010,), 1, 0x185)
    PdoConfig('TPDO', 1, (0x60410010,), type=1, cob_id=0x185)
    """

    direction: PdoDirection
    number: int
    mapping: tuple[int, ...]
    type: int = 255
    cob_id: int | None = None
    inhibit: int = 0
    event_timer: int = 0
    sync_start: int = 0
    slots: int = 8
    multiplexed: Addressing | None = None
    unused: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        # A number above 512 would reach into the records of another kind: 1800h + 512 is a mapping record.
        if self.direction not in _COMMUNICATION:
            raise EncodeError(f"direction {self.direction!r}: expected RPDO or TPDO")
        if not 1 <= self.number <= PDOS_MAX:
            raise EncodeError(f"{self.direction}{self.number}: expected a number in 1..{PDOS_MAX}")
        if self.multiplexed is not None and self.mapping:
            raise EncodeError(f"{self.direction}{self.number} is multiplexed: expected no mapping")

    def __repr__(self) -> str:
        words = "".join(f"0x{word:08X}," for word in self.mapping)
        words = f"({words if len(self.mapping) == 1 else words[:-1].replace(',', ', ')})"
        fields = [repr(self.direction), str(self.number), words, f"type={self.type}"]
        if self.cob_id is not None:
            fields.append(f"cob_id=0x{self.cob_id:X}")
        defaults = {"inhibit": 0, "event_timer": 0, "sync_start": 0, "slots": 8, "multiplexed": None, "unused": ()}
        fields += [f"{name}={value!r}" for name in defaults if (value := getattr(self, name)) != defaults[name]]
        return f"PdoConfig({', '.join(fields)})"

    @property
    def communication(self) -> int:
        """The index of the communication record."""
        return _COMMUNICATION[self.direction] + self.number - 1

    @property
    def map(self) -> int:
        """The index of the mapping record."""
        return _MAPPING[self.direction] + self.number - 1

    @property
    def count(self) -> int:
        """The value of sub-index 00 of the mapping record."""
        return next((count for count, value in MPDO_COUNTS.items() if value == self.multiplexed), len(self.mapping))

    def cob_entry(self, node: int) -> CobEntry:
        """Return the COB-ID of this PDO for a node-ID."""
        if self.cob_id is not None:
            return CobEntry.unpack(self.cob_id)
        service = PDO_SERVICES.get(f"{self.direction}{self.number}")
        return CobEntry(0, bit31=True) if service is None else CobEntry(cob_id(service, node))


def pdos_of(objects: ObjectDictionary, node: int, *, refused: list[str] | None = None) -> list[PdoConfig]:
    """Return the PDOs whose records a dictionary has, for example one from an EDS. They are an argument of `LocalNode`.

    A COB-ID of the predefined connection set is left out, so it follows the node-ID.

    Some descriptions have PDOs that break a rule, or have no COB-ID; `LocalNode` raises EncodeError for them. With a
    list as `refused`, such a PDO is returned without its mapping and switched off, so that the device works, and the
    reason is appended.
    """
    configs = []
    for direction, first in _COMMUNICATION.items():
        for index in filter(objects.subs, range(first, first + PDOS_MAX)):
            pdo = _described_pdo(objects, node, direction, index - first + 1)
            if pdo is None:
                continue
            if refused is not None:
                try:
                    validate_pdo(objects, pdo)
                except EncodeError as error:
                    refused.append(str(error))
                    off = pdo.cob_entry(node)._replace(bit31=True).pack()
                    pdo = replace(pdo, mapping=(), type=255, cob_id=off, multiplexed=None, unused=())
            configs.append(pdo)
    return configs


def _described_pdo(objects: ObjectDictionary, node: int, direction: PdoDirection, number: int) -> PdoConfig | None:
    """Return the configuration in the records of a dictionary, None without records, or with a count that is none."""
    blank = PdoConfig(direction, number, ())
    if (blank.communication, 1) not in objects or (blank.map, 0) not in objects:
        return None
    cob_id, type, inhibit, event_timer, sync_start = (
        _value(objects, blank.communication, sub) for sub in (1, 2, 3, 5, 6)
    )
    count = _value(objects, blank.map, 0)
    multiplexed = MPDO_COUNTS.get(count)
    if count > ENTRIES_MAX and multiplexed is None:
        return None
    used = 0 if multiplexed else count
    slots = min(max(objects.subs(blank.map)), ENTRIES_MAX)
    words = tuple(_value(objects, blank.map, sub) for sub in range(1, max(used, slots) + 1))
    unused = words[used:]
    is_default = number <= 4 and cob_id == blank.cob_entry(node).pack()
    return PdoConfig(
        direction,
        number,
        words[:used],
        type=type,
        cob_id=None if is_default else cob_id,
        inhibit=inhibit,
        event_timer=event_timer,
        sync_start=sync_start,
        slots=slots,
        multiplexed=multiplexed,
        unused=unused if any(unused) and multiplexed is None else (),
    )


def _value(objects: ObjectDictionary, index: int, sub: int) -> int:
    value = objects.get(index, sub) if (index, sub) in objects else 0
    return value if isinstance(value, int) else 0  # a description may have given it a wrong data type


def validate_pdo(objects: ObjectDictionary, pdo: PdoConfig) -> None:
    """Raise EncodeError if the type or the mapping of a PDO breaks a rule, or a COB-ID with which it is on."""
    name = f"{pdo.direction}{pdo.number}"
    entry = CobEntry.unpack(pdo.cob_id or 0)
    if pdo.cob_id is not None and not entry.bit31 and entry.is_restricted and pdo.count:
        raise EncodeError(f"{name}: COB-ID {entry.identifier:03X}h is restricted [CiA 301], so the PDO cannot be on")
    if not (0 <= pdo.type <= 255 and has_type(pdo.direction, pdo.type)):
        raise EncodeError(f"{name}: transmission type {pdo.type} does not exist")
    if pdo.multiplexed is not None and pdo.type <= RTR_AT_ONCE:
        raise EncodeError(f"{name} is multiplexed: expected type 254 or 255, not {pdo.type}")
    try:
        resolve(objects, pdo.direction, pdo.mapping)
    except EncodeError as error:
        raise EncodeError(f"{name}: {error}") from None


def add_records(objects: ObjectDictionary, node: int, pdo: PdoConfig, changed: Callable[[], object]) -> None:
    """Add the two records of a PDO to the dictionary, with the rules for writing them.

    An entry that the dictionary has (from a device description) keeps its name and whether it can be mapped, but
    gets a new default and rules; the reserved sub-index 04 is not touched. A record that it has gets no times that it
    does not have, unless `pdo` sets them. `changed` is called when a write has been
    accepted, before it is stored. Raise EncodeError if `pdo` itself breaks a rule.
    """
    validate_pdo(objects, pdo)
    rules = _Rules(objects, pdo, changed)
    record, name = pdo.communication, f"{pdo.direction}{pdo.number}"

    def add(index: int, sub: int, title: str, type: str, default: int, check: Callable[[int], None] | None) -> None:
        access: Literal["const", "rw"] = "const" if check is None else "rw"
        hook = None if check is None else rules.hook(check)
        own = objects.entry(index, sub) if (index, sub) in objects else Entry(index, sub, f"{name} {title}", type)
        objects.replace(Entry(index, sub, own.name, type, access, default, on_write=hook, mappable=own.mappable))

    times: tuple[tuple[int, str, str, int, Callable[[int], None]], ...] = (
        (3, "inhibit time", "u16", pdo.inhibit, rules.switched_off(record, 3)),
        (5, "event timer", "u16", pdo.event_timer, lambda value: None),
        (6, "SYNC start value", "u8", pdo.sync_start, rules.switched_off(record, 6)),
    )
    is_described = (record, 1) in objects
    add(record, 1, "COB-ID", "u32", pdo.cob_entry(node).pack(), rules.cob_id)
    add(record, 2, "transmission type", "u8", pdo.type, rules.type)
    for sub, title, type, default, check in times:
        if default or not is_described or (record, sub) in objects:
            add(record, sub, title, type, default, check)
    add(record, 0, "highest sub-index", "u8", max(_value(objects, record, 0), *objects.subs(record)), None)
    words = pdo.mapping + pdo.unused
    slots = min(max(pdo.slots, len(words)), ENTRIES_MAX)
    add(pdo.map, 0, "entries", "u8", pdo.count, rules.count)
    for sub in range(1, slots + 1):
        word = words[sub - 1] if sub <= len(words) else 0
        add(pdo.map, sub, f"entry {sub}", "u32", word, rules.entry(sub))


def has_type(direction: PdoDirection, type: int) -> bool:
    """Return whether a transmission type exists: 241 to 251 are reserved, and an RPDO cannot be sent on request."""
    return not LAST_CYCLIC < type < RTR_AT_SYNC and not (direction == "RPDO" and type in (RTR_AT_SYNC, RTR_AT_ONCE))


def resolve(objects: ObjectDictionary, direction: PdoDirection, words: tuple[int, ...]) -> PdoMapping:
    """Return the mapping of 32-bit entries. Raise EncodeError if an object cannot be mapped."""
    entries = []
    for word in words:
        mapped = MappedObject.of_word(word)
        if not mapped.is_dummy:
            if (mapped.index, mapped.sub) not in objects:
                raise EncodeError(f"{mapped.name} cannot be mapped: there is no such object")
            entry = objects.entry(mapped.index, mapped.sub)
            if entry.access in (("ro", "const") if direction == "RPDO" else ("wo",)):
                raise EncodeError(f"{mapped.name} is {entry.access} and cannot be mapped to an {direction}")
            if not entry.is_mappable(direction):
                raise EncodeError(f"{mapped.name} cannot be mapped to an {direction}")
            if entry.type == "domain":
                raise EncodeError(f"{mapped.name} is a domain, which cannot be mapped")
            mapped = MappedObject.of_word(word, entry.type)
        elif mapped.bits != _DUMMY_BITS[mapped.index]:
            raise EncodeError(f"dummy {mapped.name} has {mapped.bits} bits: expected {_DUMMY_BITS[mapped.index]}")
        entries.append(mapped)
    return PdoMapping(entries)


class _Rules:
    """The checks of writes to the records of one PDO, one method for each sub-index."""

    def __init__(self, objects: ObjectDictionary, pdo: PdoConfig, changed: Callable[[], object]) -> None:
        self.objects = objects
        self.pdo = pdo
        self.changed = changed

    def hook(self, check: Callable[[int], None]) -> Callable[[Value], None]:
        def on_write(value: Value) -> None:
            check(int(value))
            self.changed()

        return on_write

    def _is_on(self) -> bool:
        return not CobEntry.unpack(int(self.objects.get(self.pdo.communication, 1))).bit31

    def cob_id(self, word: int) -> None:
        new = CobEntry.unpack(word)
        old = CobEntry.unpack(int(self.objects.get(self.pdo.communication, 1)))
        is_same = (new.identifier, new.extended) == (old.identifier, old.extended)
        stays_on = not new.bit31 and not old.bit31
        if not CobEntry.is_well_formed(word) or (stays_on and not is_same) or (not new.bit31 and new.is_restricted):
            raise SdoAbort(AbortCode.INVALID_VALUE, self.pdo.communication, 1)

    def type(self, value: int) -> None:
        multiplexed = int(self.objects.get(self.pdo.map, 0)) in MPDO_COUNTS
        if not has_type(self.pdo.direction, value) or (multiplexed and value <= RTR_AT_ONCE):
            raise SdoAbort(AbortCode.INVALID_VALUE, self.pdo.communication, 2)

    def switched_off(self, index: int, sub: int) -> Callable[[int], None]:
        def check(value: int) -> None:
            if self._is_on():
                raise SdoAbort(AbortCode.INVALID_VALUE, index, sub)

        return check

    def count(self, value: int) -> None:
        index = self.pdo.map
        if self._is_on():
            raise SdoAbort(AbortCode.UNSUPPORTED_ACCESS, index, 0)
        if value in MPDO_COUNTS and int(self.objects.get(self.pdo.communication, 2)) > RTR_AT_ONCE:
            return
        if (index, value) not in self.objects:
            raise SdoAbort(AbortCode.PDO_TOO_LONG, index, 0)
        words = tuple(int(self.objects.get(index, sub)) for sub in range(1, value + 1))
        if sum(word & 0xFF for word in words) > BITS_MAX:
            raise SdoAbort(AbortCode.PDO_TOO_LONG, index, 0)
        try:
            resolve(self.objects, self.pdo.direction, words)
        except EncodeError:
            raise SdoAbort(AbortCode.NOT_MAPPABLE, index, 0) from None

    def entry(self, sub: int) -> Callable[[int], None]:
        def check(word: int) -> None:
            if self._is_on() or self.objects.get(self.pdo.map, 0) != 0:
                raise SdoAbort(AbortCode.UNSUPPORTED_ACCESS, self.pdo.map, sub)
            try:
                resolve(self.objects, self.pdo.direction, (word,) if word else ())
            except EncodeError:
                raise SdoAbort(AbortCode.NOT_MAPPABLE, self.pdo.map, sub) from None

        return check


def checked_pdos(pdos: Iterable[PdoConfig]) -> tuple[PdoConfig, ...]:
    """Return the PDOs. Raise EncodeError for anything else."""
    listed = tuple(pdos) if isinstance(pdos, Iterable) else (pdos,)
    for pdo in listed:
        if not isinstance(pdo, PdoConfig):
            text = "expected several PdoConfig, such as [PdoConfig('TPDO', 1, (0x60410010,))]"
            raise EncodeError(f"LocalNode: pdos = {shown(pdos)}: {text}", "pdos")
    return listed
