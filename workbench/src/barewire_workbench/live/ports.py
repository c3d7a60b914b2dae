"""The ports of this machine: serial ports and CAN interfaces, each with the URL to use it.

Serial ports are those that pyserial lists. The program that holds a port is read from /proc, CAN interfaces from /sys
and `ip` (all on Linux); python-can names the adapters that it can find by itself.
"""

from __future__ import annotations

import json
import logging
import os
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from barewire.errors import PortError

_CAN_HARDWARE = "280"
"""ARPHRD_CAN, the type of a CAN interface in /sys/class/net."""


_NO_ADAPTERS = {"socketcan", "virtual", "udp_multicast", "serial", "socketcand"}
"""Interfaces of python-can that stand elsewhere in the list, or are no adapters. It would wait four seconds for servers
of socketcand."""


class FoundPort(NamedTuple):
    """A port: its URL, what it is, its USB identity or bit rate, and what holds it."""

    url: str
    description: str
    details: tuple[str, ...] = ()
    held_by: tuple[str, ...] = ()

    def __str__(self) -> str:
        held = f"in use by {', '.join(self.held_by)}" if self.held_by else ""
        return "; ".join(part for part in (self.description, *self.details, held) if part)

    def as_dict(self) -> dict[str, object]:
        """The port, for JSON."""
        return {
            "url": self.url,
            "description": self.description,
            "details": list(self.details),
            "held_by": list(self.held_by),
        }


def serial_ports() -> list[FoundPort]:
    """Return the serial ports, USB adapters first. Raises PortError without pyserial."""
    try:
        from serial.tools.list_ports import comports
    except ModuleNotFoundError:
        raise PortError("serial ports need pyserial: pip install 'barewire[serial]'") from None
    ports = []
    for port in sorted(comports(), key=lambda port: (port.vid is None, port.device)):
        details = []
        if port.vid is not None:
            details.append(f"USB {port.vid:04X}:{port.pid:04X}")
        if port.serial_number:
            details.append(f"serial number {port.serial_number}")
        stable = stable_name(port.device)
        if stable is not None:
            details.append(f"always {stable}")
        words = [word for word in (port.manufacturer, port.description) if word and word != "n/a"]
        ports.append(
            FoundPort(f"rtu://{port.device}", " ".join(words) or "serial port", tuple(details), holders(port.device))
        )
    return ports


def stable_name(device: str, folder: Path = Path("/dev/serial/by-id")) -> str | None:
    """Return the link in `folder` that leads to a device, whatever number it has after the next start."""
    with suppress(OSError):
        for link in sorted(folder.iterdir()):
            if os.path.realpath(link) == os.path.realpath(device):
                return str(link)
    return None


def holders(device: str, processes: Path = Path("/proc")) -> tuple[str, ...]:
    """Return the programs that have a device open, as "NAME (PID)": those that this user may see."""
    place = os.path.realpath(device)
    names = []
    for folder in sorted(processes.glob("[0-9]*"), key=lambda folder: int(folder.name)):
        with suppress(OSError):  # the process ended, or belongs to another user
            if any(os.path.realpath(link) == place for link in (folder / "fd").iterdir()):
                names.append(f"{(folder / 'comm').read_text().strip()} ({folder.name})")
    return tuple(names)


def can_interfaces(folder: Path = Path("/sys/class/net")) -> list[FoundPort]:
    """Return the CAN interfaces of the system, with their state and bit rate, as far as `ip` shows them."""
    ports = []
    with suppress(OSError):
        for interface in sorted(folder.iterdir()):
            with suppress(OSError):
                if (interface / "type").read_text().strip() == _CAN_HARDWARE:
                    state = (interface / "operstate").read_text().strip()
                    ports.append(_can_interface(interface.name, state))
    return ports


def _can_interface(name: str, state: str) -> FoundPort:
    details = [f"state {state}"]
    url = f"can://socketcan/{name}"
    with suppress(OSError, ValueError, LookupError, subprocess.SubprocessError):
        command = ["ip", "-details", "-json", "link", "show", "dev", name]
        shown = subprocess.run(command, capture_output=True, timeout=5, check=True).stdout
        link: dict[str, Any] = json.loads(shown)[0]["linkinfo"]
        details[0] = f"state {link.get('info_data', {}).get('state', state)}"
        bitrate = link["info_data"]["bittiming"]["bitrate"]
        details.append(f"{bitrate} bit/s")
    if state == "down":
        details.append(f"ip link set {name} up type can bitrate 125000")
    return FoundPort(url, "CAN interface", tuple(details))


def can_adapters() -> Iterator[FoundPort]:
    """Yield the adapters that python-can finds by itself, without the interfaces of the system; none without it."""
    logger = logging.getLogger("can")
    level = logger.level
    logger.setLevel(logging.CRITICAL)  # python-can warns of each driver that is not installed
    try:
        import can

        adapters = can.detect_available_configs(sorted(can.VALID_INTERFACES - _NO_ADAPTERS))
    except ModuleNotFoundError:
        return
    finally:
        logger.setLevel(level)
    for adapter in adapters:
        yield FoundPort(f"can://{adapter['interface']}/{adapter['channel']}", "CAN adapter")


def all_ports() -> list[FoundPort]:
    """Return everything that was found."""
    return [*serial_ports(), *can_interfaces(), *can_adapters()]
