"""The boot-up of a network by its CANopen manager, and what it does when a node is lost later.   [CiA 302-2]

        1  reset communication         of all nodes; one by one, without those that are kept alive, if there are any
        2  boot slave, in parallel     mandatory nodes: after their boot-up message, or 1 s after the reset; without a
                                       response (B) again every second, until the boot time (1F89h) is over
                                       optional nodes: whenever they send their boot-up message
        3  start                       each node when it has booted; or with `start_all` all at once, when every
                                       mandatory node has booted: then the network is ready
        4  error control               heartbeats and node guarding. A node that is lost is reset and boots again; if it
                                       is mandatory, the whole network may be reset, or stopped (1F80h)

`BootManager` is the machine: `feed` returns frames to send and `BootEvent`s. `boot_network` is a conversation that runs
it until the network has booted; it does not watch the nodes afterwards.

A node that failed boots again when it sends its boot-up message, for example because it was exchanged. So does a node
that reboots while it boots, because it has lost what was written; it fails after three times (`REBOOTS`).

`check_network` is the dry run: what a manager would find and write, without an NMT command and without a write.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

from barewire.canopen.frame import CanFrame
from barewire.canopen.manager.boot_slave import RESET_TIME, BootError, BootProgress, BootResult, boot_slave
from barewire.canopen.manager.network_list import BootSlave, NetworkList, checked_network
from barewire.canopen.nmt.error_control import Guard, GuardEvent, GuardingMaster, HeartbeatConsumer
from barewire.canopen.nmt.messages import NmtCommand, NmtMessage, NmtState, NodeState
from barewire.canopen.sdo import Channel
from barewire.conversation import DEFAULT_TIMEOUT, Conversation, Heard, Listen, Send
from barewire.errors import DecodeError, EncodeError

RETRY_TIME = 1.0
"""Seconds between two boot slave processes of a mandatory node that does not respond."""

REBOOTS = 3
"""How often a boot slave process begins again because the node rebooted meanwhile; then it fails."""

_FUNCTION_CODE = 0x780
_ERROR_CONTROL = 0x700
_RECEIVED = (0x580, 0x600, _ERROR_CONTROL)  # SDO responses, SDO requests of other clients, and error control

BootEventKind = Literal[
    "booted", "failed", "waiting", "missing", "started", "ready", "lost", "rebooted", "reset", "stopped"
]


class BootEvent(NamedTuple):
    """A step of the network.

    booted      a boot slave process has succeeded
    failed      a boot slave process has failed; `result` has the letter and the reason
    waiting     a mandatory node does not respond yet, and is asked again
    missing     the boot time is over, and this mandatory node has not booted
    started     the node was started, or with node 0 all nodes
    ready       all mandatory nodes have booted
    lost        the heartbeat of the node, or its response to node guarding, did not arrive in time
    rebooted    the node has sent its boot-up message although it had booted, or while it booted
    reset       the node, or with node 0 the network, is reset
    stopped     all nodes are stopped
    """

    node: int
    kind: BootEventKind
    at: float
    result: BootResult | None = None

    def __str__(self) -> str:
        if self.result is not None and self.kind in ("booted", "failed", "waiting"):
            return f"{self.result}{'; it is asked again' if self.kind == 'waiting' else ''}"
        name = f"node {self.node}" if self.node else "network"
        text = {"missing": "mandatory, and has not booted in time", "lost": "lost: no heartbeat or guarding response"}
        return f"{name}: {text.get(self.kind, self.kind)}"

    def __repr__(self) -> str:
        return f"<BootEvent {self}>"


class NetworkBoot(NamedTuple):
    """How the boot-up of a network ended, and the last result of each node. It is true if the network is ready."""

    ready: bool
    results: tuple[BootResult, ...]

    def __bool__(self) -> bool:
        return self.ready

    def __str__(self) -> str:
        return "\n".join([*map(str, self.results), f"the network is {'ready' if self.ready else 'not ready'}"])

    def __repr__(self) -> str:
        booted = sum(result.ok for result in self.results)
        return f"<NetworkBoot: {'ready' if self.ready else 'not ready'}, {booted} nodes booted>"


def check_network(
    network: NetworkList,
    *,
    timeout: float = DEFAULT_TIMEOUT,
    channels: Callable[[int], Channel] = Channel,
    progress: BootProgress | None = None,
) -> Conversation[CanFrame, NetworkBoot]:
    """Check each node as `boot_network` does, one after the other, and write nothing. Return a result for each node,
    whose `planned` says what would be written, and whether the network could become ready."""
    results = []
    for slave in checked_network(network).slaves:
        checking = boot_slave(slave, channels(slave.node), timeout=timeout, progress=progress, dry_run=True)
        results.append((yield from checking))
    failed = {result.node for result in results if not result.ok}
    return NetworkBoot(not any(slave.mandatory and slave.node in failed for slave in network.slaves), tuple(results))


_Output: TypeAlias = Iterator[CanFrame | BootEvent]


class _Process:
    """A boot slave process that is carried out by a machine."""

    def __init__(self, conversation: Conversation[CanFrame, BootResult]) -> None:
        self.conversation = conversation
        self.has_begun = False
        self.until = float("-inf")
        self.result: BootResult | None = None

    def step(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Begin or go on until the process waits, and return the frames to send. `result` is set at its end."""
        frames: list[CanFrame] = []
        try:
            step = self.conversation.send(Heard(frame, now)) if self.has_begun else next(self.conversation)
            self.has_begun = True
            while not isinstance(step, Listen) or step.until <= now:
                frames += () if isinstance(step, Listen) else step.items
                step = self.conversation.send(Heard(None, now))
            self.until = step.until
        except StopIteration as stop:
            self.result = stop.value
        return frames


