"""Ports: what carries bytes or CAN frames, and the only files that import pyserial and python-can.

    base            the protocols of a port, for the blocking and the asyncio engine
    tcp, udp, tls   network connections of blocking clients; listening sockets of servers; certificates and roles
    serial, pty     serial ports, RS-485; pseudo-terminals
    python_can      CAN buses
    async_tcp, async_tls, async_udp, async_serial     the same for asyncio clients
    mailbox         where what an asyncio connection receives waits for a conversation
    tls_session     TLS of a server's connection, without a socket
    trace           shows what passes to a function of the caller

Which scheme of a URL uses which file is the table `barewire.io.endpoint.CARRIERS`.

Depends on: `endpoint`.  Used by: the engines, clients and servers.
"""
