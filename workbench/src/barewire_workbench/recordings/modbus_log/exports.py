"""Exports of Wireshark and tshark.

**Exports of Wireshark and tshark as text: hex dumps of packets, with the lines above them, and C arrays**

    tshark -x                0000  00 00 5e 00 ... 08 00 45 00  ..............E.       a dump for each packet
    tshark -P -x, -V -x      the summary or all fields, then the dump; times are in both
    "Follow TCP stream"      00000000  00 01 00 00 00 06 01 03 ...   the client; the server is indented
    C arrays                 static const unsigned char pkt1[66] = { 0x00, 0x00, ... };   char peer0_0[] = { ... };

A dump that begins at offset 0 is a packet with all its headers, from Ethernet or IP on; those without Modbus are known
and skipped. A text export without bytes (the summary or the fields alone) cannot be read: `without_bytes` says why.

**Exports as JSON and CSV: packets of Wireshark and tshark with their payload**

    tshark -T json, -T json -x, -T jsonraw, and "Export Packet Dissections, As JSON"      a list of packets
    tshark -T ek                                                                          one object in each line
    tshark -T fields -E header=y -E separator=, -e frame.time_epoch -e tcp.payload        a table with a line of names

A packet has its bytes as `tcp.payload` or `udp.payload`, or as a whole (`frame_raw`). The ports of a packet show its
direction; without them the summary does ("Query", "Response"), or the transaction numbers.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Container, Iterator
from typing import Any, NamedTuple

from barewire.errors import DecodeError
from barewire_workbench.frames.input import dump_line
from barewire_workbench.recordings.capture import (
    ETHERNET,
    MODBUS_PORTS,
    RTU_PORT,
    ModbusPayload,
    Packet,
    modbus_payload,
)
from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry, Stamp
from barewire_workbench.recordings.modbus_log.octets import stamp_in

_SUMMARY = re.compile(r"\s*\d+\s+(?P<at>\d+\.\d+)\s+\S+\s+(?:→|->|\S)")
_EPOCH = re.compile(r"\s*(?:Epoch (?:Arrival )?Time|Arrival Time)\b.*?:\s*(?P<at>.+)")
_FIELDS = re.compile(r"Frame \d+: \d+ bytes on wire")
_NO_BYTES = re.compile(r"Query: Trans:|Response: Trans:| Modbus/TCP |Modbus RTU|Transaction Identifier: \d")
_ARRAY = re.compile(r"\s*(?:static |const |unsigned |char |uint8_t )+(?P<name>\w+)\s*\[\d*\]\s*=\s*\{(?P<rest>.*)")
_PEER = re.compile(r"peer(?P<peer>[01])_\d+")
_RAW_IP = 101


class _Dump(NamedTuple):
    lines: list[int]
    data: bytes
    stamp: Stamp | None
    name: str = ""


def without_bytes(lines: list[str]) -> str | None:
    """Return what is wrong with an export that has no bytes; None for other text.

    >>> without_bytes(["<?xml version='1.0'?>", "<pdml>"])
    'line 1: PDML or PSML: export JSON (tshark -T json -x), or give the capture'
    """
    for number, line in enumerate(lines[:200], start=1):
        if re.match(r"\s*<(?:pdml|psml|\?xml)\b", line):
            return f"line {number}: PDML or PSML: export JSON (tshark -T json -x), or give the capture"
        if _NO_BYTES.search(line) or _FIELDS.match(line):
            return f"line {number}: an export of Wireshark without bytes: add them (tshark -x), or give the capture"
    return None


def read_wireshark(lines: list[str], ports: Container[int] = MODBUS_PORTS) -> FormContent:
    """Return the Modbus payloads of dumped packets, or the pieces of a followed stream."""
    dumps = [*_dumps(lines), *_arrays(lines)]
    entries: list[LogEntry] = []
    known: set[int] = set()
    for dump in dumps:
        if peer := _PEER.fullmatch(dump.name):
            entries.append(LogEntry(dump.lines[0], dump.data, None, peer["peer"] == "0", dump.stamp))
            known.update(dump.lines)
        elif (payload := _payload(dump.data, ports)) is not None:
            entries.append(LogEntry(dump.lines[0], payload.data, None, payload.from_client, dump.stamp))
            known.update(dump.lines)
        elif _is_packet(dump.data):
            known.update(dump.lines)
    if not entries:
        entries, known = _followed(lines)
    if entries:
        known.update(number for number, line in enumerate(lines, 1) if not dump_line(line) and _is_field(line, lines))
    return FormContent(entries, known)


def _is_field(line: str, lines: list[str]) -> bool:
    """Return whether a line belongs to the fields of -V or is a summary; -V has many kinds of them."""
    return bool(_SUMMARY.match(line)) or any(_FIELDS.match(other) for other in lines[:3]) or line.startswith("No. ")


def _payload(data: bytes, ports: Container[int]) -> ModbusPayload | None:
    """Return the Modbus bytes of a packet of Ethernet, or of IP alone."""
    for link in (ETHERNET, 113, _RAW_IP):
        payload = modbus_payload(Packet(0.0, data, link), ports)
        if payload is not None:
            return payload
    return None


def _is_packet(data: bytes) -> bool:
    return len(data) >= 34 and (data[12:14] in (b"\x08\x00", b"\x86\xdd", b"\x08\x06") or data[14:16] == b"\x08\x00")


def _dumps(lines: list[str]) -> Iterator[_Dump]:
    """Yield the dumps that begin at offset 0 and continue without a gap, with the last time above each."""
    stamp: Stamp | None = None
    numbers: list[int] = []
    data = b""
    for number, line in enumerate([*lines, ""], start=1):
        row = dump_line(line) if not line.startswith("    ") else None
        if row is not None and numbers and row.offset == len(data):
            numbers.append(number)
            data += row.data
            continue
        if numbers:
            yield _Dump(numbers, data, stamp)
            numbers, data = [], b""
        if row is not None and row.offset == 0:
            numbers, data = [number], row.data
        elif time := _SUMMARY.match(line):
            stamp = Stamp(float(time["at"]))
        elif time := _EPOCH.match(line):
            stamp = _stamp(time["at"]) or stamp


def _stamp(text: str) -> Stamp | None:
    number = re.match(r"(\d+\.\d+) seconds", text)
    if number:
        return Stamp(float(number[1]))
    return stamp_in(text)


def _arrays(lines: list[str]) -> Iterator[_Dump]:
    """Yield the C arrays."""
    name, numbers, text = "", list[int](), ""
    for number, line in enumerate(lines, start=1):
        plain = re.sub(r"/\*.*?\*/", "", line)
        heading = _ARRAY.match(plain)
        if heading:
            name, numbers, text = heading["name"], [number], heading["rest"]
        elif numbers:
            numbers.append(number)
            text += plain
        if numbers and "}" in text:
            digits = re.findall(r"0x([0-9A-Fa-f]{1,2})\b", text)
            yield _Dump(numbers, bytes(int(token, 16) for token in digits), None, name)
            numbers, text = [], ""


def _followed(lines: list[str]) -> tuple[list[LogEntry], set[int]]:
    """Return the pieces of "Follow TCP stream" as a hex dump: each direction counts its own offsets."""
    entries: list[LogEntry] = []
    known: set[int] = set()
    offsets = {True: 0, False: 0}
    directions: list[bool] = []
    for number, line in enumerate(lines, start=1):
        plain = line.strip()
        if re.fullmatch(r"=+|Follow: .*|Filter: .*|Node \d: .*", plain):
            known.add(number)
            continue
        row = dump_line(plain)
        if row is None:
            continue
        from_client = not line[:1].isspace()
        if row.offset != offsets[from_client]:
            return [], set()
        offsets[from_client] += len(row.data)
        if entries and directions[-1] is from_client and len(entries[-1].data or b"") % 16 == 0:
            entries[-1] = entries[-1]._replace(data=(entries[-1].data or b"") + row.data)
        else:
            entries.append(LogEntry(number, row.data, None, from_client))
            directions.append(from_client)
        known.add(number)
    return (entries, known) if len(set(directions)) == 2 else ([], set())


_PAYLOADS = ("tcp.payload", "udp.payload", "tcp.segment_data", "data.data", "usb.capdata")
_TIMES = ("frame.time_epoch", "frame.time_relative", "frame.time", "_ws.col.Time", "Time", "time")
_INFOS = ("_ws.col.Info", "_ws.col.info", "Info")
_DEPTH = 60
"""The deepest nesting of JSON: packets have a few dozen levels."""


def read_json(lines: list[str], ports: Container[int] = MODBUS_PORTS) -> FormContent:
    """Return the entries of packets in JSON; no entries if the text is something else.

    Raises DecodeError for packets without bytes.
    """
    text = "\n".join(lines)
    if not text.lstrip()[:1] or text.lstrip()[0] not in "[{" or '"layers"' not in text:
        return FormContent([], set())
    entries: list[LogEntry] = []
    packets = list(_packets(text, lines))
    for line, layers in packets:
        if (entry := _packet_entry(line, layers, ports)) is not None:
            entries.append(entry)
    if packets and not entries and '"mb' in text:
        raise DecodeError("value", b"", 0, "the packets of this JSON have no bytes: export with tshark -T json -x")
    return FormContent(entries, set(range(1, len(lines) + 1)) if entries else set())


def _packets(text: str, lines: list[str]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the layers of each packet, with its line."""
    numbers = [number for number, line in enumerate(lines, start=1) if '"layers"' in line]
    try:
        if text.lstrip().startswith("["):
            packets = json.loads(text)
        else:
            packets = [json.loads(line) for line in lines if '"layers"' in line]
    except (ValueError, RecursionError) as error:
        raise DecodeError("value", b"", 0, f"not the JSON of packets: {error}") from None
    for number, packet in zip(numbers, packets if isinstance(packets, list) else ()):
        source = packet.get("_source", packet) if isinstance(packet, dict) else {}
        layers = source.get("layers") if isinstance(source, dict) else None
        if isinstance(layers, dict):
            yield number, layers


