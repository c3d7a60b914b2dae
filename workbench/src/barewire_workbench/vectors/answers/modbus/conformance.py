"""Answers for server-conformance: our server with a table of 100 registers and coils, on a line of its own."""

from __future__ import annotations

from collections.abc import Callable

from barewire.ascii import AsciiLine, encode as ascii_frame
from barewire.modbus import Server, Table
from barewire.modbus.adu import Adu
from barewire.modbus.framing import Line
from barewire.rtu import RtuLine, Timing, encode as rtu_frame
from barewire.tcp import TcpLine, encode as tcp_frame
from barewire_workbench.conform.modbus import CLOSED, ServerStep, answer_text, read_step
from barewire_workbench.vectors.questions import Fields

UNIT = 1
_TIMING = Timing.of(19200)
_LINES: dict[str, tuple[Callable[[], Line], Callable[[int, bytes], bytes], Callable[[bytes], bytes]]] = {
    "tcp": (TcpLine, lambda unit, pdu: tcp_frame(unit, pdu, 1), lambda frame: frame[6:]),
    "rtu": (lambda: RtuLine(_TIMING, role="server", units=(UNIT,)), rtu_frame, lambda frame: frame[:-2]),
    "ascii": (AsciiLine, ascii_frame, lambda frame: bytes.fromhex(frame[1:-2].decode())[:-1]),
}
"""By framing: the line of a server, a frame for it, and unit and PDU of a frame that it sends."""


def answer_steps(given: Fields) -> Fields:
    """Run the steps, and return what was answered in each: PDUs, nothing, or "closed"."""
    new_line, frame, content = _LINES[given["framing"]]
    units, now, answers = {UNIT: Table(100)}, 1.0, []
    server = Server(new_line(), units, serial=given["framing"] != "tcp")
    for step in map(read_step, given["steps"]):
        now += step.after + 1
        sent = map(content, _carried_out(server, step, frame, now))
        texts = answer_text([Adu(data[0], data[1:]) for data in sent])
        now += 1
        server.line.sent(now)
        if server.line.broken is not None:
            texts, server = texts or CLOSED, Server(new_line(), units, serial=False)
        answers.append(texts)
    return {"answers": answers}


def _carried_out(server: Server, step: ServerStep, frame: Callable[[int, bytes], bytes], now: float) -> list[bytes]:
    """Feed the stimuli of a step, then silence, and return the frames that the server sends."""
    data = b"".join(stimulus.framed(frame, UNIT) for stimulus in step.stimuli)
    replies = server.feed(data, now)
    for _ in range(8):
        if server.deadline is not None:
            replies += server.feed(None, max(now, server.deadline))
    return [reply.data for reply in replies]
