"""The gateway as a node of the net: a CANopen device with an SDO server and a heartbeat.   [CiA 309-3]

        [1] 1 r 0x1008 0 vs          an object of the gateway itself, without a frame on the bus: "barewire gateway"
        [2] set heartbeat 500        its producer heartbeat time 1017h, in ms
        [3] set id 9                 its node-ID after the next reset of communication
        [4] init 9                   reset its communication: 709h | 00

The node runs on the bus beside the connections: other masters read its objects, and NMT commands to node 0 reach it.
"""

from __future__ import annotations

from typing import TypeVar

from barewire.canopen.communication_objects import standard_objects
from barewire.canopen.device.device import LocalNode
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import LssAddress
from barewire.canopen.nmt.messages import NmtCommand
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.conversation import Conversation, play

Result = TypeVar("Result")

_HEARTBEAT = 0x1017


class GatewayNode:
    """The gateway's own node. `next_id` is its node-ID after the next reset of communication."""

    def __init__(self, device: LocalNode) -> None:
        self.device = device
        self.next_id = device.node
        self._on_reset = device.on_reset
        device.on_reset = self._reset

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.device.node}: {self.device.state.name.lower().replace('_', '-')}>"

    def set_heartbeat(self, milliseconds: int) -> None:
        """Send a heartbeat in this interval, 0 for none. Raise SdoAbort if the node has no 1017h."""
        self.device.objects.set(_HEARTBEAT, 0, milliseconds)

    def carry_out(self, conversation: Conversation[CanFrame, Result], now: float) -> tuple[Result, list[CanFrame]]:
        """Run a conversation with this node alone, which takes no time. Return its result, and all other frames of the
        node, which belong on the bus."""
        device, frames = self.device, list[CanFrame]()
        response_id = 0x580 + (device.node or 0)

        def peer(request: CanFrame, at: float) -> list[tuple[float, CanFrame]]:
            answers = []
            for frame in device.feed(request, now):
                if frame.key == (response_id, False):
                    answers.append((at, frame))
                else:
                    frames.append(frame)
            return answers

        result, _ = play(conversation, peer, start=now)
        return result, frames + device.feed(None, now)

    def _reset(self, command: NmtCommand) -> None:
        if self.next_id != self.device.node:
            self.device.renumber(self.next_id)
        if self._on_reset is not None:
            self._on_reset(command)


def gateway_node(node: int) -> GatewayNode:
    """Return a node with the communication objects of CiA 301 and no others, whose name is "barewire gateway"."""
    objects = standard_objects(LssAddress(0, 0, 0, 0), name="barewire gateway")
    return GatewayNode(LocalNode(node, ObjectDictionary(objects)))
