"""A CAN frame on the bus: its fields, CRC-15, stuff bits, duration, arbitration; and a COB-ID taken apart.

    58Fh   101 1000 1111      function code 1011 = 580h, node-ID 000 1111 = 15     SDO answer of node 15

`wire` has the bits that are drawn, `canopen.cob_ids` classifies the identifiers that the package receives; the steps
here work out the CRC, the stuff bits and the identifier on their own.
"""

from __future__ import annotations

from collections.abc import Sequence

from barewire.canopen.cob_ids import SERVICES, CobEntry, CobService, classify, is_restricted
from barewire.canopen.frame import BASE_MAX, EXTENDED_MAX, CanFrame
from barewire.errors import EncodeError
from barewire_workbench.frames.result import counted
from barewire_workbench.steps.model import Steps, StepSection, StepTable, grouped_bits, parse_hex_number
from barewire_workbench.steps.timing import shown_time
from barewire_workbench.wire import (
    CAN_CRC_POLYNOMIAL,
    EQUAL_BITS_MAX,
    INTERMISSION,
    CanBits,
    CanField,
    arbitrate,
    can_bits,
    check_bitrate,
    longest_can_frame,
)

FRAMES_MAX = 8
"""Frames in one arbitration."""

_MEANINGS = {
    "SOF": "start of frame: dominant, all receivers synchronise",
    "identifier": "the lower number wins the bus",
    "identifier extension": "the other 18 bits",
    "SRR": "recessive in place of RTR, so that a base frame wins",
    "r0": "reserved",
    "r1": "reserved",
    "CRC": "remainder, see below",
    "CRC delimiter": "recessive",
    "ACK slot": "sent recessive; receivers make it dominant",
    "ACK delimiter": "recessive",
    "EOF": "end of frame: seven recessive bits",
}


def can_frame_steps(frames: Sequence[CanFrame], bitrate: int = 125_000) -> Steps:
    """Work out the bits of a CAN frame, and with several the arbitration between them, at a rate in bit/s.

    >>> can_frame_steps([CanFrame.parse("605#4041600000000000")], 500_000)
    <Steps can-frame: 605#4041600000000000 has 121 bits, 13 of them stuff bits: 242 us at 500000 bit/s>

    Raises EncodeError for no frame, more than 8, a frame that CAN cannot carry, and a rate outside 1..1000000.
    """
    if not 1 <= len(frames) <= FRAMES_MAX:
        raise EncodeError(f"{len(frames)} frames: expected 1..{FRAMES_MAX}", "frames")
    check_bitrate(bitrate)
    sent = [can_bits(frame) for frame in frames]
    if len(sent) > 1:
        return _arbitration(sent)
    only = sent[0]
    sections: list[StepSection] = [_fields(only), *_crc(only), *_stuffing(only), *_length(only, bitrate)]
    total, stuffed = len(only.bits), only.stuff_count
    return Steps(
        "can-frame",
        f"CAN frame {only.frame}, bit by bit",
        "ISO 11898-1; Bosch CAN Specification 2.0",
        tuple(sections),
        f"{only.frame} has {total} bits, {stuffed} of them stuff bits: {shown_time(total / bitrate)} "
        f"at {bitrate} bit/s",
        {
            "frame": str(only.frame),
            "crc": only.crc,
            "levels": only.levels,
            "bits": total,
            "stuff_bits": stuffed,
            "seconds": only.duration(bitrate),
        },
    )


def _fields(sent: CanBits) -> StepTable:
    rows, part = [], ""
    for field in sent.fields:
        shown = grouped_bits(field.value, field.width) if field.width in (4, 8) else field.levels
        rows.append(
            ("" if field.part == part else field.part, field.name, str(field.width), shown, _meaning(sent, field))
        )
        part = field.part
    return StepTable(
        "The fields in the order of sending, before stuffing. 0 is dominant, 1 recessive.",
        ("part", "field", "width", "bits", "meaning"),
        tuple(rows),
    )


def _meaning(sent: CanBits, field: CanField) -> str:
    name, value = field.name, field.value
    if name == "identifier" and not sent.frame.extended:
        return f"{value:X}h; {_MEANINGS[name]}"
    if name == "identifier":
        return f"the first 11 bits of {sent.frame.id:08X}h"
    if name == "RTR":
        return "recessive: a remote frame" if value else "dominant: a data frame"
    if name == "IDE":
        return "recessive: 29 bits" if value else "dominant: an identifier of 11 bits"
    if name == "DLC":
        return f"{counted(value)} {'requested' if sent.frame.remote else 'of data'}"
    if name.startswith("data"):
        return f"{value:02X}h"
    return _MEANINGS[name]


