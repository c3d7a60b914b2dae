"""The NMT master: send a command and wait until the node confirms it; wait for a state or a boot-up.   [CiA 301]

        000h | 01 05           ->
                               <-        705h | 05        the next heartbeat reports operational: confirmed

NMT has no response, so a command is confirmed by the error control messages of the node: a heartbeat with the target
state, or the boot-up message after a reset. Nodes without heartbeat are polled by node guarding (`ask_every`).

The functions that wait send nothing:

        705h | 00     wait_for_boot_up
        705h | 7F     wait_for_heartbeat
        705h | 05     wait_for_state
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from typing import NamedTuple

from barewire.canopen.cob_ids import check_node
from barewire.canopen.cyclic import check_period
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import (
    STATE_AFTER,
    NmtCommand,
    NmtMessage,
    NmtState,
    NodeState,
    guarding_request,
    reported_state,
)
from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.errors import EncodeError, NoAnswer, shown

_STATES = frozenset(NmtState)
STATE_TIMEOUT = 2.0
"""Seconds in which a node is to report its state: longer than the heartbeat time of most nodes."""


class NmtConfirmation(NamedTuple):
    """A node that confirmed a command: its state, and the seconds from the command to the confirmation."""

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
    """Send a command to a node, or with 0 to all, and wait until each node of `confirmed_by` reports the target state.

        confirmed_by   the nodes to wait for; default: the node itself, and none for a command to all
        timeout        seconds to wait for the confirmations
        ask_every      seconds after which nodes without heartbeat are polled by node guarding, again and again

    A reset is confirmed by the boot-up message only.

    >>> from barewire.conversation import play
    >>> node = lambda frame, now: [(now + 0.1, CanFrame.parse("705#7F")), (now + 0.6, CanFrame.parse("705#05"))]
    >>> play(send_nmt(NmtCommand.START, 5), node)[0]
    [NmtConfirmation(node=5, state=5, after=0.6)]

    Raise NoAnswer with the last state that each unconfirmed node reported, or with what to do if it reported none;
    EncodeError for an `ask_every` that is not a number of seconds above 0.
    """
    if ask_every is not None:
        check_period("ask_every", ask_every)
    if confirmed_by is None:
        confirmed_by = [node] if node else []
    waiting = {check_node(number): "" for number in confirmed_by}  # with what each reported instead
    sent: Heard[CanFrame] = yield Send(NmtMessage(command, node).encode())
    confirmed: list[NmtConfirmation] = []
    frames = 0
    until = sent.now + timeout
    next_request = float("inf") if ask_every is None else sent.now + ask_every
    while waiting:
        heard: Heard[CanFrame] = yield Listen(min(until, next_request))
        if heard.item is not None:
            frames += 1
            report = reported_state(heard.item)
            if report is not None and report.node in waiting:
                after = heard.now - sent.now
                if report.state == STATE_AFTER[command]:
                    del waiting[report.node]
                    confirmed.append(NmtConfirmation(report.node, report.state, after))
                else:
                    waiting[report.node] = f"it last reported {report.name}, {after:.3g} s after the command"
        if heard.now >= until and waiting:
            raise NoAnswer(_unconfirmed(command, waiting, timeout, frames, ask_every is not None))
        if heard.now >= next_request:
            next_request = heard.now + (ask_every or timeout)
            for number in waiting:
                yield Send(guarding_request(number))
    return confirmed


def request_state(node: int, *, timeout: float = STATE_TIMEOUT) -> Conversation[CanFrame, NodeState]:
    """Request the state of a node by node guarding, or hear it in its next heartbeat. A node with heartbeats does not
    answer the request, so `timeout` is to be longer than its heartbeat time (1017h). Raise NoAnswer."""
    sent: Heard[CanFrame] = yield Send(guarding_request(check_node(node)))
    until = sent.now + timeout
    frames = 0
    while True:
        heard: Heard[CanFrame] = yield Listen(until)
        if heard.item is not None:
            frames += 1
            report = reported_state(heard.item)
            if report is not None and report.node == node:
                return report
        if heard.now >= until:
            raise NoAnswer(
                f"node {node} did not report its state within {timeout:g} s; {frames} other frames came; a node with "
                "heartbeats (1017h) reports it with the next one: is the timeout longer than their period?"
            )


def wait_for_boot_up(node: int | None = None, *, timeout: float = 10.0) -> Conversation[CanFrame, NodeState]:
    """Wait for the boot-up message of a node, or of any node with None. Raise NoAnswer.

    >>> from barewire.conversation import play
    >>> play(wait_for_boot_up(5, timeout=0.5), lambda frame, now: [])
    Traceback (most recent call last):
    barewire.errors.NoAnswer: no boot-up message from node 5 within 0.5 s: no state was reported
    """
    return _wait(node, "boot-up message", lambda report: report.is_boot_up, timeout)


def wait_for_heartbeat(node: int | None = None, *, timeout: float = 10.0) -> Conversation[CanFrame, NodeState]:
    """Wait for the next heartbeat of a node, or of any node with None; a boot-up message does not count."""
    return _wait(node, "heartbeat", lambda report: not report.is_boot_up, timeout)


def wait_for_state(node: int, states: Collection[int], *, timeout: float = 10.0) -> Conversation[CanFrame, NodeState]:
    """Wait until a node reports one of these states. Raise NoAnswer, and EncodeError for what is not a state."""
    if not states:
        raise EncodeError("no state: expected a state, such as NmtState.OPERATIONAL")
    for state in states:
        if state not in _STATES:
            names = ", ".join(f"NmtState.{state.name}" for state in NmtState)
            raise EncodeError(f"state {shown(state)}: expected one of {names}")
    names = " or ".join(NodeState(node, state).name for state in states)
    return _wait(node, f"state {names}", lambda report: report.state in states, timeout)


def _wait(
    node: int | None, event: str, wanted: Callable[[NodeState], bool], timeout: float
) -> Conversation[CanFrame, NodeState]:
    if node is not None:
        check_node(node)  # here, since the body of a generator would check it with its first step only
    return _waiting(node, event, wanted, timeout)


def _waiting(
    node: int | None, event: str, wanted: Callable[[NodeState], bool], timeout: float
) -> Conversation[CanFrame, NodeState]:
    heard: Heard[CanFrame] = yield Listen(float("-inf"))  # returns at once, with the time
    until = heard.now + timeout
    latest = ""
    while True:
        report = None if heard.item is None else reported_state(heard.item)
        if report is not None and node in (None, report.node):
            if wanted(report):
                return report
            latest = f"last reported was {NmtState.INITIALISING.name.lower() if report.is_boot_up else report.name}"
        if heard.now >= until:
            source = "any node" if node is None else f"node {node}"
            raise NoAnswer(f"no {event} from {source} within {timeout:g} s: {latest or 'no state was reported'}")
        heard = yield Listen(until)


def _unconfirmed(command: NmtCommand, waiting: dict[int, str], timeout: float, frames: int, guarded: bool) -> str:
    """Return the text of the error, with what to do if a node did not report any state."""
    name = command.name.lower().replace("_", " ")
    states = "; ".join(f"node {node}: {state or 'it did not report its state'}" for node, state in waiting.items())
    text = f"{name} was not confirmed within {timeout:g} s: {states} ({frames} frames came)"
    if all(waiting.values()):
        return text
    if STATE_AFTER[command] == NmtState.INITIALISING:
        return f"{text}: a reset is confirmed by the boot-up message only"
    if guarded:
        return f"{text}: it did not answer node guarding either"
    return (
        f"{text}: without heartbeat it does not report by itself: with ask_every=0.1 its state is requested by node "
        "guarding, or write its heartbeat time in ms to 1017h"
    )
