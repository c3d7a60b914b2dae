"""Answers of the learner played against simulated machines, in virtual time: no port, no clock.

The two functions:

    rtu_answer(request)    the bytes that an ADXL at unit 1 sends back; empty if it stays silent
    can_answers(frame)     the frames that an AZ3 at node 5 sends back
"""

from __future__ import annotations

from barewire.canopen.frame import CanFrame
from barewire.devices.sim import simulator
from barewire.modbus.server.server import Server
from barewire.rtu.line import RtuLine
from barewire.rtu.timing import Timing

LAB_NODE = 5
"""The node-ID of the drive in the labs on CAN."""


def rtu_answer(request: bytes) -> bytes:
    """Return what an ADXL at unit 1 answers on RTU.

    >>> rtu_answer(bytes.fromhex("01 04 0F B1 00 02 22 F8")).hex(" ")
    '01 04 04 00 00 00 f5 3b c3'
    """
    units = {1: simulator("adxl").modbus}
    server = Server(RtuLine(Timing.of(19200), role="server", units=units), units, serial=True)
    replies = server.feed(request, 1.0)
    while not replies and server.deadline is not None:
        replies = server.feed(None, server.deadline)
    return b"".join(reply.data for reply in replies)


def can_answers(*frames: CanFrame) -> list[CanFrame]:
    """Return what an AZ3 at node 5 sends after these frames, one after the other.

    >>> [str(frame) for frame in can_answers(CanFrame(0x605, bytes.fromhex("40 41 60 00 00 00 00 00")))]
    ['585#4B41600070120000']
    """
    node = simulator("az3", 0.0, node=LAB_NODE).canopen
    assert node is not None
    node.feed(None, 1.0)  # its boot-up message
    answers: list[CanFrame] = []
    for frame in frames:
        answers += node.feed(frame, 1.0)
    return answers
