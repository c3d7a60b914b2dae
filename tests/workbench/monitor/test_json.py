"""JSON output: the keys of each event are those of docs/how-to/can-analysis.md, and every value is valid JSON."""

from __future__ import annotations

import json
import re
from dataclasses import fields, is_dataclass
from pathlib import Path

import pytest

from barewire.canopen import CanFrame, eds
from barewire.devices import load
from barewire_workbench.monitor import CanMonitor, event_as_dict, event_line, of_device, of_dictionary
from barewire_workbench.monitor.events import (
    EVENT_KINDS,
    EmcyReport,
    Gap,
    NmtCommandReport,
    NodeReport,
    PdoReport,
    SdoTransferReport,
    Violation,
)
from tests.workbench.monitor.recorded_run import DRIVE, of, recorded

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "can-analysis.md"
ROW = re.compile(r"^\| `([a-z-]+)` \| (`at`.*) \|$", re.MULTILINE)


def documented() -> dict[str, tuple[list[str], list[str]]]:
    """Return the keys that each event always has, and those that it has under a condition."""
    rows = dict(ROW.findall(PAGE.read_text(encoding="utf-8")))
    halves = {name: text.partition(";") for name, text in rows.items()}
    return {name: (re.findall(r"`(\w+)`", a), re.findall(r"`(\w+)`", b)) for name, (a, _, b) in halves.items()}


def test_the_page_has_the_json_keys_of_every_event() -> None:
    table = documented()
    assert set(table) == set(EVENT_KINDS.values())
    added = {"violation": ["clause"], "emcy": ["text", "errors"]}
    for kind, name in EVENT_KINDS.items():
        names = [field.name for field in fields(kind)] if is_dataclass(kind) else list(kind._fields)  # type: ignore[attr-defined]
        assert table[name][0] == [*names, *added.get(name, [])], name
    for event in (
        Violation(1.0, "SDO-MUX", 5, "x"), EmcyReport(1.0, 5, 0x1000, 1, b""),
        NmtCommandReport(1.0, 1, 5), Gap(1.0, None, None, "x"),
        NodeReport(1.0, 5, "heard", 5), NodeReport(1.0, 5, "missing", None),
        SdoTransferReport(1.0, 5, 0x605, "upload", "expedited", 0, 0, "aborted", None, None, 0, abort=0x0602_0000),
    ):  # fmt: skip
        result = event_as_dict(event)
        always, sometimes = table[result["event"]]
        assert {*always} <= set(result) <= {"event", *always, *sometimes}


def test_a_recorded_run_has_only_documented_json_keys() -> None:
    table, monitor = documented(), CanMonitor([of_device(load("az3"), DRIVE)])
    events = [event for now, frame in recorded() for event in monitor.feed(frame, now)]
    for result in map(event_as_dict, [*events, *monitor.end(monitor.now)]):
        always, sometimes = table[result["event"]]
        assert {"event", *always} <= set(result) <= {"event", *always, *sometimes}


FILE = """\
[2000]
ParameterName=v
DataType={code}
AccessType=ro
PDOMapping=1
[1800]
ParameterName=TPDO1
ObjectType=9
[1800sub0]
ParameterName=n
DataType=5
AccessType=const
DefaultValue=1
[1800sub1]
ParameterName=COB-ID
DataType=7
AccessType=rw
DefaultValue=0x185
[1A00]
ParameterName=mapping
ObjectType=9
[1A00sub0]
ParameterName=n
DataType=5
AccessType=rw
DefaultValue=1
[1A00sub1]
ParameterName=1
DataType=7
AccessType=rw
DefaultValue=0x200000{bits:02X}
"""


@pytest.mark.parametrize(
    ("code", "data", "value", "text"),
    [
        (0x08, "0000C07F", "nan", "nan"),
        (0x08, "000080FF", "-inf", "-inf"),
        (0x11, "000000000000F03F", 1.0, "1"),
        (0x01, "01", True, "on"),
        (0x0C, "E80300000100", 86_401_000, "1984-01-02 00:00:01"),
        (0x0D, "E80300000100", 86_401_000, "1 day, 0:00:01"),
        (0x0A, "0102FF00", "0102ff00", "01 02 FF 00"),
        (0x09, "41424300", "41424300", "41 42 43 00"),  # a PDO does not define where a text ends
        (0x1B, "FFFFFFFFFFFFFFFF", 2**64 - 1, str(2**64 - 1)),
    ],
)
def test_a_value_of_any_type_is_valid_json_and_text(code: int, data: str, value: object, text: str) -> None:
    document = eds.parse(FILE.format(code=code, bits=4 * len(data)).encode())
    monitor = CanMonitor([of_dictionary(document.dictionary(5), 5)])
    monitor.feed(CanFrame.parse("705#05"), 0.0)
    (event,) = of(PdoReport, monitor.feed(CanFrame.parse(f"185#{data}"), 1.0))
    result = json.loads(json.dumps(event_as_dict(event), allow_nan=False))
    assert result["values"] == {"v": value}
    assert event_line(event).endswith(f"v = {text}")
