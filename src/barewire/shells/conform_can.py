"""The battery of `canopen.conform` held against a device on a real bus.

    for result in conform_can(Endpoint.parse("can://socketcan/can0?node=5")): ...

First the device's objects are read, so that it is asked only what it has; behind a reset of the communication, if any
case changes anything. Then come the cases one by one, each behind a reset where it or the one before changes anything.
A `gentle` battery reads only.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from barewire.canopen.conform import (
    BOOT,
    PATIENCE,
    Case,
    Outcome,
    carry_out,
    cases,
    is_there,
    prepare,
    survey,
    wants_reset,
)
from barewire.canopen.frame import CanFrame
from barewire.errors import EncodeError
from barewire.shells.blocking import Port, run
from barewire.shells.endpoint import Endpoint


class Result(NamedTuple):
    """How a case went. `outcome` is None where it was left out, and `left_out` says why."""

    case: Case
    outcome: Outcome | None
    left_out: str = ""

    @property
    def failure(self) -> str | None:
        """The difference as a sentence."""
        return None if self.outcome is None else self.outcome.failure


def conform_can(
    endpoint: Endpoint, *, gentle: bool = False, large: tuple[int, int] | None = None, only: tuple[str, ...] = ("",)
) -> Iterator[Result]:
    """Run every case. EncodeError for another endpoint, PortError without a bus, NoAnswer where no device is.

    `large` is an object that takes any bytes, for downloads of several segments; `only` are the beginnings of the names
    of the cases to run.
    """
    if endpoint.scheme != "can":
        raise EncodeError(f"endpoint {str(endpoint)!r}: these cases are for can://")
    from barewire.shells.can_bus import CanPort

    node, patience = endpoint.integer("node", 1), endpoint.seconds("timeout", PATIENCE)
    port: Port[CanFrame] = CanPort(endpoint)
    try:
        boot = BOOT
        subject = run(survey(node, timeout=patience, large=large), port)
        if large is not None and not run(is_there(node, *large, timeout=patience), port):
            raise EncodeError(f"the large object {large[0]:04X}:{large[1]:02X}: node {node} has no such object")
        chosen = [case for case in cases(subject) if case.name.startswith(only) and not case.lacks]
        if not gentle and any(case.effect != "reads" for case in chosen):
            # Somebody may have set it up otherwise: what it has after a reset is what it has in the cases.
            boot = boot if run(prepare(subject), port) else patience
            subject = run(survey(node, timeout=patience, large=large), port)
        before: Case | None = None
        for case in cases(subject):
            if not case.name.startswith(only):
                continue
            if left_out := _left_out(case, gentle, remote=not endpoint.place.startswith("socketcand/")):
                yield Result(case, None, left_out)
                continue
            # A device that says no boot-up message (NMT-11 tells so) is not waited for any more.
            if wants_reset(case, before) and not run(prepare(subject, boot=boot), port):
                boot = patience
            yield Result(case, run(carry_out(case, patience=patience), port))
            before = case
        if before is not None and wants_reset(before, before):
            run(prepare(subject, boot=boot), port)
    finally:
        port.close()


def _left_out(case: Case, gentle: bool, remote: bool) -> str:
    """Why a case is not held against this device; empty if it is."""
    if case.lacks:
        return f"needs {case.lacks}"
    if gentle and case.effect != "reads":
        return case.effect
    asks = any("#R" in text for turn in case.turns for text in turn.says)
    return "" if remote or not asks else "needs remote frames, which socketcand does not carry"
