"""A device that is tested, as the kind `device-conformance` says."""

from __future__ import annotations

from adapter import NotOffered
from adapter_device import NODE, OBJECTS, device_answers
from bus import build, feed, run, said, start

OF_THE_APPLICATION = ("1029:", "1280:")
"""Objects that it does not follow itself, or only as a master."""


class Tested:
    """The device with most objects. It has LSS without the identify services."""

    node, has = NODE, ("LSS", "large object")

    def __init__(self) -> None:
        build([row for row in OBJECTS if not row["object"].startswith(OF_THE_APPLICATION)])
        if wrong := start(NODE, lss=1):
            raise NotOffered(f"does not start: {wrong}")
        run(20_000)
        said()

    def hear(self, frame: str) -> list[str]:
        feed(frame)
        return self.wait(0)

    def wait(self, seconds: float) -> list[str]:
        run(round(seconds * 1e6))
        return [line for line in said() if "#" in line]


TESTED_ANSWERS = device_answers(Tested)