def _packet_entry(line: int, layers: dict[str, Any], ports: Container[int]) -> LogEntry | None:
    fields = dict(_flat(layers, 0))
    stamp = _table_stamp(next((fields[name] for name in _TIMES if name in fields), ""))
    whole = fields.get("frame_raw", "")
    if whole:
        try:
            payload = modbus_payload(Packet(0.0, bytes.fromhex(whole), ETHERNET), ports)
        except ValueError:
            payload = None
        if payload is not None:
            return LogEntry(line, payload.data, None, payload.from_client, stamp)
    return _row_entry(line, fields, stamp, ports)


def _flat(value: object, depth: int) -> Iterator[tuple[str, str]]:
    """Yield the fields of all layers with the names of Wireshark; ek writes `tcp_tcp_payload` for `tcp.payload`."""
    if not isinstance(value, dict) or depth > _DEPTH:
        return
    for name, content in value.items():
        plain = re.sub(r"^(\w+?)_\1_", r"\1.", name) if "." not in name else name
        if isinstance(content, dict):
            yield from _flat(content, depth + 1)
        elif isinstance(content, list):
            yield plain, str(content[0]) if content else ""
        else:
            yield plain, str(content)


def read_csv(lines: list[str], ports: Container[int] = MODBUS_PORTS) -> FormContent:
    """Return the entries of a table whose first line names its columns; no entries if it has no bytes.

    >>> read_csv(["frame.time_epoch,tcp.payload", "1.5,000100000003018302"]).entries[0].stamp
    Stamp(seconds=1.5, day=None, of_day=False)
    """
    head = next((line for line in lines if line.strip()), "")
    start = lines.index(head) if head else 0
    separator = max(",;\t|", key=head.count)
    names = [name.strip().strip('"') for name in head.split(separator)]
    if not any(name in _PAYLOADS for name in names):
        return FormContent([], set())
    entries: list[LogEntry] = []
    known = {start + 1}
    for number, line in enumerate(lines[start + 1 :], start=start + 2):
        try:
            row = next(csv.reader([line], delimiter=separator), [])
        except csv.Error:
            continue
        fields = dict(zip(names, row))
        entry = _row_entry(
            number, fields, _table_stamp(next((fields[name] for name in _TIMES if fields.get(name)), "")), ports
        )
        if entry is not None:
            entries.append(entry)
            known.add(number)
    return FormContent(entries, known)


