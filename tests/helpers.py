"""Shared by the tests of several rooms: ways to deliver bytes, the accounting of bytes, peers in virtual time."""

from __future__ import annotations

import functools
import inspect
import random
import re
import socket
import sysconfig
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import Any, TypeVar

import pytest
from hypothesis import settings, strategies as st

from barewire.errors import DecodeError
from barewire.modbus import Adu, Noise, Server
from barewire.modbus.framing import Line, LineEvent
from barewire.rtu import Timing

T = TypeVar("T")

Chunk = tuple[bytes | None, float]
"""One call of `feed`: bytes (or None when nothing came), and the time."""

Peer = Callable[[bytes, float], Iterable[tuple[float, bytes]]]
"""The other end of the line, as `play` takes it."""

BAREWIRE = f"{sysconfig.get_path('scripts')}/barewire"
"""The command in a process of its own. `python -m barewire` looks through all installed packages for it first, which
takes a fifth of the time of a short command."""

PATIENCE = 30.0
"""Seconds that a test waits for what must happen on a real port: no busy machine takes so long."""

modest = settings(max_examples=30, deadline=None, derandomize=True, database=None)
"""For property tests: 60 examples, the same in every run."""


def part_or_whole(part: T, whole: T) -> list[Any]:
    """The values of a parameter: a part of a search, and the whole, which `make proof` and .ci/run search."""
    return [part, pytest.param(whole, marks=pytest.mark.proof)]


def some_of(values: Iterable[T], count: int) -> list[Any]:
    """The values of a parameter, such as seeds: those after the first `count` are for `make proof` and .ci/run."""
    return [
        value if place < count else pytest.param(value, marks=pytest.mark.proof) for place, value in enumerate(values)
    ]


_NAMED = type(pytest.param())


