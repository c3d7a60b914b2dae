"""Runs the conformance cases of the vectors, kind `device-conformance`, and those of an EDS on a device on a real bus.

    for result in conform_can(Endpoint.parse("can://socketcan/can0?node=5")): ...

First the objects of the device are read, because cases for objects that it lacks are left out. If any case changes
values, the communication is reset before that (with an EDS the whole node). Then the cases run one by one, each after a
reset if it or the previous case changes values. A `gentle` battery only reads.

A case that fails is repeated, twice at most: a departure shows each time, a race of the device or of the bus does not.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache, partial
from typing import NamedTuple, Self

from barewire.canopen.eds import Eds, EdsObject
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NmtCommand
from barewire.conversation import Conversation, Listen, Send
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.engine.blocking import run
from barewire.io.ports.base import Port
from barewire_workbench.conform.canopen.battery import all_cases, may_have_changed, needs_reset, prepare, run_case
from barewire_workbench.conform.canopen.model import BOOT, NODE_ANSWER_TIMEOUT, NodeCase, NodeOutcome, Subject
from barewire_workbench.conform.canopen.probe import is_there, probe, second_answer
from barewire_workbench.conform.canopen.script import Placeholders, applies, read_node_case
from barewire_workbench.live.results import TwoDevices, Unfinished, case_line
from barewire_workbench.vectors.files import load_vectors
from barewire_workbench.vectors.judge import Answer
from barewire_workbench.vectors.questions import Case, Question
from barewire_workbench.vectors.run import AdapterFailure
from barewire_workbench.vectors.tested_device import described

NODE_KIND = "device-conformance"
"""The kind of the vectors that these cases are."""
FILES = ("sdo", "segments", "blocks", "nmt", "services", "pdo", "lss", "configuration")
"""The files of that kind, vectors/cases/canopen/conform-*.json, in the order in which they are run."""


_REPETITIONS = 2
"""How often a case that failed is repeated, unless it passes before."""


class NodeCaseResult(NamedTuple):
    """The result of a case. `outcome` is None if the case was left out; `left_out` is the reason.

    `outcome` is that of the first run. With `now_and_then` this run failed, and a repetition passed.
    """

    case: NodeCase
    outcome: NodeOutcome | None
    left_out: str = ""
    now_and_then: bool = False

    @property
    def failure(self) -> str | None:
        """The difference as a sentence."""
        return None if self.outcome is None else self.outcome.failure

    @property
    def verdict(self) -> str:
        """One of ok, failed, now and then, left out."""
        if self.now_and_then:
            return "now and then"
        return "left out" if self.outcome is None else "failed" if self.failure else "ok"

    @property
    def line(self) -> str:
        """The result as a line of text."""
        text = f"{self.case.title}: {self.failure}" if self.failure else self.case.title
        return case_line(self.verdict, f"{self.case.name:6}", text, self.left_out)

    def as_dict(self) -> dict[str, object]:
        """Return the result for JSON."""
        return {
            "case": self.case.name,
            "title": self.case.title,
            "clause": self.case.clause,
            "effect": self.case.effect,
            "ok": None if self.outcome is None else self.failure is None,
            "verdict": self.verdict,
            "left_out": self.left_out or None,
            "received": [] if self.outcome is None else [list(step) for step in self.outcome.received],
            "failure": self.failure,
        }


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
    opened, NoAnswer if no device answers, TwoDevices if two answer, Unfinished if the device stops answering for good.
    """
    if endpoint.scheme != "can":
        raise EncodeError(f"endpoint {str(endpoint)!r}: these cases are for can://")
    if eds is not None and not eds.objects:
        raise EncodeError("the EDS describes no objects: expected sections like [1000]")
    from barewire.io.ports.can.interfaces import can_port

    objects, dummies = (None, frozenset[int]()) if eds is None else (eds.objects, eds.dummies)
    port: Port[CanFrame] = can_port(endpoint)
    try:
        tester = _Tester(endpoint, port, gentle, large, only, objects, on_stopped)
        why = partial(
            why_left_out,
            gentle=gentle,
            remote=_has_remote_frames(endpoint),
            save=save or on_power_cycle is not None,
            power_cycle=on_power_cycle is not None,
            application=write_application,
        )
        wanted = cases(tester.subject, objects, dummies, only)
        for place, case in enumerate(wanted):
            if left_out := why(case):
                yield NodeCaseResult(case, None, left_out)
                continue
            not_run = sum(not why(other) for other in wanted[place:])
            outcome = tester.run(case, not_run, on_power_cycle)
            try:
                passes = tester.passes_again(outcome, not_run - 1)
            except Unfinished:
                yield NodeCaseResult(case, outcome)
                raise
            yield NodeCaseResult(case, outcome, now_and_then=passes)
        tester.end()
    finally:
        port.close()


