"""A device that is tested, as the kind `device-conformance` says."""

from __future__ import annotations

from adapter_device import NODE, OBJECTS, device_answers
from bus import Node
from device import NEEDED

OWN = [row for row in NEEDED if row["object"] != "1014:00"]
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
