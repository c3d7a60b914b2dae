"""The master's side of NMT: a command, and the proof that it was obeyed.   [CiA 301, NMT]

        000h | 01 05           ->
                               <-        705h | 05        the next heartbeat says operational: obeyed

NMT commands are never confirmed, so a master that must know waits for what the node says of itself: a heartbeat with
the wanted state, the boot-up message after a reset. A node without heartbeat is asked by guarding (`ask_every`).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from barewire.canopen.cob_ids import check_node
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.heartbeat import NodeState, guarding_request
from barewire.canopen.nmt.messages import STATE_AFTER, NmtCommand, NmtMessage
from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.errors import DecodeError, NoAnswer


class NmtConfirmation(NamedTuple):
    """A node that is where the command led it: the state it told, and how many seconds after the command."""

    node: int
    state: int
    after: float


def send_nmt(
    command: NmtCommand,
    node: int = 0,
    *,
    confirmed_by: Iterable[int] | None = None,
    timeout: float = 2.0,
    ask_every: float | None = None,
) -> Conversation[CanFrame, list[NmtConfirmation]]:
    """Command a node, or with 0 all of them, and wait until every node of `confirmed_by` says that it is there.

    Without `confirmed_by` that is the node itself, and nobody for a command to all. An empty one waits for nothing.
    `ask_every` so many seconds the nodes that have not confirmed yet are asked by node guarding: for nodes that have
    no heartbeat. After a reset only the boot-up message is a proof.

    >>> from barewire.conversation import play
    >>> node = lambda frame, now: [(now + 0.1, CanFrame.parse("705#7F")), (now + 0.6, CanFrame.parse("705#05"))]
    >>> play(send_nmt(NmtCommand.START, 5), node)[0]
    [NmtConfirmation(node=5, state=5, after=0.6)]

    Raises NoAnswer with the last word of each node that did not confirm.
    """
    waiting = {check_node(number): "" for number in (confirmed_by if confirmed_by is not None else [node] * (node > 0))}
    sent: Heard[CanFrame] = yield Send(NmtMessage(command, node).encode())
    obeyed: list[NmtConfirmation] = []
    frames = 0
    until = sent.now + timeout
    asking = float("inf") if ask_every is None else sent.now + ask_every
    while waiting:
        heard: Heard[CanFrame] = yield Listen(min(until, asking))
        if heard.item is not None:
            frames += 1
            told = _state(heard.item)
            if told is not None and told.node in waiting:
                waiting[told.node] = f"its last word was {told.name}, {heard.now - sent.now:.3g} s after the command"
                if told.state == STATE_AFTER[command]:
                    del waiting[told.node]
                    obeyed.append(NmtConfirmation(told.node, told.state, heard.now - sent.now))
        if heard.now >= until and waiting:
            raise NoAnswer(_missing(command, waiting, timeout, frames))
        if heard.now >= asking:
            asking = heard.now + (ask_every or timeout)
            for number in waiting:
                yield Send(guarding_request(number))
    return obeyed


def request_state(node: int, *, timeout: float = 0.5) -> Conversation[CanFrame, NodeState]:
    """The state of a node, asked by node guarding; a heartbeat that comes meanwhile is as good. Raises NoAnswer."""
    sent: Heard[CanFrame] = yield Send(guarding_request(check_node(node)))
    until = sent.now + timeout
    frames = 0
    while True:
        heard: Heard[CanFrame] = yield Listen(until)
        if heard.item is not None:
            frames += 1
            told = _state(heard.item)
            if told is not None and told.node == node:
                return told
        if heard.now >= until:
            raise NoAnswer(f"node {node} did not tell its state within {timeout:g} s; {frames} other frames were heard")


def _state(frame: CanFrame) -> NodeState | None:
    try:
        return NodeState.decode(frame)
    except DecodeError:
        return None


def _missing(command: NmtCommand, waiting: dict[int, str], timeout: float, frames: int) -> str:
    what = command.name.lower().replace("_", " ")
    each = "; ".join(f"node {node}: {word or 'it said nothing of its state'}" for node, word in waiting.items())
    return f"{what} was not confirmed within {timeout:g} s: {each} ({frames} frames were heard)"
