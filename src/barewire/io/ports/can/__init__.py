"""Ports that carry CAN frames.

The files, in reading order:

    interfaces      `can_port` opens any bus: which interface of a URL has which port
    socketcan       CAN buses of Linux, on a raw socket
    bcm             cyclic frames that the Linux kernel sends
    memory          buses inside one process, for tests and demos
    python_can      CAN buses of all other interfaces, by python-can
    socketcand      the socketcand protocol over TCP, with answers read strictly
"""
