"""A program that answers the questions of the vectors: JSON on its standard input and output, one object a line.

    we send      {"hello": "barewire-vectors", "protocol": 1}
    it answers   {"name": "pymodbus", "version": "3.16.1", "kinds": {"crc16": ["encode"], "lrc": ["encode"]}}
    we send      {"id": "crc16-1.encode", "kind": "crc16", "do": "encode", "bytes": "02 07"}
    it answers   {"id": "crc16-1.encode", "is": {"crc": "1241", "wire": "41 12"}}

It is not asked what it does not offer. Questions do not wait for answers: up to WINDOW of them are under way. A program
that ends is started again for the questions that it has not answered, but the first of them, which has failed; one that
does not answer in time is killed, and started again. What it writes to its standard error is kept for the text of a
failure.
"""

from __future__ import annotations

import json
import os
import queue
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any, NoReturn, Self

from barewire.errors import PortError, shown
from barewire_workbench.vectors.judge import Answer
from barewire_workbench.vectors.questions import Question
from barewire_workbench.vectors.run import AdapterFailure

PROTOCOL = 1
START_TIMEOUT = 30.0
"""Seconds in which a program must answer the hello: interpreters and virtual machines start slowly."""
BUFFERED = "; is its input read line by line, and its output flushed after each line?"
LINE_LONGEST = 1 << 20
"""Bytes of a line of answer."""
WINDOW = 64
"""Questions that are sent before the first of them is answered."""
_END_TIMEOUT = 1.0
"""Seconds in which a program must end when its input is closed."""
_LINES_MOST = 16
"""Lines that are read ahead: a program that floods its output has to wait, and memory stays small."""
_LOST_MOST = 20
"""Crashes and time-outs after which a program is given up: what it has not been asked by then has failed."""


class _Asked:
    """A question, and what has become of it."""

    def __init__(self, question: Question) -> None:
        self.question = question
        self.answer: Answer | AdapterFailure | None = None


