"""What was heard on a CAN bus, in words: a line for each event, and a dict for programs.

0.100000  node 5   SDO       upload 6041h:00 -> 37 06, 1.0 ms
0.200000  node 5   heartbeat operational, was pre-operational
0.300000  ?!       GAP       2 heartbeats, SYNC: all silent at once for 10.2 s
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from math import isfinite
from typing import Any

from barewire.canopen.emcy.message import error_text, register_names
from barewire.canopen.nmt.messages import NmtCommand
from barewire.canopen.sdo.aborts import abort_text
from barewire.explain.can_monitor.events import (
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
from barewire.explain.can_monitor.nodes import state_name
from barewire.explain.can_monitor.rules import BUS_RULES
from barewire.explain.can_monitor.transfer import object_name
from barewire.explain.capture.model import Unread
from barewire.explain.result import counted

BYTES_SHOWN = 16

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
"""What an event is called: in JSON, and for choosing."""


def event_kind(event: MonitorEvent) -> str:
    """Its name in `EVENT_KINDS`."""
    return EVENT_KINDS[type(event)]


def is_repeated(event: MonitorEvent) -> bool:
    """Whether it says nothing new."""
    return bool(getattr(event, "repeated", False))


def event_line(event: MonitorEvent) -> str:
    """The line for an event.

    >>> event_line(Loss(1.5, 5, 1, "segment 3 did not arrive"))
    '1.500000  node 5    LOSS        segment 3 did not arrive'
    """
    who, what, said = _parts(event)
    return f"{event.at:.6f}  {who:<8}  {what:<10}  {said}".rstrip()


def _who(node: int) -> str:
    return f"node {node}" if node else "all"


def _parts(event: MonitorEvent) -> tuple[str, str, str]:
    """Who, what, and the sentence."""
    match event:
        case SdoTransferReport():
            return _who(event.node), "SDO", _transfer(event)
        case Violation():
            return _who(event.node) if event.node else "", "VIOLATION", f"{event.rule}: {event.text} [{event.frame}]"
        case Gap():
            frames = f" ({counted(event.frames, 'frame')})" if event.frames else ""
            return _who(event.node) if event.node else "", "GAP", f"not in the recording{frames}: {event.evidence}"
        case Loss():
            return _who(event.node), "LOSS", event.evidence
        case NodeReport():
            return _who(event.node), "guarding" if event.guarded else "heartbeat", _node(event)
        case NmtCommandReport():
            return _who(event.node), "NMT", NmtCommand(event.command).name.lower().replace("_", " ")
        case EmcyReport():
            return _who(event.node), "EMCY", _emergency(event)
        case SyncReport():
            return "all", "SYNC", _sync(event)
        case TimeReport():
            return "all", "TIME", event.text
        case LssReport():
            return "device" if event.answer else "all", "LSS", event.text
        case PdoReport():
            return _who(event.node) if event.node else "", event.name, _pdo(event)
        case PdoMappingReport():
            carries = ", ".join(event.objects) or "nothing that is known"
            where = "switched off" if event.cob_id is None else f"{event.cob_id:03X}h carries {carries} from now on"
            return _who(event.node), event.name, where
        case BusErrorReport():
            return "", "BUS ERROR", event.text
        case ForeignFrameReport():
            return "", "FOREIGN", f"{event.what}: {event.frame}; further ones are counted"
        case Unread():
            return "", "UNREAD", f"line {event.line}: {event.why}: {event.text}"
        case Summary():
            counts = ", ".join(f"{name} {count}" for name, count in event.counts.items())
            broken = ", ".join(f"{rule} {count}" for rule, count in event.violations.items())
            said = f"{counted(event.frames, 'frame')} in {event.seconds:.3f} s: {counts or 'nothing'}"
            return "", "SUMMARY", f"{said}; broken: {broken}" if broken else said


def _transfer(event: SdoTransferReport) -> str:
    words = [
        event.direction if event.direction != "unknown" else "access",
        object_name(event.index, event.sub),
        event.name,
    ]
    arrow = "<-" if event.direction == "download" else "->"
    value = event.text or ("" if event.data is None else digits(event.data))
    if event.data is None and event.count:
        value = f"{event.count} bytes seen, not all of them"
    if event.outcome == "done" or (event.direction == "download" and value):
        words.append(f"{arrow} {value or 'nothing'}")
    told = [] if event.manner in ("expedited", "unknown") else [f"{event.manner}, {counted(event.count)}"]
    if event.blocks:
        told[-1] += f" in {counted(event.blocks, 'block')}"
    if event.crc:
        told.append(
            {"ok": "CRC ok", "wrong": "CRC WRONG", "unused": "without CRC", "unknown": "CRC not known"}[event.crc]
        )
    if event.outcome == "aborted":
        by = f" by the {event.by}" if event.by == "client" else ""
        told.append(f"ABORTED{by}: {abort_text(event.abort or 0)}")
    elif event.outcome != "done":
        told.append(
            {"unanswered": "NO ANSWER", "left": "the client did not go on", "cut": "the end is not in the recording"}[
                event.outcome
            ]
        )
    told += [f"{event.again} sent again"] if event.again else []
    told += [f"{event.missing} not recorded"] if event.missing else []
    told.append("the beginning is not in the recording" if event.began is None else _span(event.at - event.began))
    if event.late:
        told.append("late")
    return f"{' '.join(word for word in words if word)}; {', '.join(told)}"


def _span(seconds: float) -> str:
    return f"{seconds:.3f} s" if seconds >= 1 else f"{1e3 * seconds:.1f} ms"


def digits(data: bytes) -> str:
    """Bytes as people read them: pairs, and the text if they are one."""
    shown = data[:BYTES_SHOWN].hex(" ").upper() + (" ..." if len(data) > BYTES_SHOWN else "")
    if len(data) > 4 and all(32 <= byte < 127 for byte in data.rstrip(b"\0")):
        text = data.rstrip(b"\0")[: 2 * BYTES_SHOWN].decode("ascii")
        return f"{text!r}" + (" ..." if len(data) > 2 * BYTES_SHOWN else "")
    return shown


def _node(event: NodeReport) -> str:
    name = "unknown" if event.state is None else state_name(event.state)
    match event.kind:
        case "boot-up":
            return "boot-up" + (f", was {state_name(event.before)}" if event.before is not None else "")
        case "heard":
            return name
        case "state":
            return f"{name}, was {state_name(event.before or 0)}"
        case "missing":
            return f"MISSING for {event.seconds or 0:.3f} s, was {name}"
        case "back":
            return f"back after {event.seconds or 0:.3f} s, {name}"
    return name


def _emergency(event: EmcyReport) -> str:
    register = ", ".join(register_names(event.register)) or "no error left"
    told = f"{event.code:04X}h {error_text(event.code)}; register {event.register:02X}h ({register})"
    return f"{told}; {event.info.hex(' ').upper()}"


def _sync(event: SyncReport) -> str:
    number = "" if event.counter is None else f"number {event.counter}"
    if event.period is None:
        return ", ".join(filter(None, (event.kind if event.kind != "beat" else "", number)))
    jitter = f"{1e3 * (event.shortest or 0):.3f} to {1e3 * (event.longest or 0):.3f} ms"
    if event.kind == "summary":
        return f"{event.beats} beats, every {1e3 * event.period:.3f} ms ({jitter})"
    kind = {"missing": "MISSING", "back": "back", "first": "first", "beat": ""}[event.kind]
    return ", ".join(filter(None, (kind, number, f"every {1e3 * event.period:.3f} ms")))


def _pdo(event: PdoReport) -> str:
    if event.requested:
        return "asked for by a remote frame"
    return ", ".join(event.texts) or (event.data.hex(" ").upper() or "no data")


def event_as_dict(event: MonitorEvent) -> dict[str, Any]:
    """For programs: ready for `json.dumps`; bytes are hexadecimal, NaN is a text. `event` says what it is.

    >>> event_as_dict(NmtCommandReport(1.0, 1, 5))
    {'event': 'nmt', 'at': 1.0, 'command': 1, 'node': 5}
    """
    names = [field.name for field in fields(event)] if is_dataclass(event) else list(event._fields)
    told: dict[str, Any] = {"event": event_kind(event)}
    told |= {name: _plain(getattr(event, name)) for name in names}
    if isinstance(event, SdoTransferReport) and event.abort is not None:
        told["abort_text"] = abort_text(event.abort)
    elif isinstance(event, Violation):
        told["clause"] = BUS_RULES[event.rule].clause
    elif isinstance(event, EmcyReport):
        told |= {"text": error_text(event.code), "errors": list(register_names(event.register))}
    elif isinstance(event, NodeReport) and event.state is not None:
        told["state_name"] = state_name(event.state)
    return told


def _plain(value: object) -> object:
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, float) and not isfinite(value):
        return str(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value
