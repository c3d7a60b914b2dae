"""The order in which objects that are not PDO records are written, and the steps before some of them.   [CiA 301]

        1005h, 1012h, 1014h, 12xxh     the identifier changes only while the service is off: it is switched off first
        12xxh:03                       changes only while the channel is off: both COB-IDs off, then :03, :01, :02
        1016h                          no two entries may have one node: entries that change become 0 first
        1019h                          changes only while 1006h is 0: 1006h becomes 0 first

All others are written in the order of their addresses. PDO records are written by `pdo.remote_config`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from barewire.canopen.configuration.settings import Difference
from barewire.canopen.object_dictionary import Entry

CYCLE, OVERFLOW = 0x1006, 0x1019
_SYNC, _TIME, _EMCY, _CONSUMERS = 0x1005, 0x1012, 0x1014, 0x1016
_SDO_CHANNELS = range(0x1200, 0x1300)
_BIT30, _BIT31 = 1 << 30, 1 << 31
_CYCLE_ENTRY = Entry(CYCLE, 0, "communication cycle period", "u32")


def plain_writes(changes: Iterable[Difference], cycle: int | None = None) -> Iterator[tuple[Entry, bytes]]:
    """Yield the writes of objects that are not PDO records, in a permitted order, as (entry, bytes).

    `cycle` is the present value of 1006h if 1019h changes. The `present` values of 1005h, 1012h, 1014h, 1016h and 12xxh
    decide whether a step before is needed; None: it is always done.
    """
    changes = sorted(changes, key=_order)
    consumers = [one for one in changes if one.entry.index == _CONSUMERS and one.entry.sub]
    for one in consumers if len(consumers) > 1 else []:
        if one.present != 0:
            yield one.entry, bytes(4)
    overflow = next((one for one in changes if one.entry.index == OVERFLOW), None)
    wanted_cycle = next((one for one in changes if one.entry.index == CYCLE), None)
    if overflow is not None and (cycle is None or cycle):
        yield _CYCLE_ENTRY, bytes(4)
    channels = [one for one in changes if one.entry.index in _SDO_CHANNELS and one.entry.sub in (1, 2)]
    for one in channels:
        yield from _switched_off(one)
    for one in changes:
        if one.entry.index in (_SYNC, _TIME, _EMCY):
            yield from _switched_off(one)
        if one is overflow or (one is wanted_cycle and overflow is not None):
            continue
        yield one.entry, one.entry.codec.encode(one.wanted)
    if overflow is not None:
        yield overflow.entry, overflow.entry.codec.encode(overflow.wanted)
        if wanted_cycle is not None:
            yield wanted_cycle.entry, wanted_cycle.entry.codec.encode(wanted_cycle.wanted)
        elif cycle:
            yield _CYCLE_ENTRY, cycle.to_bytes(4, "little")


def _switched_off(one: Difference) -> Iterator[tuple[Entry, bytes]]:
    """Yield the write that switches a service off with its present identifier, if its identifier changes."""
    present = one.present if isinstance(one.present, int) else None
    if not isinstance(one.wanted, int) or (present is not None and not (present ^ one.wanted) & ~(_BIT30 | _BIT31)):
        return
    before = one.wanted if present is None else present
    if one.entry.index in (_SYNC, _TIME):  # bit 30 produces, bit 31 (of 1012h) consumes
        off = before & ~(_BIT30 | _BIT31) if one.entry.index == _TIME else before & ~_BIT30
    else:
        off = before | _BIT31
    if off not in (present, one.wanted):
        yield one.entry, off.to_bytes(4, "little")


def _order(one: Difference) -> tuple[int, bool, int]:
    """Sort by address; in an SDO channel the node-ID (:03) comes before the COB-IDs, which switch it on."""
    return one.entry.index, one.entry.index in _SDO_CHANNELS and one.entry.sub in (1, 2), one.entry.sub
