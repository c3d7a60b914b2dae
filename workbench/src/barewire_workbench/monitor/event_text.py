"""Formats the events of a CAN monitor: a line for people, or a dict for programs.

0.100000  node 5   SDO       upload 6041h:00 -> 37 06, 1.0 ms
0.200000  node 5   heartbeat operational, was pre-operational
0.300000           GAP       2 heartbeats, SYNC: all silent at once for 10.2 s
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from math import isfinite
from typing import Any

from barewire.canopen.abort_codes import abort_text
from barewire.canopen.emcy import error_text, register_names
from barewire.canopen.nmt.messages import NmtCommand
from barewire_workbench.frames.result import counted
from barewire_workbench.monitor.events import (
    BusErrorReport,
    EmcyReport,
    ForeignFrameReport,
    Gap,
    Loss,
    LssReport,
    MonitorEvent,
    NmtCommandReport,
    NodeReport,
    PdoMappingReport,
    PdoReport,
    SdoTransferReport,
    Summary,
    SyncReport,
    TimeReport,
    Violation,
)
from barewire_workbench.monitor.nodes import state_name
from barewire_workbench.monitor.rules import BUS_RULES
from barewire_workbench.monitor.transfer import object_name
from barewire_workbench.recordings.model import Unread

_BYTES_SHOWN = 16

EVENT_KINDS: dict[type, str] = {
    SdoTransferReport: "sdo",
    Gap: "gap",
    Loss: "loss",
    Violation: "violation",
    NodeReport: "node",
    NmtCommandReport: "nmt",
    EmcyReport: "emcy",
    SyncReport: "sync",
    TimeReport: "time",
    LssReport: "lss",
    PdoReport: "pdo",
    PdoMappingReport: "mapping",
    BusErrorReport: "bus-error",
    ForeignFrameReport: "foreign",
    Unread: "unread",
    Summary: "summary",
}
"""Event class -> its name in JSON and for `--only`."""

_CRC_TEXT = {"ok": "CRC ok", "wrong": "CRC WRONG", "unused": "without CRC", "unknown": "CRC not known"}
_OUTCOME_TEXT = {
    "unanswered": "NO ANSWER",
    "left": "the client did not go on",
    "cut": "the end is not in the recording",
}


def event_kind(event: MonitorEvent) -> str:
    """Return the name of the event in `EVENT_KINDS`."""
    return EVENT_KINDS[type(event)]


def is_repeated(event: MonitorEvent) -> bool:
    """Return whether the event repeats an earlier one."""
    return bool(getattr(event, "repeated", False))


def event_line(event: MonitorEvent) -> str:
    """Return the event as one line.

    >>> event_line(Loss(1.5, 5, 1, "segment 3 did not arrive"))
    '1.500000  node 5    LOSS        segment 3 did not arrive'
    """
    node, service, text = _columns(event)
    return f"{event.at:.6f}  {node:<8}  {service:<10}  {text}".rstrip()


def _node_name(node: int) -> str:
    return f"node {node}" if node else "all"


def _columns(event: MonitorEvent) -> tuple[str, str, str]:
    """Return node, service and text."""
    match event:
        case SdoTransferReport():
            return _node_name(event.node), "SDO", _transfer(event)
        case Violation():
            text = f"{event.rule}: {event.text} [{event.frame}]"
            return _node_name(event.node) if event.node else "", "VIOLATION", text
        case Gap():
            frames = f" ({counted(event.frames, 'frame')})" if event.frames else ""
            broken = f", or {event.rule} is broken" if event.rule else ""
            text = f"not in the recording{frames}{broken}: {event.evidence}"
            return _node_name(event.node) if event.node else "", "GAP", text
        case Loss():
            return _node_name(event.node), "LOSS", event.evidence
        case NodeReport():
            return _node_name(event.node), "guarding" if event.guarded else "heartbeat", _node(event)
        case NmtCommandReport():
            return _node_name(event.node), "NMT", NmtCommand(event.command).name.lower().replace("_", " ")
        case EmcyReport():
            return _node_name(event.node), "EMCY", _emergency(event)
        case SyncReport():
            return "all", "SYNC", _sync(event)
        case TimeReport():
            return "all", "TIME", event.text
        case LssReport():
            return "device" if event.answer else "all", "LSS", event.text
        case PdoReport():
            return _node_name(event.node) if event.node else "", event.name, _pdo(event)
        case PdoMappingReport():
            objects = ", ".join(event.objects) or "no known objects"
            text = "switched off" if event.cob_id is None else f"{event.cob_id:03X}h carries {objects} from now on"
            return _node_name(event.node), event.name, text
        case BusErrorReport():
            return "", "BUS ERROR", event.text
        case ForeignFrameReport():
            return "", "FOREIGN", f"{event.what}: {event.frame}; further ones are counted"
        case Unread():
            return "", "UNREAD", f"line {event.line}: {event.why}: {event.text}"
        case Summary():
            counts = ", ".join(f"{name} {count}" for name, count in event.counts.items())
            broken = ", ".join(f"{rule} {count}" for rule, count in event.violations.items())
            text = f"{counted(event.frames, 'frame')} in {event.seconds:.3f} s: {counts or 'nothing'}"
            return "", "SUMMARY", f"{text}; broken: {broken}" if broken else text


def _transfer(event: SdoTransferReport) -> str:
    direction = event.direction if event.direction != "unknown" else "access"
    words = [direction, object_name(event.index, event.sub), event.name]
    arrow = "<-" if event.direction == "download" else "->"
    value = event.text or ("" if event.data is None else data_text(event.data))
    if event.data is None and event.count:
        value = f"{event.count} bytes seen, not all of them"
    if event.outcome == "done" or (event.direction == "download" and value):
        words.append(f"{arrow} {value or 'nothing'}")
    details = [] if event.manner in ("expedited", "unknown") else [f"{event.manner}, {counted(event.count)}"]
    if event.blocks:
        details[-1] += f" in {counted(event.blocks, 'block')}"
    if event.crc:
        details.append(_CRC_TEXT[event.crc])
    if event.outcome == "aborted":
        by = f" by the {event.by}" if event.by == "client" else ""
        details.append(f"ABORTED{by}: {abort_text(event.abort or 0)}")
    elif event.outcome != "done":
        details.append(_OUTCOME_TEXT[event.outcome])
    details += [f"{event.again} sent again"] if event.again else []
    details += [f"{event.missing} not recorded"] if event.missing else []
    details.append("the beginning is not in the recording" if event.began is None else _span(event.at - event.began))
    if event.late:
        details.append("late")
    return f"{' '.join(word for word in words if word)}; {', '.join(details)}"


def _span(seconds: float) -> str:
    return f"{seconds:.3f} s" if seconds >= 1 else f"{1e3 * seconds:.1f} ms"


def data_text(data: bytes) -> str:
    """Return bytes as hexadecimal pairs, or as text if all of them are printable. Long data is cut."""
    if len(data) > 4 and all(32 <= byte < 127 for byte in data.rstrip(b"\0")):
        text = data.rstrip(b"\0")[: 2 * _BYTES_SHOWN].decode("ascii")
        return f"{text!r}" + (" ..." if len(data) > 2 * _BYTES_SHOWN else "")
    return data[:_BYTES_SHOWN].hex(" ").upper() + (" ..." if len(data) > _BYTES_SHOWN else "")


def _node(event: NodeReport) -> str:
    name = "unknown" if event.state is None else state_name(event.state)
    match event.kind:
        case "boot-up":
            alone = ", no reset was commanded" if event.unasked else ""
            return "boot-up" + (f", was {state_name(event.before)}{alone}" if event.before is not None else "")
        case "state":
            return f"{name}, was {state_name(event.before or 0)}"
        case "missing":
            return f"MISSING for {event.seconds or 0:.3f} s, was {name}"
        case "back":
            return f"back after {event.seconds or 0:.3f} s, {name}"
    return name


def _emergency(event: EmcyReport) -> str:
    register = ", ".join(register_names(event.register)) or "no error left"
    text = f"{event.code:04X}h {error_text(event.code)}; register {event.register:02X}h ({register})"
    return f"{text}; {event.info.hex(' ').upper()}"


def _sync(event: SyncReport) -> str:
    number = "" if event.counter is None else f"number {event.counter}"
    if event.period is None:
        return ", ".join(filter(None, (event.kind if event.kind != "beat" else "", number)))
    if event.kind == "summary":
        jitter = f"{1e3 * (event.shortest or 0):.3f} to {1e3 * (event.longest or 0):.3f} ms"
        return f"{event.beats} beats, every {1e3 * event.period:.3f} ms ({jitter})"
    change = {"missing": "MISSING", "back": "back", "first": "first", "beat": ""}[event.kind]
    return ", ".join(filter(None, (change, number, f"every {1e3 * event.period:.3f} ms")))


def _pdo(event: PdoReport) -> str:
    if event.requested:
        return "requested by a remote frame"
    return ", ".join(event.texts) or (event.data.hex(" ").upper() or "no data")


def event_as_dict(event: MonitorEvent) -> dict[str, Any]:
    """Return the event for `json.dumps`: bytes as hexadecimal digits, NaN as text. The key `event` has its kind.

    >>> event_as_dict(NmtCommandReport(1.0, 1, 5))
    {'event': 'nmt', 'at': 1.0, 'command': 1, 'node': 5}
    """
    names = [field.name for field in fields(event)] if is_dataclass(event) else list(event._fields)
    result: dict[str, Any] = {"event": event_kind(event)}
    result |= {name: _plain(getattr(event, name)) for name in names}
    if isinstance(event, SdoTransferReport) and event.abort is not None:
        result["abort_text"] = abort_text(event.abort)
    elif isinstance(event, Violation):
        result["clause"] = BUS_RULES[event.rule].clause
    elif isinstance(event, EmcyReport):
        result |= {"text": error_text(event.code), "errors": list(register_names(event.register))}
    elif isinstance(event, NodeReport) and event.state is not None:
        result["state_name"] = state_name(event.state)
    return result


def _plain(value: object) -> object:
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, float) and not isfinite(value):
        return str(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value
