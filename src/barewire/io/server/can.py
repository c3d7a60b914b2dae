"""A CANopen node on a bus, and the bus itself where it is one between processes that nobody serves yet."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Mapping

from barewire.canopen import CanFrame
from barewire.errors import EncodeError, PortError
from barewire.io.canopen.node_runner import Action, NodeDriver, begin
from barewire.io.canopen.reconnect import Reopening, taker
from barewire.io.canopen.socketcand import SocketcandHub
from barewire.io.endpoint import Endpoint, socketcand_address
from barewire.io.engine.locking import CanopenNode, SharedNode
from barewire.io.ports.base import Port
from barewire.io.ports.python_can import CanPort
from barewire.io.server.base import POLL_INTERVAL, ThreadedServer


class CanHost(ThreadedServer):
    """A CANopen node on a bus. A port that fails is opened anew; for the node the bus has only been silent.

    `do` does something with the node from outside and says at once what comes of it. What is changed without that is
    seen within a tenth of a second. `others` counts what came and is no frame of CANopen: reports of the controller,
    CAN FD.
    """

    def __init__(self, endpoint: Endpoint, node: CanopenNode) -> None:
        super().__init__()
        _check_node(endpoint, node)
        self._node = SharedNode(node)
        self.others = 0
        self._turn = threading.RLock()  # what is said goes out in the order in which it was said
        self._hub = _hub(endpoint)
        self.dial: Callable[[], Port[CanFrame]] = lambda: CanPort(endpoint)
        self.port: Port[CanFrame] = self.dial()
        self.url = str(endpoint)

    def _serve(self, stop: threading.Event) -> None:
        clock, reopening, ears = time.monotonic, Reopening(self.dial, stop), NodeDriver(self._node)
        with self._turn:
            self._send(begin(self._node, clock()))
        while not self.is_over(stop):
            deadline = self._node.deadline
            wait = POLL_INTERVAL if deadline is None else min(POLL_INTERVAL, max(0.0, deadline - clock()))
            try:
                item = taker(self.port)(wait)
            except PortError as error:
                opened = reopening.reopen(self.port, str(error))
                if opened is None:
                    return
                self.port, item = opened
            self.others += not (item is None or isinstance(item, CanFrame))
            with self._turn:
                self._send(ears.hear(item, clock()))

    def _give_back(self) -> None:
        self.port.close()
        if self._hub is not None:
            self._hub.close()

    def do(self, action: Action) -> None:
        """`action(now)` while nobody else is in the node. The frames that it returns are said, and what is due then.

        host.do(lambda now: device.error(0x4210, now))
        """
        with self._turn:
            self._send(self._node.do(action, time.monotonic()))

    def _send(self, frames: list[CanFrame]) -> None:
        for frame in frames:
            # A bus without anybody else to acknowledge is no reason for a device to die.
            with contextlib.suppress(PortError):
                self.port.send(frame)


def _check_node(endpoint: Endpoint, node: CanopenNode) -> None:
    """A node-ID in the URL must be the one that the device has: it is a client that is told there whom to ask."""
    told, has = endpoint.integer("node", 0), getattr(node, "node", None)
    has = getattr(has, "node", has)  # a simulated machine has a whole node, which has the number
    if told and isinstance(has, int) and has != told:
        raise EncodeError(f"endpoint {str(endpoint)!r}: node {told} is asked for, and the device is node {has}", "node")


def _hub(endpoint: Endpoint) -> SocketcandHub | None:
    """The bus itself, for a socketcand endpoint on this machine that nobody serves yet."""
    interface, _, channel = endpoint.place.partition("/")
    host, port = socketcand_address(channel)
    if interface != "socketcand" or host not in ("127.0.0.1", "localhost", "::1"):
        return None
    try:
        socket.create_connection((host, port), timeout=1.0).close()
    except ConnectionRefusedError:
        return SocketcandHub(host, port)
    return None


def open_can_host(
    url: str,
    node: CanopenNode | None,
    *,
    faults: str | Mapping[str, float] | None = None,
    fault_seed: int | None = None,
    fault_delay: float | None = None,
    on_fault: Callable[[str], None] | None = None,
) -> CanHost:
    """The host of a node at a can:// URL. The faults in its frames are those of `ModbusServer`."""
    endpoint = Endpoint.parse(url)
    if endpoint.scheme != "can":
        raise EncodeError(f"endpoint {url!r}: CANopen goes over can://")
    if node is None:
        raise EncodeError(f"endpoint {url!r}: there is no CANopen node to serve")
    model = None
    if faults is not None:
        from barewire.io.fault_injection.faults import faults_on_can

        model = faults_on_can(faults, seed=fault_seed, delay=fault_delay, on_fault=on_fault)
    host = CanHost(endpoint, node)
    if model is not None:
        from barewire.io.fault_injection.ports import FaultyPort

        dial = host.dial
        host.port, host.dial = FaultyPort(host.port, model), lambda: FaultyPort(dial(), model)
    return host
