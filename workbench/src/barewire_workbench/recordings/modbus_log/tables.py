"""Exports as JSON and CSV: packets of Wireshark and tshark with their payload.

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
from typing import Any

from barewire.errors import DecodeError
from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry, Stamp
from barewire_workbench.recordings.modbus_log.stamps import find_stamp
from barewire_workbench.recordings.modbus_packets import MODBUS_PORTS, RTU_PORT, modbus_payload
from barewire_workbench.recordings.pcapng import ETHERNET, Packet

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
            found = json.loads(text)
        else:
            found = [json.loads(line) for line in lines if '"layers"' in line]
    except (ValueError, RecursionError) as error:
        raise DecodeError("value", b"", 0, f"not the JSON of packets: {error}") from None
    for number, packet in zip(numbers, found if isinstance(found, list) else ()):
        source = packet.get("_source", packet) if isinstance(packet, dict) else {}
        layers = source.get("layers") if isinstance(source, dict) else None
        if isinstance(layers, dict):
            yield number, layers


def _packet_entry(line: int, layers: dict[str, Any], ports: Container[int]) -> LogEntry | None:
    fields = dict(_flat(layers, 0))
    stamp = _stamp(next((fields[name] for name in _TIMES if name in fields), ""))
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
            number, fields, _stamp(next((fields[name] for name in _TIMES if fields.get(name)), "")), ports
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


def _stamp(text: str) -> Stamp | None:
    try:
        return Stamp(float(text))
    except ValueError:
        found = find_stamp(text)
        return None if found is None else found[0]
