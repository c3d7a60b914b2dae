"""The cases of CiA's CANopen conformance test tool, and our cases for the same: a table of docs/conform-canopen.md.

The names are those of the public log of version 3.0.3.10 (test/test_report_CCT.md of CANopenNode/CANopenDemo on
GitHub). A row is one or several names (the numbers of one group), what they test, and the beginnings of our names; no
name stands for a case without an equivalent, and then the last column says why.
"""

from __future__ import annotations

LINT = "`barewire eds lint`"
_SAVE = "it writes to the non-volatile memory of the device"

CIA_CASES: tuple[tuple[str, str, str, str, str], ...] = (
    ("EDS checker", "01", "the EDS itself", LINT, ""),
    ("SDO", "01", "read 1000h", "SDO-01", ""),
    ("SDO", "02", "read and write objects of 1000h to 1FFFh at random", "RND-01 RND-02", ""),
    ("SDO", "03", "write 1000h", "SDO-40", ""),
    ("SDO", "04", "read a write-only object", "OD-READ", ""),
    ("SDO", "05", "read 1000h:01", "SDO-07", ""),
    ("SDO", "06", "read an object that does not exist", "SDO-06", ""),
    ("SDO", "07", "a wrong command specifier", "SDO-20 SDO-21", ""),
    ("SDO", "08", "four bytes to an object of fewer", "SDO-47 OD-LENGTH", ""),
    ("SDO", "09", "one byte to an object of more", "SDO-48 OD-LENGTH", ""),
    ("SDO", "10 11", "values too high and too low", "OD-LIMIT SDO-49", ""),
    ("SDO", "12", "1200h:01 and :02", "SDO-09 SDO-10", ""),
    ("SDO", "13", "read 1000h in segments, if the device does so", "OD-READ", ""),
    ("SDO", "14 15", "write 100Ch, 1017h in segments", "SEG-20", "1017h"),
    ("SDO", "16 18", "read a text in segments", "SEG-01 SEG-02", ""),
    ("SDO", "17", "a wrong toggle bit", "SEG-03 SEG-04", ""),
    ("SDO", "19", "read 1000h in a block without CRC", "BLK-01", ""),
    ("SDO", "20 21", "write 100Ch, 1017h in a block without CRC", "BLK-31", "1017h"),
    ("SDO", "22 23", "read a text in a block, without and with CRC", "BLK-03", "with CRC"),
    ("SDO", "24 25", "write 100Ch, 1017h in a block with CRC", "BLK-30", "1017h"),
    ("SDO", "26", "block size 128", "BLK-07", ""),
    ("SDO", "27", "a wrong sequence number acknowledged", "BLK-15", ""),
    ("SDO", "28", "further servers, 1201h", "CHN-01 CHN-02 CHN-03", "1201h only"),
    ("SDO", "29", "further servers after a reset of the communication", "CHN-06", ""),
    ("SDO", "30", "clients, 1280h, with 'save' and a reset", "CHN-10 CHN-12", "without 'save'"),
    ("PDO", "01 02", "the records of RPDOs and TPDOs", "RPD-01 TPD-01 OD-READ", ""),
    ("PDO", "03", "OPERATIONAL: remote frames", "TPD-40 TPD-48", ""),
    ("PDO", "04", "OPERATIONAL: event-driven", "TPD-04", "no event can be caused from outside"),
    ("PDO", "05", "OPERATIONAL: event timer", "TPD-38 TPD-39", ""),
    ("PDO", "06", "OPERATIONAL: cyclic", "TPD-30 TPD-31 TPD-32", ""),
    ("PDO", "07", "OPERATIONAL: acyclic", "TPD-47", ""),
    ("PDO", "08", "OPERATIONAL: SYNC start value", "TPD-49", ""),
    ("PDO", "09", "STOPPED: remote frames", "TPD-44", ""),
    ("PDO", "10 11", "STOPPED: event-driven, event timer", "TPD-46", ""),
    ("PDO", "12 13 14", "STOPPED: synchronous", "TPD-34", ""),
    ("PDO", "15", "PRE-OPERATIONAL: remote frames", "TPD-43", ""),
    ("PDO", "16 17", "PRE-OPERATIONAL: event-driven, event timer", "TPD-45", ""),
    ("PDO", "18 19 20", "PRE-OPERATIONAL: synchronous", "TPD-33 TPD-35", ""),
    ("PDO", "21", "the default mapping and the objects that it names", "OD-DEFAULT OD-READ", ""),
    ("PDO", "22", "a new mapping in the safe order", "RPD-16 TPD-16", ""),
    ("PDO", "23", "a new mapping while the count is not 0", "RPD-13 TPD-13", ""),
    ("PDO", "24", "a new mapping while the PDO is on", "RPD-12 TPD-12", ""),
    ("PDO", "25", "too many objects", "RPD-17 TPD-17", ""),
    ("PDO", "26", "objects that are too long", "RPD-18 TPD-18", ""),
    ("PDO", "27 28 29", "mappable or not, and the direction, of RPDOs", "OD-RPDO", ""),
    ("PDO", "30 31 32", "mappable or not, and the direction, of TPDOs", "OD-TPDO", ""),
    ("PDO", "33", "dummy objects", "", "DummyUsage of the EDS is not tested"),
    ("OD", "01 07", "access, of 1000h to 1FFFh and of all others", "OD-READ OD-WRITE", ""),
    ("OD", "02 08", "default values", "OD-DEFAULT", "not those that a device computes"),
    ("OD", "03", "write read-only objects", "OD-ACCESS", ""),
    ("OD", "04", "read write-only objects", "OD-READ", ""),
    ("OD", "05", "sub-index 255", "", "few devices have it"),
    ("OD", "06", "limits", "OD-LIMIT", ""),
    ("OD", "09", "read and write back", "OD-WRITE", ""),
    ("Emergency", "01", "1014h", "EMC-01", ""),
    ("Emergency", "02", "1001h", "SDO-02", ""),
    ("Emergency", "03", "1003h:01 without an error", "EMC-08", ""),
    ("Emergency", "04", "an emergency is caused", "EMC-02", ""),
    ("Emergency", "05", "1001h with an error", "EMC-03", ""),
    ("Emergency", "06", "1003h:01 with an error", "EMC-05", ""),
    ("Synchronization", "01", "the default of 1005h", "OD-DEFAULT", ""),
    ("Synchronization", "02", "the number of SYNCs", "SYN-01", ""),
    ("Synchronization", "03", "the number of TPDOs", "TPD-30 TPD-31", ""),
    ("Synchronization", "04", "consumer, and 1006h is 0", "SYN-03", ""),
    ("Synchronization", "05", "invalid values of 1019h", "SYN-07 SDO-49", ""),
    ("Synchronization", "06", "1019h is 0: SYNC without a counter", "SYN-01", ""),
    ("Synchronization", "07", "the counter", "SYN-04", ""),
    ("Synchronization", "08 10", "1019h saved", "", _SAVE),
    ("Synchronization", "09", "1019h while there is a period", "SYN-08", ""),
    ("Guarding", "01", "100Ch and 100Dh", "OD-READ", ""),
    ("Guarding", "02 03", "answers and their toggle bit", "GRD-01 GRD-02", ""),
    ("Guarding", "04", "the range of the identifiers", "", "the log says no more; 100Eh is obsolete"),
    ("Guarding", "05 06", "life guarding", "GRD-06 GRD-07", ""),
    ("Heartbeat", "01", "write 1017h", "SDO-45", ""),
    ("Heartbeat", "02", "the number of heartbeats", "HB-01 HB-06", ""),
    ("Heartbeat", "03", "switched off", "HB-05", ""),
    ("Heartbeat", "04", "the same node twice in 1016h", "HBC-07", ""),
    ("Heartbeat", "05 06", "the consumer: in time, too late", "HBC-05 HBC-01", ""),
    ("Heartbeat", "07", "the consumer, after a reset of the node", "HBC-01", "each case begins after a reset"),
    ("Heartbeat versus guarding", "01 02 03 04 05 06 07", "one of the two", "GRD-04 GRD-05", ""),
    ("Testing other", "01 02", "1010h:01 with 'wron' and 'evas'", "SDO-51 SDO-53", ""),
    ("Testing other", "03 04", "1011h:01 with 'wron' and 'daol'", "SDO-52 SDO-54", ""),
    ("Testing other", "05 06", "1010h:02", "SDO-53", ""),
    ("Testing other", "07 08", "1011h:02 with 'wron' and 'daol'", "SDO-54", ""),
    ("Testing other", "09", "1020h, saved", "CFG-01 CFG-02", "without 'save'"),
    ("Testing other", "10", "restricted CAN-IDs", "COB-01 COB-02 COB-03 COB-04 COB-05", ""),
    ("State", "01", "initialisation: boot-up message, default values", "NMT-10 NMT-17 NMT-18 OD-DEFAULT", ""),
    ("State", "02", "PRE-OPERATIONAL", "NMT-11 NMT-19 RND-02 TPD-33", ""),
    ("State", "03", "OPERATIONAL", "NMT-01 RND-03 TPD-30", ""),
    ("State", "04", "STOPPED", "NMT-02 RND-04 TPD-34", ""),
    ("Transition", "01", "reset node, reset communication", "NMT-12 NMT-13 NMT-14 NMT-15", ""),
    ("Transition", "02", "enter pre-operational", "NMT-03 NMT-05", ""),
    ("Transition", "03", "start", "NMT-04", ""),
    ("Transition", "04", "stop", "NMT-02 NMT-06", ""),
)


def table() -> list[str]:
    """Return the lines of the table."""
    lines = ["| CiA's tool | tests | here | |", "|---|---|---|---|"]
    for group, numbers, what, ours, note in CIA_CASES:
        named = ours if ours == LINT else ", ".join(ours.split())
        lines.append(f"| {group} {', '.join(numbers.split())} | {what} | {named} | {note} |")
    return lines
