"""Every bound in the source of the Modbus and SDO clients is crossed by a run of the model (`bounds`)."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from tests.model import bounds

pytestmark = pytest.mark.long
RUNS = 8
"""Of each carrier, with default options and with every option."""
CHECKED_ELSEWHERE = {
    "modbus/client/read_identification.py: ": "requests in a row: tests/modbus/client/test_read_identification.py",
    "rtu/shape.py: ": "lengths of messages, most of them of other functions: tests/rtu/test_shape.py",
    "rtu/line.py: min(due, ": "several possible lengths, which only a listener has: tests/rtu/test_line.py",
    "rtu/line.py: max(self._unchecked, ": "the search of a listener: tests/rtu/test_line.py",
    "rtu/line.py: due < _AT_SILENCE": "the same",
    "rtu/line.py: end - at >= SHORTEST": "a message has a function code, so it is never shorter",
    "rtu/frame.py: ": "a request is never longer, and a line holds no more: tests/rtu/test_frame.py",
    "ascii/frame.py: 1 <= len(pdu) <= PDU_LIMIT": "a request is never longer: tests/ascii/test_frame.py",
    "ascii/frame.py: len(data) > LONGEST": "a line holds no more: tests/ascii/test_frame.py",
    "ascii/frame.py: max(len(data) - 2, 1)": "the place in an error: tests/ascii/test_frame.py",
    "modbus/client/bus.py: heard.now < until": "a broadcast, which only `setups` has: tests/model/test_one_line.py",
    "canopen/sdo/client.py: 1 <= server <= SERVERS_MAX": "refuses an argument: tests/canopen/sdo/test_access.py",
    "canopen/sdo/plain.py: 0.0 < self.timeout < _ENDLESS": "refuses an argument: tests/canopen/sdo/test_client_ends.py",
    "canopen/sdo/channel.py: now >= self.give_up": "never silent: tests/canopen/sdo/test_client.py",
    "canopen/sdo/channel.py: heard.now >= self.late": "without a frame a wait ends no earlier",
    "modbus/client/line_state.py: min(self.silent": "days of silence: tests/modbus/client/test_line_state.py",
    "tcp/frame.py: 1 <= size <= PDU_LIMIT": "a request is never longer: tests/tcp/test_frame.py",
}
"""The beginning of the bounds that no run can cross, or none needs to."""


def test_every_bound_of_the_client_is_crossed_by_a_run() -> None:
    command = [sys.executable, "-m", "tests.model.bounds", str(RUNS)]
    ended = subprocess.run(command, cwd=bounds.SOURCE.parent.parent, capture_output=True, text=True, timeout=300)
    assert not ended.returncode, ended.stderr
    crossed = json.loads(ended.stdout)
    missing = {
        name: sorted(set(outcomes) - set(crossed.get(name, ())))
        for name, outcomes in bounds.sites().items()
        if not name.startswith(tuple(CHECKED_ELSEWHERE))
    }
    assert not {name: outcomes for name, outcomes in missing.items() if outcomes}


def test_each_exception_to_that_stands_for_a_bound() -> None:
    names = list(bounds.sites())
    assert [place for place in CHECKED_ELSEWHERE if not any(name.startswith(place) for name in names)] == []


def test_a_bound_is_found_in_every_form_that_the_source_has() -> None:
    found = "\n".join(bounds.sites())
    for text in (
        "bus.py: min(timeout, rest)",
        "bus.py: len(state.of_function(unit, _PROBE)) < _MOST_PROBES",
        "line_state.py: deque(maxlen=_KEPT)",
        "line_state.py: pending.until > now",
        "channel.py: max(timeout, self.timeout)",
        "channel.py: min(self.backlog, now + self.timeout)",
        "channel.py: heard.now >= self.quiet_until",
        "line_state.py: len(passed_over) < 3",
    ):
        assert text in found
