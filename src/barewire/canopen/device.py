"""A whole CANopen device: the services of one node, each in the states where it may work.   [CiA 301]

                                  +------------ objects (the dictionary) ------------+
        000h    NMT command  ---> |  nmt        which state, and so who may speak    |
        600h+n  SDO request  ---> |  sdo        answers out of the dictionary        | ---> 580h+n
        080h    SYNC         ---> |  pdo        process data out of and into it      | ---> 180h+n ...
        200h+n  RPDO ...     ---> |                                                  |
                time         ---> |  heartbeat  1017h milliseconds                   | ---> 700h+n
                                  +--------------------------------------------------+

                            INITIALISING   PRE-OPERATIONAL   OPERATIONAL   STOPPED
        boot-up message          x
        SDO, EMCY                                 x               x
        PDO                                                       x
        NMT, heartbeat                            x               x           x

Reset communication brings the defaults of 1000h to 1FFFh back, reset node those of 2000h to 9FFFh as well; both end
with a boot-up message in PRE-OPERATIONAL. A simulated drive is this machine with a dictionary whose values somebody
moves.

I know: one node and its dictionary.  I never know: what the values mean, buses, clocks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from barewire.canopen.dictionary import ObjectDictionary
from barewire.canopen.emcy import Emergency
from barewire.canopen.frame import CanFrame
from barewire.canopen.heartbeat import HeartbeatProducer
from barewire.canopen.nmt import NmtCommand, NmtSlave, NmtState
from barewire.canopen.pdo_engine import PdoEngine
from barewire.canopen.pdo_records import Pdo
from barewire.canopen.sdo.dialect import STANDARD, Dialect
from barewire.canopen.sdo.serve import SdoServer

ERROR_REGISTER = 0x1001
HEARTBEAT_TIME = 0x1017


class Device:
    """One node. A machine: frames and time in, frames out.

    >>> from barewire.canopen.dictionary import Entry
    >>> device = Device(5, ObjectDictionary([Entry(0x1017, 0, "heartbeat time", "u16", "rw", 1000)]))
    >>> [str(frame) for frame in device.start(0.0)], device.deadline
    (['705#00'], 1.0)
    >>> [str(frame) for frame in device.feed(CanFrame.parse("605#4017100000000000"), 0.5)]
    ['585#4B171000E8030000']

    `on_reset` is called when a reset command came, after the defaults are back: the place where a simulated
    machine puts itself back as well.
    """

    __slots__ = ("heartbeat", "nmt", "node", "objects", "on_reset", "pdo", "sdo")

    def __init__(
        self,
        node: int,
        objects: ObjectDictionary,
        pdos: Iterable[Pdo] = (),
        *,
        dialect: Dialect = STANDARD,
        on_reset: Callable[[NmtCommand], None] | None = None,
    ) -> None:
        self.node = node
        self.objects = objects
        self.nmt = NmtSlave(node)
        self.sdo = SdoServer(node, objects, dialect)
        self.pdo = PdoEngine(node, objects, pdos)
        self.heartbeat = HeartbeatProducer(node)
        self.on_reset = on_reset

    @property
    def state(self) -> NmtState:
        """The NMT state."""
        return self.nmt.state

    @property
    def deadline(self) -> float | None:
        """When the device has something to say by itself."""
        dues = [due for due in (self.heartbeat.deadline, self.pdo.deadline) if due is not None]
        return min(dues, default=None)

    def start(self, now: float) -> list[CanFrame]:
        """Power on: initialise, say the boot-up message, be PRE-OPERATIONAL."""
        self.nmt.state = NmtState.INITIALISING
        self.pdo.stop()
        self.sdo.reset()
        self._follow_heartbeat_time(now)
        boot_up = self.heartbeat.boot_up(now)
        self.nmt.booted()
        self.heartbeat.state = self.nmt.state
        return [boot_up]

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """What the frame and the time make the device say. Before `start` it says nothing."""
        if self.nmt.state is NmtState.INITIALISING:
            return []
        said: list[CanFrame] = []
        for change in self.nmt.feed(frame, now):
            if change.after is NmtState.INITIALISING:
                return self._reset(change.command, now)
            self.heartbeat.state = change.after
            if change.before is not change.after:
                self.pdo.stop()
                if change.after is NmtState.OPERATIONAL:
                    self.pdo.start()
        if self.nmt.may("SDO request"):
            said += self.sdo.feed(frame, now)
            self._follow_heartbeat_time(now)
        said += self.pdo.feed(frame, now)
        said += self.heartbeat.feed(None, now)
        return said

    def emergency(self, code: int, info: bytes = b"") -> list[CanFrame]:
        """An emergency message with the present error register; nothing in a state that does not allow it."""
        if not self.nmt.may("EMCY"):
            return []
        register = int(self.objects.get(ERROR_REGISTER)) if (ERROR_REGISTER, 0) in self.objects else 0
        return [Emergency(self.node, code, register, info).encode()]

    def _reset(self, command: NmtCommand, now: float) -> list[CanFrame]:
        self.objects.restore(0x1000, 0x9FFF if command is NmtCommand.RESET_NODE else 0x1FFF)
        if self.on_reset is not None:
            self.on_reset(command)
        return self.start(now)

    def _follow_heartbeat_time(self, now: float) -> None:
        if (HEARTBEAT_TIME, 0) in self.objects:
            self.heartbeat.set_period(int(self.objects.get(HEARTBEAT_TIME)) / 1000, now)
