"""Explains frames: every byte with its name, value and meaning, and a verdict.

    >>> print(*explain_text("rtu", "01 04 0F B1 00 02 22 F8").lines(), sep="\\n")
    0  01     unit           1             unit 1
    1  04     function code  4             04 Read Input Registers
    2  0F B1  address        0FB1h (4017)  0-based; number 4018 in 1-based tables
    4  00 02  quantity       2             input registers
    6  22 F8  CRC                          CRC ok
    valid: a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok

Every byte is in exactly one field, in order, however broken the frame is, and no input raises. The files in reading
order:

    findings     the codes of a diagnosis, and what each says
    result       the explanation: fields, verdict, lines, dict
    input/       bytes from text: hexadecimal, source literals, hex dumps
    modbus/      Modbus PDUs and the three frames around them; exchanges on a line as text
    canopen/     CAN frames by service; SDO, LSS; descriptions of nodes
    capture/     recordings: pcapng, candump, ASC, BLF, logs; Modbus and CAN in them
    can_monitor/ a monitor for CANopen buses: transfers, states, broken rules
    recorded_values       what a recording reads from a device
    played, peer_replay   a recording of a CAN bus played against a device, and compared
    client_replay         the same against our SDO client
    wire/        the levels of characters and CAN frames, and a receiver with other settings
    steps/       checksums, times, values and words, worked out step by step
    pictures/    frames, levels, exchanges, drives and values as text, SVG and HTML
    diagnosis/   what is wrong with a frame, proved by trials
    api          `explain` and `explain_text`

Depends on: modbus, canopen, rtu, ascii, tcp, devices. No ports, files or clocks. Used by: io, cli, bench, tests.
"""

from barewire.explain.api import explain, explain_exchange, explain_text
from barewire.explain.findings import DiagnosisCode, Finding
from barewire.explain.result import ExplainedField, Explanation, FrameRole, Problem, ProtocolName

__all__ = [
    "explain",
    "explain_text",
    "explain_exchange",
    "Explanation",
    "ExplainedField",
    "Problem",
    "ProtocolName",
    "FrameRole",
    "Finding",
    "DiagnosisCode",
]