def cases(
    subject: Subject,
    objects: Mapping[int, EdsObject] | None = None,
    dummies: Iterable[int] = (),
    only: tuple[str, ...] = ("",),
) -> tuple[NodeCase, ...]:
    """Return the cases for one device, in order: those of the vectors, and with the objects of an EDS those of it.

    A case that needs something the device lacks names it in `lacks`. `dummies` are those of the EDS, `only` the
    beginnings of the names; a case of the vectors with another name is not read.
    """
    scripts = [fields for fields in _vector_cases() if fields["name"].startswith(only)]
    return tuple(case for case in all_cases(subject, scripts, objects, dummies) if case.name.startswith(only))


def case_names(objects: Mapping[int, EdsObject] | None = None, dummies: Iterable[int] = ()) -> tuple[str, ...]:
    """Return the names of all cases, in order. Every device has them, except RPD-33 if its RPDO has 8 bytes."""
    return tuple(case.name for case in cases(Subject(1, {}), objects, dummies))


@cache
def _vector_cases() -> tuple[Case, ...]:
    by_name = {file.name: file.cases for file in load_vectors().files}
    return tuple(case for name in FILES for case in by_name[f"canopen/conform-{name}"])


class LiveDevice:
    """A device behind an endpoint, as a function from a question of the vectors to its answer.

    Only questions of the kind `device-conformance` are put to it; cases that store values or switch it off are not
    offered. Raises PortError for a bus that cannot be opened, NoAnswer if no device answers.
    """

    def __init__(self, endpoint: Endpoint) -> None:
        from barewire.io.ports.can.interfaces import can_port

        self._endpoint = endpoint
        self._gone = ""
        self._port: Port[CanFrame] = can_port(endpoint)
        try:
            self._tester = _Tester(endpoint, self._port)
        except BaseException:
            self._port.close()
            raise

    def __repr__(self) -> str:
        return f"<LiveDevice: {self._endpoint}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            if not self._gone:
                self._tester.end()
        finally:
            self._port.close()

    def __call__(self, question: Question) -> Answer:
        """Return whether the device passes. Raises AdapterFailure if it is not there any more."""
        if question.kind != NODE_KIND:
            return {"not_offered": f"a running device cannot be asked for {question.kind}"}
        if self._gone:
            raise AdapterFailure(f"not asked: {self._gone}")
        device = Placeholders(self._tester.subject)
        if not applies(question.case, device):
            return {"not_offered": f"only for a device with {', '.join(question.case['if'])}"}
        case = read_node_case(question.case, device)
        if left_out := why_left_out(case, gentle=False, remote=_has_remote_frames(self._endpoint)):
            return {"not_offered": left_out}
        try:
            outcome = self._tester.run(case, 0)
            if self._tester.passes_again(outcome, 0):
                raise AdapterFailure(f"now and then: {outcome.failure}")
        except NoAnswer as error:
            self._gone = str(error)
            raise AdapterFailure(self._gone) from None
        return {"is": described(self._tester.subject, outcome.received)}


def _has_remote_frames(endpoint: Endpoint) -> bool:
    return not endpoint.place.startswith("socketcand/")