def _crc(sent: CanBits) -> list[StepSection]:
    """Divide with a shift register, one row for each bit."""
    crc, rows = 0, []
    for field in sent.fields:
        if field.name == "CRC":
            break
        for place, level in enumerate(field.levels):
            bit = int(level)
            top = crc >> 14
            crc = crc << 1 & 0x7FFF
            if bit != top:
                crc ^= CAN_CRC_POLYNOMIAL
            name = field.name if place == 0 else ""
            rows.append((name, level, str(top), "xor 4599h" if bit != top else "", _fifteen(crc), f"{crc:04X}h"))
    return [
        "CRC-15. A register of 15 bits starts with zeros. For each bit from SOF to the end of the data: compare it "
        "with the highest bit of the register, and shift the register left by one place; if the two were different, "
        "xor it with 4599h (x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1). Stuff bits do not count.",
        StepTable("", ("field", "bit", "top", "", "register", "hex"), tuple(rows)),
        f"The CRC is what remains: {_fifteen(crc)}, {crc:04X}h, sent with the highest bit first.",
    ]


def _fifteen(crc: int) -> str:
    return grouped_bits(crc, 15)


def _stuffing(sent: CanBits) -> list[StepSection]:
    """Insert the stuff bits, one row for each field."""
    rows = []
    previous, equal, stuffed = "", 0, 0
    for field in sent.fields[:-4]:  # the four fields behind the CRC are not stuffed
        shown = ""
        for level in field.levels:
            equal = equal + 1 if level == previous else 1
            shown += level
            if equal == EQUAL_BITS_MAX:
                level, equal = "0" if level == "1" else "1", 1
                stuffed += 1
                shown += f"[{level}]"
            previous = level
        rows.append((field.name, shown))
    return [
        "Stuffing. After five equal bits the sender inserts one of the other level, [in brackets], from SOF to the "
        "end of the CRC, so that the receivers get an edge to synchronise on. An inserted bit is the first of the "
        "next five. The receivers drop it; six equal bits are an error.",
        StepTable("", ("field", "bits on the bus"), tuple(rows)),
        f"{counted(stuffed, 'stuff bit')} inserted. The ten bits behind the CRC, from the CRC delimiter to the end of "
        "EOF, are not stuffed: 1 0 1 1111111.",
    ]


def _length(sent: CanBits, bitrate: int) -> list[StepSection]:
    frame = sent.frame
    plain = sum(field.width for field in sent.fields)
    stuffable = plain - 10
    total, worst = len(sent.bits), longest_can_frame(len(frame.data), extended=frame.extended)
    least = plain + INTERMISSION
    rows = (
        ("fields", str(plain), shown_time(plain / bitrate)),
        ("stuff bits", str(total - plain), shown_time((total - plain) / bitrate)),
        ("this frame", str(total), shown_time(total / bitrate)),
        ("with the silence behind it", str(total + INTERMISSION), shown_time((total + INTERMISSION) / bitrate)),
        ("without any stuff bit, with the silence", str(least), shown_time(least / bitrate)),
        ("at worst, with the silence", str(worst + INTERMISSION), shown_time((worst + INTERMISSION) / bitrate)),
    )
    size = counted(len(frame.data), "data byte")
    return [
        f"Length. One bit lasts 1 s / {bitrate} = {shown_time(1 / bitrate)}. {INTERMISSION} recessive bits of silence "
        f"follow each frame. Of the {stuffable} bits that are stuffed, at worst the first five and then every four "
        f"need a stuff bit: ({stuffable} - 1) / 4, rounded down, is {(stuffable - 1) // 4}. No frame with {size} and "
        "this form of identifier is longer.",
        StepTable("", ("", "bits", "time"), rows),
    ]


# Arbitration ------------------------------------------------------------------------------------------------------


