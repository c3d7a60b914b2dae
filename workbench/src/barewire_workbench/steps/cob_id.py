"""A COB-ID taken apart: function code and node-ID, the service, the flags of an object dictionary entry.

    58Fh   101 1000 1111      function code 1011 = 580h, node-ID 000 1111 = 15     SDO answer of node 15

`canopen.cob_ids` classifies the identifiers that the package receives; the steps here do not use that.
"""

from __future__ import annotations

import re

from barewire.canopen.cob_ids import SERVICES, CobEntry, CobService, classify, is_restricted
from barewire.canopen.frame import BASE_MAX, EXTENDED_MAX, CanFrame
from barewire.errors import EncodeError, shown
from barewire_workbench.steps.model import Steps, StepSection, StepTable, grouped_bits

_SOURCE = "CiA 301: COB-ID, predefined connection set, restricted CAN-IDs"


def parse_cob_id(text: str) -> int:
    """Return the number of a COB-ID in hexadecimal digits, with 0x in front or h behind, or neither.

    >>> [f"{parse_cob_id(text):X}" for text in ("58Fh", "0x58f", "185")]
    ['58F', '58F', '185']

    Raises EncodeError for any other text, and for more than 32 bits.
    """
    found = re.fullmatch(r"(?:0[xX])?([0-9a-fA-F]{1,8})[hH]?", text.strip())
    if found is None:
        raise EncodeError(f"COB-ID {shown(text)}: expected up to 8 hexadecimal digits, such as 58Fh or 0x58F", "cob_id")
    return int(found[1], 16)


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
        found = classify(CanFrame(identifier))
        service, node = found or (None, 0)
        sections += _base(identifier, service, node)
        meaning = _meaning(service, node)
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


def _meaning(service: CobService | None, node: int) -> str:
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
        f"{identifier >> 18:03X}h, come first, then SRR and IDE, then the other 18. CANopen uses identifiers of "
        "11 bits; "
        "29 bits on the same cable usually belong to another protocol.",
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
        f"{code * 128:X}h. "
        f"Node-ID {bits[4:]} = {low:02X}h = {low}.",
    ]
    listed = []
    for row in SERVICES:
        own = row.base if row.broadcast else row.base + low
        if row.broadcast or low:
            direction = "to the device" if not row.from_device else "from the device"
            mark = "<--" if row is service else ""
            base = f"{row.base:X}h" if row.broadcast else f"{row.base:X}h + {low:X}h"
            listed.append((row.name, f"{row.base >> 7:04b}", base, f"{own:X}h", direction, mark))
    about = f"node {low}" if low else "all nodes"
    sections.append(
        StepTable(
            f"The predefined connection set for {about}, in the order of priority: the lower number wins the bus.",
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
            f"{identifier:X}h is restricted: it may not be configured for a PDO, SYNC, EMCY, TIME or a further "
            "SDO channel."
        )
    else:
        sections.append(f"{identifier:X}h is not restricted: a PDO, SYNC or EMCY may be configured to use it.")
    return sections
