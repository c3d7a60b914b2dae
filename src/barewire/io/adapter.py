"""Serial adapters that return under another name (Linux).

    opened     /dev/ttyUSB0     the links by-id/usb-FTDI_A5 and by-path/usb-1.2 lead to it: remembered
    unplugged, plugged in again
    now        /dev/ttyUSB1     by-id/usb-FTDI_A5 leads to it, so it is opened in place of ttyUSB0

A name such as ttyUSB0 is the adapter that was opened first under this name, as long as its client lives: another one
under this name is an error. A name that is a link itself, as those in /dev/serial or of a rule for udev, is followed.

A link in by-id names an adapter by its serial number, one in by-path by the socket into which it is plugged. Two
adapters of a type without serial numbers have the same link in by-id, which leads to either of them; so an adapter that
was there already, in another socket, is not taken for the one that is gone. Without such links (other systems,
containers) nothing is remembered, and every name is opened as it is.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress

from barewire.errors import PortError

_KINDS = ("by-id", "by-path")


class Adapter:
    """The adapter that a name stands for. `log` is called with one line when it is found under another name."""

    def __init__(self, path: str, log: Callable[[str], object], folder: str = "/dev") -> None:
        self.path = path
        self._log = log
        self._folder = folder
        self._links: set[str] = set()
        """The links that led to the adapter when it was opened the last time, such as by-id/usb-FTDI_A5."""
        self._sockets_of_others: set[str] = set()
        """The links in by-path that led to other adapters then."""

    def opened(self, path: str) -> None:
        """Remember the adapter that was opened."""
        device, links = self._device(path), self._links_now()
        own = {link for link, leads_to in links.items() if leads_to == device}
        if own:
            self._links = own
            self._sockets_of_others = {link for link in links.keys() - own if link.startswith("by-path")}

    def find(self) -> str:
        """Return the path under which the adapter is now. Raises PortError if its name is that of another one."""
        device, links = self._device(self.path), self._links_now()
        if not self._links or self._is_own(device, links):
            return self.path
        is_there = os.path.exists(device)
        remembered = min(self._links)
        known = sorted(link for link, leads_to in links.items() if leads_to == device)
        present = f"another adapter now: {known[0] if known else 'no link leads to it'}, not {remembered}"
        if device != self.path:
            if is_there:
                self._log(f"{self.path} is {present}")
            return self.path
        for other in sorted(set(links.values())):
            if os.path.exists(other) and self._is_own(other, links):
                self._log(f"{self.path} is {other} now: {remembered} leads to it")
                return other
        if is_there:
            raise PortError(f"{self.path} is {present}")
        return self.path

    def _is_own(self, device: str, links: dict[str, str]) -> bool:
        """Whether the remembered links lead to a device."""
        leading = {link for link, leads_to in links.items() if leads_to == device}
        if any(link.startswith("by-id") for link in leading & self._links):
            return not leading & self._sockets_of_others
        # In the same socket, and nothing says that it is another one.
        return bool(leading & self._links) and not any(link.startswith("by-id") for link in leading)

    def _links_now(self) -> dict[str, str]:
        """Return the devices to which the links in `serial` lead."""
        links: dict[str, str] = {}
        for kind in _KINDS:
            folder = os.path.join(self._folder, "serial", kind)
            with suppress(OSError):
                links |= {f"{kind}/{name}": self._device(os.path.join(folder, name)) for name in os.listdir(folder)}
        return links

    def _device(self, path: str) -> str:
        """Return the name of a device in the folder, to which a path leads."""
        for _ in range(8):
            try:
                target = os.path.normpath(os.path.join(os.path.dirname(path), os.readlink(path)))
            except (OSError, ValueError):
                break
            if os.path.dirname(target) != self._folder and not target.startswith(f"{self._folder}/serial/"):
                break
            path = target
        return path
