"""Keeps a pause between the LSS requests of a conversation, since a device may hold one request at a time.   [CiA 305]

        7E5# ->          13.5 ms          7E5# ->          13.5 ms          7E5# ->

LSS answers only some requests, so a tester cannot wait for an answer before the next one, and two frames one after the
other overwrite each other in a device with one receive buffer that a main loop empties. The pause is the time of a
frame at the slowest bit rate of CiA 301, which such a device keeps up with.
"""

from __future__ import annotations

from collections import deque
from typing import TypeVar

from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import REQUEST_KEY
from barewire.conversation import Conversation, Heard, Listen, Send

Result = TypeVar("Result")

LSS_PAUSE = 135 / 10_000
"""Seconds: a frame of eight bytes has at most 135 bits, with stuff bits, at 10 kbit/s."""


def with_lss_pauses(conversation: Conversation[CanFrame, Result]) -> Conversation[CanFrame, Result]:
    """Carry out a conversation, each LSS request `LSS_PAUSE` after the one before.

    Frames that arrive in a pause are received when the conversation listens next.
    """
    early: deque[CanFrame] = deque()
    may_send_at = now = float("-inf")
    try:
        step = next(conversation)
        while True:
            if isinstance(step, Listen):
                heard = Heard(early.popleft(), now) if early else (yield step)
            elif any(frame.key == REQUEST_KEY for frame in step.items):
                for frame in step.items:
                    while now < may_send_at:
                        heard = yield Listen(may_send_at)
                        now = heard.now
                        if heard.item is not None:
                            early.append(heard.item)
                    heard = yield Send(frame)
                    may_send_at = heard.now + LSS_PAUSE
            else:
                heard = yield step
            now = heard.now
            step = conversation.send(heard)
    except StopIteration as stop:
        result: Result = stop.value
        return result
