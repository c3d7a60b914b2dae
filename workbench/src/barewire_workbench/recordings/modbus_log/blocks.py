"""Entries of several lines: a heading with a time or a direction, and below it the bytes, often as a dump.

    > 2024/05/11 13:17:34.000792034  length=8 from=0 to=7          socat -x, with -v also the characters
     01 03 00 00 00 02 c4 0b                          ........
    2006-05-30 13:23:49.461075: /dev/ttyS0                         jpnevulator --timing-print
    01 03 00 00 00 02 C4 0B                         ........
    2026/05/11 13:17:34.792 gsets22:4002 write 8                   EPICS asyn, traceIOHex
    [23/10/2008 10:38:33]                                          Serial Port Monitor (Eltima, HHD)
    3  IRP_MJ_WRITE - Request transfers data from a client to a COM port (COM5)
       01 03 00 00 00 02 C4 0B                                ........
    [D] Sent packet: @3FFB890C/6:                                  eModbus: what it sends on RTU, without its CRC
      | 0000: 01 03 00 00 00 02                         |......          |

Headings may have several lines, and have no bytes themselves. A heading without bytes below it is no entry.
"""

from __future__ import annotations

import re

from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import measure_request, measure_response
from barewire.rtu.crc import crc16
from barewire_workbench.frames.result import counted
from barewire_workbench.recordings.modbus_log.direction import frame_pdu
from barewire_workbench.recordings.modbus_log.marked import direction_of
from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry, Stamp
from barewire_workbench.recordings.modbus_log.octets import split_octets
from barewire_workbench.recordings.modbus_log.stamps import find_stamp

_BYTES = re.compile(
    r"\s*(?:\|\s*)?(?:(?:0x)?[0-9A-Fa-f]{4,8}(?::\s+|\s*\|\s*|\s{2,}))?"
    r"(?P<bytes>[0-9A-Fa-f]{2}(?:[ \t]{1,2}[0-9A-Fa-f]{2})*)(?:\s*$|\s*\t.{1,16}| {2,}.*|\s*\|.*)"
)
_BETWEEN = re.compile(r"(?:STATUS_\w+|-{2,}|Length:? \d+.*)?")
_EMODBUS_SENT = re.compile(r"(?:.*\W)?Sent packet: @[0-9A-Fa-f]{1,16}/(?P<count>\d{1,3}):\s*")
"""The title above bytes that eModbus passed to its serial line. It calculates the CRC while it sends."""
_HEADINGS = 4
"""The most lines of a heading."""
_SOCAT = re.compile(r"[<>] \d{4}/\d\d/\d\d \d\d:\d\d:\d\d\.(?P<fraction>\d{9})\s+length=")


def read_blocks(lines: list[str]) -> FormContent:
    """Return the entries that have a heading.

    >>> read_blocks(["> 2024/05/11 13:17:34.792  length=2 from=0 to=1", " 01 83"]).entries[0][1:3]
    (b'\\x01\\x83', True)
    """
    entries: list[LogEntry] = []
    known: set[int] = set()
    heading: list[int] = []
    fields: tuple[bool | None, bool | None, Stamp | None] = (None, None, None)
    in_bytes = False
    scale = _socat_scale(lines)
    for number, line in enumerate(lines, start=1):
        found = _BYTES.fullmatch(line)
        if found is not None and (heading or in_bytes):
            data = bytes.fromhex(found["bytes"].replace("\t", " "))
            if in_bytes:
                entries[-1] = entries[-1]._replace(data=(entries[-1].data or b"") + data)
            else:
                sent, from_client, stamp = fields
                entries.append(LogEntry(number, data, sent, from_client, stamp))
                known.update(heading)
            known.add(number)
            heading, in_bytes = [], True
            continue
        if _BETWEEN.fullmatch(line.strip()):
            if line.strip() and in_bytes:
                known.add(number)
                in_bytes = False
            elif line.strip() and heading:
                heading.append(number)
            continue
        if in_bytes:
            fields = (None, None, None)
        in_bytes = False
        part = _heading(line)
        if part is None:
            heading, fields = [], (None, None, None)
            continue
        sent, from_client, stamp = part
        if scale != 1.0 and stamp is not None:
            stamp = stamp._replace(seconds=int(stamp.seconds) + stamp.seconds % 1 * scale)
        is_new = (sent is None and from_client is None) or (fields[0] is not None or fields[1] is not None)
        if is_new or len(heading) >= _HEADINGS:
            heading, fields = [], (None, None, None)
        fields = (
            fields[0] if sent is None else sent,
            fields[1] if from_client is None else from_client,
            stamp or fields[2],
        )
        heading.append(number)
    return _with_sent_crc(lines, FormContent(entries, known))


def _with_sent_crc(lines: list[str], content: FormContent) -> FormContent:
    """Return the entries with the CRC that eModbus sends and does not print: behind a PDU of the right length."""
    entries: list[LogEntry] = []
    added: list[int] = []
    for entry in content.entries:
        data = entry.data or b""
        title = _EMODBUS_SENT.fullmatch(lines[entry.line - 2]) if entry.line > 1 else None
        if title is not None and int(title["count"]) == len(data) and _is_without_crc(data):
            added.append(entry.line - 1)
            entry = entry._replace(data=data + crc16(data).to_bytes(2, "little"))
        entries.append(entry)
    if not added:
        return content
    text = "Sent packet is printed without the CRC that eModbus sends; it is added to "
    return FormContent(entries, content.known, ((added[0], f"{text}{counted(len(added), 'frame')}"),))


def _is_without_crc(data: bytes) -> bool:
    """Return whether the bytes are a unit and a PDU of RTU, and no more."""
    if len(data) < 3 or any(frame_pdu(protocol, data) is not None for protocol in ("rtu", "tcp")):
        return False
    pdu = data[1:]
    return len(pdu) in ((2,) if pdu[0] & EXCEPTION_BIT else (measure_request(pdu), measure_response(pdu)))


def _heading(line: str) -> tuple[bool | None, bool | None, Stamp | None] | None:
    """Return the direction and the time that a line states; None if it states neither."""
    stamp = find_stamp(line)
    plain = line if stamp is None else line[: stamp[1]] + " " * (stamp[2] - stamp[1]) + line[stamp[2] :]
    if split_octets(plain) is not None:
        return None  # an entry of one line, which a line of bytes may continue
    word, sent, from_client = direction_of(plain)
    if word is None and (stamp is None or line[: stamp[1]].strip("[( ")):
        return None
    if word is not None and stamp is None and not re.search(r":\s*$|IRP_MJ_|\b(?:read|write) \d+\s*$", line):
        return None
    return sent, from_client, None if stamp is None else stamp[0]


def _socat_scale(lines: list[str]) -> float:
    """Return 1000 if nine digits are microseconds: socat 1.7.4 pads these with zeros, so that all begin with 000."""
    fractions = [found["fraction"] for line in lines if (found := _SOCAT.match(line))]
    return 1000.0 if len(fractions) > 1 and all(fraction.startswith("000") for fraction in fractions) else 1.0
