"""The communication objects 1000h to 1FFFh of a device: reading them and validating writes to them.   [CiA 301]

        1001  error register          100C  guard time, ms            1014  COB-ID EMCY         1017  heartbeat time
        1003  error history           100D  life time factor          1015  inhibit time EMCY   1018  identity
        1005  COB-ID SYNC             1010  store parameters          1016  heartbeat consumer  1019  SYNC overflow
        1006  SYNC period, us         1011  restore defaults          1028  EMCY consumer       1029  error behaviour
        1007  SYNC window, us         1012  COB-ID TIME

Only 1000h, 1001h and 1018h are mandatory; a service whose object is missing works as if its value were 0.
`standard_objects` makes a set that fits most devices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.lss.messages import LssAddress
from barewire.canopen.object_dictionary import Entry, ObjectDictionary
from barewire.codecs import Value
from barewire.errors import BarewireError

_IDENTITY = 0x1018


def integer_value(objects: ObjectDictionary, index: int, sub: int = 0, default: int = 0) -> int:
    """Return the value of an object as an integer, or `default` if it is missing or cannot be read.

    A value that `on_read` returns and that is not of the type of the object counts as one that cannot be read; it is
    reported to `on_failure` of the dictionary.
    """
    if (index, sub) not in objects:
        return default
    try:
        entry = objects.entry(index, sub)
        if entry.on_read is not None:
            return int(entry.codec.decode(objects.read(index, sub)))
        return int(objects.get(index, sub))
    except (BarewireError, ValueError, OverflowError):
        return default


def service_cob_id(objects: ObjectDictionary, index: int, default: int) -> CobEntry:
    """Return the COB-ID of SYNC, TIME or EMCY. A restricted identifier, such as the 0 of a description that leaves it
    out, counts as that of `default`."""
    entry = CobEntry.unpack(integer_value(objects, index, default=default))
    return entry._replace(identifier=default & 0x7FF) if entry.is_restricted else entry


def lss_address(objects: ObjectDictionary) -> LssAddress:
    """Return the identity object 1018h as the 128-bit address that LSS uses."""
    return LssAddress(*(integer_value(objects, _IDENTITY, sub) for sub in (1, 2, 3, 4)))


def validate_writes(objects: ObjectDictionary, index: int, sub: int, check: Callable[[int], None]) -> None:
    """Call `check` at every SDO write to an object, before its own `on_write`; `check` raises SdoAbort to refuse it.

    If the dictionary does not have the object, nothing happens.
    """
    if (index, sub) not in objects:
        return
    entry = objects.entry(index, sub)
    own_hook = entry.on_write

    def on_write(value: Value) -> None:
        check(int(value))
        if own_hook is not None:
            own_hook(value)

    replace_entry(objects, replace(entry, on_write=on_write))


def replace_entry(objects: ObjectDictionary, entry: Entry) -> None:
    """Replace an entry and keep its present value."""
    value = None if entry.on_read is not None else objects.get(entry.index, entry.sub)
    objects.replace(entry)
    if value is not None:
        objects.set(entry.index, entry.sub, value)


def validate_cob_id_writes(
    objects: ObjectDictionary,
    index: int,
    in_use: Callable[[CobEntry], bool],
    sub: int = 0,
    *,
    always_received: bool = False,
) -> None:
    """Refuse (0609 0030h) to change the identifier of a COB-ID while its service is on, or to a restricted one.

    `in_use` returns whether the service is on. A service that is off may have any identifier, because masters write
    8000 0000h to switch it off. With `always_received` the device receives on the identifier even while the service is
    off, so a restricted one is always refused.
    """

    def check(word: int) -> None:
        new, old = CobEntry.unpack(word), CobEntry.unpack(integer_value(objects, index, sub))
        is_same = (new.identifier, new.extended) == (old.identifier, old.extended)
        is_forbidden = new.is_restricted and (always_received or in_use(new))
        # A restricted identifier that the device itself was made with may be written again.
        is_forbidden = is_forbidden and not (is_same and in_use(old))
        stays_on = in_use(old) and in_use(new)
        if is_forbidden or not CobEntry.is_well_formed(word) or (stays_on and not is_same):
            raise SdoAbort(AbortCode.INVALID_VALUE, index, sub)

    validate_writes(objects, index, sub, check)


def standard_objects(
    address: LssAddress = LssAddress(0, 0, 0, 0),  # noqa: B008 - a value
    *,
    device_type: int = 0,
    name: str = "",
    heartbeat: int = 0,
    history: int = 8,
    watched: int = 4,
    emcy_consumers: int = 0,
    servers: int = 1,
) -> list[Entry]:
    """Return the communication objects of a common device: all objects of the drawing above except 1010h and 1011h.

        address          the identity object 1018h
        device_type      the value of 1000h
        name             the device name 1008h; empty: no such object
        heartbeat        producer heartbeat time 1017h, in ms
        history          number of errors in 1003h
        watched          number of nodes in 1016h
        emcy_consumers   highest node-ID in 1028h
        servers          number of SDO servers; those beyond the first are off until their COB-IDs are configured

    >>> objects = ObjectDictionary(standard_objects(LssAddress(0x360, 1, 2, 3), heartbeat=1000))
    >>> objects.get(0x1017), lss_address(objects).vendor == 0x360
    (1000, True)
    """
    entries = [
        Entry(0x1000, 0, "device type", "u32", "const", device_type),
        Entry(0x1001, 0, "error register", "u8", "ro"),
        Entry(0x1003, 0, "number of errors", "u8", "rw"),
        *(Entry(0x1003, sub, f"error {sub}", "u32", "ro") for sub in range(1, history + 1)),
        Entry(0x1005, 0, "COB-ID SYNC", "u32", "rw", 0x80),
        Entry(0x1006, 0, "communication cycle period", "u32", "rw"),
        Entry(0x1007, 0, "synchronous window length", "u32", "rw"),
        Entry(0x100C, 0, "guard time", "u16", "rw"),
        Entry(0x100D, 0, "life time factor", "u8", "rw"),
        Entry(0x1012, 0, "COB-ID TIME", "u32", "rw", 0x8000_0100),
        Entry(0x1014, 0, "COB-ID EMCY", "u32", "rw", 0x80),
        Entry(0x1015, 0, "inhibit time EMCY", "u16", "rw"),
        *(Entry(0x1016, sub, f"consumer heartbeat time {sub}", "u32", "rw") for sub in range(1, watched + 1)),
        Entry(0x1017, 0, "producer heartbeat time", "u16", "rw", heartbeat),
        *(
            Entry(_IDENTITY, sub, title, "u32", "const", address[sub - 1])
            for sub, title in enumerate(("vendor-ID", "product code", "revision number", "serial number"), start=1)
        ),
        Entry(0x1019, 0, "synchronous counter overflow value", "u8", "rw"),
        *(
            Entry(0x1028, sub, f"emergency consumer {sub}", "u32", "rw", 0x8000_0000)
            for sub in range(1, emcy_consumers + 1)
        ),
        Entry(0x1029, 1, "communication error", "u8", "rw"),
    ]
    if servers > 1:
        entries += [
            Entry(0x1200, sub, title, "u32", "ro", base)
            for sub, title, base in ((1, "COB-ID client -> server", 0x600), (2, "COB-ID server -> client", 0x580))
        ]
    for index in range(0x1201, 0x1200 + servers):
        entries += [
            Entry(index, 1, "COB-ID client -> server", "u32", "rw", 0x8000_0000),
            Entry(index, 2, "COB-ID server -> client", "u32", "rw", 0x8000_0000),
            Entry(index, 3, "node-ID of the SDO client", "u8", "rw", 0),
        ]
    if name:
        entries.append(Entry(0x1008, 0, "manufacturer device name", "string", "const", name))
    return entries
