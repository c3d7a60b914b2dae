"""A program that answers the questions of the vectors: JSON on its standard input and output, one object a line.

    we send      {"hello": "barewire-vectors", "protocol": 1}
    it answers   {"name": "pymodbus", "version": "3.16.1", "kinds": {"crc16": ["encode"], "lrc": ["encode"]}}
    we send      {"id": "crc16-1.encode", "kind": "crc16", "do": "encode", "bytes": "02 07"}
    it answers   {"id": "crc16-1.encode", "is": {"crc": "1241", "wire": "41 12"}}

It is not asked what it does not offer. A program that ends is started again for the next question; one that does not
answer in time is killed, and started again. What it writes to its standard error is kept for the text of a failure.
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
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NoReturn, Self

from barewire.errors import PortError, shown
from barewire_workbench.vectors.judge import Answer
from barewire_workbench.vectors.questions import Question
from barewire_workbench.vectors.run import AdapterFailure

PROTOCOL = 1
START_TIMEOUT = 30.0
"""Seconds in which a program must answer the hello: interpreters and virtual machines start slowly."""
LINE_LONGEST = 1 << 20
"""Bytes of a line of answer."""
_END_TIMEOUT = 1.0
"""Seconds in which a program must end when its input is closed."""
_LINES_MOST = 16
"""Lines that are read ahead: a program that floods its output has to wait, and memory stays small."""
_LOST_MOST = 20
"""Crashes and time-outs after which a program is given up: what it has not been asked by then has failed."""


class VectorAdapter:
    """A running program, as a function from a question to its answer. Use it in a `with` block."""

    def __init__(self, command: str, *, timeout: float = 10.0) -> None:
        self._command = command
        self._timeout = timeout
        self._lost = 0
        self._asked: set[str] = set()
        self._process: subprocess.Popen[bytes] | None = None
        self._readers: tuple[threading.Thread, ...] = ()
        self._lines: queue.Queue[bytes | None] = queue.Queue(_LINES_MOST)
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
        if not self.offers(question.kind, question.do):
            return {"not_offered": f"{self.name} does not offer {question.kind}.{question.do}"}
        if self._lost >= _LOST_MOST:
            raise AdapterFailure(f"not asked: the adapter was lost {self._lost} times")
        try:
            if self._process is None:
                self._start()
            self._send(question.as_json())
            self._asked.add(question.id)
            return self._answer(question.id, self._timeout)
        except PortError as error:
            raise AdapterFailure(str(error)) from None

    def offers(self, kind: str, do: str) -> bool:
        """Return whether the program offers an operation."""
        return do in self._offers.get(kind, ())

    def close(self) -> None:
        """End the program: close its input, wait a second, then kill it and what it has started."""
        process, self._process = self._process, None
        if process is None:
            return
        assert process.stdin is not None
        with suppress(OSError):
            process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            process.wait(_END_TIMEOUT)
        self._release(process)

    def _release(self, process: subprocess.Popen[bytes]) -> None:
        """Kill a process with its children, wait for the threads that read its output, and close its pipes."""
        _kill(process)
        process.wait()
        assert process.stdin is not None
        with suppress(OSError):
            process.stdin.close()
        until = time.monotonic() + _END_TIMEOUT
        for thread, pipe in zip(self._readers, (process.stdout, process.stderr)):
            while thread.is_alive() and time.monotonic() < until:
                with suppress(queue.Empty):  # it may wait for room in the queue
                    self._lines.get(timeout=0.01)
            # A child that has left the group may hold the pipe: to close it would wait for the thread, without end.
            if pipe is not None and not thread.is_alive():
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
        self._complaints.clear()
        self._readers = (
            threading.Thread(target=_read, args=(self._process.stdout, self._lines), daemon=True),
            threading.Thread(target=_keep, args=(self._process.stderr, self._complaints), daemon=True),
        )
        try:
            for thread in self._readers:
                thread.start()
            self._send({"hello": "barewire-vectors", "protocol": PROTOCOL})
            hello = self._answer(None, START_TIMEOUT)
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
        assert self._process is not None
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(message).encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            self._fail("it ended before the question")

    def _answer(self, wanted: str | None, timeout: float) -> dict[str, Any]:
        """Return the next line as an object; answers to earlier questions are passed over."""
        until = time.monotonic() + timeout
        while True:
            try:
                line = self._lines.get(timeout=max(0.0, until - time.monotonic()))
            except queue.Empty:
                to_what, hint = ("", "") if wanted else (" to the hello", "; is its output flushed after each line?")
                self._fail(f"no answer{to_what} within {timeout:g} s{hint}", is_ending=False)
            if line is None:
                self._fail("it ended without an answer")
            text = shown(line.decode(errors="replace").strip())
            try:
                answer = json.loads(line)
            except (ValueError, RecursionError):
                raise AdapterFailure(f"its answer is not JSON: {text}") from None
            if not isinstance(answer, dict):
                raise AdapterFailure(f"its answer is not an object: {text}")
            if answer.get("id") == wanted:
                return answer
            if not isinstance(answer.get("id"), str):
                raise AdapterFailure(f"its answer has no id of a question: {text}")
            if answer["id"] not in self._asked:
                expected = f"expected {shown(wanted)}" if wanted else "the answer to the hello has none"
                raise AdapterFailure(f"its answer has the id {shown(answer['id'])}, {expected}")
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


def _read(stream: Any, lines: queue.Queue[bytes | None]) -> None:
    while line := stream.readline(LINE_LONGEST):
        lines.put(line)
    lines.put(None)


def _keep(stream: Any, lines: deque[str]) -> None:
    while line := stream.readline(LINE_LONGEST):
        if text := line.decode(errors="replace").strip():
            lines.append(text)