def _row_entry(line: int, fields: dict[str, str], stamp: Stamp | None, ports: Container[int]) -> LogEntry | None:
    """Return the entry of the fields of one packet; None if it has no payload."""
    text = next((fields[name] for name in _PAYLOADS if fields.get(name)), "")
    digits = re.sub(r"[:\s]|0x", "", text.partition(",")[0])
    if not digits or len(digits) % 2 or re.search(r"[^0-9A-Fa-f]", digits):
        return None
    ends = [fields.get(f"{carrier}.{end}", "") for carrier in ("tcp", "udp") for end in ("srcport", "dstport")]
    source, target = (
        int(end) if end.isdecimal() and len(end) < 6 else 0 for end in (ends[0] or ends[2], ends[1] or ends[3])
    )
    from_client: bool | None = None
    if any(port in ports or port == RTU_PORT for port in (source, target)):
        from_client = target in ports or target == RTU_PORT
    elif info := next((fields[name] for name in _INFOS if fields.get(name)), ""):
        from_client = {"Query": True, "Response": False}.get(info.strip().partition(":")[0])
    return LogEntry(line, bytes.fromhex(digits), None, from_client, stamp)


def _table_stamp(text: str) -> Stamp | None:
    try:
        return Stamp(float(text))
    except ValueError:
        return stamp_in(text)
