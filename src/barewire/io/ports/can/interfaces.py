"""The interfaces of can:// URLs: which port each of them has.

The URLs, and the file of each:

    can://socketcan/can0          `socketcan`       a raw socket of the Linux kernel
    can://memory/NAME             `memory`          a bus inside this process
    can://INTERFACE/CHANNEL       `python_can`      any other interface
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from barewire.errors import EncodeError
from barewire.io.endpoint import CAN_OPTIONS, Endpoint
from barewire.io.ports.can.socketcan import SocketCanPort, check_socketcan_options

if TYPE_CHECKING:
    from barewire.io.ports.can.memory import MemoryPort
    from barewire.io.ports.can.python_can import CanPort


def can_port(endpoint: Endpoint, *, stamps: bool = False) -> SocketCanPort | MemoryPort | CanPort:
    """Open the bus of a can:// endpoint: SocketCAN and memory by themselves, any other interface by python-can.

    `stamps`: a port that has the time of the system sets `received_at`. Raises EncodeError, PortError.
    """
    if endpoint.place.startswith("socketcan/"):
        return SocketCanPort(endpoint, stamps=stamps)
    if endpoint.place.startswith("memory/"):
        from barewire.io.ports.can.memory import MemoryPort

        return MemoryPort(endpoint)
    from barewire.io.ports.can.python_can import CanPort

    return CanPort(endpoint)


def check_interface(endpoint: Endpoint) -> None:
    """Raise EncodeError for an unknown interface, or an option that neither barewire nor the interface has. Raise
    PortError if the interface needs python-can, and that is missing."""
    if endpoint.place.startswith("socketcan/"):
        check_socketcan_options(endpoint)
        return
    if endpoint.place.startswith("memory/"):
        from barewire.io.ports.can.memory import check_memory_options

        check_memory_options(endpoint)
        return
    from barewire.io.ports.can.python_can import check_python_can_options

    check_python_can_options(endpoint)


def can_endpoint(url: str, **options: object) -> Endpoint:
    """Return the endpoint of a can:// URL; `options` override its options.

    Raises EncodeError for any other URL, and for an option that neither barewire nor the interface has.
    """
    endpoint = Endpoint.parse(url, options)
    if endpoint.scheme != "can":
        raise EncodeError(f"endpoint {str(url)!r}: CANopen needs can://INTERFACE/CHANNEL, such as can://socketcan/can0")
    if endpoint.options.keys() - CAN_OPTIONS:
        check_interface(endpoint)
    return endpoint
