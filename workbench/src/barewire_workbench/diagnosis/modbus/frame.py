"""The diagnosis of one Modbus frame in any framing."""

from __future__ import annotations

from dataclasses import replace

from barewire_workbench.diagnosis.modbus.ascii import diagnose_ascii
from barewire_workbench.diagnosis.modbus.rtu import diagnose_rtu
from barewire_workbench.diagnosis.modbus.tcp import diagnose_tcp
from barewire_workbench.frames.modbus import explain_rtu
from barewire_workbench.frames.result import Explanation, FrameRole

_DIAGNOSES = {"rtu": diagnose_rtu, "ascii": diagnose_ascii, "tcp": diagnose_tcp}


def with_diagnosis(explanation: Explanation, data: bytes, role: FrameRole | None = None) -> Explanation:
    """Return the explanation of a Modbus frame with what is wrong with it; a good frame stays as it is.

    `role` is the direction that the caller gave, None if it was guessed.
    """
    if explanation.valid:
        return explanation
    found = tuple(_DIAGNOSES[explanation.protocol](data, role))
    if explanation.protocol == "rtu" and found and found[0].code != "crc-missing":
        explanation = explain_rtu(data, role, bare=False)
    return replace(explanation, diagnosis=found)
