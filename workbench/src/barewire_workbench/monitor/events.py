"""The events of a CAN monitor: the rules that can be broken, the events as values, as lines for people, as dicts.

        SdoTransferReport     one SDO transfer, assembled      NodeReport, NmtCommandReport      states and commands
        PdoReport             process data by name             EmcyReport, SyncReport,
        PdoMappingReport      a new mapping of a PDO             TimeReport, LssReport           the other services
        BusErrorReport        from the controller              ForeignFrameReport                not classical CANopen
        Violation             a broken rule                    Summary                           counts, at the end
        Gap                   the RECORDING lacks frames       Loss                              the BUS lost a frame

Each has the time `at` in seconds; `repeated` is true for an event with the same heartbeat, SYNC or PDO as before. The
names of the fields are the keys of the JSON output (docs/how-to/can-analysis.md) and do not change.

A violation is proved by the frames. If a gap in the recording or a disturbed bus can be the cause as well, the event is
a `Gap` or a `Loss` instead.

    0.100000  node 5   SDO       upload 6041h:00 -> 37 06, 1.0 ms
    0.200000  node 5   heartbeat operational, was pre-operational
    0.300000           GAP       2 heartbeats, SYNC: all silent at once for 10.2 s
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from math import isfinite
from typing import Any, Literal, NamedTuple, TypeAlias

from barewire.canopen.abort_codes import abort_text
from barewire.canopen.emcy import error_text, register_names
from barewire.canopen.nmt.messages import NmtCommand, NodeState
from barewire.codecs import Value
from barewire_workbench.frames.result import counted
from barewire_workbench.recordings.model import Unread


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
    "STOPPED-SENDS": BusRule("CiA 301, NMT states", "a stopped node sends no SDO, PDO or EMCY"),
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


# Events -------------------------------------------------------------------------------------------------------------


TransferDirection = Literal["upload", "download", "unknown"]
TransferManner = Literal["expedited", "segmented", "block", "unknown"]
TransferOutcome = Literal["done", "aborted", "unanswered", "left", "cut"]


@dataclass(frozen=True, slots=True)
class SdoTransferReport:
    """An SDO transfer that is over.

    `outcome`: done; aborted (`abort` is the code, `by` the side); unanswered, the server stopped answering; left, the
    client did not go on; cut, the end is not in the recording. `began` is None if the beginning is not in it.
    `data` is the value, None if a byte of it is not known; `count` of its bytes were recorded. `lost` frames did not
    reach their receiver, `again` counts repeated frames; `missing` frames were on the bus and are not in the recording.
    """

    at: float
    node: int
    channel: int  # the COB-ID of the requests
    direction: TransferDirection
    manner: TransferManner
    index: int | None
    sub: int | None
    outcome: TransferOutcome
    began: float | None
    data: bytes | None
    count: int
    size: int | None = None  # as announced
    abort: int | None = None
    by: Literal["client", "server", ""] = ""
    crc: Literal["ok", "wrong", "unused", "unknown", ""] = ""
    blocks: int = 0
    again: int = 0
    lost: int = 0
    missing: int = 0
    late: bool = False  # the answer came after the monitor had given up the transfer
    name: str = ""
    text: str = ""  # the value by the device description


class Gap(NamedTuple):
    """The recording lacks frames: all from `since` to `at`, or a number of `frames`. `evidence` is the reason.

    `rule` is the rule of `BUS_RULES` that is broken if the recording lacks nothing.
    """

    at: float
    since: float | None
    frames: int | None
    evidence: str
    node: int = 0
    rule: str = ""


class Loss(NamedTuple):
    """Frames on the bus did not reach their receiver, as both sides show."""

    at: float
    node: int
    frames: int
    evidence: str


class Violation(NamedTuple):
    """A broken rule of `BUS_RULES`; `frame` is the frame that shows it."""

    at: float
    rule: str
    node: int
    text: str
    frame: str = ""
    repeated: bool = False


NodeReportKind = Literal["heard", "boot-up", "state", "missing", "back", "beat"]


class NodeReport(NamedTuple):
    """A node: its first state (`heard`), its `boot-up`, another `state`, `missing`, `back`, or no change (`beat`)."""

    at: float
    node: int
    kind: NodeReportKind
    state: int | None
    before: int | None = None
    seconds: float | None = None  # missing: length of the silence; otherwise: since the last state
    guarded: bool = False  # an answer to node guarding, not a heartbeat
    unasked: bool = False  # a boot-up of a node whose state was known, and that was not commanded to reset

    @property
    def repeated(self) -> bool:
        """Whether this repeats an earlier event."""
        return self.kind == "beat"


class NmtCommandReport(NamedTuple):
    """An NMT command; node 0 stands for all nodes."""

    at: float
    command: int
    node: int


class EmcyReport(NamedTuple):
    """An emergency, or with code 0 the end of one."""

    at: float
    node: int
    code: int
    register: int
    info: bytes


class SyncReport(NamedTuple):
    """SYNC: the `first`, `missing`, `back`, a further one (`beat`), at the end a `summary` with period and jitter."""

    at: float
    kind: Literal["first", "beat", "missing", "back", "summary"]
    counter: int | None
    beats: int
    period: float | None = None
    shortest: float | None = None
    longest: float | None = None

    @property
    def repeated(self) -> bool:
        """Whether this repeats an earlier event."""
        return self.kind == "beat"


class TimeReport(NamedTuple):
    """TIME: the time as milliseconds since 1984 and as text."""

    at: float
    milliseconds: int
    text: str


class LssReport(NamedTuple):
    """An LSS message, or a whole fastscan. `answer` is true for a message of a device."""

    at: float
    answer: bool
    service: int
    text: str


class PdoReport(NamedTuple):
    """Process data. `values` is empty without a known mapping; without a known node `node` is 0, `name` the COB-ID."""

    at: float
    node: int
    name: str
    data: bytes
    values: Mapping[str, Value]
    texts: tuple[str, ...]
    repeated: bool
    requested: bool = False  # a remote frame requests it


class PdoMappingReport(NamedTuple):
    """The mapping of a PDO was written or read; it applies from now on. `cob_id` is None if the PDO is switched off."""

    at: float
    node: int
    name: str
    cob_id: int | None
    objects: tuple[str, ...]


class BusErrorReport(NamedTuple):
    """An error frame: the recording controller reports the state of the bus."""

    at: float
    classes: int
    text: str
    repeated: bool


class ForeignFrameReport(NamedTuple):
    """The first frame of a kind that classical CANopen does not have: CAN FD, or an extended identifier."""

    at: float
    what: str
    frame: str


class Summary(NamedTuple):
    """The last event: the number of frames, of each service, and of violations of each rule."""

    at: float
    frames: int
    seconds: float
    counts: Mapping[str, int]
    violations: Mapping[str, int]


MonitorEvent: TypeAlias = (
    SdoTransferReport
    | PdoReport
    | PdoMappingReport
    | NodeReport
    | NmtCommandReport
    | EmcyReport
    | SyncReport
    | TimeReport
    | LssReport
    | BusErrorReport
    | ForeignFrameReport
    | Violation
    | Gap
    | Loss
    | Unread
    | Summary
)


# Lines and dicts ----------------------------------------------------------------------------------------------------


_BYTES_SHOWN = 16

_CRC_TEXT = {"ok": "CRC ok", "wrong": "CRC WRONG", "unused": "without CRC", "unknown": "CRC not known"}
_OUTCOME_TEXT = {
    "unanswered": "NO ANSWER",
    "left": "the client did not go on",
    "cut": "the end is not in the recording",
}


def state_name(state: int) -> str:
    """Return the name of a state.

    >>> state_name(0x7F), state_name(0x33)
    ('pre-operational', 'state 33h')
    """
    return NodeState(0, state).name if state else "boot-up"


def command_name(command: int) -> str:
    """Return the name of an NMT command.

    >>> command_name(0x80)
    'enter pre operational'
    """
    return NmtCommand(command).name.lower().replace("_", " ")


def object_name(index: int | None, sub: int | None) -> str:
    """Return index and sub-index in the usual notation.

    >>> object_name(0x6041, 0), object_name(None, None)
    ('6041h:00', 'an object')
    """
    return "an object" if index is None else f"{index:04X}h:{sub or 0:02X}"


def _transfer(event: SdoTransferReport) -> str:
    direction = event.direction if event.direction != "unknown" else "access"
    words = [direction, object_name(event.index, event.sub), event.name]
    value = event.text or ("" if event.data is None else data_text(event.data))
    if event.data is None and event.count:
        value = f"{event.count} bytes seen, not all of them"
    if event.outcome == "done" or (event.direction == "download" and value):
        words.append(f"{'<-' if event.direction == 'download' else '->'} {value or 'nothing'}")
    return f"{' '.join(filter(None, words))}; {', '.join(_transfer_details(event))}"


def _transfer_details(event: SdoTransferReport) -> Iterator[str]:
    if event.manner not in ("expedited", "unknown"):
        blocks = f" in {counted(event.blocks, 'block')}" if event.blocks else ""
        yield f"{event.manner}, {counted(event.count)}{blocks}"
    if event.crc:
        yield _CRC_TEXT[event.crc]
    if event.outcome == "aborted":
        yield f"ABORTED{' by the client' if event.by == 'client' else ''}: {abort_text(event.abort or 0)}"
    elif event.outcome != "done":
        yield _OUTCOME_TEXT[event.outcome]
    if event.again:
        yield f"{event.again} sent again"
    if event.missing:
        yield f"{event.missing} not recorded"
    yield "the beginning is not in the recording" if event.began is None else _span(event.at - event.began)
    if event.late:
        yield "late"


def _gap(event: Gap) -> str:
    frames = f" ({counted(event.frames, 'frame')})" if event.frames else ""
    broken = f", or {event.rule} is broken" if event.rule else ""
    return f"not in the recording{frames}{broken}: {event.evidence}"


def _mapping(event: PdoMappingReport) -> str:
    if event.cob_id is None:
        return "switched off"
    return f"{event.cob_id:03X}h carries {', '.join(event.objects) or 'no known objects'} from now on"


def _summary(event: Summary) -> str:
    counts = ", ".join(f"{name} {count}" for name, count in event.counts.items())
    broken = ", ".join(f"{rule} {count}" for rule, count in event.violations.items())
    text = f"{counted(event.frames, 'frame')} in {event.seconds:.3f} s: {counts or 'nothing'}"
    return f"{text}; broken: {broken}" if broken else text


def _unread(event: Unread) -> str:
    return f"line {event.line}: {event.why}: {event.text}" if event.line else event.why


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


def _node_name(event: Any) -> str:
    return f"node {event.node}" if event.node else ""


def _node_or_all(event: Any) -> str:
    return _node_name(event) or "all"


class _Form(NamedTuple):
    """How an event is shown: its name in JSON and for `--only`, and the three columns of its line."""

    kind: str
    node: Callable[[Any], str] | str
    service: Callable[[Any], str] | str
    text: Callable[[Any], str]


_FORMS: dict[type, _Form] = {
    SdoTransferReport: _Form("sdo", _node_or_all, "SDO", _transfer),
    Gap: _Form("gap", _node_name, "GAP", _gap),
    Loss: _Form("loss", _node_or_all, "LOSS", lambda event: event.evidence),
    Violation: _Form("violation", _node_name, "VIOLATION", lambda event: f"{event.rule}: {event.text} [{event.frame}]"),
    NodeReport: _Form("node", _node_or_all, lambda event: "guarding" if event.guarded else "heartbeat", _node),
    NmtCommandReport: _Form("nmt", _node_or_all, "NMT", lambda event: command_name(event.command)),
    EmcyReport: _Form("emcy", _node_or_all, "EMCY", _emergency),
    SyncReport: _Form("sync", "all", "SYNC", _sync),
    TimeReport: _Form("time", "all", "TIME", lambda event: event.text),
    LssReport: _Form("lss", lambda event: "device" if event.answer else "all", "LSS", lambda event: event.text),
    PdoReport: _Form("pdo", _node_name, lambda event: event.name, _pdo),
    PdoMappingReport: _Form("mapping", _node_or_all, lambda event: event.name, _mapping),
    BusErrorReport: _Form("bus-error", "", "BUS ERROR", lambda event: event.text),
    ForeignFrameReport: _Form(
        "foreign", "", "FOREIGN", lambda event: f"{event.what}: {event.frame}; further ones are counted"
    ),
    Unread: _Form("unread", "", "UNREAD", _unread),
    Summary: _Form("summary", "", "SUMMARY", _summary),
}
EVENT_KINDS: dict[type, str] = {event_type: form.kind for event_type, form in _FORMS.items()}
"""Event class -> its name in JSON and for `--only`."""


def event_kind(event: MonitorEvent) -> str:
    """Return the name of the event in `EVENT_KINDS`."""
    return EVENT_KINDS[type(event)]


def is_repeated(event: MonitorEvent) -> bool:
    """Return whether the event repeats an earlier one."""
    return bool(getattr(event, "repeated", False))


def is_wrong(event: MonitorEvent) -> bool:
    """Return whether the event is a fault, a refusal, or something that is missing.

    >>> is_wrong(EmcyReport(1.0, 5, 0x4210, 9, bytes(5))), is_wrong(EmcyReport(2.0, 5, 0, 0, bytes(5)))
    (True, False)
    """
    match event:
        case Violation() | Gap() | Loss() | BusErrorReport() | Unread():
            return True
        case SdoTransferReport():
            return event.outcome not in ("done", "cut")
        case EmcyReport():
            return event.code != 0
        case NodeReport() | SyncReport():
            return event.kind == "missing"
    return False


class EventColumns(NamedTuple):
    """What the line of an event shows behind its time."""

    node: str
    service: str
    text: str


def event_columns(event: MonitorEvent) -> EventColumns:
    """Return the columns of the line of an event."""
    form = _FORMS[type(event)]
    node, service = (column if isinstance(column, str) else column(event) for column in (form.node, form.service))
    return EventColumns(node, service, form.text(event))


def event_line(event: MonitorEvent) -> str:
    """Return the event as one line.

    >>> event_line(Loss(1.5, 5, 1, "segment 3 did not arrive"))
    '1.500000  node 5    LOSS        segment 3 did not arrive'
    """
    node, service, text = event_columns(event)
    return f"{event.at:.6f}  {node:<8}  {service:<10}  {text}".rstrip()


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