def _arbitration(sent: Sequence[CanBits]) -> Steps:
    outcome = arbitrate(sent)
    names = [str(frame.frame) for frame in sent]
    rows = []
    sending = set(range(len(sent)))
    for index in range(min(len(frame.bits) for frame in sent)):
        levels = {place: sent[place].bits[index].level for place in sending}
        bus = min(levels.values())
        beaten = sorted(place for place, level in levels.items() if level != bus)
        collides = index == outcome.collision
        bit = sent[min(sending - set(beaten))].bits[index]
        cells = [str(levels[place]) if place in sending else "-" for place in range(len(sent))]
        field = f"{bit.field}{' (stuff bit)' if bit.is_stuff else ''}"
        rows.append((str(index), field, *cells, str(bus), _event(beaten, names, collides=collides)))
        sending -= set(beaten)
        if collides or len(sending) == 1 or (outcome.collision is None and bit.part not in ("start", "arbitration")):
            break
    lost = {names[place]: at for place, at in enumerate(outcome.lost_at) if at is not None}
    return Steps(
        "can-frame",
        f"Arbitration between {', '.join(names)}",
        "ISO 11898-1; Bosch CAN Specification 2.0",
        (
            "The nodes begin at the same time. Each one sends a bit and reads the bus. A dominant bit, 0, overwrites a "
            "recessive one, 1. A node that sends 1 and reads 0 has lost: it stops, and tries again after the frame.",
            StepTable("", ("bit", "field", *names, "bus", ""), tuple(rows)),
        ),
        _verdict(sent, names, outcome.winner, outcome.collision),
        {
            "frames": names,
            "winner": None if outcome.winner is None else names[outcome.winner],
            "lost_at_bit": lost,
            "bit_error_at_bit": outcome.collision,
        },
    )


def _event(beaten: Sequence[int], names: Sequence[str], *, collides: bool) -> str:
    nodes = ", ".join(names[place] for place in beaten)
    if collides:
        return f"bit error in {nodes}"
    return f"{nodes} loses" if len(beaten) == 1 else f"{nodes} lose" if beaten else ""


def _verdict(sent: Sequence[CanBits], names: Sequence[str], winner: int | None, collision: int | None) -> str:
    if winner is None:
        return (
            f"No frame wins: behind the arbitration field they differ at bit {collision}, a bit error. Two nodes must "
            "never send frames with the same identifier and different data"
        )
    if all(frame.levels == sent[winner].levels for frame in sent):
        return "The frames are equal: they are sent as one, and no node notices the others"
    return f"{names[winner]} wins and is sent without delay"


# COB-IDs ------------------------------------------------------------------------------------------------------------


_SOURCE = "CiA 301: COB-ID, predefined connection set, restricted CAN-IDs"


def parse_cob_id(text: str) -> int:
    """Return the number of a COB-ID in hexadecimal digits, with 0x in front or h behind, or neither.

    >>> [f"{parse_cob_id(text):X}" for text in ("58Fh", "0x58f", "185")]
    ['58F', '58F', '185']

    Raises EncodeError for any other text, and for more than 32 bits.
    """
    return parse_hex_number(text, 8, "COB-ID", "58F", "cob_id")


def cob_id_steps(number: int, *, extended: bool = False) -> Steps:
    """Take a COB-ID apart. Above 7FFh it needs 29 bits; above 1FFFFFFFh it is an entry with flags in bits 29 to 31.

    >>> cob_id_steps(0x58F)
    <Steps cob-id: 58Fh is the SDO answer of node 15>

    Raises EncodeError outside 32 bits.
    """
    if not 0 <= number <= 0xFFFF_FFFF:
        raise EncodeError(f"COB-ID {number:X}h: expected 0..FFFFFFFFh", "cob_id")
    sections: list[StepSection] = []
    identifier = number
    if number > EXTENDED_MAX:
        extended, identifier = bool(number >> 29 & 1), number & EXTENDED_MAX
        sections += _flags(number, extended)
        if not extended:
            identifier = number & BASE_MAX
    extended = extended or identifier > BASE_MAX
    digits = f"{identifier:08X}h" if extended else f"{identifier:X}h"
    if extended:
        sections += _extended(identifier)
        meaning = "an extended identifier of 29 bits; the predefined connection set of CANopen has none"
        service, node = None, 0
    else:
        service, node = classify(CanFrame(identifier)) or (None, 0)
        sections += _base(identifier, service, node)
        meaning = _service_meaning(service, node)
    return Steps(
        "cob-id",
        f"COB-ID {number:08X}h, as the object dictionary stores it" if number > EXTENDED_MAX else f"COB-ID {digits}",
        _SOURCE,
        tuple(sections),
        f"{digits} is {meaning}",
        {
            "identifier": identifier,
            "extended": extended,
            "service": service.name if service else None,
            "node": node or None,
            "function_code": None if extended else identifier >> 7,
            "restricted": not extended and is_restricted(identifier),
        },
    )


