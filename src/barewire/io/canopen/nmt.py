"""`node.nmt` and `bus.nmt`: NMT commands, states, heartbeats, node guarding.   [CiA 301, NMT]

node.nmt.start()                                   sends the command, which the node does not confirm
node.nmt.send_confirmed(NmtCommand.START)          waits until the node reports the new state
node.nmt.state()                                   requests the state by node guarding
bus.nmt.reset()                                    every node of the bus
bus.nmt.start_heartbeat(127, 0.5)                  the heartbeat of this master
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

from barewire import canopen
from barewire._callbacks import check_callbacks
from barewire.canopen import NmtCommand
from barewire.canopen.cob_ids import check_node, check_node_ids
from barewire.io.canopen.bus.node_runner import CallbackAdapter
from barewire.io.canopen.operations import (
    ERROR_CONTROL,
    NO_LOCKS,
    BackgroundTask,
    BusOperation,
    Methods,
    R,
    Subscription,
    background,
    operation,
    send_frame,
    subscription,
)

if TYPE_CHECKING:
    from barewire.canopen import CanFrame
    from barewire.conversation import Conversation
    from barewire.io.canopen.bus_methods import SentBy

_RESPONSES = frozenset((0x580 + node, False) for node in range(1, 128))
_BOOTING = ERROR_CONTROL | _RESPONSES | {(0x600 + node, False) for node in range(1, 128)}
"""The identifiers that the boot-up of a network receives; requests are those of another client, see `Channel`."""


class NmtMethods(Methods[R]):
    """NMT commands to one node, or with node 0 to all of them. They are not confirmed."""

    def __init__(self, runner: R, node: int = 0) -> None:
        super().__init__(runner)
        self.node = node

    @operation
    def send(self, command: NmtCommand) -> BusOperation[None]:
        """Send a command, which is not confirmed."""
        return self._send(command)

    @operation
    def start(self) -> BusOperation[None]:
        """Send start remote node: to operational."""
        return self._send(NmtCommand.START)

    @operation
    def stop(self) -> BusOperation[None]:
        """Send stop remote node: to stopped, without PDOs and SDOs."""
        return self._send(NmtCommand.STOP)

    @operation
    def pre_operational(self) -> BusOperation[None]:
        """Send enter pre-operational: to pre-operational, without PDOs."""
        return self._send(NmtCommand.ENTER_PRE_OPERATIONAL)

    @operation
    def reset(self) -> BusOperation[None]:
        """Send reset node: all objects are as after power-on."""
        return self._send(NmtCommand.RESET_NODE)

    @operation
    def reset_communication(self) -> BusOperation[None]:
        """Send reset communication: only the communication objects are as after power-on."""
        return self._send(NmtCommand.RESET_COMMUNICATION)

    def _send(self, command: NmtCommand) -> BusOperation[None]:
        return send_frame(canopen.NmtMessage(command, self.node).encode())


class NodeNmtMethods(NmtMethods[R]):
    """NMT of one node."""

    @operation
    def send_confirmed(
        self, command: NmtCommand, *, timeout: float = 2.0, ask_every: float | None = None
    ) -> BusOperation[canopen.NmtConfirmation]:
        """Send a command and wait until the node reports the state that it leads to.

        timeout     seconds until NoAnswer is raised
        ask_every   seconds between two requests of node guarding, for a node without heartbeat; by default none
        """
        confirming = canopen.send_nmt(command, self.node, timeout=timeout, ask_every=ask_every)
        return BusOperation(_only(confirming), NO_LOCKS, ERROR_CONTROL)

    @operation
    def state(self, *, timeout: float = 2.0) -> BusOperation[canopen.NodeState]:
        """Request the state of the node by node guarding. A node with heartbeats does not answer: its next heartbeat
        counts, so `timeout` is to be longer than its heartbeat time (1017h)."""
        return BusOperation(canopen.request_state(self.node, timeout=timeout), NO_LOCKS, ERROR_CONTROL)

    @operation
    def wait_for_boot_up(self, *, timeout: float = 10.0) -> BusOperation[canopen.NodeState]:
        """Wait for the boot-up message of the node."""
        return BusOperation(canopen.wait_for_boot_up(self.node, timeout=timeout), NO_LOCKS, ERROR_CONTROL)

    @operation
    def wait_for_heartbeat(self, *, timeout: float = 10.0) -> BusOperation[canopen.NodeState]:
        """Wait for the next heartbeat of the node."""
        return BusOperation(canopen.wait_for_heartbeat(self.node, timeout=timeout), NO_LOCKS, ERROR_CONTROL)

    @operation
    def wait_for_state(self, *states: int, timeout: float = 10.0) -> BusOperation[canopen.NodeState]:
        """Wait for a heartbeat with one of these states."""
        return BusOperation(canopen.wait_for_state(self.node, states, timeout=timeout), NO_LOCKS, ERROR_CONTROL)

    @subscription
    def heartbeats(self, timeout: float | None = None) -> Subscription[canopen.HeartbeatEvent]:
        """Return a stream of the events of this node: it booted, is active, changed its state. With a `timeout`, in
        seconds, also: its heartbeat was lost."""
        times = {} if timeout is None else {self.node: timeout}
        return Subscription(canopen.HeartbeatConsumer(times), frozenset({(0x700 + self.node, False)}))


class NetworkNmtMethods(NmtMethods[R]):
    """NMT of all nodes."""

    @operation
    def send_confirmed(
        self,
        command: NmtCommand,
        *,
        confirmed_by: Iterable[int],
        timeout: float = 2.0,
        ask_every: float | None = None,
    ) -> BusOperation[list[canopen.NmtConfirmation]]:
        """Send a command to all and wait until each node of `confirmed_by` reports the state that it leads to."""
        check_node_ids("confirmed_by", confirmed_by)
        confirming = canopen.send_nmt(command, 0, confirmed_by=confirmed_by, timeout=timeout, ask_every=ask_every)
        return BusOperation(confirming, NO_LOCKS, ERROR_CONTROL)

    @subscription
    def heartbeats(self, times: Mapping[int, float] | None = None) -> Subscription[canopen.HeartbeatEvent]:
        """Return a stream of the events of all nodes: booted, active, changed the state. `times` has the nodes whose
        loss is an event too, with the seconds without heartbeat."""
        return Subscription(canopen.HeartbeatConsumer(times or {}), ERROR_CONTROL)

    @operation
    def boot(
        self,
        network: canopen.NetworkList,
        *,
        listen: float = 2.0,
        timeout: float | None = None,
        on_event: Callable[[canopen.BootEvent], object] | None = None,
        progress: Callable[[int, str], object] | None = None,
        dry_run: bool = False,
    ) -> BusOperation[canopen.NetworkBoot]:
        """Boot a network as its CANopen manager (CiA 302-2): check, configure and start its nodes.

        network     the nodes, what each must be, and how they are started
        listen      seconds to wait at least for the boot-up messages of optional nodes
        timeout     seconds that each SDO response may take; by default the client's
        on_event    called with each event: booted, failed, started, ready ...
        progress    called as progress(node, step) before each step of a node
        dry_run     send no NMT command and write nothing: check each node, and return what would be written

        The communication of the nodes is reset first. All channels of the bus are locked until the network has booted.
        The nodes are not watched afterwards: `start_manager` does that. Faults of nodes are in the result; they raise
        no error. The result is true if the network is ready.
        """
        from barewire.canopen.manager.network_list import checked_network  # loaded by programs with a manager only

        checked_network(network)
        check_callbacks("boot", on_event=on_event, progress=progress)
        wait = self.runner.timeout if timeout is None else timeout
        if dry_run:
            checking = canopen.check_network(network, timeout=wait, channels=self._channel, progress=progress)
            return BusOperation(checking, None, _BOOTING, wait)
        booting = canopen.boot_network(
            network, listen=listen, timeout=wait, channels=self._channel, on_event=on_event, progress=progress
        )
        return BusOperation(booting, None, _BOOTING, wait)

    def _channel(self, node: int) -> canopen.Channel:
        return self.runner.bus.channel(node, self.runner.dialect)

    @background
    def start_manager(
        self,
        network: canopen.NetworkList,
        callback: Callable[[canopen.BootEvent], object],
        *,
        timeout: float | None = None,
        progress: Callable[[int, str], object] | None = None,
    ) -> BackgroundTask:
        """Boot a network as `boot` does, and watch its nodes until it is stopped: a node that is lost is reset, and
        boots again. `callback` is called with each event, in the thread or task of the manager. An error that it or
        `progress` raises is logged and kept in `statistics.errors`; the manager goes on.

        It takes no locks: have no SDO transfers with a node while it boots.
        """
        check_callbacks("start_manager", callback=callback, progress=progress)

        def report(node: int, step: str) -> None:
            if progress is not None:
                adapter.call(progress, node, step)  # its errors do not end the manager

        manager = canopen.BootManager(
            network,
            timeout=self.runner.timeout if timeout is None else timeout,
            channels=lambda node: canopen.Channel(node, self.runner.dialect),
            progress=report,
        )
        adapter = CallbackAdapter(manager, callback)
        return BackgroundTask(adapter, ERROR_CONTROL | _RESPONSES)

    @background
    def start_heartbeat(
        self,
        node: int,
        period: float,
        *,
        state: canopen.NmtState = canopen.NmtState.OPERATIONAL,
        by: SentBy = "python",
    ) -> BackgroundTask:
        """Send the heartbeat of a master whose node-ID is `node` every `period` seconds, the first one at once, until
        it is stopped. Devices watch it by 1016h. Nothing else of the node exists; `bus.host` runs a whole one.

        by="kernel": the kernel sends it if the bus is can://socketcan. Then it shows that the program has not ended,
        but not that it works: a program that hangs has a heartbeat too. `by_kernel` of the result is whether it does.
        """
        from barewire.io.canopen.bus_methods import cyclic_task

        heartbeat = canopen.NodeState(check_node(node), state).encode()
        return cyclic_task(self.runner.bus, canopen.CyclicProducer(period, heartbeat), by)

    @background
    def start_guarding(
        self, guards: Mapping[int, canopen.Guard], callback: Callable[[canopen.GuardEvent], object]
    ) -> BackgroundTask:
        """Guard nodes by regular requests to each, until it is stopped. `callback` is called with each event, in the
        thread or task that sends the requests."""
        return BackgroundTask(
            CallbackAdapter(canopen.GuardingMaster(guards, time.monotonic()), callback), ERROR_CONTROL
        )


def _only(
    confirming: Conversation[CanFrame, list[canopen.NmtConfirmation]],
) -> Conversation[CanFrame, canopen.NmtConfirmation]:
    (confirmation,) = yield from confirming
    return confirmation
