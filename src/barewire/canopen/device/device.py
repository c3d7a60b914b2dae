"""A local node: a whole CANopen device, each service in the NMT states that allow it.   [CiA 301]

                                  +------------ objects (the dictionary) ------------+
        000h    NMT command  ---> |  nmt        the NMT state                        |
        600h+n  SDO request  ---> |  sdo        reads and writes the dictionary      | ---> 580h+n
        1201h   SDO request  ---> |  channels   the same on additional channels      | ---> 1201h
        080h    SYNC         ---> |  sync       consumed, or produced                | ---> 080h
        200h+n  RPDO ...     ---> |  pdo        process data                         | ---> 180h+n ...
        100h    TIME         ---> |  time       time of day                          | ---> 100h
        700h+m  heartbeats   ---> |  control    heartbeat, node and life guarding    | ---> 700h+n
        7E5h    LSS          ---> |  lss        node-ID and bit rate                 | ---> 7E4h
        080h+m  emergencies  ---> |  errors, emergencies    own, and of other nodes  | ---> 080h+n
                                  +--------------------------------------------------+

                            INITIALISING   PRE-OPERATIONAL   OPERATIONAL   STOPPED
        boot-up message          x
        SDO, EMCY, SYNC, TIME                     x               x
        PDO                                                       x
        NMT, error control                        x               x           x
        LSS                      x                x               x           x

Reset communication restores the defaults (or the values stored by 1010h) of 1000h to 1FFFh; reset node restores those
of 2000h to 9FFFh as well. Both end with a boot-up message in PRE-OPERATIONAL. A device without a node-ID receives and
sends only LSS. A simulated drive is this machine with a dictionary whose values the simulation computes.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable

from barewire._callbacks import check_callbacks
from barewire.canopen.cob_ids import NODE_MAX, check_node
from barewire.canopen.device.services import (
    HEARTBEAT_ERROR,
    WRONG_LENGTH,
    AdditionalServers,
    DeviceConsumers,
    DeviceSync,
    ErrorControl,
    validate_channel_writes,
    validate_consumer_writes,
    validate_sync_writes,
)
from barewire.canopen.device.storage import StoredParameters
from barewire.canopen.emcy import EmcyConsumer, EmcyProducer
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import REQUEST_KEY
from barewire.canopen.lss.slave import LssSlave
from barewire.canopen.nmt.error_control import HeartbeatProducer
from barewire.canopen.nmt.messages import NmtCommand, NmtSlave, NmtState
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.pdo.config import PdoConfig, checked_pdos
from barewire.canopen.pdo.engine import PdoEngine
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.canopen.sdo.server import SdoServer
from barewire.canopen.time_stamp import TimeConsumer, TimeStamp
from barewire.errors import EncodeError, shown

_RECOVERED, _INTERNAL_SOFTWARE = 0x8140, 0x6100
_FOLLOWED = {0x1005, 0x1006, 0x1007, 0x100C, 0x100D, 0x1012, 0x1016, 0x1017, 0x1019, 0x1028, *range(0x1201, 0x1280)}
"""The objects that configure the services."""
_PAST, _NEVER, _NMT = float("-inf"), -1, (0, False)


class LocalNode:
    """A whole CANopen node. A machine: frames and time in, frames out.

        node       the node-ID, None if the device has none yet
        objects    the object dictionary
        pdos       the factory settings of the PDOs
        dialect    the SDO dialect of the responses
        on_reset   called at a reset command, after the defaults are restored, so that the application can reset itself
        lss        with an LSS slave, the device can be given its node-ID over the bus
        on_failure    called as on_failure(place, error) for each error in the code of the application (`on_read`,
                      `on_write`, `on_reset`, `store` of LSS) or of the device itself; without it the error is raised

    With `on_failure` the device works on after an error: the request during which it occurred is aborted with
    0800 0000h, a value that cannot be read is zero in a PDO, and the other services are not affected. Emergency 6100h
    (internal software) is sent, and stays active until the node is reset or the application calls
    `error_gone(0x6100, now)`. SdoAbort and other errors of barewire refuse an access; they are not failures.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> device = LocalNode(5, ObjectDictionary([Entry(0x1017, 0, "heartbeat time", "u16", "rw", 1000)]))
    >>> [str(frame) for frame in device.start(0.0)], device.deadline
    (['705#00'], 1.0)
    >>> [str(frame) for frame in device.feed(CanFrame.parse("605#4017100000000000"), 0.5)]
    ['585#4B171000E8030000']
    """

    __slots__ = (
        *("__weakref__", "_computed", "_due", "_has_failed", "_identifiers", "_on", "_on_failure", "_pdos", "_seen"),
        *("_silent_until", "channels", "consumers", "control", "dialect", "errors", "lss", "nmt", "node", "objects"),
        *("on_reset", "pdo", "sdo", "stored", "sync"),
    )

    def __init__(
        self,
        node: int | None,
        objects: ObjectDictionary,
        pdos: Iterable[PdoConfig] = (),
        *,
        dialect: SdoDialect = STANDARD,
        on_reset: Callable[[NmtCommand], None] | None = None,
        lss: LssSlave | None = None,
        on_failure: Callable[[str, Exception], None] | None = None,
    ) -> None:
        if not isinstance(objects, ObjectDictionary):
            text = "expected an ObjectDictionary, such as ObjectDictionary([Entry(...), ...])"
            raise EncodeError(f"LocalNode: objects = {shown(objects)}: {text}", "objects")
        check_node(NODE_MAX if node is None else node)
        check_callbacks("LocalNode", on_reset=on_reset)
        self.objects, self.dialect, self.on_reset = objects, dialect, on_reset
        self.on_failure = on_failure
        self._has_failed = False  # and no emergency says so yet
        self.lss = lss
        if lss is not None:
            lss.node = lss.pending = node
            lss.silence = self._be_silent
        self.stored = StoredParameters(objects)
        self.sync = DeviceSync(objects)
        self.consumers = DeviceConsumers(objects)
        validate_sync_writes(objects)
        validate_consumer_writes(objects)
        validate_channel_writes(objects)
        self._pdos, self._on = checked_pdos(pdos), False
        self._silent_until = self._due = _PAST
        self._seen, self._computed = _NEVER, True
        self.errors = EmcyProducer(node or NODE_MAX, objects)
        self.errors.allowed = False
        self._make_services(node)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.node}: {self.state.name.lower().replace('_', '-')}, {self.objects!r}>"

    def _make_services(self, node: int | None) -> None:
        """Make the services for a node-ID. Without a node-ID they exist but are not fed."""
        self.node = node
        self._identifiers: tuple[object, frozenset[tuple[int, bool]] | None] | None = None
        number = NODE_MAX if node is None else check_node(node)
        # The producer of emergencies is kept, since it has the errors that are active and those of 1003h.
        self.errors.renumber(number)
        self.nmt = NmtSlave(number)
        self.sdo = SdoServer(number, self.objects, self.dialect, on_failure=self.report_failure)
        self.channels = AdditionalServers(number, self.objects, self.dialect, on_failure=self.report_failure)
        self.pdo = PdoEngine(number, self.objects, self._pdos, self.errors)
        self.control = ErrorControl(number, self.objects)
        self.stored.apply()

    def renumber(self, node: int | None) -> None:
        """Change or remove the node-ID without LSS. Call it before `start` or in `on_reset`."""
        self._make_services(node)

    @property
    def state(self) -> NmtState:
        """The NMT state."""
        return self.nmt.state

    @property
    def heartbeat(self) -> HeartbeatProducer:
        """The heartbeat producer."""
        return self.control.heartbeat

    @property
    def time(self) -> TimeConsumer:
        """The TIME consumer, in use if 1012h configures it."""
        return self.consumers.time

    @property
    def emergencies(self) -> EmcyConsumer:
        """The active errors of the nodes that 1028h lists."""
        return self.consumers.emergencies

    @property
    def receives(self) -> frozenset[tuple[int, bool]] | None:
        """The (identifier, extended) of all frames that have an effect on the device as it is configured now, None if
        any may have one. A `NodeGroup` feeds it no others."""
        try:
            pdos = self.pdo.receives
        except Exception:
            return None  # an object of the application cannot be read, which `feed` reports
        if self._identifiers is None or self._identifiers[0] is not pdos:
            parts = [service.receives for service in (self.sdo, self.channels, self.control, self.consumers)]
            own = {_NMT, self.sync.key}.union(*parts if self.node is not None else ())
            own |= {REQUEST_KEY} if self.lss is not None else set()
            self._identifiers = pdos, None if pdos is None or self._computed else pdos | own
        return self._identifiers[1]

    @property
    def deadline(self) -> float | None:
        """The time at which the device next sends something without a request."""
        if not self._on or self.node is None:
            return None
        dues = [self.control.deadline]
        if self._may_communicate:
            try:
                dues += [self.sdo.deadline, self.channels.deadline, self.errors.deadline, self.sync.deadline]
                dues += [self.pdo.deadline]  # it may read objects of the application
            except Exception as error:
                self.report_failure("deadline", error)
        earliest = min((due for due in dues if due is not None), default=None)
        return None if earliest is None else max(earliest, self._silent_until)

    @property
    def on_failure(self) -> Callable[[str, Exception], None] | None:
        """Called with each error of the application or of the device."""
        return self._on_failure

    @on_failure.setter
    def on_failure(self, function: Callable[[str, Exception], None] | None) -> None:
        check_callbacks("LocalNode", on_failure=function)
        self._on_failure = function
        self.objects.on_failure = None if function is None else self.report_failure

    def report_failure(self, place: str, error: Exception) -> None:
        """Report an error to `on_failure`, and send emergency 6100h at the next `feed`; without it, raise the error."""
        if self._on_failure is None:
            raise error
        self._has_failed = True
        self._on_failure(place, error)

    @property
    def _may_communicate(self) -> bool:
        """Whether the NMT state allows SDO, EMCY, SYNC and TIME."""
        return self.nmt.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL)

    def start(self, now: float) -> list[CanFrame]:
        """Power on: enter PRE-OPERATIONAL and return the boot-up message; without a node-ID, wait for LSS."""
        self._on = True
        self.nmt.state = NmtState.INITIALISING
        self.pdo.stop()
        self.sdo.reset()
        self.channels.reset()
        self.sync.stop()
        if self.node is None:
            return []
        boot_up = self.control.boot(now)
        self.nmt.booted()
        self._enter(self.nmt.state)
        try:
            self._follow(None, now, [])
        except Exception as error:
            self.report_failure("configuration", error)
        return [boot_up]

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Return the frames to send after a frame, or after time passing. Before `start` there are none."""
        if not self._on or now < self._silent_until:
            return []
        if now < self._due and self._seen == self.objects.changes and frame is not None and self.sdo.accept(frame, now):
            return []  # fast path: a segment inside a block download, and nothing else is due
        frames: list[CanFrame] = []
        for place, service in _SERVICES:
            try:
                if service(self, frame, now, frames):
                    break
            except Exception as error:
                self.report_failure(place, error)
        if self._has_failed:
            self._has_failed = False
            frames += self.errors.error(_INTERNAL_SOFTWARE, now)
        # The fast path above is for block downloads: only while a transfer runs is the deadline worth its computation.
        self._due = _PAST if self.sdo.deadline is None else self.deadline or _PAST
        return frames

    # The services in the order in which they are fed. They append the frames to send to `frames`, and return True if
    # the services after them are not fed.

    def _feed_nmt(self, frame: CanFrame | None, now: float, frames: list[CanFrame]) -> bool:
        if self.lss is not None:
            frames += self.lss.feed(frame, now)
            if self.lss.must_boot:
                self._make_services(self.lss.take_over())
                frames += self.start(now)
                return True
        if self.node is None:
            return True
        for change in self.nmt.feed(frame, now):
            if change.after is NmtState.INITIALISING:
                frames += self._reset(change.command, now)
                return True
            if change.before is not change.after:
                self._enter(change.after)
        return False

    def _feed_sdo(self, frame: CanFrame | None, now: float, frames: list[CanFrame]) -> None:
        if self._may_communicate:
            frames += self.sdo.feed(frame, now)
            frames += self.channels.feed(frame, now)
        else:
            self.sdo.forget()
            self.channels.forget()

    def _feed_error_control(self, frame: CanFrame | None, now: float, frames: list[CanFrame]) -> None:
        control_frames, events = self.control.feed(frame, now)
        frames += control_frames
        for node, resolved in events:
            self._identifiers = None  # the node is missing, or is not any more
            frames += self._error_control(node, resolved, now)

    def _feed_heartbeat(self, frame: CanFrame | None, now: float, frames: list[CanFrame]) -> None:
        frames += self.control.heartbeat.feed(None, now)

    def _feed_pdo(self, frame: CanFrame | None, now: float, frames: list[CanFrame]) -> None:
        if self._may_communicate:
            frames += self._sync_and_pdo(frame, now)

    def _feed_consumers(self, frame: CanFrame | None, now: float, frames: list[CanFrame]) -> None:
        if self._may_communicate:
            self.consumers.feed(frame, now)
            frames += self.errors.feed(None, now)

    def error(
        self, code: int, now: float, *, source: Hashable = None, info: bytes = b"", register: int | None = None
    ) -> list[CanFrame]:
        """Record an error in register and history. Return the emergency, if the NMT state allows one."""
        return self.errors.error(code, now, source=source, info=info, register=register)

    def error_gone(self, code: int, now: float, *, source: Hashable = None, info: bytes = b"") -> list[CanFrame]:
        """Clear an error. Return the emergency 0000h with the remaining register."""
        return self.errors.error_gone(code, now, source=source, info=info)

    def bus_off(self, now: float) -> None:
        """Change the NMT state as 1029h configures it, because the CAN is bus-off or a monitored node is lost."""
        after = self.control.after_error(self.nmt.state)
        if after is not self.nmt.state:
            self.nmt.state = after
            self._enter(after)

    def recovered(self, now: float) -> list[CanFrame]:
        """Return the emergency 8140h, cleared at once, because the CAN controller recovered from bus-off."""
        return self.error(_RECOVERED, now) + self.error_gone(_RECOVERED, now)

    def send_time(self, stamp: TimeStamp) -> list[CanFrame]:
        """Return the TIME message, if 1012h makes this device a producer and the NMT state allows it."""
        return self.consumers.time_message(stamp) if self._may_communicate and self.node is not None else []

    def _sync_and_pdo(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Feed SYNC and PDOs. A SYNC has the same effect whether it is received or produced."""
        self.pdo.sync_key, self.pdo.window = self.sync.key, self.sync.window
        frames: list[CanFrame] = []
        if frame is not None and self.sync.is_sync(frame):
            if self.sync.has_wrong_length(frame):
                frames += self.errors.error(WRONG_LENGTH, now, info=bytes([len(frame.data)]))
                frame = None
            else:
                frames += self.errors.error_gone(WRONG_LENGTH, now)
        elif produced := self.sync.produce(now):
            if frame is not None:
                frames += self.pdo.feed(frame, now)  # first, because it was received before the SYNC is sent
            frames += produced
            frame = produced[0]
        return frames + self.pdo.feed(frame, now)

    def _error_control(self, node: int, resolved: bool, now: float) -> list[CanFrame]:
        """Return the emergency about a monitored node (0: the guarding master) that is lost, or is back."""
        source, info = ("error control", node), bytes([node])
        if resolved:
            return self.errors.error_gone(HEARTBEAT_ERROR, now, source=source, info=info)
        frames = self.errors.error(HEARTBEAT_ERROR, now, source=source, info=info)
        self.bus_off(now)
        return frames

    def _enter(self, state: NmtState) -> None:
        """Change the services to a new NMT state."""
        self._seen = _NEVER  # the objects are followed again: SYNC was not, in STOPPED
        self.control.set_state(state)
        self.errors.allowed = self._may_communicate
        self.pdo.stop()
        if state is NmtState.OPERATIONAL:
            self.pdo.start()
        if state is NmtState.STOPPED:
            self.sync.stop()

    def _reset(self, command: NmtCommand, now: float) -> list[CanFrame]:
        everything = command is NmtCommand.RESET_NODE
        self.stored.restore(0x1000, 0x9FFF if everything else 0x1FFF)
        self.errors.reset(communication_only=not everything)
        if self.on_reset is not None:
            try:
                self.on_reset(command)
            except Exception as error:
                self.report_failure("on_reset", error)
        if self.lss is not None and self.lss.take_over() != self.node:
            self._make_services(self.lss.node)  # a pending node-ID takes effect at a reset   [CiA 305, node-ID]
        return self.start(now)

    def _follow(self, frame: CanFrame | None, now: float, frames: list[CanFrame]) -> None:
        """Read the communication objects, if any may have changed."""
        if self._seen == self.objects.changes and not self._computed:
            return
        self._seen, self._identifiers = self.objects.changes, None
        self._computed = not _FOLLOWED.isdisjoint(self.objects.computed)
        self.control.follow(now)
        self.channels.follow()
        if self._may_communicate:
            self.sync.follow(now)
        self.consumers.follow()

    def _be_silent(self, until: float) -> None:
        """Send and receive nothing until then, while the bit rate changes."""
        self._silent_until = until


_SERVICES: tuple[tuple[str, Callable[[LocalNode, CanFrame | None, float, list[CanFrame]], object]], ...] = (
    ("NMT and LSS", LocalNode._feed_nmt),
    ("SDO", LocalNode._feed_sdo),
    ("configuration", LocalNode._follow),
    ("error control", LocalNode._feed_error_control),
    ("heartbeat", LocalNode._feed_heartbeat),
    ("SYNC and PDO", LocalNode._feed_pdo),
    ("EMCY and TIME", LocalNode._feed_consumers),
)
