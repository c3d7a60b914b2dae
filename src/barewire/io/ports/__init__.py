"""Ports carry bytes or CAN frames. Only these files import pyserial and python-can.

    base            the protocols of a port, for the blocking and the asyncio engine
    tcp, udp, tls   network connections of blocking clients; listening sockets of servers; certificates and roles
    serial, pty     serial ports, RS-485; pseudo-terminals
    can/            CAN buses: SocketCAN of Linux, and all interfaces of python-can
    async_tcp, async_tls, async_udp, async_serial     the same for asyncio clients
    mailbox         holds the bytes that an asyncio connection received until a conversation takes them
    trace           shows all items to a function of the caller

The table `barewire.io.endpoint.CARRIERS` has the files for each scheme of a URL.
"""
