"""Conformance cases of the configuration: restricted identifiers, further SDO channels, 1020h, random reads and writes.

COB     each COB-ID that can be configured refuses every restricted CAN-ID         [CiA 301 7.3.5]
CHN     1201h to 127Fh are further SDO servers, 1280h to 12FFh the channels of clients   [CiA 301 7.2.4, 7.5.2]
CFG     1020h, verify configuration, holds what was written until a reset
RND     reads and writes in random order, in each NMT state; the order is the same in each run
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from barewire.canopen.cob_ids import is_restricted
from barewire.canopen.conformance.frames import (
    HEARTBEAT,
    LOAD,
    PRE,
    READ_ONLY_CODES,
    RESET,
    RESET_COMMUNICATION,
    SAVE,
    START,
    STOP,
    Sdo,
    little,
    make_case,
    multiplexer,
    nmt_command,
    silence,
)
from barewire.canopen.conformance.model import BOOT, POWER_CYCLE, SILENCE, NodeCase, NodeStep, Subject
from barewire.canopen.object_dictionary import ObjectAddress

# Each case is a row: name, title, steps, needs, reason.
# fmt: off

_RESTRICTED, _CHANNEL = "CiA 301 7.3.5 restricted CAN-IDs", "CiA 301 7.2.4 SDO channels"
_STORE = "CiA 301 7.5.2 store and restore"
_VERIFY, _RANDOM = "CiA 301 7.5.2 verify configuration", "CiA 301 7.2.4 SDO in each state"
_VALUE = (0x0609_0030, 0x0609_0031, 0x0609_0032)
_OFF, _CONSUMES = 0x8000_0000, 0x8000_0000
_REQUEST, _RESPONSE, _OTHER = 0x6A0, 0x6A1, 0x6A2
"""CAN-IDs that are free for SDO channels."""
_SERVER, _CLIENT = 0x1201, 0x1280
_FURTHER_SERVERS, _FURTHER_CLIENTS = range(0x1202, 0x1280), range(0x1281, 0x1300)
_STAMP = {1: 15_000, 2: 43_200_000}
"""Days since 1984 and milliseconds after midnight, for 1020h."""


def configuration_cases(subject: Subject) -> Iterator[NodeCase]:
    """Yield the cases of the configuration for one device."""
    yield from _restricted(subject)
    yield from _channels(subject)
    yield from _verify(subject)
    yield from _stored(subject)
    yield from _random(subject)


def _restricted(subject: Subject) -> Iterator[NodeCase]:
    s = Sdo(subject.node)
    identifiers = [identifier for identifier in range(0x800) if is_restricted(identifier)]
    rpdo, tpdo = subject.pdo(0x1400, 0x1600), subject.pdo(0x1800, 0x1A00)
    for name, index, sub, first, flags, needs in (
        ("COB-01", 0x1005, 0, None, 0, ("1005h",)),
        ("COB-02", 0x1012, 0, None, _CONSUMES, ("1012h",)),
        ("COB-03", 0x1014, 0, _OFF | (0x80 + subject.node), 0, ("1014h",)),
        ("COB-04", rpdo.communication if rpdo else 0x1400, 1, _OFF | subject.number(0x1400, 1), 0, ("RPDO",)),
        ("COB-05", tpdo.communication if tpdo else 0x1800, 1, _OFF | subject.number(0x1800, 1), 0, ("TPDO",)),
        ("COB-06", _SERVER, 1, _OFF, 0, ("1201h:01",)),
        ("COB-07", _SERVER, 2, _OFF, 0, ("1201h:02",)),
        ("COB-08", _CLIENT, 1, _OFF, 0, ("1280h:01",)),
        ("COB-09", _CLIENT, 2, _OFF, 0, ("1280h:02",)),
    ):
        fixed = s.refused(index, sub, *READ_ONLY_CODES, 0x0800_0022)
        off = () if first is None else (s.write(index, sub, first, 4)._replace(ends=(fixed,)),)
        refused = [s.refuse(index, sub, identifier | flags, 4, *_VALUE, *READ_ONLY_CODES)
                   for identifier in identifiers]
        yield make_case(subject, _RESTRICTED, (s.responses,), name,
                        f"{index:04X}h:{sub:02X} refuses all {len(identifiers)} restricted CAN-IDs", *off, *refused,
                        effect="writes", needs=needs, why="06090030")
    # Of the further channels, which may be 253, the ends of each range: they have the code of the first.
    ends = [word for word in identifiers if not (is_restricted(word - 1) and is_restricted(word + 1))]
    for name, span in (("COB-10", _FURTHER_SERVERS), ("COB-11", _FURTHER_CLIENTS)):
        refused = [s.refuse(index, sub, identifier, 4, *_VALUE, *READ_ONLY_CODES)
                   for index in _present(subject, span) for sub in (1, 2) for identifier in ends]
        yield make_case(subject, _RESTRICTED, (s.responses,), name,
                        f"{span[0]:04X}h and above refuse {len(ends)} restricted CAN-IDs", *refused, effect="writes",
                        needs=_channel_needs(subject, span), why="06090030")


def _present(subject: Subject, span: range) -> list[int]:
    """Return the SDO channels that the device has, of a range of indices; those with one CAN-ID alone do not count."""
    return [index for index in span if subject.has(index, 1) and subject.has(index, 2)]


def _channel_needs(subject: Subject, span: range) -> tuple[str, str]:
    """Return what a case with the channels of a range needs: the first one."""
    first = next(iter(_present(subject, span)), span[0])
    return f"{first:04X}h:01", f"{first:04X}h:02"


def _channels(subject: Subject) -> Iterator[NodeCase]:
    node = subject.node
    s = Sdo(node)
    make = partial(make_case, subject, _CHANNEL, (f"{_RESPONSE:03X}#", s.responses), effect="commands")
    case = partial(make, needs=("1201h:01", "1201h:02"))

    def put(index: int, sub: int, word: int) -> NodeStep:
        return s.write(index, sub, word, 4)

    def on(index: int) -> tuple[NodeStep, ...]:
        return put(index, 1, _OFF), put(index, 2, _OFF), put(index, 1, _REQUEST), put(index, 2, _RESPONSE)

    request = f"{_REQUEST:03X}#{s.upload(0x1000)[4:]}"
    answered = NodeStep((request,), (f"{_RESPONSE:03X}#4[2-9A-F]{multiplexer(0x1000, 0)}........",))
    quiet = silence(request, wait=0.1)
    boots = NodeStep((nmt_command(RESET_COMMUNICATION, node),), (SILENCE,), wait=BOOT / 3, full_wait=True)
    yield case("CHN-01", "1201h: a second server, which answers on its own CAN-IDs", *on(_SERVER), answered, answered)
    yield case("CHN-02", "the default server works beside it", *on(_SERVER), answered, s.works, answered)
    yield case("CHN-03", "switched off, it is silent", *on(_SERVER), answered, put(_SERVER, 1, _OFF | _REQUEST), quiet)
    yield case("CHN-04", "its CAN-ID cannot be changed while it is on", *on(_SERVER),
               s.refuse(_SERVER, 1, _OTHER, 4, *_VALUE), answered, why="06090030")
    stop, back = silence(nmt_command(STOP, node), wait=0.02), silence(nmt_command(PRE, node), wait=0.02)
    yield case("CHN-05", "no SDO in STOPPED", *on(_SERVER), stop, quiet, back, answered)
    restored = [s.read(_SERVER, sub, subject.number(_SERVER, sub).to_bytes(4, "little")) for sub in (1, 2)]
    yield case("CHN-06", "a reset of the communication restores it", *on(_SERVER), boots, *restored)
    client = partial(make, needs=("1280h:01", "1280h:02"))
    kept = [s.read(_CLIENT, sub, word.to_bytes(4, "little")) for sub, word in ((1, _REQUEST), (2, _RESPONSE))]
    yield client("CHN-10", "1280h: the CAN-IDs of a client are kept", *on(_CLIENT), *kept)
    yield client("CHN-11", "a CAN-ID of a client cannot be changed while it is on", *on(_CLIENT),
                 s.refuse(_CLIENT, 1, _OTHER, 4, *_VALUE), *kept, why="06090030")
    restored = [s.read(_CLIENT, sub, subject.number(_CLIENT, sub).to_bytes(4, "little")) for sub in (1, 2)]
    yield client("CHN-12", "a reset of the communication restores 1280h", *on(_CLIENT), boots, *restored)
    in_turn = [step for index in _present(subject, _FURTHER_SERVERS)
               for step in (*on(index), answered, answered, put(index, 1, _OFF | _REQUEST), quiet)]
    yield make("CHN-07", "1202h and above: each further server answers on its own CAN-IDs", *in_turn, s.works,
               needs=_channel_needs(subject, _FURTHER_SERVERS))
    for name, span, what in (("CHN-08", _FURTHER_SERVERS, "servers"), ("CHN-13", _FURTHER_CLIENTS, "clients")):
        # Switched off they may all have the same CAN-IDs.
        places = [(index, sub) for index in _present(subject, span) for sub in (1, 2)]
        words = [_OFF | (_REQUEST if sub == 1 else _RESPONSE) for _, sub in places]
        off = [put(*place, _OFF) for place in places]
        writes = [put(*place, word) for place, word in zip(places, words)]
        kept = [s.read(*place, word.to_bytes(4, "little")) for place, word in zip(places, words)]
        restored = [s.read(*place, subject.number(*place).to_bytes(4, "little")) for place in places]
        yield make(name, f"{span[0]:04X}h and above: {what} keep their CAN-IDs until a reset of the communication",
                   *off, *writes, *kept, boots, *restored, needs=_channel_needs(subject, span))


def _verify(subject: Subject) -> Iterator[NodeCase]:
    s = Sdo(subject.node)
    case = partial(make_case, subject, _VERIFY, (s.responses,), needs=("1020h:01", "1020h:02"))
    write = [s.write(0x1020, sub, number, 4) for sub, number in _STAMP.items()]
    kept = [s.read(0x1020, sub, number.to_bytes(4, "little")) for sub, number in _STAMP.items()]
    yield case("CFG-01", "1020h holds the date and time of a configuration", *write, *kept, effect="writes")
    boots = NodeStep((nmt_command(RESET_COMMUNICATION, subject.node),), (SILENCE,), wait=BOOT / 3, full_wait=True)
    before = [s.read(0x1020, sub, subject.number(0x1020, sub).to_bytes(4, "little")) for sub in _STAMP]
    yield case("CFG-02", "without 'save' a reset of the communication restores 1020h", *write, boots, *before,
               effect="commands", why="a stamp without its configuration would be wrong")


def _stored(subject: Subject) -> Iterator[NodeCase]:
    """Yield the cases that store values. Those before the battery are stored again after each of them."""
    node = subject.node
    s = Sdo(node)
    boot = f"{0x700 + node:03X}#00"
    case = partial(make_case, subject, _STORE, (s.responses, boot), effect="stores")
    communication, whole = (
        NodeStep((nmt_command(command, node),), (boot,), wait=BOOT) for command in (RESET_COMMUNICATION, RESET)
    )
    # A device that starts itself would be no hindrance: SDO works in OPERATIONAL.
    save, load = (s.write(index, 1, word, 4)._replace(wait=5.0) for index, word in ((0x1010, SAVE), (0x1011, LOAD)))
    write, kept = s.write(0x1017, 0, 12_345, 2), s.read(0x1017, 0, (12_345).to_bytes(2, "little"))
    needs = ("1017h", "1010h:01")
    yield case("STO-01", "'save' keeps 1017h over a reset of the communication", write, save, communication, kept,
               needs=needs)
    yield case("STO-02", "'save' keeps 1017h over a reset of the node", write, save, whole, kept, needs=needs)
    later = s.write(0x1017, 0, 23_456, 2)
    yield case("STO-03", "a value written after 'save' is not kept", write, save, later, communication, kept,
               needs=needs)
    channel = {1: _REQUEST, 2: _RESPONSE}
    for name, index, values, size in (
        ("STO-04", 0x1019, {0: 5}, 1), ("STO-05", 0x1020, _STAMP, 4), ("STO-06", _CLIENT, channel, 4)
    ):
        off = [s.write(index, sub, _OFF, 4) for sub in values if index == _CLIENT]
        writes = [s.write(index, sub, value, size) for sub, value in values.items()]
        reads = [s.read(index, sub, value.to_bytes(size, "little")) for sub, value in values.items()]
        yield case(name, f"'save' keeps {index:04X}h", *off, *writes, save, communication, *reads,
                   needs=("1010h:01", *(f"{index:04X}h:{sub:02X}" for sub in values)))
    other = NodeStep((s.upload(0x1017),), (f"{s.responses}4B171000(?!{little(12_345, 2)})........",))
    yield case("STO-07", "'load' restores 1017h, with the next reset", write, save, load, kept, whole, other,
               needs=(*needs, "1011h:01"), why="until the reset the values stay")
    power = NodeStep((), (boot,), wait=POWER_CYCLE)
    yield case("STO-08", "'save' keeps 1017h while the device is off", write, save, power, kept, effect="power",
               needs=needs)


def irregular(start: int) -> Iterator[int]:
    """Yield numbers of 31 bits in an irregular order, the same for each start (Park and Miller's generator)."""
    number = start
    while True:
        number = number * 48_271 % 0x7FFF_FFFF
        yield number


def _choice(order: Iterator[int], places: list[ObjectAddress]) -> ObjectAddress:
    return places[next(order) % len(places)]


def _random(subject: Subject) -> Iterator[NodeCase]:
    """Yield reads and writes whose order and values only depend on the node-ID."""
    node, order = subject.node, irregular(subject.node)
    s = Sdo(node)
    short = sorted(place for place, data in subject.values.items() if 1 <= len(data) <= 4 and place[0] < 0x2000)
    reads = [NodeStep((s.upload(*place),), (s.sized(*place, len(subject.values[place])),))
             for place in (_choice(order, short) for _ in range(50 if short else 0))]
    case = partial(make_case, subject, _RANDOM, (s.responses,))
    yield case("RND-01", "50 reads of 1000h to 1FFFh in random order", *(reads or [s.works]), effect="reads")

    def writes(count: int) -> list[NodeStep]:
        steps: list[NodeStep] = []
        for _ in range(count):
            period, watch = 20_000 + next(order) % 40_000, subject.other_node << 16 | 1 + next(order) % 0xFFFF
            steps += [s.write(0x1017, 0, period, 2), s.read(0x1017, 0, period.to_bytes(2, "little"))]
            if subject.has(0x1016, 1):
                steps += [s.write(0x1016, 1, watch, 4), s.read(0x1016, 1, watch.to_bytes(4, "little"))]
        return steps

    for name, state, enter in (("RND-02", "PRE-OPERATIONAL", ()), ("RND-03", "OPERATIONAL", (START,))):
        entered = [silence(nmt_command(command, node), wait=0.02) for command in enter]
        yield case(name, f"10 random writes in {state}, each read back", *entered, *writes(10), effect="commands",
                   needs=HEARTBEAT)
    before = s.write(0x1017, 0, 30_000, 2)
    unheard = [silence(s.download(0x1017, 0, 20_000 + next(order) % 10_000, 2), wait=0.05) for _ in range(5)]
    unread = [silence(s.upload(*_choice(order, short or [(0x1000, 0)])), wait=0.05) for _ in range(5)]
    stop, back = (silence(nmt_command(command, node), wait=0.02) for command in (STOP, PRE))
    after = NodeStep((s.upload(0x1017),), (s.response(f"4B171000{little(30_000, 2)}"),))
    yield case("RND-04", "10 random reads and writes in STOPPED: no answer, nothing is written", before, stop,
               *(step for pair in zip(unheard, unread) for step in pair), back, after, effect="commands",
               needs=HEARTBEAT)
