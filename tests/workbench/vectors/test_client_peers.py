"""The adapters of clients in Python, for kind `client`: what is known of them shows up by itself."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from barewire_workbench.live.vector_adapter import VectorAdapter
from barewire_workbench.vectors.judge import judge
from barewire_workbench.vectors.questions import Question
from tests.workbench.vectors.loaded import VECTORS

ADAPTERS = Path(__file__).parents[3] / "vectors" / "peers"


def question(case_id: str) -> Question:
    (one,) = VECTORS.questions(*VECTORS.find(case_id))
    return one


PASSED = ("client-rtu-fates-1", "client-rtu-fates-4", "client-rtu-retries-1")
"""A slow answer, a lost request, and no trouble at all."""
LATE, FOREIGN_FIRST, ONE_RETRY = "client-rtu-late-1", "client-rtu-fates-40", "client-rtu-retries-5"


@pytest.mark.parametrize(
    ("program", "module", "failed", "not_offered"),
    [
        ("pymodbus", "pymodbus", (LATE,), ()),
        ("minimalmodbus", "minimalmodbus", (LATE, FOREIGN_FIRST), (ONE_RETRY,)),
        ("modbus-tk", "modbus_tk", (LATE, FOREIGN_FIRST), (ONE_RETRY,)),
        ("umodbus", "umodbus", (LATE, FOREIGN_FIRST), (ONE_RETRY,)),
    ],
)
def test_a_serial_client(program: str, module: str, failed: tuple[str, ...], not_offered: tuple[str, ...]) -> None:
    pytest.importorskip(module)
    with VectorAdapter(f"{sys.executable} {ADAPTERS} {program}", timeout=60) as adapter:
        states = {one: judge(question(one), adapter(question(one))) for one in (*PASSED, *failed, *not_offered)}
        assert adapter.version
    assert {one: verdict.state for one, verdict in states.items()} == (
        dict.fromkeys(PASSED, "passed") | dict.fromkeys(failed, "failed") | dict.fromkeys(not_offered, "not offered")
    )
    assert "registers 0777 is wrong in any case" in states[LATE].text


def test_a_tcp_client() -> None:
    pytest.importorskip("pyModbusTCP")
    ids = ("client-tcp-fates-1", "client-tcp-fates-40", "client-tcp-numbers-1", "client-rtu-fates-1")
    with VectorAdapter(f"{sys.executable} {ADAPTERS} pymodbustcp", timeout=60) as adapter:
        states = [judge(question(one), adapter(question(one))).state for one in ids]
    assert states == ["passed", "failed", "passed", "not offered"]
