"""What the servers of Modbus units have in common, in a thread and in asyncio, on any port.

    client -> bytes -> UnitsConnection.answer -> Server.feed -> (fault injector) -> write -> bytes -> client
                                                     |
                           UnitsServer: the units, their counters, the log, the limits of connections

A port without connections, a serial line or UDP, has one `Server` and one framing state, those of the `UnitsServer`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Mapping
from typing import TYPE_CHECKING, Any

from barewire.io.modbus.carriers import modbus_line
from barewire.io.server.base import server_log
from barewire.io.server.limits import ConnectionTable, End
from barewire.modbus.server.server import Caller, LaterResponse, Server, ServerStatistics

if TYPE_CHECKING:
    from barewire.errors import PortError
    from barewire.io.endpoint import Endpoint
    from barewire.io.ports.base import Watch
    from barewire.modbus import AnyUnit
    from barewire.modbus.messages.registry import AnyRequest
    from barewire.modbus.server.server import Reply

Inject = Callable[["Reply", Callable[[bytes], None]], None]
"""Takes an answer and the function that sends it; sends it now, later, changed or not at all (`FaultInjector`)."""


class UnitsServer:
    """The units of a server, and what is recorded about their clients. `inject` puts faults into the answers.

    Raises EncodeError for wrong options.
    """

    failure: PortError | None = None
    """The error of the port that ended the server."""

    def __init__(self, endpoint: Endpoint, units: Mapping[int, AnyUnit], inject: Inject | None = None) -> None:
        self.endpoint = endpoint
        self.url = str(endpoint)
        """The URL for clients, with the port number that the system chose for port 0."""
        self.units = units
        self.inject = inject
        self.log = server_log(endpoint)
        self.statistics = ServerStatistics()
        self.connections: ConnectionTable[Any] = ConnectionTable(endpoint, self.statistics, self.log)
        self.line = modbus_line(endpoint, "server", units)
        """The framing state of a port without connections; of others it shows that the options are right."""
        self.echoes: bool | None = None if endpoint.is_serial_port else False
        """Whether the line echoes, for `Server`. Behind a tunnel is a program, or an adapter of its own."""
        if endpoint.choice("echo", "0") == "auto":
            self.echoes = True


class UnitsConnection(ABC):
    """The connection of one client: it has its own framing state, and shares the units."""

    peer = "?"
    was_answered = False
    _watch: Watch | None = None

    def __init__(self, shared: UnitsServer, **options: Any) -> None:
        """`options` are those of `Server`."""
        self._shared = shared
        self._line = modbus_line(shared.endpoint, "server", tuple(shared.units))
        self.caller = Caller()
        """This client, as a `PduUnit` sees it."""
        self._server = Server(
            self._line,
            shared.units,
            serial=shared.endpoint.framing != "tcp",
            statistics=shared.statistics,
            on_failure=shared.log.failed,
            on_refusal=self._refused,
            caller=self.caller,
            echoes=shared.echoes,
            **options,
        )

    @property
    def role(self) -> str | None:
        """The role of the client, from its TLS certificate."""
        return None

    def _refused(self, unit: int, request: AnyRequest | None) -> None:
        self._shared.log.refused(unit, request, self.peer, self.role)

    def answer(self, data: bytes | None, now: float) -> bool:
        """Take bytes, or the end of a silence, and write the answers. Return whether there were any."""
        if self._watch is not None and data is not None:
            self._watch("received", data)
        replies = self._server.feed(data, now)
        if replies:
            self.send(replies)
        if self._line.broken is not None:  # the beginning of the next frame cannot be found any more
            self.end(str(self._line.broken), "broken")
        return bool(replies)

    def send(self, replies: list[Reply]) -> None:
        """Write replies, those to the requests of one read together."""
        self.was_answered = True
        if self._shared.inject is not None:
            for reply in replies:  # one by one: each has faults of its own
                self._shared.inject(reply, self.write)
        else:
            self.write(replies[0].data if len(replies) == 1 else b"".join([reply.data for reply in replies]))

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send answers to the client, or keep what the system does not take now."""

    @abstractmethod
    def end(self, why: str, end: End) -> None:
        """Close after the pending bytes are sent. Without `why` the client ended the connection."""


def later_response(awaitable: Awaitable[bytes | None]) -> LaterResponse:
    """Return the response that an `async def handle_pdu` will have, in a task of its own."""
    later = LaterResponse()

    async def respond() -> None:
        try:
            later.give(await awaitable)
        except BaseException as error:
            later.give(error)
            if not isinstance(error, Exception):
                raise

    import asyncio  # not at the top: the servers without asyncio do not need it

    task = asyncio.get_running_loop().create_task(respond())
    _tasks.add(task)
    task.add_done_callback(_tasks.discard)
    return later


_tasks: set[Any] = set()
"""The tasks of units: the event loop keeps only weak references, and one may be collected while it waits."""
