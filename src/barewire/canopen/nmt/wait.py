"""Wait until a node says of itself what one hopes to hear.   [CiA 301, heartbeat, boot-up]

        705h | 00     it has booted               wait_for_boot_up
        705h | 7F     it is alive                 wait_for_heartbeat
        705h | 05     it is where it should be    wait_for_state

Nothing is sent: a node without heartbeat is asked with `ask_state` of `nmt_master`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

from barewire.canopen.cob_ids import check_node
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.heartbeat import NodeState
from barewire.canopen.nmt.messages import NmtState
from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import DecodeError, NoAnswer


def wait_for_boot_up(node: int | None = None, *, timeout: float = 10.0) -> Conversation[CanFrame, NodeState]:
    """The boot-up message of this node, or of any with None.

    >>> from barewire.conversation import play
    >>> play(wait_for_state(5, [NmtState.STOPPED], timeout=0.5), lambda frame, now: [])
    Traceback (most recent call last):
    barewire.errors.NoAnswer: node 5 did not say within 0.5 s that it is stopped: it said nothing of its state
    """
    return _wait(node, "that it has booted", lambda told: told.is_boot_up, timeout)


def wait_for_heartbeat(node: int | None = None, *, timeout: float = 10.0) -> Conversation[CanFrame, NodeState]:
    """The next heartbeat of this node, or of any with None; a boot-up message is none."""
    return _wait(node, "that it is alive", lambda told: not told.is_boot_up, timeout)


def wait_for_state(node: int, states: Collection[int], *, timeout: float = 10.0) -> Conversation[CanFrame, NodeState]:
    """The next heartbeat that says that the node is in one of these states."""
    names = " or ".join(NodeState(node, state).name for state in states)
    return _wait(node, f"that it is {names}", lambda told: told.state in states, timeout)


def _wait(
    node: int | None, what: str, wanted: Callable[[NodeState], bool], timeout: float
) -> Conversation[CanFrame, NodeState]:
    if node is not None:
        check_node(node)
    return _waiting("no node said" if node is None else f"node {node} did not say", node, what, wanted, timeout)


def _waiting(
    who: str, node: int | None, what: str, wanted: Callable[[NodeState], bool], timeout: float
) -> Conversation[CanFrame, NodeState]:
    heard: Heard[CanFrame] = yield Listen(float("-inf"))
    until = heard.now + timeout
    last = ""
    while True:
        if heard.item is not None:
            told = _read(heard.item)
            if told is not None and node in (None, told.node):
                if wanted(told):
                    return told
                last = f"its last word was {NmtState.INITIALISING.name.lower() if told.is_boot_up else told.name}"
        if heard.now >= until:
            raise NoAnswer(f"{who} within {timeout:g} s {what}: {last or 'it said nothing of its state'}")
        heard = yield Listen(until)


def _read(frame: CanFrame) -> NodeState | None:
    try:
        return NodeState.decode(frame)
    except DecodeError:
        return None