class VectorAdapter:
    """A running program, as a function from a question to its answer. Use it in a `with` block."""

    def __init__(self, command: str, *, timeout: float = 10.0) -> None:
        self._command = command
        self._timeout = timeout
        self._lost = 0
        self._sent: set[str] = set()
        self._process: subprocess.Popen[bytes] | None = None
        self._threads: tuple[threading.Thread, ...] = ()
        self._lines: queue.Queue[bytes | None] = queue.Queue(_LINES_MOST)
        self._outgoing: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._complaints: deque[str] = deque(maxlen=5)
        self.name, self.version = command, ""
        self._offers: Mapping[str, Any] = {}
        self._start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __call__(self, question: Question) -> Answer:
        """Return the answer to a question. Raise AdapterFailure if the program crashes, is late or writes nonsense."""
        answer = next(self.answers([question]))
        if isinstance(answer, AdapterFailure):
            raise answer
        return answer

    def answers(self, questions: Iterable[Question]) -> Iterator[Answer | AdapterFailure]:
        """Yield the answers to questions in their order, or why there is none. Up to WINDOW questions are under way.

        No two of these have the same id.
        """
        asked: deque[_Asked] = deque()
        waiting: dict[str, _Asked] = {}
        for question in questions:
            asked.append(_Asked(question))
            self._ask(asked[-1], waiting)
            while len(asked) >= WINDOW:
                yield self._first_answer(asked, waiting)
        while asked:
            yield self._first_answer(asked, waiting)

    def _first_answer(self, asked: deque[_Asked], waiting: dict[str, _Asked]) -> Answer | AdapterFailure:
        """Take the first question out of those under way, when it has been answered or has failed."""
        row = asked.popleft()
        while row.answer is None:
            self._receive(waiting)
        return row.answer

    def _ask(self, row: _Asked, waiting: dict[str, _Asked]) -> None:
        """Send a question, if it is offered and the program has not been given up."""
        question = row.question
        if not self.offers(question.kind, question.do):
            row.answer = {"not_offered": f"{self.name} does not offer {question.kind}.{question.do}"}
        elif self._lost >= _LOST_MOST:
            row.answer = AdapterFailure(f"not asked: the adapter was lost {self._lost} times")
        else:
            try:
                if self._process is None:
                    self._start()
                self._send(question.as_json())
                self._sent.add(question.id)
                waiting[question.id] = row
            except PortError as error:
                row.answer = AdapterFailure(str(error))

    def _receive(self, waiting: dict[str, _Asked]) -> None:
        """Wait for the answer to a question that is under way. Without one the first has failed, and the others are
        asked again if the program is lost."""
        try:
            answer = self._answer(waiting, self._timeout)
            waiting.pop(answer["id"]).answer = answer
        except AdapterFailure as failure:
            waiting.pop(next(iter(waiting))).answer = failure
            if self._process is None:
                others = [*waiting.values()]
                waiting.clear()
                for row in others:
                    self._ask(row, waiting)

    def offers(self, kind: str, do: str) -> bool:
        """Return whether the program offers an operation."""
        return do in self._offers.get(kind, ())

    def close(self) -> None:
        """End the program: close its input, wait a second, then kill it and what it has started."""
        process, self._process = self._process, None
        if process is None:
            return
        self._outgoing.put(None)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_END_TIMEOUT)
        self._release(process)

    def _release(self, process: subprocess.Popen[bytes]) -> None:
        """Kill a process with its children, wait for the threads that read its output, and close its pipes."""
        _kill(process)
        process.wait()
        self._outgoing.put(None)
        until = time.monotonic() + _END_TIMEOUT
        for thread, pipe in zip(self._threads, (process.stdout, process.stderr, process.stdin)):
            while thread.is_alive() and time.monotonic() < until:
                with suppress(queue.Empty):  # it may wait for room in the queue
                    self._lines.get(timeout=0.01)
            # A child that has left the group may hold the pipe: to close it would wait for the thread, without end.
            if pipe is not None and not thread.is_alive():
                with suppress(OSError):
                    pipe.close()

    def _start(self) -> None:
        """Start the program and shake hands. Raise PortError if it cannot be used."""
        try:
            words = shlex.split(self._command)
        except ValueError as error:
            raise PortError(f"adapter {shown(self._command)}: {error}") from None
        if not words:
            raise PortError("adapter: the command is empty")
        pipe = subprocess.PIPE
        try:
            self._process = subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=pipe, start_new_session=True)
        except OSError as error:
            reason = error.strerror or str(error)
            if isinstance(error, FileNotFoundError) and "/" not in words[0]:
                reason = f"no such program on the PATH; a file here is started as ./{words[0]}, or by its interpreter"
            raise PortError(f"adapter {shown(self._command)}: {reason}") from None
        self._lines = queue.Queue(_LINES_MOST)
        self._outgoing = queue.SimpleQueue()
        self._complaints.clear()
        self._threads = (
            threading.Thread(target=_read, args=(self._process.stdout, self._lines), daemon=True),
            threading.Thread(target=_keep, args=(self._process.stderr, self._complaints), daemon=True),
            threading.Thread(target=_write, args=(self._process.stdin, self._outgoing), daemon=True),
        )
        try:
            for thread in self._threads:
                thread.start()
            self._send({"hello": "barewire-vectors", "protocol": PROTOCOL})
            hello = self._answer({}, START_TIMEOUT)
        except AdapterFailure as failure:
            self.close()
            raise PortError(f"adapter {shown(self._command)}: {failure}") from None
        except BaseException:  # Ctrl-C while it starts
            self.close()
            raise
        kinds = hello.get("kinds")
        rows = kinds.values() if isinstance(kinds, dict) else ()
        if not isinstance(kinds, dict) or not all(isinstance(row, list) for row in rows):
            self.close()
            raise PortError(f'adapter {shown(self._command)}: its hello needs "kinds": {{"crc16": ["encode"], ...}}')
        self.name, self.version = str(hello.get("name", self._command)), str(hello.get("version", ""))
        self._offers = kinds

    def _send(self, message: Mapping[str, Any]) -> None:
        self._outgoing.put(json.dumps(message).encode() + b"\n")

    def _answer(self, wanted: Mapping[str, _Asked], timeout: float) -> dict[str, Any]:
        """Return the next answer to one of these questions, of none the hello; pass over answers to earlier ones."""
        until = time.monotonic() + timeout
        while True:
            try:
                line = self._lines.get(timeout=max(0.0, until - time.monotonic()))
            except queue.Empty:
                to_what, hint = ("", "") if wanted else (" to the hello", BUFFERED)
                self._fail(f"no answer{to_what} within {timeout:g} s{hint}", is_ending=False)
            if line is None:
                self._fail("it ended without an answer")
            try:
                answer = json.loads(line, parse_constant=_no_constant)
            except (ValueError, RecursionError):
                raise AdapterFailure(f"its answer is not JSON: {_text(line)}") from None
            if not isinstance(answer, dict):
                raise AdapterFailure(f"its answer is not an object: {_text(line)}")
            answer_id = answer.get("id")
            if answer_id is None and not wanted:
                return answer
            if not isinstance(answer_id, str):
                raise AdapterFailure(f"its answer has no id of a question: {_text(line)}")
            if answer_id in wanted:
                return answer
            if answer_id not in self._sent:
                expected = f"expected {shown(next(iter(wanted)))}" if wanted else "the answer to the hello has none"
                raise AdapterFailure(f"its answer has the id {shown(answer_id)}, {expected}")
            if time.monotonic() >= until:
                self._fail(f"no answer within {timeout:g} s, but answers to earlier questions", is_ending=False)

    def _fail(self, text: str, *, is_ending: bool = True) -> NoReturn:
        """Kill the program, and raise AdapterFailure with the last line that it wrote to its standard error.

        A program that `is_ending` by itself is given time for it, so that its exit status can be told.
        """
        assert self._process is not None
        process = self._process
        self._process = None
        self._lost += 1
        if is_ending:
            with suppress(subprocess.TimeoutExpired):
                process.wait(_END_TIMEOUT)
        status = process.poll()  # None: it still runs, and the signal that ends it is ours
        self._release(process)
        complaint = self._complaints[-1] if self._complaints else ""
        ended = "" if status is None else f" ({_status_text(status)})"
        raise AdapterFailure(text + ended + (f": {complaint}" if complaint else ""))


