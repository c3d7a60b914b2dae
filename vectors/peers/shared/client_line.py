"""For the adapters of Modbus clients in Python: a client on a line in virtual time, and what it is asked.

    def connect(line, patches):            a client of the library on a line, and the function that asks with it
        client = library.Client(line)

        def ask(unit, code, fields):       the fields as in ARGUMENTS: what was read, or None for a write
            return getattr(client, NAMES[code])(*given(code, fields))

        return ask

    clients(connect, codes, "rtu")         the answers of kind `pdu` and `exchange`: one request, one response
    over_time(connect)                     those of kind `client`: the peer of the case answers

The libraries are not changed. They get a serial port or a socket on the line of the peer, which is
../../reference/modbus/client_peer.py, and the clock that they import is replaced by the time of this line, so nothing
is waited for. A library that has no such line, no retries, no broadcast or no way to ask this function says that the
case is not offered.
"""

from __future__ import annotations

import logging
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "reference" / "modbus"))

from adapter import Answers, NotOffered, octets
from adapter_client import Call, ExceptionAnswer, client_answers, request_fields
from client_peer import ClientPeer, unwrapped, wrapped

BEGIN = 1000.0
"""The time at the beginning, in seconds: some libraries compare with a time 0."""
UNIT = 1
NAMES = {
    **{1: "read_coils", 2: "read_discrete_inputs", 3: "read_holding_registers", 4: "read_input_registers"},
    **{5: "write_single_coil", 6: "write_single_register"},
    **{15: "write_multiple_coils", 16: "write_multiple_registers"},
}
"""The names that most libraries have for their functions."""


class Line:
    """The line to the peer, as a serial port and as a socket; and the `time` module of a library."""

    port = name = "virtual"
    bytesize, stopbits, parity, is_open = 8, 1, "N", True

    def __init__(self, case, peer=None):
        self.peer = peer or ClientPeer(case)
        self.setup = case["line"]
        self.is_serial = self.setup["framing"] != "tcp"
        self.baudrate = self.setup.get("baud", 19200)
        self.timeout = self.setup["timeout"] / 1e6
        self.now = BEGIN
        self.received = b""

    def microseconds(self):
        """The time of the peer."""
        return round((self.now - BEGIN) * 1e6)

    def due(self):
        """The time of the next piece; None if nothing is under way."""
        return BEGIN + self.peer.coming[0][0] / 1e6 if self.peer.coming else None

    def take(self):
        """Receive what has come."""
        while self.peer.coming and self.peer.coming[0][0] <= self.microseconds():
            self.received += self.peer.coming.pop(0)[1]

    def wait(self, until, size):
        """Let time pass until so many bytes have come, or this time is over."""
        self.take()
        while len(self.received) < size and (due := self.due()) is not None and due <= until:
            self.now = max(self.now, due)
            self.take()
        if len(self.received) < size:
            self.now = max(self.now, until)

    def cut(self, size):
        data, self.received = self.received[:size], self.received[size:]
        return data

    # The time module

    def time(self):
        return self.now

    monotonic = perf_counter = time

    def sleep(self, seconds):
        self.now += max(0.0, seconds)

    # A serial port

    def write(self, data):
        if self.is_serial:
            self.now += len(data) * 11 / self.baudrate
        self.peer.hear(bytes(data), self.microseconds())
        return len(data)

    def read(self, size=1):
        self.wait(self.now + (self.timeout or 0.0), size)
        return self.cut(size)

    @property
    def in_waiting(self):
        self.take()
        return len(self.received)

    def inWaiting(self):
        return self.in_waiting

    def reset_input_buffer(self):
        self.take()
        self.received = b""

    flushInput = reset_input_buffer

    def flush(self):
        """Requests are sent at once."""

    reset_output_buffer = flushOutput = open = flush

    def isOpen(self):
        return True

    # A socket

    send = sendall = write

    def recv(self, size):
        self.wait(self.now + self.timeout, 1)
        if not self.received:
            raise TimeoutError("timed out")
        return self.cut(size)

    def close(self):
        """Close a connection: what is under way is lost. A serial port receives on."""
        if not self.is_serial:
            self.received = b""
            self.peer.coming.clear()

    def fileno(self):
        return 3

    def getsockname(self):
        return ("virtual", 502)

    def connect(self, *_):
        """It is connected."""

    setblocking = settimeout = setsockopt = connect

    def select(self, reading, writing=(), failing=(), timeout=0.0):
        """The function select.select, with this line as the only socket."""
        self.wait(self.now + max(0.0, timeout or 0.0), 1)
        return (list(reading) if self.received else [], [], [])


