"""The events of a CAN monitor: values, each with the time `at` in seconds. `event_text` formats them.

        SdoTransferReport     one SDO transfer, assembled      NodeReport, NmtCommandReport      states and commands
        PdoReport             process data by name             EmcyReport, SyncReport,
        PdoMappingReport      a new mapping of a PDO             TimeReport, LssReport           the other services
        BusErrorReport        from the controller              ForeignFrameReport                not classical CANopen
        Violation             a broken rule                    Summary                           counts, at the end
        Gap                   the RECORDING lacks frames       Loss                              the BUS lost a frame

`repeated` is true for an event with the same heartbeat, SYNC or PDO as before. The names of the fields are the keys of
the JSON output (docs/how-to/can-analysis.md) and do not change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

from barewire.codecs import Value
from barewire_workbench.recordings.model import Unread

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

    `rule` is the rule of `rules.BUS_RULES` that is broken if the recording lacks nothing.
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
    """A broken rule of `rules.BUS_RULES`; `frame` is the frame that shows it."""

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
