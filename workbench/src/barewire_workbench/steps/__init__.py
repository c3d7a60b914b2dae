"""Calculations worked out step by step, for learning them: what a program does in one call, line by line.

    >>> from barewire_workbench.steps import lrc_steps
    >>> print(*lrc_steps(bytes.fromhex("0104")).lines()[5:9], sep="\\n")
    byte  decimal  binary     sum  hex
    ----  -------  ---------  ---  ---
    01h         1  0000 0001    1  1h
    04h         4  0000 0100    5  5h

The files in reading order:

    model         a calculation as a value: texts, tables, result; as lines, as a dict
    checksums     the CRC of RTU, the LRC of ASCII
    timing        a character, t1.5 and t3.5, exchanges
    number        a float or an integer as bytes and registers, in each order, and back
    can           a CAN frame bit by bit; arbitration; a COB-ID taken apart
    drive_words   control word and status word of a CiA 402 drive
"""

from barewire_workbench.steps.can import can_frame_steps, cob_id_steps, parse_cob_id
from barewire_workbench.steps.checksums import CRC_VIEWS, CrcView, crc_steps, lrc_steps
from barewire_workbench.steps.drive_words import control_word_steps, parse_word, status_word_steps
from barewire_workbench.steps.model import Steps, StepSection, StepTable
from barewire_workbench.steps.number import NUMBER_TYPES, number_from_bytes_steps, number_steps
from barewire_workbench.steps.timing import timing_steps

__all__ = [
    "CRC_VIEWS",
    "NUMBER_TYPES",
    "CrcView",
    "StepSection",
    "StepTable",
    "Steps",
    "can_frame_steps",
    "cob_id_steps",
    "control_word_steps",
    "crc_steps",
    "lrc_steps",
    "number_from_bytes_steps",
    "number_steps",
    "parse_cob_id",
    "parse_word",
    "status_word_steps",
    "timing_steps",
]
