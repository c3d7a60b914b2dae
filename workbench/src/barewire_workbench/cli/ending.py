"""How a command ends: by signals, and not before a late response that the next command could take for its own."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import click

from barewire.errors import BarewireError
from barewire_workbench.cli.output import note

if TYPE_CHECKING:
    from barewire import ModbusClient


class EndedBySignal(KeyboardInterrupt):
    """A signal ends this process, with the exit status `status`."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.status = 128 + number


_ENDING_SIGNALS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


def _handled(handler: Callable[[int, object], object], *, interrupt: bool) -> dict[int, Any]:
    """Have a function called at the signals that end the process, with `interrupt` Ctrl-C too. Return the handlers
    before. An ignored signal stays ignored: SIGHUP under nohup, SIGINT in background jobs of a shell."""
    signals = (*_ENDING_SIGNALS, signal.SIGINT) if interrupt else _ENDING_SIGNALS
    handlers = {number: signal.getsignal(number) for number in signals}
    previous = {number: before for number, before in handlers.items() if before is not signal.SIG_IGN}
    for number in previous:
        signal.signal(number, handler)
    return previous


@contextmanager
def ended_by_signals(*, interrupt: bool = False) -> Iterator[Callable[[], None]]:
    """Within the block, the first signal that would end the process raises `EndedBySignal`; later ones are ignored.

    SIGTERM and SIGHUP are such signals, with `interrupt` SIGINT (Ctrl-C) too. Yield a function that makes the block
    ignore the first one as well. After a signal, SIGTERM and SIGHUP stay ignored behind the block; Ctrl-C does not.
    """
    is_ignored = has_ended = False

    def ignore() -> None:
        nonlocal is_ignored
        is_ignored = True

    # The handler stays when the signals are ignored: Python prints a warning if SIG_IGN replaces it just after a
    # signal was received.
    def end(number: int, _: object) -> None:
        nonlocal is_ignored, has_ended
        if not is_ignored:
            is_ignored = has_ended = True
            raise EndedBySignal(number)

    previous = _handled(end, interrupt=interrupt)
    try:
        yield ignore
    finally:
        for number, before in previous.items():
            if not has_ended or number == signal.SIGINT:
                signal.signal(number, before)


@contextmanager
def ending_signals_call(end: Callable[[], object]) -> Iterator[None]:
    """Within the block, call a function at each signal that would end the process, Ctrl-C too: for an event loop."""
    previous = _handled(lambda *_: end(), interrupt=True)
    try:
        yield
    finally:
        for number, before in previous.items():
            signal.signal(number, before)


# Late responses


@contextmanager
def late_response_awaited(machine: Callable[[], object], no_wait: bool) -> Iterator[None]:
    """After the block, wait until no late response of a serial line is expected any more, unless `no_wait`.

    The next command has no memory of the requests of this one. The error of the block, or a line on stderr, says how
    long that took. Ctrl-C in the block or while waiting ends the command at once; the line says that too. `machine`
    returns the MachineClient, which must still be open, or None.
    """
    failure: BarewireError | None = None
    try:
        yield
    except BarewireError as error:
        failure = error
        raise
    except (KeyboardInterrupt, click.exceptions.Exit):
        if not no_wait and _pending_client(machine()) is not None:
            _note_if_possible("interrupted before a response that the next command could take for its own")
        no_wait = True
        raise
    finally:
        text = "" if no_wait else _wait_for_late_response(machine())
        if text and failure is not None:
            failure.add_context(text)
        elif text:
            _note_if_possible(text)


def _note_if_possible(text: str) -> None:
    with suppress(OSError):  # a closed terminal must not hide the error of the block
        note(text)


def _pending_client(machine: object) -> ModbusClient | None:
    """Return the client of a machine, if a response on its serial line is pending."""
    from barewire import ModbusClient

    client = getattr(machine, "client", None)
    return client if isinstance(client, ModbusClient) and client.bus.state.pending else None


def _wait_for_late_response(machine: object) -> str:
    """Wait, and return what was done in words; an empty text if no response was pending, or the port has failed."""
    client = _pending_client(machine)
    if client is None:
        return ""
    start = time.monotonic()
    try:
        client.settle()
    except BarewireError:
        return ""
    except KeyboardInterrupt:
        pass
    waited = f"waited {time.monotonic() - start:.1f} s more for a late response"
    return f"{waited}, which the next command could take for its own (--no-wait: do not wait)"
