"""A device that is tested, as the kind `device-conformance` says."""

from __future__ import annotations

from adapter_device import NODE, OBJECTS, device_answers
from bus import Node

OWN = [
    {"object": "100C:00", "type": "UNSIGNED16", "access": "rw", "value": "65535"},
    {"object": "100D:00", "type": "UNSIGNED8", "access": "rw", "value": "255"},
    {"object": "1F80:00", "type": "UNSIGNED32", "access": "rw", "value": "4"},
]
"""It has guarding, and does not start itself."""


class Tested:
    """The device with most objects."""

    node, has = NODE, ("LSS", "LSS identify remote slave", "large object")

    def __init__(self) -> None:
        self.device = Node([*OBJECTS, *OWN], NODE, lss=True)
        self.device.start()
        self.wait(0.02)

    def __del__(self) -> None:
        self.device.close()

    def hear(self, frame: str) -> list[str]:
        self.device.feed(frame)
        return self.wait(0)

    def wait(self, seconds: float) -> list[str]:
        self.device.run_to(self.device.now + round(seconds * 1e6))
        return self.device.said()


ANSWERS = device_answers(Tested)
