"""Part of the adapter of the `canopen` library: its LocalNode as a device that is tested, in virtual time.

DEVICE_ANSWERS      the answers that main.py adds to its own
"""

from __future__ import annotations

from typing import Any

import can
import canopen
from adapter_canopen import listed, variables
from adapter_device import NODE, device_answers
from canopen.network import MessageListener
from canopen_objects import objects

OBJECTS = variables(0x1018, (0x360, 0x1234, 0x10002, 7), access="const")
OBJECTS += listed("UNSIGNED32", "const", "1000:00=131474") + listed("UNSIGNED8", "ro", "1001:00=0")
OBJECTS += [{"object": "1008:00", "type": "VISIBLE_STRING", "access": "const", "value": "a node of canopen"}]
OBJECTS += listed("UNSIGNED16", "rw", "100C:00=0 1017:00=0")


class Periodic:
    """A frame that is sent again and again."""

    def __init__(self, frame: tuple[int, Any], period: float, now: float) -> None:
        self.frame, self.period, self.due, self.runs = frame, period, now + period, True

    def update(self, data: Any) -> None:
        self.frame = (self.frame[0], data)

    def stop(self) -> None:
        self.runs = False


class Tested(canopen.Network):
    """A network without a bus, with one node; what the node sends is kept."""

    node, has = NODE, ()

    def __init__(self) -> None:
        super().__init__()
        self.now, self.said, self.timers = 0.0, list[str](), list[Periodic]()
        od = canopen.ObjectDictionary()
        for one in objects(OBJECTS):
            od.add_object(one)
        self.create_node(NODE, od).nmt.state = "PRE-OPERATIONAL"
        self.said.clear()
        self.hears = MessageListener(self)

    def send_message(self, can_id: int, data: Any, remote: bool = False) -> None:
        self.said.append(f"{can_id:03X}#{bytes(data).hex().upper()}")

    def send_periodic(self, can_id: int, data: Any, period: float, remote: bool = False) -> Any:
        self.timers.append(Periodic((can_id, data), period, self.now))
        return self.timers[-1]

    def hear(self, frame: str) -> list[str]:
        identifier, _, data = frame.partition("#")
        remote = data.startswith("R")
        self.hears.on_message_received(
            can.Message(
                arbitration_id=int(identifier, 16),
                is_extended_id=len(identifier) == 8,
                is_remote_frame=remote,
                data=None if remote else bytes.fromhex(data),
                dlc=int(data[1:] or "0") if remote else None,
            )
        )
        return self.take()

    def wait(self, seconds: float) -> list[str]:
        until = self.now + seconds
        while due := [timer for timer in self.timers if timer.runs and timer.due <= until]:
            first = min(due, key=lambda timer: timer.due)
            self.now = first.due
            first.due += first.period
            self.send_message(*first.frame)
        self.now = until
        return self.take()

    def take(self) -> list[str]:
        said, self.said = self.said, []
        return said


DEVICE_ANSWERS = device_answers(Tested)