def every_case(
    names: str | tuple[str, ...], cases: Iterable[Any]
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Check many cases in one test: a decorator that takes names and cases as `pytest.mark.parametrize` does.

    Each case is checked, also behind one that is wrong. The first error is raised with a list of all wrong cases. An
    item of pytest costs more than a small check, as each process of a run collects all of them. All cases share the
    fixtures of the test.
    """
    names = (names,) if isinstance(names, str) else names
    rows = [case if isinstance(case, _NAMED) else pytest.param(*(case if len(names) > 1 else [case])) for case in cases]
    if not rows or any(row.marks for row in rows):
        raise ValueError(f"expected cases of {', '.join(names)}, at least one, and none with a mark")

    def fold(check: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(check)
        def test(**fixtures: Any) -> None:
            __tracebackhide__ = True
            errors: list[BaseException] = []
            wrong: list[str] = []
            for row in rows:
                given = dict(zip(names, row.values, strict=True))
                try:
                    check(**fixtures, **given)
                except (Exception, pytest.fail.Exception) as error:
                    errors.append(error)
                    wrong.append(str(row.id or ", ".join(f"{name}={value!r:.100}" for name, value in given.items())))
                    wrong += [
                        f"    {line}"
                        for line in (*str(error).strip().splitlines()[:1], *getattr(error, "__notes__", ()))
                    ]
            if errors:
                errors[0].add_note("\n".join([f"{len(errors)} of {len(rows)} cases are wrong:", *wrong]))
                raise errors[0]

        signature = inspect.signature(check)
        fixtures = [parameter for name, parameter in signature.parameters.items() if name not in names]
        del test.__wrapped__  # pytest would ask for its parameters
        test.__signature__ = signature.replace(parameters=fixtures)  # type: ignore[attr-defined]
        return test

    return fold


def until(condition: Callable[[], bool]) -> None:
    """Wait for an effect in another thread, `PATIENCE` seconds at most."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def free_port() -> int:
    """A TCP port of the loopback interface on which no server listens.

    It is below 32768: from there on, the kernel gives ports to every connection and every server at port 0, so that a
    test in another process could be given this one before it is used here.
    """
    while True:
        number = random.SystemRandom().randrange(20_000, 32_768)
        with suppress(OSError), socket.create_server(("127.0.0.1", number)):
            return number


def unhex(text: str) -> bytes:
    """Bytes from hexadecimal text: `unhex("01 83 02")`."""
    return bytes.fromhex(text)


def readable(decode: Callable[[bytes], T], data: bytes) -> T | None:
    """The result of `decode`; None if it raises a DecodeError, which must give the data and a place in them."""
    try:
        return decode(data)
    except DecodeError as error:
        refusal = error
    assert refusal.data == data
    assert 0 <= refusal.at <= len(data)
    return None


# Delivery --------------------------------------------------------------------------------------------------------


def deliveries(frame: bytes) -> Iterator[list[bytes]]:
    """The ways in which a port may deliver one frame: whole, byte by byte, in two parts at each place."""
    yield [frame]
    yield [frame[at : at + 1] for at in range(len(frame))]
    for at in range(1, len(frame)):
        yield [frame[:at], frame[at:]]


def spaced(parts: Iterable[bytes], step: float, start: float = 1.0) -> list[Chunk]:
    """The parts with `step` seconds from the end of one to the end of the next."""
    return [(part, start + place * step) for place, part in enumerate(parts)]


def feed_all(line: Line, chunks: Iterable[Chunk]) -> list[LineEvent]:
    """All events of the chunks; at each deadline the line is fed None."""
    events: list[LineEvent] = []
    for data, now in chunks:
        if line.deadline is not None and line.deadline <= now:
            events += line.feed(None, line.deadline)
        events += line.feed(data, now)
    return events


def silence(line: Line) -> list[LineEvent]:
    """The events at the line's deadline when nothing comes before."""
    return line.feed(None, line.deadline) if line.deadline is not None else []


def frames_of(events: Iterable[LineEvent]) -> list[Adu]:
    return [event for event in events if isinstance(event, Adu)]


def noise_of(events: Iterable[LineEvent]) -> list[Noise]:
    return [event for event in events if isinstance(event, Noise)]


# The accounting of bytes -------------------------------------------------------------------------------------------


def bytes_of(events: Iterable[LineEvent], encode: Callable[[Adu], bytes]) -> bytes:
    """The bytes of the events in order: frames as on the wire, and noise."""
    return b"".join(encode(event) if isinstance(event, Adu) else event.data for event in events)


def chunked(bytes_of_chunks: st.SearchStrategy[bytes], longest_pause: float) -> st.SearchStrategy[list[Chunk]]:
    """Chunks at times that never run backwards, some of them None."""
    steps = st.floats(0.0, longest_pause, allow_nan=False)
    pairs = st.lists(st.tuples(st.one_of(st.none(), bytes_of_chunks), steps), max_size=12)
    return pairs.map(_with_times)


def _with_times(pairs: list[tuple[bytes | None, float]]) -> list[Chunk]:
    now, chunks = 0.0, []
    for data, step in pairs:
        now += step
        chunks.append((data, now))
    return chunks


def accounts_for_every_byte(line: Line, chunks: Iterable[Chunk], encode: Callable[[Adu], bytes], bound: int) -> None:
    """frames + noise + held = fed, after each chunk; and never more held than `bound`."""
    fed, reported = b"", b""
    for data, now in chunks:
        reported += bytes_of(line.feed(data, now), encode)
        fed += data or b""
        assert reported + line.held == fed
        assert len(line.held) <= bound


# Peers in virtual time -------------------------------------------------------------------------------------------


def answering(*answers: tuple[float, bytes]) -> Peer:
    """A peer that answers the first item it receives: each of `answers` so many seconds after it."""
    left = list(answers)

    def peer(item: bytes, now: float) -> list[tuple[float, bytes]]:
        sent, left[:] = [(now + after, data) for after, data in left], []
        return sent

    return peer


def serving(server: Server, timing: Timing | None = None) -> Peer:
    """A server at the other end; its replies take the time that their characters take."""

    def peer(item: bytes, now: float) -> list[tuple[float, bytes]]:
        sent = []
        replies = server.feed(item, now)
        while not replies and server.deadline is not None:
            replies = server.feed(None, server.deadline)
        for reply in replies:
            out = max(reply.at, now) + (timing.duration(len(reply.data)) if timing else 0.0)
            server.sent(out)
            sent.append((out, reply.data))
        return sent

    return peer


class FailingUnit:
    """A unit whose code raises `error`."""

    def __init__(self, error: BaseException) -> None:
        self.error = error

    def handle(self, request: Any, now: float) -> None:
        raise self.error


def refused(error: type[Exception], text: str) -> pytest.RaisesExc[Exception]:
    """`pytest.raises` for an error with exactly this text in it."""
    return pytest.raises(error, match=re.escape(text))
