"""The battery of `canopen.conform` held against a device on a real bus.

    for result in conform_can(Endpoint.parse("can://socketcan/can0?node=5")): ...

First the device's objects are read, so that it is asked only what it has; behind a reset of the communication, if any
case changes anything. Then come the cases one by one, each behind a reset where it or the one before changes anything.
A `gentle` battery reads only.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

from barewire.canopen.conformance.battery import cases
from barewire.canopen.conformance.model import BOOT, NODE_ANSWER_TIMEOUT, NodeCase, NodeOutcome
from barewire.canopen.conformance.probe import is_there, probe
from barewire.canopen.conformance.runner import prepare, run_case, wants_reset
from barewire.canopen.frame import CanFrame
from barewire.conversation import Conversation, Listen, Send
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.engine.blocking import run
from barewire.io.engine.conformance import Unfinished
from barewire.io.ports.base import Port


class Result(NamedTuple):
    """How a case went. `outcome` is None where it was left out, and `left_out` says why."""

    case: NodeCase
    outcome: NodeOutcome | None
    left_out: str = ""

    @property
    def failure(self) -> str | None:
        """The difference as a sentence."""
        return None if self.outcome is None else self.outcome.failure


def conform_can(
    endpoint: Endpoint, *, gentle: bool = False, large: tuple[int, int] | None = None, only: tuple[str, ...] = ("",)
) -> Iterator[Result]:
    """Run every case. EncodeError for another endpoint, PortError without a bus, NoAnswer where no device is;
    Unfinished where one was and is silent for good.

    `large` is an object that takes any bytes, for downloads of several segments; `only` are the beginnings of the names
    of the cases to run.
    """
    if endpoint.scheme != "can":
        raise EncodeError(f"endpoint {str(endpoint)!r}: these cases are for can://")
    from barewire.io.ports.python_can import CanPort

    node, patience = endpoint.integer("node", 1), endpoint.seconds("timeout", NODE_ANSWER_TIMEOUT)
    port: Port[CanFrame] = CanPort(endpoint)
    try:
        boot = BOOT
        subject = run(probe(node, timeout=patience, large=large), port)
        if large is not None and not run(is_there(node, *large, timeout=patience), port):
            raise EncodeError(f"the large object {large[0]:04X}:{large[1]:02X}: node {node} has no such object")
        chosen = [case for case in cases(subject) if case.name.startswith(only) and not case.lacks]
        if not gentle and any(case.effect != "reads" for case in chosen):
            # Somebody may have set it up otherwise: what it has after a reset is what it has in the cases.
            boot = boot if run(prepare(subject), port) else patience
            subject = run(probe(node, timeout=patience, large=large), port)
        wanted = [case for case in cases(subject) if case.name.startswith(only)]
        before, remote = None, not endpoint.place.startswith("socketcand/")
        for place, case in enumerate(wanted):
            if left_out := _left_out(case, gentle, remote=remote):
                yield Result(case, None, left_out)
                continue
            not_run = sum(not _left_out(other, gentle, remote=remote) for other in wanted[place:])
            try:
                if wants_reset(case, before) and not run(prepare(subject, boot=boot), port):
                    # A device that says no boot-up message (NMT-11 tells so) is not waited for any more.
                    boot = patience
                    _hear_it(node, patience, port, not_run, before)
                outcome = run(run_case(case, timeout=patience), port)
            except PortError as error:
                raise Unfinished(f"{error}, in the case {case.name}", not_run) from None
            yield Result(case, outcome)
            before = case
            if outcome.failure is not None and not outcome.received[-1] and case.effect == "reads":
                _hear_it(node, patience, port, not_run - 1, case)
        if before is not None and wants_reset(before, before):
            run(prepare(subject, boot=boot), port)
    finally:
        port.close()


def _hear_it(node: int, patience: float, port: Port[CanFrame], not_run: int, before: NodeCase | None) -> None:
    """Make sure that the device is still there, or there again in a while. Raises Unfinished where it is not."""
    until = time.monotonic() + BOOT
    while True:
        try:
            run(_speaks(node, patience), port)
            return
        except NoAnswer:
            if time.monotonic() > until:
                behind = f" behind the case {before.name}" if before is not None else ""
                raise Unfinished(f"node {node} answers no more{behind}", not_run) from None


def _speaks(node: int, patience: float) -> Conversation[CanFrame, None]:
    """Ask for the device type, which every device has; NoAnswer if nothing at all comes back."""
    heard = yield Send(CanFrame(0x600 + node, bytes.fromhex("4000100000000000")))
    until = heard.now + patience
    while heard.now < until:
        heard = yield Listen(until)
        if heard.item is not None and heard.item.key == (0x580 + node, False):
            return
    raise NoAnswer(f"node {node} does not answer")


def _left_out(case: NodeCase, gentle: bool, remote: bool) -> str:
    """Why a case is not held against this device; empty if it is."""
    if case.lacks:
        return f"needs {case.lacks}"
    if gentle and case.effect != "reads":
        return case.effect
    asks = any("#R" in text for step in case.steps for text in step.sends)
    return "" if remote or not asks else "needs remote frames, which socketcand does not carry"
