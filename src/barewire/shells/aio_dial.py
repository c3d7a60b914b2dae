"""Connections of asyncio clients, by URL: the link, and a mailbox for each that shares it."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable

from barewire.errors import PortError
from barewire.shells.aio import AsyncLink, Connected, Datagrams, Mailbox
from barewire.shells.endpoint import Endpoint
from barewire.shells.tcp_socket import CONNECT
from barewire.shells.tls import client_context, tls_reason


async def dial(endpoint: Endpoint, boxes: int, receive: Callable[[bytes], None]) -> tuple[AsyncLink, list[Mailbox]]:
    """Connect. `receive` is given what comes; that nothing comes any more is told to all mailboxes.

    PortError in one line if it fails.
    """
    if endpoint.is_serial_port:
        return _serial(endpoint, receive)
    name = endpoint.place
    host, port = endpoint.host_and_port
    mailboxes: list[Mailbox] = []

    def lose(why: str) -> None:
        for box in mailboxes:
            box.fail(why)

    loop = asyncio.get_running_loop()
    link: Connected | Datagrams
    try:
        async with asyncio.timeout(CONNECT):
            if endpoint.scheme == "udp":
                _, link = await loop.create_datagram_endpoint(
                    lambda: Datagrams(receive, lose), remote_addr=(host, port)
                )
            else:
                context, server_name = _tls(endpoint, host)
                _, link = await loop.create_connection(
                    lambda: Connected(receive, lose), host, port, ssl=context, server_hostname=server_name
                )
    except TimeoutError:
        raise PortError(f"{name}: no connection within {CONNECT:g} s") from None
    except OSError as error:
        raise PortError(f"{name}: {tls_reason(error)}") from None
    write = link.write_together if boxes > 1 and isinstance(link, Connected) else link.write
    mailboxes += [Mailbox(name, write) for _ in range(boxes)]
    return link, mailboxes


def _tls(endpoint: Endpoint, host: str) -> tuple[ssl.SSLContext | None, str | None]:
    if endpoint.scheme != "tls":
        return None, None
    return client_context(endpoint), endpoint.options.get("server_name", host)


def _serial(endpoint: Endpoint, receive: Callable[[bytes], None]) -> tuple[AsyncLink, list[Mailbox]]:
    from barewire.shells.aio_serial import SerialLink, SerialMailbox
    from barewire.shells.serial_port import SerialPort

    boxes: list[Mailbox] = []
    link = SerialLink(SerialPort.of(endpoint), receive, lambda why: boxes[0].fail(why))
    box = SerialMailbox(link.name, link.write)
    box.link = link
    boxes.append(box)
    return link, boxes
