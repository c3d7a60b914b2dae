"""The gateway: listeners in front, backends behind, and the routes from unit addresses to backends.

    listener  ->  Server (frames, limits, TLS)  ->  Route: policy, address  ->  Backend  ->  the unit
                                                      |
                                                      '-> 01, 02 refused      0A no backend has this unit

One event loop carries out everything; no request has a task or a thread of its own.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self

from barewire.gateway.backend import Backend, ModbusBackend
from barewire.gateway.config import (
    BackendConfig,
    GatewayConfig,
    host_and_port,
    listener_endpoint,
    occupied_by,
    share_port,
)
from barewire.gateway.dispatch import NO_PATH, Query
from barewire.gateway.policy import Policy
from barewire.gateway.status import SAMPLE_INTERVAL, History, of_backend, of_listener
from barewire.io.log import PortLog
from barewire.io.server.asyncio_network import DatagramServer, StreamServer, server_at
from barewire.modbus.adu import BROADCAST
from barewire.modbus.exceptions import ILLEGAL_FUNCTION, exception_name
from barewire.modbus.messages.raw import RawRequest
from barewire.modbus.server.server import AnyUnit, Caller, LaterResponse

if TYPE_CHECKING:
    from ssl import SSLContext

    from barewire.gateway.page import StatusPage
    from barewire.gateway.publish.publisher import PublishConfig, Publisher


class Route:
    """One unit address, as clients see it. A unit of the server that passes each request on to a backend."""

    def __init__(self, gateway: Gateway, unit: int, backend: Backend | None, address: int) -> None:
        self.gateway = gateway
        self.unit = unit
        self.backend = backend
        self.address = address
        """The unit's address on the line."""

    def handle_pdu(self, pdu: bytes, caller: Caller) -> LaterResponse | bytes | None:
        """Pass a request on, unless the policy refuses it. A broadcast is not answered."""
        request = RawRequest(pdu)
        policy = self.gateway.policy
        if not policy.allows_all and (code := policy.refusal(caller, self.unit, request)) is not None:
            self.gateway.refused(caller, self.unit, request, code)
            return bytes((pdu[0] | 0x80, code))
        if self.backend is None:
            self.gateway.has_no_path(caller, self.unit)
            return bytes((pdu[0] | 0x80, NO_PATH))
        if self.unit == BROADCAST and self.backend.has_broadcasts and not request.writes:
            return bytes((pdu[0] | 0x80, ILLEGAL_FUNCTION))  # no unit answers a broadcast, so it can only write
        later = LaterResponse()
        self.backend.submit(Query(caller, self.address, request, later.give))
        if self.unit == BROADCAST and self.backend.has_broadcasts:
            return None  # a broadcast has no response, also on TCP
        return later


