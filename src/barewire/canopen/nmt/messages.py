"""NMT messages and states: five commands from the master, four states in every device.   [CiA 301, NMT, error control]

        000h | command | node          not confirmed; node 0 addresses all nodes
        700h+n | t sssssss             the state of node n: in a boot-up message, a heartbeat, a response to guarding

        01 start         02 stop         80 enter pre-operational         81 reset node      82 reset communication

                     power on, 81, 82
                            v
                     INITIALISING  00   ---- boot-up message 700h+n | 00 ---->  PRE-OPERATIONAL  7F
                                                                                   |  ^  01 80  |  ^
                                                              OPERATIONAL 05 <-----+  +---------+  STOPPED 04

Start, stop and enter pre-operational lead to their state from each of the lower three states; a device in INITIALISING
receives nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from barewire.canopen.cob_ids import NODE_MAX, NODE_MIN, PDO_SERVICES, ServiceName, check_node, classify, cob_id
from barewire.canopen.frame import CanFrame
from barewire.codecs import BitPattern, Layout
from barewire.errors import DecodeError, EncodeError


class NmtCommand(IntEnum):
    """The command specifiers of the NMT message."""

    START = 0x01
    STOP = 0x02
    ENTER_PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


class NmtState(IntEnum):
    """The states, with their numbers in a heartbeat. 00 is sent once, as the boot-up message."""

    INITIALISING = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


STATE_BYTE = BitPattern("tsss ssss")
_ERROR_CONTROL = 0x700 >> 7
"""The function code of error control, the four bits of an identifier before the node."""
_NAMES = {state.value: state.name.lower().replace("_", "-") for state in NmtState}

STATE_AFTER = {
    NmtCommand.START: NmtState.OPERATIONAL,
    NmtCommand.STOP: NmtState.STOPPED,
    NmtCommand.ENTER_PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
    NmtCommand.RESET_NODE: NmtState.INITIALISING,
    NmtCommand.RESET_COMMUNICATION: NmtState.INITIALISING,
}

_CONFIGURING = frozenset[ServiceName]({"NMT", "error control", "SYNC", "TIME", "EMCY", "SDO request", "SDO answer"})
SERVICES_IN: dict[NmtState, frozenset[ServiceName]] = {
    NmtState.INITIALISING: frozenset(),
    NmtState.PRE_OPERATIONAL: _CONFIGURING,
    NmtState.OPERATIONAL: _CONFIGURING | frozenset(PDO_SERVICES.values()),
    NmtState.STOPPED: frozenset({"NMT", "error control"}),
}
"""The services that a device sends and receives in each state. PDO 5 to 512 work where the first four do."""


@dataclass(frozen=True, slots=True)
class NmtMessage:
    """A command to one node, or to all nodes if the node is 0.

        000h | command 1 | node 1

    >>> str(NmtMessage(NmtCommand.START, 5).encode())
    '000#0105'
    """

    command: NmtCommand
    node: int = 0

    layout = Layout("<BB", "command", "node")

    def encode(self) -> CanFrame:
        """Return the frame with COB-ID 000h. Raise EncodeError for an unknown command or a node outside 0..127."""
        if self.node:
            check_node(self.node)
        if not isinstance(self.command, int):
            commands = ", ".join(f"NmtCommand.{command.name}" for command in NmtCommand)
            raise EncodeError(f"NMT command {self.command!r}: expected one of {commands}")
        return CanFrame(cob_id("NMT"), self.layout.pack(self.command, self.node))

    @classmethod
    def decode(cls, frame: CanFrame) -> NmtMessage:
        """Decode a frame. Raise DecodeError for another identifier or length, an unknown command, a node above 127."""
        if frame.key != (cob_id("NMT"), False) or frame.remote:
            raise DecodeError("mismatch", frame.data, 0, f"{frame} is not an NMT command: expected COB-ID 000h")
        command, node = cls.layout.unpack(frame.data)
        if command not in STATE_AFTER:
            raise DecodeError("function", frame.data, 0, f"{command:02X}h is not an NMT command")
        if node > 127:
            raise DecodeError("value", frame.data, 1, f"node {node}: expected 0..127")
        return cls(NmtCommand(command), node)


@dataclass(frozen=True, slots=True)
class NodeState:
    """A heartbeat, a boot-up message or the response to node guarding: all carry this one byte.

        700h+n | t sssssss        t = 0 in a heartbeat; alternates in responses to node guarding

    >>> str(NodeState(5, NmtState.OPERATIONAL).encode())
    '705#05'
    >>> NodeState.decode(CanFrame.parse("705#85"))
    NodeState(node=5, state=5, toggle=True)
    """

    node: int
    state: int
    toggle: bool = False

    @property
    def is_boot_up(self) -> bool:
        """Whether it is the boot-up message 00h: the node has just finished its initialisation."""
        return self.state == NmtState.INITIALISING and not self.toggle

    @property
    def name(self) -> str:
        """The state in words, or as a number if it is a reserved value."""
        return _NAMES.get(self.state, f"state {self.state:02X}h")

    def encode(self) -> CanFrame:
        """Return the frame: one byte on 700h+n."""
        return CanFrame(cob_id("error control", self.node), bytes([STATE_BYTE.encode(t=self.toggle, s=self.state)]))

    @classmethod
    def decode(cls, frame: CanFrame) -> NodeState:
        """Decode a frame. Bytes behind the first are ignored, because some devices send them.

        Raise DecodeError for another identifier and for a frame without data.
        """
        service_and_node = classify(frame)
        if service_and_node is None or service_and_node[0].name != "error control" or frame.remote:
            raise DecodeError(
                "mismatch", frame.data, 0, f"{frame} is not an error control message: expected 701h..77Fh"
            )
        if not frame.data:
            raise DecodeError("short", frame.data, 0, "the state is byte 0, but there are none")
        fields = STATE_BYTE.decode(frame.data[0])
        return cls(service_and_node[1], fields["s"], bool(fields["t"]))


def reported_state(frame: CanFrame) -> NodeState | None:
    """Return the state that a frame reports, None if it is not an error control message."""
    if frame.id >> 7 != _ERROR_CONTROL:  # most frames of a bus: an exception would cost more than this look
        return None
    try:
        return NodeState.decode(frame)
    except DecodeError:
        return None


def guarding_request(node: int) -> CanFrame:
    """Return the remote frame by which a master requests the state of a node.

    >>> str(guarding_request(5))
    '705#R1'
    """
    return CanFrame(cob_id("error control", node), remote=True, requested=1)


def consumer_entry(word: int) -> tuple[int, float] | None:
    """Return one entry of 1016h, `00 | node | time in ms`, as (node, seconds).

    >>> consumer_entry(134072)
    (2, 3.0)

    Return None if the entry is unused: the node is 0 or above 127, or the time is 0.
    """
    node, milliseconds = word >> 16 & 0xFF, word & 0xFFFF
    return (node, milliseconds / 1000) if NODE_MIN <= node <= NODE_MAX and milliseconds else None


class NmtChange(NamedTuple):
    """A received command and its effect. `before` and `after` are equal if the device was in that state already."""

    command: NmtCommand
    before: NmtState
    after: NmtState


class NmtSlave:
    """The NMT state of one device, changed by the commands addressed to it. A machine.

    After a reset it is in INITIALISING, until the device has finished its initialisation and calls `booted`.

    >>> slave = NmtSlave(5)
    >>> slave.booted()
    >>> slave.feed(NmtMessage(NmtCommand.STOP).encode(), 0.0)[0].after.name, slave.may("SDO request")
    ('STOPPED', False)
    """

    __slots__ = ("node", "state")
    deadline = None  # nothing is timed

    def __init__(self, node: int) -> None:
        self.node = check_node(node)
        self.state = NmtState.INITIALISING

    def booted(self) -> None:
        """End the initialisation and enter PRE-OPERATIONAL. The caller sends the boot-up message now."""
        if self.state is not NmtState.INITIALISING:
            raise EncodeError(f"node {self.node} is {self.state.name}, not INITIALISING")
        self.state = NmtState.PRE_OPERATIONAL

    def feed(self, frame: CanFrame | None, now: float) -> list[NmtChange]:
        """Apply an NMT command. Other frames, commands to other nodes and invalid commands change nothing."""
        if frame is None or frame.id or self.state is NmtState.INITIALISING:
            return []
        try:
            message = NmtMessage.decode(frame)
        except DecodeError:
            return []
        if message.node not in (0, self.node):
            return []
        before, self.state = self.state, STATE_AFTER[message.command]
        return [NmtChange(message.command, before, self.state)]

    def may(self, service: ServiceName) -> bool:
        """Return whether a service works in the present state."""
        return service in SERVICES_IN[self.state]
