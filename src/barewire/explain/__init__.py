"""Paste a frame, learn something: every byte of it by name, value and meaning, and a verdict.

    >>> print(*explain_text("rtu", "01 04 0F B1 00 02 22 F8").lines(), sep="\\n")
    0  01     unit           1             unit 1
    1  04     function code  4             04 Read Input Registers
    2  0F B1  address        0FB1h (4017)  0-based; number 4018 in 1-based tables
    4  00 02  quantity       2             input registers
    6  22 F8  CRC                          CRC ok
    valid: a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok

Every byte is in exactly one field, in order, however broken the frame is; and nothing that comes in can raise. Files:

    protocols    the two ways in                       text    what people paste
    dress, dump  what programs and tools put around bytes
    explanation  the value, its lines and its dict     words   the sentences
    pdu          the letter: request or response?      can     whose identifier is it?
    modbus       the three envelopes around it         sdo, lss  the two services with tables of their own

    replay       a recording of a line, decoded        overheard  what was heard there, in words
    pcapng, packets  captures, and Modbus in them      bytelog    logs and dumps

    can_recording  a recording of a CAN bus, decoded   listen/    what was heard there: transfers, states, broken rules
    candump, asc   its forms as text                   socketcan  its frames in captures
    recorded       what all forms are made of

I know: the shape of every message.  I never know: devices, ports, files, clocks, colours.
Who may import me: shells, cli, bench, tests.
"""

from barewire.explain.api import explain, explain_text
from barewire.explain.result import ExplainedField, Explanation, Problem, Protocol, Role

__all__ = ["explain", "explain_text", "Explanation", "ExplainedField", "Problem", "Protocol", "Role"]
