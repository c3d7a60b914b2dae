"""What a listener on a CAN bus tells: values, each with the time `at` in seconds. `words` makes lines of them.

        Transfer    one SDO transfer, put together           NodeEvent, Command    states, and who commands them
        Pdo, Mapped process data by name; what is mapped     Emcy, Sync, Time, Lss the other services
        Violation   a rule that was broken                   BusError, Foreign     what is no CANopen at all
        Gap         the RECORDING lacks something            Loss                  the BUS lost something

`repeated` is true where nothing new was said: the same heartbeat, SYNC, or PDO once more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

from barewire.codecs import Value
from barewire.explain.capture.model import Unread

TransferDirection = Literal["upload", "download", "unknown"]
TransferManner = Literal["expedited", "segmented", "block", "unknown"]
TransferOutcome = Literal["done", "aborted", "unanswered", "left", "cut"]


@dataclass(frozen=True, slots=True)
class SdoTransferReport:
    """An SDO transfer that is over.

    `outcome`: done; aborted (`abort` the code, `by` whom); unanswered, the server said nothing more; left, the client
    said nothing more; cut, the recording does not tell the end. `began` is None if the recording begins later.
    `data` is the value, None if not all of it is known; `count` bytes were seen. `lost` frames did not reach their
    receiver, `again` were sent again; `missing` ones were on the bus and are not in the recording.
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
    late: bool = False  # the answer came after we, too, had given it up
    name: str = ""
    text: str = ""  # the value as the device's description tells it


class Gap(NamedTuple):
    """The recording lacks something: from `since` to `at`, or `frames` of them; `evidence` says how we know."""

    at: float
    since: float | None
    frames: int | None
    evidence: str
    node: int = 0


class Loss(NamedTuple):
    """Something on the bus did not reach its receiver, as the two themselves show."""

    at: float
    node: int
    frames: int
    evidence: str


class Violation(NamedTuple):
    """A rule of `rules.RULES` was broken; `frame` is the frame that shows it."""

    at: float
    rule: str
    node: int
    text: str
    frame: str = ""
    repeated: bool = False


NodeReportKind = Literal["heard", "boot-up", "state", "missing", "back", "beat"]


class NodeReport(NamedTuple):
    """Something about a node: `heard` for the first time, its `boot-up`, another `state`, `missing`, `back`; or the
    same as before (`beat`)."""

    at: float
    node: int
    kind: NodeReportKind
    state: int | None
    before: int | None = None
    seconds: float | None = None  # missing: since when; beat: since the last one
    guarded: bool = False  # an answer to node guarding, not a heartbeat

    @property
    def repeated(self) -> bool:
        """Nothing new."""
        return self.kind == "beat"


class NmtCommandReport(NamedTuple):
    """An NMT command; node 0 is all."""

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
    """SYNC: `first`, `missing`, `back`, one more (`beat`), and `summary` at the end: its period and its jitter."""

    at: float
    kind: Literal["first", "beat", "missing", "back", "summary"]
    counter: int | None
    beats: int
    period: float | None = None
    shortest: float | None = None
    longest: float | None = None

    @property
    def repeated(self) -> bool:
        """Nothing new."""
        return self.kind == "beat"


class TimeReport(NamedTuple):
    """TIME: what time it is, as milliseconds since 1984 and as text."""

    at: float
    milliseconds: int
    text: str


class LssReport(NamedTuple):
    """An LSS message; a whole fastscan is one. `answer`: from a device."""

    at: float
    answer: bool
    service: int
    text: str


class PdoReport(NamedTuple):
    """Process data. Without a mapping `values` is empty; without an owner `node` is 0 and `name` the COB-ID."""

    at: float
    node: int
    name: str
    data: bytes
    values: Mapping[str, Value]
    texts: tuple[str, ...]
    repeated: bool
    requested: bool = False  # a remote frame asks for it


class PdoMappingReport(NamedTuple):
    """Somebody changed or told what a PDO carries: from now on it is unpacked so. An empty `objects`: switched off."""

    at: float
    node: int
    name: str
    cob_id: int | None
    objects: tuple[str, ...]


class BusErrorReport(NamedTuple):
    """The controller of the recorder reports about the bus."""

    at: float
    classes: int
    text: str
    repeated: bool


class ForeignFrameReport(NamedTuple):
    """The first frame of a kind that is not classical CANopen: CAN FD, or an extended identifier."""

    at: float
    what: str
    frame: str


class Summary(NamedTuple):
    """The last event: how much was heard, how much of each, and which rules were broken how often."""

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
