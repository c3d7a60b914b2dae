"""Ports carry bytes or CAN frames. Only these files import pyserial and python-can.

    base            the protocols of a port, for the blocking and the asyncio engine; a port that shows all items
    network, tls    TCP, UDP and TLS of blocking clients; listening sockets of servers; certificates and roles
    descriptor      a descriptor that one thread may close while others wait for it
    serial, pty     serial ports, RS-485; pseudo-terminals
    async_links     TCP, TLS, UDP and serial ports of asyncio clients
    can/            CAN buses: SocketCAN of Linux, and all interfaces of python-can

The table `barewire.io.endpoint.CARRIERS` has the transport of each scheme of a URL.
"""
