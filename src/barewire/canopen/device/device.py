"""A whole CANopen device: the services of one node, each in the states where it may work.   [CiA 301]

                                  +------------ objects (the dictionary) ------------+
        000h    NMT command  ---> |  nmt        which state, and so who may speak    |
        600h+n  SDO request  ---> |  sdo        answers out of the dictionary        | ---> 580h+n
        1201h   SDO request  ---> |  channels   the same on further channels         | ---> 1201h
        080h    SYNC         ---> |  sync       heard, or produced                   | ---> 080h
        200h+n  RPDO ...     ---> |  pdo        process data out of and into it      | ---> 180h+n ...
        100h    TIME         ---> |  time       what time it is                      |
        700h+m  heartbeats   ---> |  control    who is alive; that I am              | ---> 700h+n
        7E5h    LSS          ---> |  lss        which node-ID I have                 | ---> 7E4h
                                  |  errors     what is wrong here                   | ---> 080h+n
                                  +--------------------------------------------------+

                            INITIALISING   PRE-OPERATIONAL   OPERATIONAL   STOPPED
        boot-up message          x
        SDO, EMCY, SYNC, TIME                     x               x
        PDO                                                       x
        NMT, error control                        x               x           x
        LSS                      x                x               x           x

Reset communication brings the defaults (or what 1010h stored) of 1000h to 1FFFh back, reset node those of 2000h to
9FFFh as well; both end with a boot-up message in PRE-OPERATIONAL. A device without a node-ID hears nothing but LSS and
says nothing else. A simulated drive is this machine with a dictionary whose values somebody moves.

I know: one node and its dictionary.  I never know: what the values mean, buses, clocks.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable

from barewire.canopen.cob_ids import NODE_MAX, check_node
from barewire.canopen.device.consumers import DeviceConsumers
from barewire.canopen.device.error_control import HEARTBEAT_ERROR, ErrorControl, validate_consumer_writes
from barewire.canopen.device.sdo_channels import AdditionalServers, validate_channel_writes
from barewire.canopen.device.storage import StoredParameters
from barewire.canopen.device.sync import WRONG_LENGTH, DeviceSync, validate_sync_writes
from barewire.canopen.emcy.consumer import EmcyConsumer
from barewire.canopen.emcy.producer import EmcyProducer
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.slave import LssSlave
from barewire.canopen.nmt.heartbeat import HeartbeatProducer
from barewire.canopen.nmt.messages import NmtCommand, NmtSlave, NmtState
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.pdo.config import PdoConfig
from barewire.canopen.pdo.engine import PdoEngine
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.canopen.sdo.server.server import SdoServer
from barewire.canopen.time_stamp import TimeConsumer, TimeStamp

RECOVERED = 0x8140
FOLLOWED = {0x1005, 0x1006, 0x1007, 0x100C, 0x100D, 0x1012, 0x1016, 0x1017, 0x1019, 0x1028, *range(0x1201, 0x1280)}
"""The objects that say how the services go."""
_PAST, _NEVER = float("-inf"), -1


class LocalNode:
    """One node. A machine: frames and time in, frames out.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> device = LocalNode(5, ObjectDictionary([Entry(0x1017, 0, "heartbeat time", "u16", "rw", 1000)]))
    >>> [str(frame) for frame in device.start(0.0)], device.deadline
    (['705#00'], 1.0)
    >>> [str(frame) for frame in device.feed(CanFrame.parse("605#4017100000000000"), 0.5)]
    ['585#4B171000E8030000']

    `on_reset` is called when a reset command came, after the defaults are back: the place where a simulated machine
    puts itself back as well. With `lss` the device can be given its node-ID over the bus; `node` None means that it
    has none yet.
    """

    __slots__ = (
        *("__weakref__", "_computed", "_due", "_on", "_pdos", "_seen", "_silent_until"),
        *("channels", "control", "dialect", "ears", "errors", "lss", "nmt", "node", "objects", "on_reset"),
        *("pdo", "sdo", "stored", "sync"),
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
    ) -> None:
        self.objects = objects
        self.dialect = dialect
        self.on_reset = on_reset
        self.lss = lss
        if lss is not None:
            lss.node = lss.pending = node
            lss.silence = self._be_silent
        self.stored = StoredParameters(objects)
        self.sync = DeviceSync(objects)
        self.ears = DeviceConsumers(objects)
        validate_sync_writes(objects)
        validate_consumer_writes(objects)
        validate_channel_writes(objects)
        self._pdos = tuple(pdos)
        self._on = False
        self._silent_until = self._due = _PAST
        self._seen = _NEVER
        self._computed = True
        self.errors = EmcyProducer(node or NODE_MAX, objects)
        self.errors.allowed = False
        self._settle(node)

    def _settle(self, node: int | None) -> None:
        """The services of this node-ID. A device that has none keeps them ready, and does not feed them."""
        self.node = node
        place = check_node(NODE_MAX if node is None else node)
        self.errors.renumber(place)
        self.nmt = NmtSlave(place)
        self.sdo = SdoServer(place, self.objects, self.dialect)
        self.channels = AdditionalServers(place, self.objects, self.dialect)
        self.pdo = PdoEngine(place, self.objects, self._pdos, self.errors)
        self.control = ErrorControl(place, self.objects)
        self.stored.put_back()

    def renumber(self, node: int | None) -> None:
        """Another node-ID, or none, that does not come from LSS. To be called before `start` or in `on_reset`."""
        self._settle(node)

    @property
    def state(self) -> NmtState:
        """The NMT state."""
        return self.nmt.state

    @property
    def heartbeat(self) -> HeartbeatProducer:
        """What says that this device is alive."""
        return self.control.heartbeat

    @property
    def time(self) -> TimeConsumer:
        """What time it is, if 1012h lets this device hear it."""
        return self.ears.time

    @property
    def emergencies(self) -> EmcyConsumer:
        """What is wrong with the nodes that 1028h lists."""
        return self.ears.emergencies

    @property
    def deadline(self) -> float | None:
        """When the device has something to say by itself."""
        if not self._on or self.node is None:
            return None
        dues = [self.control.deadline]
        if self._may_speak:
            dues += [self.sdo.deadline, self.channels.deadline, self.pdo.deadline]
            dues += [self.errors.deadline, self.sync.deadline]
        first = min((due for due in dues if due is not None), default=None)
        return None if first is None else max(first, self._silent_until)

    @property
    def _may_speak(self) -> bool:
        """SDO, EMCY, SYNC and TIME are allowed in the same states."""
        return self.nmt.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL)

    def start(self, now: float) -> list[CanFrame]:
        """Power on: initialise, say the boot-up message, be PRE-OPERATIONAL. Without a node-ID: wait for LSS."""
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
        self._be(self.nmt.state, now)
        self._follow(now)
        return [boot_up]

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """What the frame and the time make the device say. Before `start` it says nothing."""
        if not self._on or now < self._silent_until:
            return []
        if now < self._due and self._seen == self.objects.changes and frame is not None and self.sdo.accept(frame, now):
            return []  # inside a block, and nothing else is due: the way of nearly every frame of a long download
        said = [] if self.lss is None else self.lss.feed(frame, now)
        if self.lss is not None and self.lss.wants_to_boot:
            self._settle(self.lss.take_over())
            return said + self.start(now)
        if self.node is None:
            return said
        for change in self.nmt.feed(frame, now):
            if change.after is NmtState.INITIALISING:
                return said + self._reset(change.command, now)
            if change.before is not change.after:
                self._be(change.after, now)
        if self._may_speak:
            said += self.sdo.feed(frame, now) + self.channels.feed(frame, now)
        else:
            self.sdo.forget()
            self.channels.forget()
        self._follow(now)
        frames, missed = self.control.feed(frame, now)
        said += frames
        for node, gone in missed:
            said += self._missed(node, gone, now)
        if self._may_speak:
            said += self._sync_and_pdo(frame, now)
            self.ears.feed(frame, now)
            said += self.errors.feed(None, now)
        self._due = _PAST if self.sdo.deadline is None else self.deadline or _PAST
        return said

    def error(
        self, code: int, now: float, *, source: Hashable = None, info: bytes = b"", register: int | None = None
    ) -> list[CanFrame]:
        """An error has come: it is in the register and the history, and said where the state allows it."""
        return self.errors.error(code, now, source=source, info=info, register=register)

    def error_gone(self, code: int, now: float, *, source: Hashable = None, info: bytes = b"") -> list[CanFrame]:
        """That error is gone; said with 0000h and the register that is left."""
        return self.errors.error_gone(code, now, source=source, info=info)

    def bus_off(self, now: float) -> None:
        """The CAN controller left the bus, or somebody is missed on it: what 1029h says."""
        after = self.control.after_error(self.nmt.state)
        if after is not self.nmt.state:
            self.nmt.state = after
            self._be(after, now)

    def recovered(self, now: float) -> list[CanFrame]:
        """The CAN controller was bus-off and is back: said as 8140h, and at once as over."""
        return self.error(RECOVERED, now) + self.error_gone(RECOVERED, now)

    def say_time(self, stamp: TimeStamp) -> list[CanFrame]:
        """A TIME message, if 1012h bit 30 lets this device produce it and the state allows it."""
        return self.ears.say_time(stamp) if self._may_speak and self.node is not None else []

    def _sync_and_pdo(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """SYNC moves PDOs, whoever says it."""
        said, beat, wrong = self.sync.feed(frame, now)
        if wrong is not None and frame is not None:
            length = bytes([len(frame.data)])
            said += (
                self.errors.error(WRONG_LENGTH, now, info=length)
                if wrong
                else self.errors.error_gone(WRONG_LENGTH, now)
            )
        self.pdo.sync_key, self.pdo.window = self.sync.key, self.sync.window
        return said + self.pdo.feed(beat if wrong is not None or beat is not None else frame, now)

    def _missed(self, node: int, gone: bool, now: float) -> list[CanFrame]:
        """Somebody is silent who must not be, or is heard again."""
        source, info = ("missed", node), bytes([node])
        if gone:
            return self.errors.error_gone(HEARTBEAT_ERROR, now, source=source, info=info)
        said = self.errors.error(HEARTBEAT_ERROR, now, source=source, info=info)
        self.bus_off(now)
        return said

    def _be(self, state: NmtState, now: float) -> None:
        """Another state: whoever has to know."""
        self._seen = _NEVER
        self.control.be(state)
        self.errors.allowed = self._may_speak
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
            self.on_reset(command)
        if self.lss is not None and self.lss.take_over() != self.node:
            self._settle(self.lss.node)
        return self.start(now)

    def _follow(self, now: float) -> None:
        """What the communication objects say now; not asked again while nothing can have changed."""
        objects = self.objects
        if self._seen == objects.changes and not self._computed:
            return
        self._seen = objects.changes
        self._computed = not FOLLOWED.isdisjoint(objects.computed)
        self.control.follow(now)
        self.channels.follow()
        if self._may_speak:
            self.sync.follow(now)
        self.ears.follow()

    def _be_silent(self, until: float) -> None:
        """The bit rate changes: nothing is said and nothing heard until then."""
        self._silent_until = until