@dataclass(slots=True)
class _Node:
    """The present condition of a node of the network list."""

    slave: BootSlave
    process: _Process | None = None
    begin_at: float | None = None  # when its process begins
    result: BootResult | None = None
    booted: bool = False
    started: bool = False
    waiting: bool = False  # it does not respond, and is asked again
    reboots: int = 0  # while it booted
    guarding: GuardingMaster | None = None


class BootManager:
    """Boots a network, starts its nodes and watches them. A machine: `feed` returns CanFrame and BootEvent.

        network     the nodes, and how they are started
        timeout     seconds for each SDO response
        channels    returns the SDO channel to a node
        progress    called with each step of a boot slave process, in words; its errors are raised by `feed`, and end
                    the process of that node

    The first `feed` resets the communication of the nodes. `results` has the last result of each node.

    >>> manager = BootManager(NetworkList([BootSlave(5, mandatory=True)]))
    >>> [str(item) for item in manager.feed(None, 0.0)], manager.deadline
    (['000#8200'], 1.0)
    >>> [str(item) for item in manager.feed(CanFrame.parse("705#00"), 0.1)]
    ['605#4000100000000000']
    """

    def __init__(
        self,
        network: NetworkList,
        *,
        timeout: float = DEFAULT_TIMEOUT,
        channels: Callable[[int], Channel] = Channel,
        progress: BootProgress | None = None,
    ) -> None:
        self.network = checked_network(network)
        self.timeout = timeout
        self.ready = False
        self._channels = channels
        self._progress = progress
        self._nodes = {slave.node: _Node(slave) for slave in network.slaves if slave.listed}
        self._begun = self._stopped = False
        self._boot_end: float | None = None
        self._heartbeats = HeartbeatConsumer({})

    def __repr__(self) -> str:
        booted = sum(node.booted for node in self._nodes.values())
        return f"<BootManager: {booted} of {len(self._nodes)} nodes booted{', ready' if self.ready else ''}>"

    @property
    def results(self) -> tuple[BootResult, ...]:
        """The last result of each node that has one."""
        return tuple(node.result for node in self._nodes.values() if node.result is not None)

    @property
    def busy(self) -> bool:
        """Whether a boot slave process runs, or is about to begin."""
        return not self._begun or any(node.process or node.begin_at is not None for node in self._nodes.values())

    @property
    def deadline(self) -> float | None:
        """When the next step is due."""
        if not self._begun:
            return float("-inf")
        dues = [self._boot_end, self._heartbeats.deadline]
        for node in self._nodes.values():
            dues.append(node.begin_at)
            dues.append(None if node.process is None else node.process.until)
            dues.append(None if node.guarding is None else node.guarding.deadline)
        return min((due for due in dues if due is not None), default=None)

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame | BootEvent]:
        """Return the frames to send and the events."""
        return list(self._react(frame, now))

    def _react(self, frame: CanFrame | None, now: float) -> _Output:
        if not self._begun:
            yield from self._reset_communication()
            yield from self._begin(now)
        if not self._stopped:
            yield from self._watch(frame, now)
        if self._stopped:  # before, or because a node is lost
            return
        if frame is not None and not frame.extended and not frame.remote:
            node = self._nodes.get(frame.id & 0x7F)
            if node is not None and frame.id & _FUNCTION_CODE in _RECEIVED:
                yield from self._receive(node, frame, now)
        for node in self._nodes.values():
            if node.begin_at is not None and now >= node.begin_at:
                yield from self._boot(node, now)
            elif node.process is not None and now >= node.process.until:
                yield from self._go_on(node, now)
        if self._boot_end is not None and now >= self._boot_end:
            self._boot_end = None
            yield from self._end_of_boot_time(now)

    def _reset_communication(self) -> Iterator[CanFrame]:
        kept_alive = {number for number, node in self._nodes.items() if node.slave.keep_alive}
        if not kept_alive:
            yield _nmt(NmtCommand.RESET_COMMUNICATION, 0)
            return
        for number in range(1, 128):
            if number not in kept_alive and number != self.network.node:
                yield _nmt(NmtCommand.RESET_COMMUNICATION, number)

    def _begin(self, now: float) -> _Output:
        """Begin the boot-up after a reset of the network."""
        self._begun, self.ready = True, False
        self._boot_end = now + self.network.boot_time if self.network.boot_time else None
        for node in self._nodes.values():
            self._forget(node)
            node.reboots = 0
            # Optional nodes are booted when they send their boot-up message, mandatory ones if they do not send it too.
            if node.slave.keep_alive:
                node.begin_at = now
            elif node.slave.mandatory:
                node.begin_at = now + RESET_TIME
        yield from self._check_ready(now)

    def _forget(self, node: _Node) -> None:
        if node.process is not None:
            node.process.conversation.close()
        node.process = node.begin_at = node.guarding = None
        node.booted = node.started = node.waiting = False
        times = self._heartbeats.times
        self._heartbeats.watch({number: time for number, time in times.items() if number != node.slave.node})

    # Boot slave

    def _receive(self, node: _Node, frame: CanFrame, now: float) -> _Output:
        """Begin a process with the boot-up message of a node, or go on with the one that runs."""
        booting = False
        if frame.id & _FUNCTION_CODE == _ERROR_CONTROL:
            try:
                booting = NodeState.decode(frame).is_boot_up
            except DecodeError:
                return
        if node.process is not None:
            yield from self._step(node, frame, now)
            result = node.process.result
            # A node whose boot-up message ended its process has lost what was written. It boots again, not for ever.
            boots_again = booting and result is not None and not result.ok and node.reboots < REBOOTS
            if not boots_again:
                yield from self._end(node, now)
                return
            node.reboots += 1
        elif not booting:
            return
        if node.booted or node.process is not None:
            yield BootEvent(node.slave.node, "rebooted", now)
        self._forget(node)
        yield from self._boot(node, now, after_boot_up=True)

    def _boot(self, node: _Node, now: float, *, after_boot_up: bool = False) -> _Output:
        number = node.slave.node
        node.begin_at = None
        conversation = boot_slave(
            node.slave,
            self._channels(number),
            timeout=self.timeout,
            progress=self._progress,
            after_boot_up=after_boot_up,
            end=self._boot_end if self._boot_end is not None and node.slave.mandatory else float("inf"),
        )
        node.process = _Process(conversation)
        yield from self._go_on(node, now)

    def _go_on(self, node: _Node, now: float) -> _Output:
        yield from self._step(node, None, now)
        yield from self._end(node, now)

    def _step(self, node: _Node, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Let the process of a node go on. An error of `progress` ends it, and is raised."""
        assert node.process is not None
        try:
            return node.process.step(frame, now)
        except BaseException:
            node.process = None
            raise

    def _end(self, node: _Node, now: float) -> _Output:
        """Go on with the network if the boot slave process of a node has ended."""
        if node.process is None or node.process.result is None:
            return
        slave, result = node.slave, node.process.result
        node.process, node.result, node.reboots = None, result, 0
        if result.ok:
            node.booted, node.waiting = True, False
            yield BootEvent(slave.node, "booted", now, result)
            self._start_error_control(node, now)
            if self.ready or not self.network.start_all:
                yield from self._start(node, now)
            yield from self._check_ready(now)
        elif result.error is BootError.B and slave.mandatory and self._has_time(now):
            node.begin_at = now + RETRY_TIME
            if not node.waiting:
                node.waiting = True
                yield BootEvent(slave.node, "waiting", now, result)
        elif not (node.waiting and result.error is BootError.B):  # a node that is waited for is reported as missing
            yield BootEvent(slave.node, "failed", now, result)

    def _has_time(self, now: float) -> bool:
        return not self.network.boot_time or (self._boot_end is not None and now < self._boot_end)

    def _end_of_boot_time(self, now: float) -> _Output:
        for node in self._nodes.values():
            if node.slave.mandatory and not node.booted:
                if node.begin_at is not None and node.waiting:
                    node.begin_at = None
                yield BootEvent(node.slave.node, "missing", now, node.result)

    # Start

    def _check_ready(self, now: float) -> _Output:
        if self.ready or any(node.slave.mandatory and not node.booted for node in self._nodes.values()):
            return
        self.ready, self._boot_end = True, None
        yield BootEvent(0, "ready", now)
        if not self.network.start_all or not self.network.start_slaves:
            return
        nodes = list(self._nodes.values())
        # One NMT command for all also starts those that failed, so each one must have booted.
        if nodes and all(node.booted and node.slave.boot for node in nodes):
            yield _nmt(NmtCommand.START, 0)
            yield BootEvent(0, "started", now)
            for node in nodes:
                node.started = True
        else:
            for node in nodes:
                if node.booted:
                    yield from self._start(node, now)

    def _start(self, node: _Node, now: float) -> _Output:
        operational = node.result is not None and node.result.state == NmtState.OPERATIONAL
        if self.network.start_slaves and node.slave.boot and not node.started and not operational:
            node.started = True
            yield _nmt(NmtCommand.START, node.slave.node)
            yield BootEvent(node.slave.node, "started", now)

    # Error control

    def _start_error_control(self, node: _Node, now: float) -> None:
        slave = node.slave
        if slave.heartbeat:
            self._heartbeats.watch(self._heartbeats.times | {slave.node: slave.heartbeat})
            self._heartbeats.expect(slave.node, now + slave.heartbeat)  # lost also if it never sends a heartbeat
        elif slave.guard_time and slave.retry_factor:
            node.guarding = GuardingMaster({slave.node: Guard(slave.guard_time, slave.retry_factor)}, now)

    def _watch(self, frame: CanFrame | None, now: float) -> _Output:
        lost = [event.node for event in self._heartbeats.feed(frame, now) if event.kind == "lost"]
        for number, node in self._nodes.items():
            if node.guarding is not None:
                for item in node.guarding.feed(frame, now):
                    if not isinstance(item, GuardEvent):
                        yield item
                    elif item.kind == "lost":
                        lost.append(number)
        for number in lost:
            if (node := self._nodes[number]).booted:
                yield from self._lost(node, now)

    def _lost(self, node: _Node, now: float) -> _Output:
        slave = node.slave
        yield BootEvent(slave.node, "lost", now)
        if slave.mandatory and self.network.stop_all:
            self._stopped, self._boot_end = True, None
            for other in self._nodes.values():
                self._forget(other)
            yield _nmt(NmtCommand.STOP, 0)
            yield BootEvent(0, "stopped", now)
        elif slave.mandatory and self.network.reset_all:
            yield _nmt(NmtCommand.RESET_NODE, 0)
            yield BootEvent(0, "reset", now)
            yield from self._begin(now)
        else:
            self._forget(node)
            node.begin_at = now + RESET_TIME if slave.mandatory else None
            yield _nmt(NmtCommand.RESET_NODE, slave.node)
            yield BootEvent(slave.node, "reset", now)


def boot_network(
    network: NetworkList,
    *,
    listen: float = 2.0,
    timeout: float = DEFAULT_TIMEOUT,
    channels: Callable[[int], Channel] = Channel,
    on_event: Callable[[BootEvent], object] | None = None,
    progress: BootProgress | None = None,
) -> Conversation[CanFrame, NetworkBoot]:
    """Boot a network and start its nodes. It ends when no boot slave process runs any more.

        listen      seconds to wait at least for the boot-up messages of optional nodes
        timeout     seconds for each SDO response
        on_event    called with each BootEvent
        progress    called with each step of a boot slave process

    With a boot time of 0, mandatory nodes are waited for without limit. Faults of nodes are in the result.
    """
    if not listen >= 0:
        raise EncodeError(f"listen {listen} s: expected 0 or more", "listen")
    manager = BootManager(network, timeout=timeout, channels=channels, progress=progress)
    heard: Heard[CanFrame] = yield Listen(float("-inf"))
    end = heard.now + listen
    while True:
        for item in manager.feed(heard.item, heard.now):
            if isinstance(item, CanFrame):
                yield Send(item)
            elif on_event is not None:
                on_event(item)
        if not manager.busy and (heard.now >= end or len(manager.results) == len(network.slaves)):
            return NetworkBoot(manager.ready, manager.results)
        deadline = manager.deadline
        heard = yield Listen(end if deadline is None or (not manager.busy and deadline > end) else deadline)


def _nmt(command: NmtCommand, node: int) -> CanFrame:
    return NmtMessage(command, node).encode()
