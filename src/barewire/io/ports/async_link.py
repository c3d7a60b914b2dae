"""Connections of asyncio clients, by URL: the link, and a mailbox for each that shares it."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable

from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.engine.asyncio import AsyncLink, Connected, Datagrams, Mailbox
from barewire.io.ports.tcp import CONNECT
from barewire.io.ports.tls import client_context, tls_reason
from barewire.io.ports.trace import Direction, Watch
from barewire.tcp import FanOut


async def dial(endpoint: Endpoint, fan: FanOut | None, watch: Watch | None = None) -> tuple[AsyncLink, list[Mailbox]]:
    """Connect. What is received goes into the only mailbox, or into one of many by the transaction numbers (`fan`);
    the end of the connection is passed to all of them. `watch(direction, data)` is called with everything that passes.

    PortError in one line if it fails.
    """
    if endpoint.is_serial_port:
        return _serial(endpoint, watch)
    name = endpoint.place
    host, port = endpoint.host_and_port
    boxes: list[Mailbox] = []

    def spread(data: bytes) -> None:
        assert fan is not None
        for place, frame in fan.feed(data):
            boxes[place].put(frame)

    def lose(why: str) -> None:
        for box in boxes:
            box.fail(why)

    link: Connected | Datagrams = Datagrams(lose) if endpoint.scheme == "udp" else Connected(lose)
    write = link.write_together if fan is not None and isinstance(link, Connected) else link.write
    boxes += [Mailbox(name, _traced("sent", write, watch)) for _ in range(1 if fan is None else len(fan.lines))]
    link.receive = _traced("received", boxes[0].put if fan is None else spread, watch)
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(CONNECT):
            if isinstance(link, Datagrams):
                await loop.create_datagram_endpoint(lambda: link, remote_addr=(host, port))
            else:
                context, server_name = _tls(endpoint, host)
                await loop.create_connection(lambda: link, host, port, ssl=context, server_hostname=server_name)
    except TimeoutError:
        raise PortError(f"{name}: no connection within {CONNECT:g} s") from None
    except OSError as error:
        raise PortError(f"{name}: {tls_reason(error)}") from None
    return link, boxes


def _tls(endpoint: Endpoint, host: str) -> tuple[ssl.SSLContext | None, str | None]:
    if endpoint.scheme != "tls":
        return None, None
    return client_context(endpoint), endpoint.options.get("server_name", host)


def _serial(endpoint: Endpoint, watch: Watch | None) -> tuple[AsyncLink, list[Mailbox]]:
    from barewire.io.ports.async_serial import SerialLink, SerialMailbox
    from barewire.io.ports.serial import SerialPort

    receive = _traced("received", lambda data: box.put(data), watch)
    link = SerialLink(SerialPort.of(endpoint), receive, lambda why: box.fail(why))
    box = SerialMailbox(link.name, _traced("sent", link.write, watch))
    box.link = link
    return link, [box]


def _traced(direction: Direction, pass_on: Callable[[bytes], None], watch: Watch | None) -> Callable[[bytes], None]:
    """`pass_on`, and `watch(direction, data)` before it."""
    if watch is None:
        return pass_on

    def traced(data: bytes) -> None:
        watch(direction, data)
        pass_on(data)

    return traced
