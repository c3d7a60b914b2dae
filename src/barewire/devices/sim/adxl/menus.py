"""What an ADXL keeps in its head: the parameters of its menus, and the list of events.

        menu 5000h, sub-menu 5001h, parameter 5002h  --->  5004h  one value of P01.04, P08.01 ...

The Modbus manual names six parameters and no more, so no others exist here: an unknown number is exception 02. Their
ranges, and the numbers that stand for the choices of P08.02, P08.03 and P08.05, are not printed; they are counted from
0 in the order of the list.
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.devices.sim.core.store import Declined

ACCELERATION_TIME = (1, 0, 4)
NODE_ADDRESS = (8, 0, 1)
EVENTS = 60
TEXT_LENGTH = 56


class Setting(NamedTuple):
    """One parameter of a menu."""

    default: int
    minimum: int
    maximum: int


SETTINGS: dict[tuple[int, int, int], Setting] = {
    ACCELERATION_TIME: Setting(10, 1, 120),  # seconds; the example of the manual sets 10
    NODE_ADDRESS: Setting(1, 1, 255),
    (8, 0, 2): Setting(3, 0, 7),  # 1200 2400 4800 9600 19200 38400 57600 115200
    (8, 0, 3): Setting(0, 0, 4),  # 8N 8O 8E 7O 7E
    (8, 0, 4): Setting(1, 1, 2),  # stop bits
    (8, 0, 5): Setting(0, 0, 2),  # Modbus RTU, ASCII, TCP
}
"""By (menu, sub-menu, parameter); sub-menu 0 where a menu has none."""

FACTORY = {key: setting.default for key, setting in SETTINGS.items()}


class Menus:
    """The parameters: as they are, as they are saved, and the copy that C13 makes."""

    def __init__(self) -> None:
        self.values = dict(FACTORY)
        self.saved = dict(FACTORY)
        self.copy: dict[tuple[int, int, int], int] | None = None

    def read(self, key: tuple[int, int, int]) -> int:
        """The value; Declined if there is no such parameter."""
        if key not in self.values:
            menu, sub, number = key
            raise Declined("place", f"no parameter {number} in menu {menu}, sub-menu {sub}")
        return self.values[key]

    def check(self, key: tuple[int, int, int], value: int) -> None:
        """Declined for a parameter that does not exist and for a value out of its range."""
        self.read(key)
        setting = SETTINGS[key]
        if not setting.minimum <= value <= setting.maximum:
            raise Declined("value", f"{value}: expected {setting.minimum}..{setting.maximum}")


class Events:
    """The last sixty events. Index 0 is the oldest one that is still there; the manual does not say which end it is."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.total = 0
        self.index = 0

    def add(self, uptime: float, text: str) -> None:
        """One more event, with the seconds since power-on in front of it."""
        self.texts = [*self.texts, f"{int(uptime):08d} {text}"[:TEXT_LENGTH]][-EVENTS:]
        self.total += 1

    def clear(self) -> None:
        """C16."""
        self.texts, self.total, self.index = [], 0, 0

    @property
    def pointer(self) -> int:
        """Goes up with every event; with the sixtieth it is 0 again (table 4)."""
        return self.total % EVENTS

    def select(self, index: int) -> None:
        """Which event is read next: "smaller than the number of events stored"."""
        self.check(index)
        self.index = index

    def check(self, index: int) -> None:
        """Declined for an event that is not there."""
        if index >= len(self.texts):
            raise Declined("value", f"event {index}: {len(self.texts)} are stored")

    def text(self) -> str:
        """The event that the index points to; Declined("state") behind the last one."""
        if self.index >= len(self.texts):
            raise Declined("state", "no event is left to read")
        return self.texts[self.index]