class Gateway:
    """A running gateway.

        async with Gateway(read_config(text)) as gateway:
            await gateway.stopping.wait()

    Raises PortError if a listener cannot be opened. A line that cannot be opened is no error: its units get 0A, until
    it can.
    """

    def __init__(self, config: GatewayConfig) -> None:
        self.config = config
        self.policy: Policy = config.policy
        self.backends: list[Backend] = []
        self.routes: dict[int, AnyUnit] = {}
        self.refusals = 0
        """Requests that the policy refused."""
        self._history = History()
        self.page: StatusPage | None = None
        self.publisher: Publisher | None = None
        self.stopping = asyncio.Event()
        """Set by `stop`: the program should leave the gateway."""
        self._listeners: dict[str, StreamServer | DatagramServer] = {}
        self._former: list[Backend] = []
        """The backends that ended while answers could still come, on lines that no backend has now."""
        self._clock = asyncio.get_running_loop().time
        self._started_at = self._clock()
        self._sampling: asyncio.TimerHandle | None = None
        self._log = PortLog("barewire.gateway", "gateway")
        self._use(config, [])

    async def __aenter__(self) -> Self:
        try:
            for url in self.config.listeners:
                self._listeners[url] = await self._listening(url)
            page = await self._page_at(self.config.status)
            await self._swap(page, self._publisher_of(self.config.publish))
        except BaseException:
            await self._close()
            raise
        self._sample()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def stop(self) -> None:
        """Ask the program to leave the gateway."""
        self.stopping.set()

    def _use(self, config: GatewayConfig, known: Sequence[tuple[BackendConfig, Backend]]) -> None:
        """Use the backends and routes of a configuration. Backends that it shares with the present one go on."""
        self.config, self.policy = config, config.policy
        self.backends = [
            next((backend for old, backend in known if old == row), None) or self._backend(row)
            for row in config.backends
        ]
        routes = {unit: Route(self, unit, None, unit) for unit in range(256)}
        for row, backend in zip(config.backends, self.backends):
            routes |= {unit: Route(self, unit, backend, address) for unit, address in row.units.items()}
            if row.broadcast:
                routes[BROADCAST] = Route(self, BROADCAST, backend, BROADCAST)
        self.routes.clear()  # the listeners have this dict
        self.routes.update(routes)

    def _backend(self, config: BackendConfig) -> Backend:
        both = (config.name, config.endpoint, config.options, config.of_units, config.default)
        if config.endpoint.scheme != "can":
            return ModbusBackend(*both, capacity=config.queue, patience=config.patience)
        from barewire.gateway.canopen_backend import CanopenBackend, NodeConfig

        nodes = {node: NodeConfig(node, config.devices.get(unit)) for unit, node in config.units.items()}
        return CanopenBackend(*both, nodes=nodes, capacity=config.queue, patience=config.patience)

    async def _listening(self, url: str) -> StreamServer | DatagramServer:
        """Return a listener that listens. Raises PortError."""
        server = server_at(listener_endpoint(url), self.routes)
        await server.listen()
        return server

    async def _page_at(self, url: str | None) -> StatusPage | None:
        """Return the status page at this URL: the present one, or a new one. Raises PortError."""
        if url is None:
            return None
        if self.page is not None and host_and_port(url) == host_and_port(self.config.status or ""):
            return self.page
        from barewire.gateway.page import StatusPage  # loads microdot

        page = StatusPage(self, url)
        await page.start()
        return page

    def _publisher_of(self, config: PublishConfig | None) -> Publisher | None:
        """Return the publisher of a configuration: the present one, or a new one, which does nothing yet. Raises
        PortError."""
        present = self.publisher
        if config is None:
            return None
        if present is not None and present.config == config:
            return present
        from barewire.gateway.publish.publisher import Publisher  # loads aiomqtt

        has_same_buffer = present is not None and present.config.buffer == config.buffer
        return Publisher(config, present.buffer if present is not None and has_same_buffer else None)

    async def _swap(self, page: StatusPage | None, publisher: Publisher | None) -> None:
        """Use this page and this publisher in place of the present ones."""
        if self.page is not None and page is not self.page:
            await self.page.close()
        self.page = page
        if publisher is not self.publisher:
            if self.publisher is not None:
                await self.publisher.stop()
                if publisher is None or publisher.buffer is not self.publisher.buffer:
                    self.publisher.buffer.close()
            if publisher is not None:
                await publisher.__aenter__()
        self.publisher = publisher

    def _sample(self) -> None:
        self._history.sample(self.backends)
        self._sampling = asyncio.get_running_loop().call_later(SAMPLE_INTERVAL, self._sample)

    def status(self) -> dict[str, Any]:
        """Return the state as values that JSON has. Times are in seconds, points in time since 1970."""
        now = self._clock()
        return {
            "now": time.time(),
            "running_for": now - self._started_at,
            "listeners": [of_listener(server) for server in self.listeners],
            "refused_by_policy": self.refusals,
            "backends": [
                of_backend(backend, config.units, now) for backend, config in zip(self.backends, self.config.backends)
            ],
            "publisher": None if self.publisher is None else self.publisher.status(),
            "history": {"interval": SAMPLE_INTERVAL, "samples": list(self._history.samples)},
        }

    @property
    def listeners(self) -> list[StreamServer | DatagramServer]:
        """The servers in front."""
        return list(self._listeners.values())

    @property
    def urls(self) -> list[str]:
        """The URLs of the listeners, with the ports that they got."""
        return [server.url.partition("?")[0] for server in self.listeners]

    def refused(self, caller: Caller, unit: int, request: RawRequest, code: int) -> None:
        """Log a request that the policy refuses."""
        self.refusals += 1
        client = f"{caller.peer or 'a client'}{f' as {caller.role}' if caller.role else ''}"
        function = f"function {request.function_code}" + (f" ({request.name})" if request.known else "")
        text = f"{client}: {function} to unit {unit}: refused by the policy, {exception_name(code)}"
        self._log.warning("refused", text)

    def has_no_path(self, caller: Caller, unit: int) -> None:
        """Log a request to a unit that no backend has."""
        self._log.warning(("path", unit), f"{caller.peer or 'a client'}: no backend has unit {unit}")

    async def reload(self, config: GatewayConfig) -> None:
        """Use another configuration. What is the same in both goes on without a break.

        The policy and the routes hold at once. A backend that changed is drained, and its port is free before the new
        one opens it. A listener of which only the options changed is closed and opened again; the certificates of all
        are read again. Raises PortError or EncodeError if anything cannot be opened; then all stays as it was.
        """
        opened: dict[str, StreamServer | DatagramServer] = {}
        replaced: list[str] = []
        page, publisher = self.page, self.publisher
        try:
            page = await self._page_at(config.status)
            publisher = self._publisher_of(config.publish)
            contexts = {url: _context_of(url) for url in config.listeners if url in self._listeners}
            for url in config.listeners:
                if url in self._listeners:
                    continue
                for old in [old for old in self._listeners if old not in config.listeners and _same_port(old, url)]:
                    await self._listeners.pop(old).close()
                    replaced.append(old)
                opened[url] = await self._listening(url)
        except BaseException:
            for server in opened.values():
                await server.close()
            if page is not None and page is not self.page:
                await page.close()
            if publisher is not None and (self.publisher is None or publisher.buffer is not self.publisher.buffer):
                publisher.buffer.close()
            for old in replaced:
                self._listeners[old] = await self._listening(old)
            raise
        known = list(zip(self.config.backends, self.backends))
        ended = [backend for row, backend in known if row not in config.backends]
        gone = [url for url in self._listeners if url not in config.listeners]
        for url, context in contexts.items():
            if context is not None:
                self._listeners[url].context = context  # type: ignore[union-attr]  # only TLS has one
        self._listeners |= opened
        self._use(config, known)
        former = [*self._former, *ended]
        for backend in self.backends:
            if all(backend is not old for _, old in known):
                backend.follow([old for old in former if occupied_by(old.endpoint) == occupied_by(backend.endpoint)])
        self._former = [old for old in former if not old.successors]
        # Together: a publisher may take some seconds to leave its lines, and new backends wait for the old ones.
        closing = [self._listeners.pop(url).close() for url in gone]
        await asyncio.gather(self._swap(page, publisher), self._end(ended), *closing)
        self._former = [old for old in self._former if old.awaits_answers]

    async def _end(self, backends: list[Backend]) -> None:
        async def end(backend: Backend) -> None:
            await backend.drain(self.config.drain)
            await backend.close()

        await asyncio.gather(*map(end, backends))

    async def close(self) -> None:
        """Answer what is under way, for `drain` seconds at most, and close everything. New requests get 0A."""
        await self._swap(self.page, None)
        await self._end(self.backends)
        await self._close()

    async def _close(self) -> None:
        for server in self._listeners.values():
            await server.close()
        self._listeners.clear()
        if self._sampling is not None:
            self._sampling.cancel()
        await self._swap(None, None)


def _context_of(url: str) -> SSLContext | None:
    """Return the TLS settings of a listener, with its certificates as they are now; None without TLS."""
    endpoint = listener_endpoint(url)
    if endpoint.transport != "tls":
        return None
    from barewire.io.ports.tls import server_context

    return server_context(endpoint)


def _same_port(url: str, other: str) -> bool:
    """Whether two listeners would have the same port, so that only one of them can be open."""
    return share_port(occupied_by(listener_endpoint(url)), occupied_by(listener_endpoint(other)))