def _status_text(status: int) -> str:
    """Return how a process ended: `exit status 3`, or of a signal its name, `SIGSEGV`."""
    if status >= 0:
        return f"exit status {status}"
    try:
        return signal.Signals(-status).name
    except ValueError:  # a number without a name
        return f"signal {-status}"


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and, on POSIX, its children: one that a wrapper has started is the adapter as well."""
    if sys.platform != "win32":
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()


def _text(line: bytes) -> str:
    return shown(line.decode(errors="replace").strip())


def _no_constant(name: str) -> NoReturn:
    """Refuse what json.loads accepts, and JSON does not have."""
    raise ValueError(f"{name} is no number of JSON")


def _write(stream: Any, lines: queue.SimpleQueue[bytes | None]) -> None:
    """Write lines until one is None, then close the stream: several in one piece if they are there already."""
    with suppress(OSError):  # it has ended, which its output shows
        while (line := lines.get()) is not None:
            stream.write(line)
            if lines.empty():
                stream.flush()
    with suppress(OSError):
        stream.close()


def _read(stream: Any, lines: queue.Queue[bytes | None]) -> None:
    while line := stream.readline(LINE_LONGEST):
        lines.put(line)
    lines.put(None)


def _keep(stream: Any, lines: deque[str]) -> None:
    while line := stream.readline(LINE_LONGEST):
        if text := line.decode(errors="replace").strip():
            lines.append(text)
