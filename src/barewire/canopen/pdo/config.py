"""The records that configure PDOs, as they stand in the object dictionary.   [CiA 301, PDO communication and mapping]

        communication 1400h+ (RPDO), 1800h+ (TPDO)         mapping 1600h+ (RPDO), 1A00h+ (TPDO)

        00  highest sub-index                              00  how many entries are in force; FEh, FFh: see `mpdo`
        01  COB-ID u32, bit 31: switched off               01  index 2 | sub 1 | bits 1
        02  transmission type u8                           02  ...
        03  inhibit time u16, in 100 us
        05  event timer u16, in ms
        06  SYNC start value u8

        type 0        acyclic with SYNC: TPDO at the next SYNC if something changed    RPDO takes effect
        type 1..240   cyclic with SYNC: TPDO at every n-th                             at the next SYNC
        type 252      TPDO on request, with what it was at the last SYNC               -
        type 253      TPDO on request, with what it is                                 -
        type 254/255  TPDO when something changes, at the latest with the event timer  RPDO at once
                      only these go with a multiplexed PDO, and while it is one no other is taken: 0609 0030h

The event timer of an RPDO is how long it may stay away.

To change a mapping: switch the PDO off (bit 31 of 01), set 00 of the mapping to 0, write the entries, set 00 to their
number, switch the PDO on. Out of this order the answer is 0601 0000h.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from barewire.canopen.cob_ids import CobEntry, ServiceName, cob_id, is_restricted
from barewire.canopen.object_dictionary import Entry, ObjectDictionary
from barewire.canopen.pdo.mapping import BITS_MAX, ENTRIES_MAX, MappedObject, PdoMapping
from barewire.canopen.pdo.multiplexed import MPDO_COUNTS, Addressing
from barewire.canopen.sdo.aborts import AbortCode, SdoAbort
from barewire.codecs import Value
from barewire.errors import EncodeError

PdoDirection = Literal["RPDO", "TPDO"]

PDOS_MAX = 512
"""PDOs of each direction."""
LAST_CYCLIC, RTR_AT_SYNC, RTR_AT_ONCE = 240, 252, 253

_DIRECTIONS: tuple[PdoDirection, ...] = ("RPDO", "TPDO")
_COMMUNICATION = {"RPDO": 0x1400, "TPDO": 0x1800}
_MAPPING = {"RPDO": 0x1600, "TPDO": 0x1A00}
_DEFAULT_SERVICE: dict[tuple[PdoDirection, int], ServiceName] = {
    ("RPDO", 1): "RPDO1",
    ("RPDO", 2): "RPDO2",
    ("RPDO", 3): "RPDO3",
    ("RPDO", 4): "RPDO4",
    ("TPDO", 1): "TPDO1",
    ("TPDO", 2): "TPDO2",
    ("TPDO", 3): "TPDO3",
    ("TPDO", 4): "TPDO4",
}


@dataclass(frozen=True, slots=True)
class PdoConfig:
    """The factory setting of one PDO: what it maps, when it goes, on which COB-ID.

    `mapping` are the 32-bit entries. Without a `cob_id` PDO 1 to 4 have theirs from the predefined connection set,
    and any further one is switched off until somebody gives it an identifier.

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
    slots: int = 8  # room for entries, if not more are mapped
    multiplexed: Addressing | None = None  # then it maps nothing, and says with each object which it is: see `mpdo`

    def __post_init__(self) -> None:
        # Behind the last record of one kind begins another: 1800h + 512 would be a mapping.
        if self.direction not in _COMMUNICATION:
            raise EncodeError(f"direction {self.direction!r}: expected RPDO or TPDO")
        if not 1 <= self.number <= PDOS_MAX:
            raise EncodeError(f"{self.direction}{self.number}: expected a number in 1..{PDOS_MAX}")
        if self.multiplexed is not None and self.mapping:
            raise EncodeError(f"{self.direction}{self.number} is multiplexed, so it maps nothing")

    def __repr__(self) -> str:
        words = "".join(f"0x{word:08X}," for word in self.mapping)
        words = f"({words if len(self.mapping) == 1 else words[:-1].replace(',', ', ')})"
        said = [repr(self.direction), str(self.number), words, f"type={self.type}"]
        if self.cob_id is not None:
            said.append(f"cob_id=0x{self.cob_id:X}")
        others = {"inhibit": 0, "event_timer": 0, "sync_start": 0, "slots": 8, "multiplexed": None}
        said += [f"{name}={value!r}" for name in others if (value := getattr(self, name)) != others[name]]
        return f"PdoConfig({', '.join(said)})"

    @property
    def communication(self) -> int:
        """Index of the communication record."""
        return _COMMUNICATION[self.direction] + self.number - 1

    @property
    def map(self) -> int:
        """Index of the mapping record."""
        return _MAPPING[self.direction] + self.number - 1

    @property
    def count(self) -> int:
        """What stands in sub-index 00 of the mapping."""
        return next((count for count, kind in MPDO_COUNTS.items() if kind == self.multiplexed), len(self.mapping))

    def cob_entry(self, node: int) -> CobEntry:
        """The COB-ID with the node-ID in it."""
        if self.cob_id is not None:
            return CobEntry.unpack(self.cob_id)
        service = _DEFAULT_SERVICE.get((self.direction, self.number))
        return CobEntry(0, bit31=True) if service is None else CobEntry(cob_id(service, node))


