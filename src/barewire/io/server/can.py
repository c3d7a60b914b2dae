"""Servers of one CANopen node on a bus: `CanopenServer` in a thread, `AsyncCanopenServer` in an asyncio task.

    with CanopenServer("can://socketcan/can0?node=5", device="az3") as server:         a simulator
    async with AsyncCanopenServer("can://memory/x?node=5", eds="drive.eds") as server:

A socketcand bus between processes needs a server. If none listens at a can://socketcand endpoint on this computer, the
first node that is served there starts one, `SocketcandHub`:

    client                      hub
    ------                      ---
                     <-  < hi >
    < open can0 >    ->
                     <-  < ok >
    < rawmode >      ->
                     <-  < ok >
    < send 605 8 40 41 60 0 0 0 0 0 >   ->   to all others:  < frame 605 1764000000.000001 4041600000000000 >

python-can's `socketcand` interface uses this protocol, so any program with python-can can join. Buses have names; a
frame of one client goes to all others on the same bus, as on a cable.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast
from weakref import WeakValueDictionary

from barewire.canopen import CanFrame
from barewire.canopen.frame import BASE_MAX, DATA_MAX, EXTENDED_MAX
from barewire.devices.device import Device
from barewire.errors import EncodeError, PortError, shown
from barewire.io.canopen.bus.node_runner import Action, NodeDriver, NodeStatistics, check_instance, ended_text, node_ids
from barewire.io.canopen.bus.port import Reopening, receiver
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.endpoint import Endpoint, socketcand_address
from barewire.io.engine.locking import CanopenNode, SharedNode
from barewire.io.log import PortLog
from barewire.io.ports.base import Port
from barewire.io.ports.can.interfaces import can_endpoint, can_port
from barewire.io.ports.network import place_of, reason
from barewire.io.server.base import AsyncServer, ThreadedServer

if TYPE_CHECKING:
    from pathlib import Path

    from barewire.canopen.eds.eds_file import Eds
    from barewire.canopen.object_dictionary import ObjectDictionary
    from barewire.devices.sim.machine import Simulator
    from barewire.io.canopen.bus.async_bus import AsyncRunning
    from barewire.io.canopen.bus.shared_bus import WatchFrames
    from barewire.io.fault_injection.faults import Faults, GivenFaults

    Served = str | Device | Simulator | CanopenNode | ObjectDictionary | Eds


_BACKLOG = 0x10000
"""Bytes that may wait for one client; further frames are dropped."""

_LONGEST = 4096
"""Characters without a complete message after which the connection is closed: it is another protocol."""

_served: WeakValueDictionary[tuple[str, int], _CanopenServerBase] = WeakValueDictionary()
"""The servers of this process that are open, by bus and node-ID."""
_serving = threading.Lock()


class _CanopenServerBase:
    """The constructor of both servers."""

    def __init__(
        self,
        url: str,
        *,
        device: Served | None = None,
        eds: str | Path | Eds | None = None,
        node: int | None = None,
        faults: GivenFaults | None = None,
        fault_seed: int | None = None,
        fault_delay: float | None = None,
        on_fault: Callable[[str], None] | None = None,
        **options: Any,
    ) -> None:
        super().__init__()
        endpoint = self._endpoint = can_endpoint(url, node=node, **options)
        self.refused_pdos: list[str] = []
        """Why PDOs of an EDS are switched off: their description breaks a rule."""
        self._node = SharedNode(_node_of(endpoint, device, eds, self.refused_pdos))
        self.url = str(endpoint)
        self.dial: Callable[[], Port[CanFrame]] = lambda: can_port(endpoint)
        self.faults: Faults[CanFrame] | None = None
        if faults is not None:
            from barewire.io.fault_injection.faults import faults_on_can
            from barewire.io.fault_injection.ports import FaultyPort

            model = faults_on_can(faults, seed=fault_seed, delay=fault_delay, on_fault=on_fault)
            self.dial = lambda: FaultyPort(can_port(endpoint), model)
            self.faults = model
        self._hub: SocketcandHub | None = None
        self.statistics = NodeStatistics()
        """Counters of frames, and the latest errors in the code of the device."""
        self._log = PortLog("barewire.canopen.server", f"can://{endpoint.place}")
        for why in self.refused_pdos:
            self._log.warning("PDO", f"switched off: {why}")
        self._prepare()

    def _prepare(self) -> None:
        """Finish the constructor."""

    def _claim(self) -> None:
        """Begin to serve. Raise EncodeError if this program serves a node with the same node-ID on the bus: both would
        answer each request."""
        keys = [(self._endpoint.place, number) for number in sorted(node_ids(self._node))]
        with _serving:
            for place, number in keys:
                if _served.get((place, number), self) is not self:
                    text = f"node {number} is served on can://{place} already: expected another node-ID, or close that"
                    raise EncodeError(f"{text} server first", "device")
            _served.update(dict.fromkeys(keys, self))

    def _disclaim(self) -> None:
        with _serving:
            for key in [key for key, server in _served.items() if server is self]:
                del _served[key]


class CanopenServer(_CanopenServerBase, ThreadedServer):
    """A node on a bus, served in a thread. The constructor opens the port; `with`, `start()` or `run(stop)` serve.

    device      the node: a `LocalNode`, a simulator or its name, an `ObjectDictionary`, an `Eds`, or any object with
                `feed` and `deadline`
    eds         instead of `device`: the path of an EDS, or a parsed one
    node        the node-ID of a device that has none of its own, 1..127; by default that of the URL, or 1
    faults, fault_seed, fault_delay, on_fault      as those of `ModbusServer`
    options     those of the URL, which they override

    A port that fails is opened again; meanwhile the node receives nothing. `statistics` counts frames. An error in the
    code of the device is logged and kept in `statistics.errors`; the device works on, and a request is aborted with
    0800 0000h.

    Raises EncodeError for a wrong URL, option or device, PortError for a bus that cannot be opened. `start` and `run`
    raise EncodeError if this program serves a node with the same node-ID on the bus.
    """

    _logger = "barewire.canopen.server"

    def _prepare(self) -> None:
        self._bus_log = PortLog("barewire.canopen.bus", self._log.place)
        self._driver = NodeDriver(self._node, self.statistics, self._log)
        self._watch: WatchFrames | None = None
        self._sending = threading.RLock()  # frames are sent in the order in which they were made
        self._hub = _hub(self._endpoint)
        try:
            self.port: Port[CanFrame] = self.dial()
        except BaseException:
            if self._hub is not None:
                self._hub.close()
            raise

    def _begin(self) -> None:
        if not self._has_started:
            try:
                self._claim()
            except EncodeError:
                self.close()
                raise
        super()._begin()

    def _serve(self, stop: threading.Event) -> None:
        clock, driver = time.monotonic, self._driver
        pauses = self._endpoint.pauses
        reopening = Reopening(
            self.dial, lambda seconds: self._is_over_in(stop, seconds), pauses=pauses, log=self._bus_log
        )
        self._log.info("serving", "serving")
        watch = self._watch = self._bus_log.watch()
        with self._sending:
            self._send(driver.start(clock()))
        while not self.is_over(stop):
            try:
                item = receiver(self.port)(driver.wait(clock()))
            except PortError as error:
                self.statistics.failures += 1
                opened = reopening.reopen(self.port, str(error))
                if opened is None:
                    return
                self.port, item = opened
            self.statistics.count(item)
            if watch is not None and isinstance(item, CanFrame):
                watch("received", item)
            with self._sending:
                self._send(driver.feed(item, clock()))

    def _release(self) -> None:
        self._disclaim()
        self._driver.release()
        self.port.close()
        self._log.info("closed", "closed")
        self._log.flush()
        if self._hub is not None:
            self._hub.close()

    def do(self, action: Action) -> None:
        """Call `action(now)` with the node locked, then send the frames that it returns and those that are due.

            server.do(lambda now: device.error(0x4210, now))

        A value that is changed without `do` takes effect within 0.1 s. Raises what the action raises, and PortError if
        the server has ended.
        """
        if self.failure is not None:
            raise PortError(f"{self.url}: {ended_text(self._node, self.failure)}")
        with self._sending:
            now = time.monotonic()
            self._send([*self._node.do(action, now), *self._driver.feed(None, now)])

    def _send(self, frames: list[CanFrame]) -> None:
        for frame in frames:
            # Sending fails while no other node acknowledges. The server continues.
            try:
                self.port.send(frame)
            except PortError as error:
                self.statistics.refused(frame, error, self._log)
                continue
            self.statistics.sent += 1
            if self._watch is not None:
                self._watch("sent", frame)


class AsyncCanopenServer(_CanopenServerBase, AsyncServer):
    """A node on a bus, in an asyncio task. The arguments are those of `CanopenServer`.

    The constructor opens nothing; `async with` or `await start()` opens the bus.
    """

    def _prepare(self) -> None:
        self._is_released = False
        self._bus: CanBus | None = None
        self._running: AsyncRunning | None = None
        self._failure: BaseException | None = None

    def _open_bus(self) -> CanBus:
        self._hub = _hub(self._endpoint)
        if self._is_released and self._hub is not None:  # closed meanwhile
            self._hub.close()
        return CanBus(self.dial(), dial=self.dial, lazy=True)

    async def _open(self) -> None:
        from barewire.io.canopen.bus.async_bus import AsyncRunning, open_in_thread

        self._claim()
        self._bus = await open_in_thread(self._open_bus)
        self._running = AsyncRunning(self._bus, self._node, None, self.statistics, self._log)
        self._log.info("serving", "serving")

    @property
    def failure(self) -> BaseException | None:
        """The error that ended the server, or None."""
        return self._failure if self._running is None else self._running.failure

    async def do(self, action: Action) -> None:
        """Call `action(now)`, then send the frames that it returns and those that are due."""
        if self._running is None:
            raise PortError(f"{self.url}: not served: enter `async with`")
        await self._running.do(action)

    async def _release(self) -> None:
        self._is_released = True
        self._disclaim()
        if self._running is not None:
            self._running.stop()
            self._failure = self._running.failure
            self._running = None
            self._log.info("closed", "closed")
            self._log.flush()
        if self._bus is not None:
            await asyncio.to_thread(self._bus.close)
        if self._hub is not None:
            await asyncio.to_thread(self._hub.close)


def _node_of(
    endpoint: Endpoint, device: Served | None, eds: str | Path | Eds | None, refused: list[str]
) -> CanopenNode:
    """Return the node to serve, which has `feed` and `deadline`. Raises EncodeError for any other device.

    The reasons of PDOs that are switched off, because their description breaks a rule, are appended to `refused`.
    """
    from barewire.canopen.object_dictionary import ObjectDictionary

    if (device is None) == (eds is None):
        raise EncodeError(f"endpoint {str(endpoint)!r}: expected device= or eds=, one of them", "device")
    check_instance(device)
    node = endpoint.integer("node", 0) or None
    if isinstance(device, (str, Device)):
        from barewire.devices.sim import simulator

        device = simulator(device, time.monotonic(), node=node)
    adapter = getattr(device, "canopen", device)
    if device is not None and adapter is None:
        described = getattr(device, "device", None)
        raise EncodeError(f"{described.name if described else shown(device)} has no CANopen", "device")
    if hasattr(adapter, "feed") and hasattr(adapter, "deadline"):
        machine = cast("CanopenNode", adapter)
        _check_node_id(endpoint, machine)
        return machine
    from barewire.canopen import LocalNode, pdos_of
    from barewire.canopen.eds.eds_file import Eds
    from barewire.io.canopen.node import dictionary_of

    node = node or 1
    source = device if eds is None else eds
    if eds is None and not isinstance(source, (ObjectDictionary, Eds)):
        expected = (
            "a LocalNode, a simulator or its name, an ObjectDictionary, an EDS, or a machine with feed and deadline"
        )
        raise EncodeError(f"device={shown(device)}: expected {expected}", "device")
    objects = dictionary_of(cast("Eds | ObjectDictionary", source), node)
    return LocalNode(node, objects, pdos_of(objects, node, refused=refused))


def _check_node_id(endpoint: Endpoint, machine: CanopenNode) -> None:
    """Raise EncodeError if the URL has another node-ID than the device, because clients use the same URL."""
    requested, own = endpoint.integer("node", 0), getattr(machine, "node", None)
    own = getattr(own, "node", own)  # the `node` of a simulator is a LocalNode, whose `node` is the number
    if requested and isinstance(own, int) and own != requested:
        raise EncodeError(
            f"endpoint {str(endpoint)!r}: node {requested} is requested, the device is node {own}", "node"
        )


def _hub(endpoint: Endpoint) -> SocketcandHub | None:
    """Start a socketcand server if the endpoint is on this computer and no server listens there yet."""
    interface, _, channel = endpoint.place.partition("/")
    host, port = socketcand_address(channel)
    if interface != "socketcand" or host not in ("127.0.0.1", "localhost", "::1"):
        return None
    try:
        socket.create_connection((host, port), timeout=1.0).close()
    except ConnectionRefusedError:
        return SocketcandHub(host, port)
    return None


class SocketcandHub:
    """A server of the socketcand protocol, in a thread of its own. Raises PortError if the port is taken."""

    def __init__(self, host: str, port: int) -> None:
        self._loop = asyncio.new_event_loop()
        self._buses: dict[str, set[asyncio.StreamWriter]] = {}
        try:
            self._server = self._loop.run_until_complete(asyncio.start_server(self._client, host, port))
        except OSError as error:
            self._loop.close()
            raise PortError(f"{place_of(host, port)}: {reason(error)}") from None
        self._thread = threading.Thread(target=self._loop.run_forever, name="socketcand", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close all connections and the port."""
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result(timeout=5.0)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(timeout=5.0)
        self._loop.close()

    async def _end(self) -> None:
        self._server.close()
        tasks = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        name = text = ""
        writer.write(b"< hi >")
        try:
            while (data := await reader.read(_LONGEST)) and len(text) < _LONGEST:
                text += data.decode("latin-1")
                while ">" in text:
                    message, _, text = text.partition(">")
                    words = message.partition("<")[2].split()
                    if words[:1] == ["open"] and len(words) == 2:
                        self._leave(name, writer)
                        name = words[1]
                        writer.write(b"< ok >")
                    elif words == ["rawmode"] and name:
                        self._buses.setdefault(name, set()).add(writer)
                        writer.write(b"< ok >")
                    elif words == ["echo"]:
                        writer.write(b"< echo >")
                    elif words[:1] != ["send"] or not self._pass_on(words[1:], self._buses.get(name, set()) - {writer}):
                        writer.write(b"< error unknown command >")
                    else:
                        continue
                    await writer.drain()  # a client that does not read its answers is not read either
        except ConnectionError:
            pass
        except asyncio.CancelledError:
            writer.transport.abort()  # what a client did not read is not waited for
        finally:
            self._leave(name, writer)
            writer.close()
            with contextlib.suppress(ConnectionError, asyncio.CancelledError):
                await writer.wait_closed()

    def _leave(self, name: str, writer: asyncio.StreamWriter) -> None:
        """Remove a client from a bus, and the bus if it was the last."""
        members = self._buses.get(name, set())
        members.discard(writer)
        if not members:
            self._buses.pop(name, None)

    def _pass_on(self, words: list[str], others: set[asyncio.StreamWriter]) -> bool:
        """Pass a frame, IDENTIFIER LENGTH BYTE..., on to all others. Return False if the text is not a frame."""
        try:
            identifier, length, *data = (int(word, 16) for word in words)
            frame = bytes(data)
        except ValueError:
            return False
        base = len(words[0]) == 3  # three digits are a base identifier, even if the number would fit an extended one
        limit = BASE_MAX if base else EXTENDED_MAX
        if not 0 <= identifier <= limit or length != len(frame) or length > DATA_MAX:
            return False
        written = f"{identifier:03X}" if base else f"{identifier:08X}"
        message = f"< frame {written} {time.time():.6f} {frame.hex().upper()} >".encode()
        for other in others:
            # A client that does not read loses frames, as with a full controller: memory is limited, others never wait.
            if other.transport.get_write_buffer_size() < _BACKLOG:
                other.write(message)
        return True
