"""The rules of a CANopen bus that the monitor checks: a closed list, each with its clause and a sentence.

A violation is proved by the frames. If a gap in the recording or a disturbed bus can be the cause as well, the event is
a `Gap` or a `Loss` instead.
"""

from __future__ import annotations

from typing import NamedTuple


class BusRule(NamedTuple):
    """One rule: the clause of the standard, and what it requires."""

    clause: str
    text: str


BUS_RULES: dict[str, BusRule] = {
    "SDO-LENGTH": BusRule("CiA 301, SDO", "an SDO message has 8 bytes"),
    "SDO-COMMAND": BusRule("CiA 301, SDO", "the command byte is one of the standard; an abort is exactly 80h"),
    "SDO-RESERVED": BusRule("CiA 301, SDO", "reserved bits of the command byte and reserved bytes are 0"),
    "SDO-WRONG-SCS": BusRule("CiA 301, SDO", "the answer is of a kind that the request can have"),
    "SDO-MUX": BusRule("CiA 301, SDO", "the answer, or the abort, is about the object that was requested"),
    "SDO-OVERLAP": BusRule("CiA 301, SDO", "one transfer at a time on a channel: no new request before its end"),
    "SDO-UNASKED": BusRule("CiA 301, SDO", "answers and segments are sent only within a transfer"),
    "SDO-TOGGLE": BusRule(
        "CiA 301, SDO segments", "the toggle bit begins with 0, alternates, and the answer repeats it"
    ),
    "SDO-SIZE": BusRule("CiA 301, SDO", "as many bytes are transferred as were announced"),
    "SDO-ABORT-CODE": BusRule("CiA 301, SDO abort codes", "an abort has one of the codes of the standard"),
    "SDO-BLOCK-SIZE": BusRule("CiA 301, SDO block", "a block has 1 to 127 segments"),
    "SDO-BLOCK-SEQNO": BusRule("CiA 301, SDO block", "segments are numbered from 1 up to the size of the block"),
    "SDO-BLOCK-ACK": BusRule("CiA 301, SDO block", "no segment is acknowledged that was not sent"),
    "SDO-BLOCK-CRC": BusRule("CiA 301, SDO block", "the CRC is that of the bytes, if both sides calculate one"),
    "SDO-BLOCK-SWITCH": BusRule("CiA 301, SDO block", "with the protocol switch 0 the answer is a block upload"),
    "NMT-LENGTH": BusRule("CiA 301, NMT", "an NMT command has 2 bytes"),
    "NMT-COMMAND": BusRule("CiA 301, NMT", "the command is 01, 02, 80, 81 or 82"),
    "NMT-NODE": BusRule("CiA 301, NMT", "a command is for a node 1 to 127, or for all with 0"),
    "NMT-NOT-OBEYED": BusRule("CiA 301, NMT", "a node goes to the state that it is commanded to"),
    "STOPPED-TALKS": BusRule("CiA 301, NMT states", "a stopped node sends no SDO, PDO or EMCY"),
    "PDO-NOT-OPERATIONAL": BusRule("CiA 301, NMT states", "a node sends PDOs in the state operational only"),
    "HEARTBEAT-LENGTH": BusRule("CiA 301, heartbeat", "error control has 1 byte"),
    "HEARTBEAT-STATE": BusRule("CiA 301, heartbeat", "the state is 00, 04, 05 or 7F"),
    "HEARTBEAT-TOGGLE": BusRule(
        "CiA 301, heartbeat", "bit 7 of a heartbeat is 0; only an answer to guarding toggles it"
    ),
    "GUARD-TOGGLE": BusRule("CiA 301, node guarding", "the toggle bit is 0 first after a boot, then alternates"),
    "EMCY-LENGTH": BusRule("CiA 301, EMCY", "an emergency has 8 bytes"),
    "EMCY-CODE": BusRule("CiA 301, EMCY", "the first byte of an error code is 00, 10 to 9F or F0 to FF"),
    "EMCY-REGISTER": BusRule("CiA 301, 1001h", "an error sets bit 0 of the error register; bit 6 is 0"),
    "SYNC-LENGTH": BusRule("CiA 301, SYNC", "SYNC has no data, or a counter of 1 byte, and stays with it"),
    "SYNC-COUNTER": BusRule("CiA 301, SYNC", "the counter goes from 1 up to at most 240 and leaves none out"),
    "TIME-LENGTH": BusRule("CiA 301, TIME", "TIME has 6 bytes"),
    "TIME-VALUE": BusRule("CiA 301, TIME_OF_DAY", "a day has fewer than 86 400 000 milliseconds"),
    "LSS-LENGTH": BusRule("CiA 305", "an LSS message has 8 bytes"),
    "LSS-SERVICE": BusRule("CiA 305", "the first byte is a service of its direction"),
    "PDO-TOO-SHORT": BusRule("CiA 301, PDO", "a PDO has at least the bytes that are mapped"),
    "PDO-TOO-LONG": BusRule("CiA 301, PDO", "a PDO has no more bytes than are mapped"),
    "REMOTE-REQUEST": BusRule("CiA 301, COB-IDs", "only PDOs and node guarding are requested by remote frames"),
    "ID-RESERVED": BusRule("CiA 301, restricted CAN-IDs", "reserved identifiers are not used"),
}
"""Rule id -> rule. The ids are stable: programs depend on them."""