def pdos_of(objects: ObjectDictionary, node: int) -> list[PdoConfig]:
    """The PDOs that a dictionary describes by itself, as one out of an EDS does: what `Device` wants to be given.

    A COB-ID of the predefined connection set stays tied to the node-ID.
    """
    found = []
    for direction in _DIRECTIONS:
        for number in range(1, PDOS_MAX + 1):
            pdo = PdoConfig(direction, number, ())
            if (pdo.communication, 1) not in objects or (pdo.map, 0) not in objects:
                continue
            told = {sub: _number(objects, pdo.communication, sub) for sub in (1, 2, 3, 5, 6)}
            count = _number(objects, pdo.map, 0)
            multiplexed = MPDO_COUNTS.get(count)
            if count > ENTRIES_MAX and multiplexed is None:
                continue
            words = () if multiplexed else tuple(_number(objects, pdo.map, sub) for sub in range(1, count + 1))
            own = number <= 4 and told[1] == pdo.cob_entry(node).pack()
            slots = max(objects.subs(pdo.map))
            times = told[3], told[5], told[6]
            found.append(
                PdoConfig(direction, number, words, told[2], None if own else told[1], *times, slots, multiplexed)
            )
    return found


def _number(objects: ObjectDictionary, index: int, sub: int) -> int:
    return int(objects.get(index, sub)) if (index, sub) in objects else 0


def add_records(objects: ObjectDictionary, node: int, pdo: PdoConfig, changed: Callable[[], object]) -> None:
    """Put the two records of a PDO into the dictionary, with the rules for changing them.

    Where the dictionary has an entry of the records already (a device description lists them too), it keeps its name
    and takes its default and its rules from here; sub-index 04, reserved, stays as it is, or absent. `changed` is
    called when a write has been accepted, just before it is stored. Raises EncodeError if the factory setting itself
    breaks a rule.
    """
    if not (0 <= pdo.type <= 255 and has_type(pdo.direction, pdo.type)):
        raise EncodeError(f"{pdo.direction}{pdo.number}: there is no transmission type {pdo.type} for it")
    if pdo.multiplexed is not None and pdo.type <= RTR_AT_ONCE:
        raise EncodeError(f"{pdo.direction}{pdo.number} is multiplexed: expected type 254 or 255, here is {pdo.type}")
    resolve(objects, pdo.direction, pdo.mapping)
    rules = _Rules(objects, pdo, changed)
    at, name = pdo.communication, f"{pdo.direction}{pdo.number}"

    def put(index: int, sub: int, what: str, type: str, default: int, check: Callable[[int], None] | None) -> None:
        access: Literal["const", "rw"] = "const" if check is None else "rw"
        hook = None if check is None else rules.hook(check)
        called = objects.entry(index, sub).name if (index, sub) in objects else f"{name} {what}"
        objects.replace(Entry(index, sub, called, type, access, default, on_write=hook))

    put(at, 0, "highest sub-index", "u8", 6, None)
    put(at, 1, "COB-ID", "u32", pdo.cob_entry(node).pack(), rules.cob_id)
    put(at, 2, "transmission type", "u8", pdo.type, rules.type)
    put(at, 3, "inhibit time", "u16", pdo.inhibit, rules.switched_off(at, 3))
    put(at, 5, "event timer", "u16", pdo.event_timer, lambda value: None)
    put(at, 6, "SYNC start value", "u8", pdo.sync_start, rules.switched_off(at, 6))
    slots = min(max(pdo.slots, len(pdo.mapping)), ENTRIES_MAX)
    put(pdo.map, 0, "entries", "u8", pdo.count, rules.count)
    for sub in range(1, slots + 1):
        word = pdo.mapping[sub - 1] if sub <= len(pdo.mapping) else 0
        put(pdo.map, sub, f"entry {sub}", "u32", word, rules.entry(sub))


def has_type(direction: PdoDirection, type: int) -> bool:
    """Whether there is such a transmission type: 241 to 251 are reserved, and nobody asks for an RPDO."""
    return not LAST_CYCLIC < type < RTR_AT_SYNC and not (direction == "RPDO" and type in (RTR_AT_SYNC, RTR_AT_ONCE))


def resolve(objects: ObjectDictionary, direction: PdoDirection, words: tuple[int, ...]) -> PdoMapping:
    """The mapping behind the entries, with the types that the dictionary has for them. Raises EncodeError."""
    entries = []
    for word in words:
        mapped = MappedObject.of_word(word)
        if not mapped.is_dummy:
            place = mapped.index, mapped.sub
            if place not in objects:
                raise EncodeError(f"{mapped.name} cannot be mapped: there is no such object")
            entry = objects.entry(*place)
            if entry.access in (("ro", "const") if direction == "RPDO" else ("wo",)):
                raise EncodeError(f"{mapped.name} is {entry.access} and cannot be mapped to an {direction}")
            if direction not in entry.mappable:
                raise EncodeError(f"{mapped.name} is not meant for an {direction}")
            mapped = MappedObject.of_word(word, entry.type)
        entries.append(mapped)
    return PdoMapping(entries)


class _Rules:
    """What may be written to the records of one PDO, and when."""

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
        same = (new.identifier, new.extended) == (old.identifier, old.extended)
        taken = not new.extended and is_restricted(new.identifier)
        if not new.bit31 and ((not old.bit31 and not same) or taken):
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