def _service_meaning(service: CobService | None, node: int) -> str:
    if service is None:
        return "no identifier of the predefined connection set; a device may be configured to use it"
    if service.broadcast:
        return f"{service.name}, one identifier for all nodes"
    if service.name == "error control":
        return f"the error control of node {node}: heartbeat, boot-up, node guarding"
    to_or_of = "of" if service.from_device else "to"
    return f"the {service.name} {to_or_of} node {node}"


def _flags(word: int, extended: bool) -> list[StepSection]:
    entry = CobEntry.unpack(word)
    rows = (
        ("31", str(word >> 31 & 1), "PDO, SDO channel, EMCY: 1 = not in use; TIME: 1 = consumes"),
        ("30", str(word >> 30 & 1), "PDO: 1 = no remote requests; SYNC, TIME: 1 = produces"),
        ("29", str(word >> 29 & 1), "0 = identifier of 11 bits, 1 = 29 bits"),
        ("28..0" if extended else "10..0", f"{entry.identifier:X}h", "the identifier on the bus"),
    )
    sections: list[StepSection] = [
        "More than 29 bits: this is an entry of the object dictionary, for example 1400h:01. Its upper bits are flags:",
        StepTable("", ("bit", "value", "meaning"), rows),
    ]
    if not CobEntry.is_well_formed(word):
        sections.append(
            "Bits 11 to 28 have to be 0 when bit 29 is 0; here they are not, so the entry is not well formed."
        )
    return sections


def _extended(identifier: int) -> list[StepSection]:
    return [
        f"{identifier:08X}h is sent with 29 bits: {grouped_bits(identifier, 29)}. On the wire the first 11 bits, "
        f"{identifier >> 18:03X}h, come first, then SRR and IDE, then the other 18. CANopen uses identifiers of 11 "
        "bits; 29 bits on the same cable usually belong to another protocol.",
    ]


def _base(identifier: int, service: CobService | None, node: int) -> list[StepSection]:
    bits = f"{identifier:011b}"
    code, low = identifier // 128, identifier % 128
    rows = (
        ("bit", *map(str, range(10, -1, -1))),
        ("value", *bits),
        ("field", "f", "f", "f", "f", *("n" * 7)),
    )
    sections: list[StepSection] = [
        f"{identifier:X}h in binary, 11 bits. The upper 4 are the function code (f), the lower 7 the node-ID (n):",
        StepTable("", rows[0], rows[1:]),
        f"Function code {bits[:4]} = {code}, which is {identifier:X}h with the node-ID 0: {code} x 80h = "
        f"{code * 128:X}h. Node-ID {bits[4:]} = {low:02X}h = {low}.",
    ]
    listed = []
    for row in SERVICES:
        own = row.base if row.broadcast else row.base + low
        if row.broadcast or low:
            direction = "to the device" if not row.from_device else "from the device"
            mark = "<--" if row is service else ""
            base = f"{row.base:X}h" if row.broadcast else f"{row.base:X}h + {low:X}h"
            listed.append((row.name, f"{row.base >> 7:04b}", base, f"{own:X}h", direction, mark))
    whom = f"node {low}" if low else "all nodes"
    sections.append(
        StepTable(
            f"The predefined connection set for {whom}, in the order of priority: the lower number wins the bus.",
            ("service", "code", "base", "COB-ID", "direction", ""),
            tuple(listed),
        )
    )
    if low == 0 and service is None:
        sections.append(
            f"Node-ID 0 is no node: it has a meaning only in NMT, SYNC and TIME, and {identifier:X}h is none of them."
        )
    elif service is None:
        sections.append(f"No service of the set has the function code {bits[:4]}.")
    if is_restricted(identifier):
        sections.append(
            f"{identifier:X}h is restricted: it may not be configured for a PDO, SYNC, EMCY, TIME or a further SDO "
            "channel."
        )
    else:
        sections.append(f"{identifier:X}h is not restricted: a PDO, SYNC or EMCY may be configured to use it.")
    return sections