def needs(line, *framings, retries=False, echo=False):
    """Raise NotOffered for a line that a library does not have."""
    if line.setup["framing"] not in framings:
        raise NotOffered(f"no line like this: {line.setup['framing']}")
    if line.setup.get("retries") and not retries:
        raise NotOffered("no retries")
    if line.setup.get("echo") and not echo:
        raise NotOffered("no option for a line with an echo")
    if line.setup.get("at_once"):
        raise NotOffered("one question at a time")


# One request, one response ---------------------------------------------------------------------------------------


class Reply:
    """A peer that keeps what is sent, and answers with one PDU."""

    def __init__(self, framing, pdu):
        self.framing, self.pdu, self.sent, self.coming = framing, pdu, b"", []

    def hear(self, frame, now):
        self.sent += frame
        _, _, number = unwrapped(self.framing, frame)
        if self.pdu is not None:
            self.coming.append((now, wrapped(self.framing, UNIT, self.pdu.hex(), number)))


def clients(connect: Any, codes: set[int], framing: str) -> Answers:
    """Return the answers of a client to single requests, and over time."""
    setup = {"framing": framing, "timeout": 1_000_000}

    def call(code: int, fields: dict[str, Any], reply: bytes | None) -> tuple[bytes, Any]:
        line = Line({"line": setup}, Reply(framing, reply))
        result = None
        with ExitStack() as patches:
            ask = connect(line, patches)
            try:
                result = ask(UNIT, code, fields)
            except NotOffered:
                raise
            except Exception:
                if reply is not None or not line.peer.sent:
                    raise
        return line.peer.sent[7:] if framing == "tcp" else line.peer.sent[1:-2], result

    one: Call = call
    return {**client_answers(one, codes), **over_time(connect)}


# Over time -------------------------------------------------------------------------------------------------------


def over_time(connect: Any) -> Answers:
    """Return the answers of kind `client`."""
    logging.disable(logging.CRITICAL)

    def run(case: dict[str, Any]) -> dict[str, Any]:
        line = Line(case)
        outcomes = []
        with ExitStack() as patches:
            ask = connect(line, patches)
            for place, question in enumerate(case["ask"]):
                line.now = max(line.now, BEGIN + question["at"] / 1e6)
                line.peer.begin(place)
                outcomes.append(outcome(ask, question, line.is_serial))
                line.peer.end(place)
        return {"ask": [{"outcome": one, "seen": seen} for one, seen in zip(outcomes, line.peer.seen)]}

    return {"client": {"run": run}}


def outcome(ask: Any, question: dict[str, Any], is_serial: bool) -> str:
    """Ask one question, and return the text of its outcome."""
    pdu = octets(question["pdu"])
    fields = request_fields(pdu)
    if fields is None or pdu[0] > 0x10:
        raise NotOffered(f"function {pdu[0]:02X}")
    try:
        found = ask(question["unit"], pdu[0], fields)
    except NotOffered:
        raise
    except ExceptionAnswer as refused:
        found = refused
    except Exception:
        return "no answer"
    return told(pdu[0], found, question, is_serial)


def told(code: int, found: Any, question: dict[str, Any], is_serial: bool) -> str:
    """Return the text of an outcome: values, done or sent, or an exception response."""
    if isinstance(found, ExceptionAnswer):
        return f"exception {found.args[0]:02X}"
    if code > 4 or found is None:
        return "sent" if question["unit"] == 0 and is_serial else "done"
    if code <= 2:
        return "bits " + "".join("01"[bool(bit)] for bit in found)
    return "registers " + " ".join(f"{register:04X}" for register in found)
