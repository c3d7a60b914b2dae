"""The conformance battery of `canopen.conformance`, run on a device on a real bus.

    for result in conform_can(Endpoint.parse("can://socketcan/can0?node=5")): ...

First the objects of the device are read, because cases for objects that it lacks are left out. If any case changes
values, the communication is reset before that (with an EDS the whole node). Then the cases run one by one, each after a
reset if it or the previous case changes values. A `gentle` battery only reads.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import NamedTuple

from barewire.canopen.conformance.battery import cases, may_have_changed, needs_reset, prepare, run_case
from barewire.canopen.conformance.model import BOOT, NODE_ANSWER_TIMEOUT, NodeCase, NodeOutcome, Subject
from barewire.canopen.conformance.probe import is_there, probe
from barewire.canopen.eds import Eds, EdsObject
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NmtCommand
from barewire.conversation import Conversation, Listen, Send
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.engine.blocking import run
from barewire.io.engine.conformance import Unfinished
from barewire.io.ports.base import Port


class NodeCaseResult(NamedTuple):
    """The result of a case. `outcome` is None if the case was left out; `left_out` is the reason."""

    case: NodeCase
    outcome: NodeOutcome | None
    left_out: str = ""

    @property
    def failure(self) -> str | None:
        """The difference as a sentence."""
        return None if self.outcome is None else self.outcome.failure


def conform_can(
    endpoint: Endpoint,
    *,
    gentle: bool = False,
    large: tuple[int, int] | None = None,
    only: tuple[str, ...] = ("",),
    eds: Eds | None = None,
    save: bool = False,
    write_application: bool = False,
    on_power_cycle: Callable[[], None] | None = None,
    on_stopped: Callable[[], None] | None = None,
) -> Iterator[NodeCaseResult]:
    """Run the cases, and yield the result of each.

    gentle      run only cases that read
    large       (index, sub-index) of an object that accepts any bytes, for downloads of several segments
    only        the beginnings of the names of the cases to run; by default all run
    eds         the EDS of the device: every object is compared with it, in cases whose names begin with OD-
    save        run the cases that store values in the non-volatile memory of the device as well
    write_application   with an EDS, give the objects from 2000h on other values within their limits; a drive may move
    on_power_cycle   called when the device must be switched off and on, within two minutes; None: it never must
    on_stopped  called when a silent device, STOPPED by a run that was interrupted, answers after NMT 80h

    Raises EncodeError for an endpoint that is not can:// and an EDS without objects, PortError for a bus that cannot be
    opened, NoAnswer if no device answers, Unfinished if the device stops answering for good.
    """
    if endpoint.scheme != "can":
        raise EncodeError(f"endpoint {str(endpoint)!r}: these cases are for can://")
    if eds is not None and not eds.objects:
        raise EncodeError("the EDS describes no objects: expected sections like [1000]")
    from barewire.io.ports.can.interfaces import can_port

    node, patience = endpoint.integer("node", 1), endpoint.seconds("timeout", NODE_ANSWER_TIMEOUT)
    objects, dummies = (None, frozenset[int]()) if eds is None else (eds.objects, eds.dummies)
    port: Port[CanFrame] = can_port(endpoint)
    try:
        if not gentle:
            _wake(port, node, patience, on_stopped)
        subject, boot = _probe(port, node, patience, gentle, large, only, objects)
        why = partial(
            why_left_out,
            gentle=gentle,
            remote=not endpoint.place.startswith("socketcand/"),
            save=save or on_power_cycle is not None,
            power_cycle=on_power_cycle is not None,
            application=write_application,
        )
        wanted = [case for case in cases(subject, objects, dummies) if case.name.startswith(only)]
        previous = None
        for place, case in enumerate(wanted):
            if left_out := why(case):
                yield NodeCaseResult(case, None, left_out)
                continue
            not_run = sum(not why(other) for other in wanted[place:])
            before = previous and previous.case
            try:
                if needs_reset(case, previous) and not run(
                    prepare(subject, after=before, boot=boot, timeout=patience), port
                ):
                    # A device that sends no boot-up message (reported by NMT-11) is not waited for again.
                    boot = patience
                    _check_answers(node, patience, port, not_run, before)
                if case.effect == "power" and on_power_cycle is not None:
                    on_power_cycle()
                outcome = run(run_case(case, timeout=patience), port)
            except PortError as error:
                raise Unfinished(f"{error}, in the case {case.name}", not_run) from None
            yield NodeCaseResult(case, outcome)
            previous = outcome
            if outcome.failure is not None and not outcome.received[-1] and case.effect in ("reads", "tries"):
                _check_answers(node, patience, port, not_run - 1, case)
        if previous is not None and may_have_changed(previous):
            run(prepare(subject, after=previous.case, boot=boot, timeout=patience), port)
    finally:
        port.close()


def _wake(port: Port[CanFrame], node: int, patience: float, on_stopped: Callable[[], None] | None) -> None:
    """Switch a device that does not answer to PRE-OPERATIONAL: SDO does not work in STOPPED.   [CiA 301 7.3.2.2]

    A run that was interrupted may have left it there. A device that answers gets no command. If it answers afterwards,
    `on_stopped` is called; if it does not, `probe` will say so.
    """
    try:
        run(_request_device_type(node, patience), port)
        return
    except NoAnswer:
        run(_send(CanFrame(0, bytes([NmtCommand.ENTER_PRE_OPERATIONAL, node]))), port)
    try:
        run(_request_device_type(node, patience), port)
    except NoAnswer:
        return
    if on_stopped is not None:
        on_stopped()


def _send(frame: CanFrame) -> Conversation[CanFrame, None]:
    yield Send(frame)


def _probe(
    port: Port[CanFrame],
    node: int,
    patience: float,
    gentle: bool,
    large: tuple[int, int] | None,
    only: tuple[str, ...],
    objects: Mapping[int, EdsObject] | None,
) -> tuple[Subject, float]:
    """Read the objects of the device; return them, and the seconds to wait for a boot-up message."""
    boot = BOOT
    subject = run(probe(node, timeout=patience, large=large, objects=objects), port)
    if large is not None and not run(is_there(node, *large, timeout=patience), port):
        raise EncodeError(f"the large object {large[0]:04X}:{large[1]:02X}: node {node} has no such object")
    chosen = [case for case in cases(subject, objects) if case.name.startswith(only) and not case.lacks]
    if not gentle and any(case.effect != "reads" for case in chosen):
        # Its configuration may have been changed: the cases need the values that it has after a reset.
        command = NmtCommand.RESET_COMMUNICATION if objects is None else NmtCommand.RESET_NODE
        boot = boot if run(prepare(subject, command=command), port) else patience
        subject = run(probe(node, timeout=patience, large=large, objects=objects), port)
    return subject, boot


def _check_answers(node: int, patience: float, port: Port[CanFrame], not_run: int, before: NodeCase | None) -> None:
    """Wait until the device answers. Raises Unfinished if it does not answer within the time of a boot."""
    until = time.monotonic() + BOOT
    while True:
        try:
            run(_request_device_type(node, patience), port)
            return
        except NoAnswer:
            if time.monotonic() > until:
                after = f" after the case {before.name}" if before is not None else ""
                raise Unfinished(f"node {node} does not answer any more{after}", not_run) from None


def _request_device_type(node: int, patience: float) -> Conversation[CanFrame, None]:
    """Upload the device type, which every device has. Raises NoAnswer if no response arrives."""
    heard = yield Send(CanFrame(0x600 + node, bytes.fromhex("4000100000000000")))
    until = heard.now + patience
    while heard.now < until:
        heard = yield Listen(until)
        if heard.item is not None and heard.item.key == (0x580 + node, False):
            return
    raise NoAnswer(f"node {node} does not answer")


def why_left_out(
    case: NodeCase,
    gentle: bool,
    *,
    remote: bool,
    save: bool = False,
    power_cycle: bool = False,
    application: bool = False,
) -> str:
    """Return why a case is not run on a bus with or without remote frames; empty if it is run."""
    if case.lacks:
        return f"needs {case.lacks}"
    if gentle and case.effect != "reads":
        return case.effect
    if case.effect == "stores" and not save:
        return "stores values: needs --save"
    if case.effect == "power" and not power_cycle:
        return "needs --power-cycle"
    if case.effect == "application" and not application:
        return "writes application objects: needs --write-application"
    has_remote_frames = any("#R" in text for step in case.steps for text in step.sends)
    return "" if remote or not has_remote_frames else "needs remote frames, which socketcand does not carry"
