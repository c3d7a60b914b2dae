"""Ports that carry CAN frames.

    socketcan       CAN buses of Linux, and `can_port`, which opens any bus
    python_can      CAN buses of all other interfaces, by python-can
    socketcand      the socketcand protocol over TCP, with answers read strictly

Depends on: `endpoint`.  Used by: CanBus, cli.
"""
