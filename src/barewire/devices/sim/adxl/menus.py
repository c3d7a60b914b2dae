"""The memory of the ADXL: the parameters of its menus, and the list of events.                   [ADXL addendum]

        menu 5000h, sub-menu 5001h, parameter 5002h  --->  5004h  one value of P01.04, P08.01 ...

Simulated are the six parameters that the Modbus manual names; every other number is exception 02. Their ranges, and the
numbers for the choices of P08.02, P08.03 and P08.05, are not printed; here they count from 0 in the order of the list.
Only the acceleration time and the node address have an effect, the others are only stored.
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.devices.sim.core.store import Declined

ACCELERATION_TIME = (1, 0, 4)
NODE_ADDRESS = (8, 0, 1)
_TEXT_LENGTH = 56


class MenuParameter(NamedTuple):
    """One parameter of a menu."""

    default: int
    minimum: int
    maximum: int


_PARAMETERS: dict[tuple[int, int, int], MenuParameter] = {
    ACCELERATION_TIME: MenuParameter(10, 1, 120),  # seconds; the example of the manual sets 10
    NODE_ADDRESS: MenuParameter(1, 1, 255),
    (8, 0, 2): MenuParameter(3, 0, 7),  # 1200 2400 4800 9600 19200 38400 57600 115200
    (8, 0, 3): MenuParameter(0, 0, 4),  # 8N 8O 8E 7O 7E
    (8, 0, 4): MenuParameter(1, 1, 2),  # stop bits
    (8, 0, 5): MenuParameter(0, 0, 2),  # Modbus RTU, ASCII, TCP
}
"""By (menu, sub-menu, parameter); sub-menu 0 where a menu has none."""

FACTORY = {key: parameter.default for key, parameter in _PARAMETERS.items()}


class Menus:
    """The parameters: the values in use, the saved ones, and the copy that C13 makes."""

    def __init__(self) -> None:
        self.values = dict(FACTORY)
        self.saved = dict(FACTORY)
        self.copy: dict[tuple[int, int, int], int] | None = None

    def read(self, key: tuple[int, int, int]) -> int:
        """Return the value; raises Declined if there is no such parameter."""
        if key not in self.values:
            menu, sub, number = key
            raise Declined("place", f"no parameter {number} in menu {menu}, sub-menu {sub}")
        return self.values[key]

    def check(self, key: tuple[int, int, int], value: int) -> None:
        """Raise Declined for a parameter that does not exist and for a value out of its range."""
        self.read(key)
        parameter = _PARAMETERS[key]
        if not parameter.minimum <= value <= parameter.maximum:
            raise Declined("value", f"{value}: expected {parameter.minimum}..{parameter.maximum}")


class EventList:
    """The last sixty events. Index 0 is the oldest one here; the manual does not state the order."""

    SIZE = 60

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.total = 0
        self.index = 0

    def add(self, uptime: float, text: str) -> None:
        """Add an event; its text begins with the seconds since power-on."""
        self.texts = [*self.texts, f"{int(uptime):08d} {text}"[:_TEXT_LENGTH]][-self.SIZE :]
        self.total += 1

    def clear(self) -> None:
        """Delete all events (C16)."""
        self.texts, self.total, self.index = [], 0, 0

    @property
    def pointer(self) -> int:
        """Increases with every event; with the sixtieth it is 0 again (table 4)."""
        return self.total % self.SIZE

    def select(self, index: int) -> None:
        """Select the event that is read next: "smaller than the number of events stored"."""
        self.check(index)
        self.index = index

    def check(self, index: int) -> None:
        """Raise Declined for an event that is not stored."""
        if index >= len(self.texts):
            raise Declined("value", f"event {index}: {len(self.texts)} are stored")

    def text(self) -> str:
        """Return the event at the index; raises Declined("state") after the last one."""
        if self.index >= len(self.texts):
            raise Declined("state", "no event is left to read")
        return self.texts[self.index]
