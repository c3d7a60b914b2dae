"""Logs of serial sniffers that print every byte with its character.

    > 	0x01 (SOH)                                 interceptty: > to the device, < from it; one byte a line
    < 0x83
    Host   --> [SOH] (001) [ETX] (003) ...         slsnif: decimal; (01) with --hex
    Device --> [SOH] (001) ...                     above each line its time, with --timestamp
    2.821799000000000,'1' (0x01),,                 Saleae Logic 1, "Async Serial": seconds and one byte
    2.821799,0x01,,                                its export with hexadecimal values
    "Async Serial","data",2.821799,0.00104,0x01    Saleae Logic 2: start and duration

Bytes of one direction belong together until the other direction begins; where there are times, pauses end frames.
"""

from __future__ import annotations

import re

from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry, Stamp
from barewire_workbench.recordings.modbus_log.stamps import find_stamp

_INTERCEPTTY = re.compile(r"(?:\[\d\d:\d\d[ :]\d\d\.\d+\]|\s*)(?P<mark>[<>]) \s*0x(?P<byte>[0-9a-f]{2})(?: \(.*\))?\s*")
_INTERCEPTTY_TIME = re.compile(r"\[(\d\d):(\d\d)[ :](\d\d\.\d+)\]")
_SLSNIF = re.compile(r"(?P<word>Host  |Device|      ) --> (?P<bytes>.+)")
_SLSNIF_BYTE = re.compile(r"(?:\[[^\]]{2,5}\]|<[^>]{2,5}>|[A-Z0-9]{2,5}|.) \((?P<byte>[0-9a-f]{2,3})\) ?", re.DOTALL)
_SALEAE = (
    re.compile(r"(?P<at>-?\d+\.\d+),.{0,24}?\(?0x(?P<byte>[0-9A-Fa-f]{2})\)?(?:,.*)?"),
    re.compile(r'"?[^",]{1,60}"?,"?data"?,(?P<at>-?\d+\.?\d*),[\d.eE+-]*,"?0x(?P<byte>[0-9A-Fa-f]{2})"?(?:,.*)?'),
)
_SALEAE_HEAD = re.compile(r'(?i)"?(?:time ?\[s\]|name)"?,.*(?:value|data|type).*')


def read_bytewise(lines: list[str]) -> FormContent:
    """Return the entries of such a log.

    >>> [entry.data.hex() for entry in read_bytewise(["> \\t0x01", "> \\t0x83", "< 0x02"]).entries]
    ['0183', '02']
    """
    entries: list[LogEntry] = []
    known: set[int] = set()
    stamp: Stamp | None = None
    for number, line in enumerate(lines, start=1):
        if found := _INTERCEPTTY.fullmatch(line):
            sent, data = found["mark"] == ">", bytes.fromhex(found["byte"])
            time = _INTERCEPTTY_TIME.match(line)
            at = None if time is None else Stamp(60 * (60 * int(time[1]) + int(time[2])) + float(time[3]), None, True)
            last = entries[-1] if entries else None
            if last is not None and last.sent is sent and (at is None or at == last.stamp) and number - 1 in known:
                entries[-1] = last._replace(data=(last.data or b"") + data)
            else:
                entries.append(LogEntry(number, data, sent, stamp=at))
            known.add(number)
        elif found := _SLSNIF.match(line):
            bytes_found = [piece["byte"] for piece in _SLSNIF_BYTE.finditer(found["bytes"])]
            if not bytes_found:
                continue
            base = 10 if len(bytes_found[0]) == 3 else 16
            data = bytes(int(byte, base) & 0xFF for byte in bytes_found)
            if found["word"].strip():
                entries.append(LogEntry(number, data, found["word"] == "Host  ", stamp=stamp))
            elif entries:
                entries[-1] = entries[-1]._replace(data=(entries[-1].data or b"") + data)
            known.add(number)
            stamp = None
        elif found := next((found for form in _SALEAE if (found := form.fullmatch(line.strip()))), None):
            entries.append(LogEntry(number, bytes.fromhex(found["byte"]), stamp=Stamp(float(found["at"]))))
            known.add(number)
        elif line.startswith("Total bytes transmitted:") or _SALEAE_HEAD.fullmatch(line.strip()):
            known.add(number)
        elif line.strip() and (at_found := find_stamp(line)) and not line[at_found[2] :].strip(" 0123456789"):
            stamp = at_found[0]  # the line above those of slsnif
            known.update({number} if number < len(lines) and _SLSNIF.match(lines[number]) else ())
    return FormContent(entries, known)