class _Tester:
    """Carries out cases on one device. `subject` has its objects, as they were before the first case."""

    def __init__(
        self,
        endpoint: Endpoint,
        port: Port[CanFrame],
        gentle: bool = False,
        large: tuple[int, int] | None = None,
        only: tuple[str, ...] = ("",),
        objects: Mapping[int, EdsObject] | None = None,
        on_stopped: Callable[[], None] | None = None,
    ) -> None:
        self._node = endpoint.integer("node", 1)
        self._patience = endpoint.seconds("timeout", NODE_ANSWER_TIMEOUT)
        self._port = port
        self._previous: NodeOutcome | None = None
        self._boot = BOOT
        """Seconds to wait for a boot-up message."""
        if not gentle:
            self._wake(on_stopped)
        twice = run(second_answer(self._node, timeout=self._patience), port)
        if twice is not None:
            raise TwoDevices(self._node, *twice)
        self.subject = self._probed(large, objects)
        if large is not None and not run(is_there(self._node, *large, timeout=self._patience), port):
            raise EncodeError(f"the large object {large[0]:04X}:{large[1]:02X}: node {self._node} has no such object")
        chosen = [case for case in cases(self.subject, objects, only=only) if not case.lacks]
        if not gentle and any(case.effect != "reads" for case in chosen):
            # Its configuration may have been changed: the cases need the values that it has after a reset.
            command = NmtCommand.RESET_COMMUNICATION if objects is None else NmtCommand.RESET_NODE
            if not run(prepare(self.subject, command=command), port):
                self._boot = self._patience
            self.subject = self._probed(large, objects)

    def _probed(self, large: tuple[int, int] | None, objects: Mapping[int, EdsObject] | None) -> Subject:
        return run(probe(self._node, timeout=self._patience, large=large, objects=objects), self._port)

    def run(self, case: NodeCase, not_run: int, on_power_cycle: Callable[[], None] | None = None) -> NodeOutcome:
        """Run one case, after a reset if it needs one. Raises Unfinished if the device does not answer any more."""
        before = self._previous and self._previous.case
        try:
            if needs_reset(case, self._previous) and not self._prepare(before):
                # A device that sends no boot-up message (reported by NMT-11) is not waited for again.
                self._boot = self._patience
                self._check_answers(not_run, before)
            if case.effect == "power" and on_power_cycle is not None:
                on_power_cycle()
            self._previous = run(run_case(case, timeout=self._patience), self._port)
        except PortError as error:
            raise Unfinished(f"{error}, in the case {case.name}", not_run) from None
        return self._previous

    def passes_again(self, outcome: NodeOutcome, not_run: int) -> bool:
        """Repeat a case that failed, and return whether it passed. Raises Unfinished if the device does not answer."""
        self._check_after(outcome, not_run)
        if outcome.failure is None or outcome.case.effect == "power":
            return False
        for _ in range(_REPETITIONS):
            again = self.run(outcome.case, not_run)
            self._check_after(again, not_run)
            if again.failure is None:
                return True
        return False

    def _check_after(self, outcome: NodeOutcome, not_run: int) -> None:
        """Check that the device still answers, if it did not in a case that changes nothing."""
        case = outcome.case
        if outcome.failure is not None and not outcome.received[-1] and case.effect in ("reads", "tries"):
            self._check_answers(not_run, case)

    def end(self) -> None:
        """Undo what the last case has changed."""
        if self._previous is not None and may_have_changed(self._previous):
            self._prepare(self._previous.case)

    def _prepare(self, after: NodeCase | None) -> bool:
        return run(prepare(self.subject, after=after, boot=self._boot, timeout=self._patience), self._port)

    def _wake(self, on_stopped: Callable[[], None] | None) -> None:
        """Switch a device that does not answer to PRE-OPERATIONAL: SDO does not work in STOPPED.  [CiA 301 7.3.2.2]

        A run that was interrupted may have left it there. A device that answers gets no command. If it answers
        afterwards, `on_stopped` is called; if it does not, `probe` will say so.
        """
        if self._is_there():
            return
        run(_send(CanFrame(0, bytes([NmtCommand.ENTER_PRE_OPERATIONAL, self._node]))), self._port)
        if self._is_there() and on_stopped is not None:
            on_stopped()

    def _check_answers(self, not_run: int, before: NodeCase | None) -> None:
        """Wait until the device answers. Raises Unfinished if it does not answer within the time of a boot."""
        until = time.monotonic() + BOOT
        while not self._is_there():
            if time.monotonic() > until:
                after = f" after the case {before.name}" if before is not None else ""
                raise Unfinished(f"node {self._node} does not answer any more{after}", not_run)

    def _is_there(self) -> bool:
        return run(_answers(self._node, self._patience), self._port)


def _send(frame: CanFrame) -> Conversation[CanFrame, None]:
    yield Send(frame)


def _answers(node: int, patience: float) -> Conversation[CanFrame, bool]:
    """Upload the device type, which every device has; return whether a response arrives."""
    heard = yield Send(CanFrame(0x600 + node, bytes.fromhex("4000100000000000")))
    until = heard.now + patience
    while heard.now < until:
        heard = yield Listen(until)
        if heard.item is not None and heard.item.key == (0x580 + node, False):
            return True
    return False


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
