"""Each rule with two recordings: one that breaks it, and a similar one that does not."""

from __future__ import annotations

import re
from binascii import crc_hqx
from pathlib import Path

from barewire.canopen import CanFrame
from barewire.devices import load
from barewire_workbench.monitor import BUS_RULES, CanMonitor, event_line, of_device
from barewire_workbench.monitor.events import MonitorEvent, Violation
from tests.helpers import every_case
from tests.workbench.monitor.recorded_run import of

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "can-analysis.md"

UP = ("605#4008100000000000", "585#4108100008000000")
DOWN = ("605#2108100008000000", "585#6008100000000000")
STOPPED, PREOP, OPERATIONAL = "705#04", "705#7F", "705#05"


def block(crc: int, *, blksize: str = "7F", first: str = "01", ack: str = "02", size: str = "0A000000") -> list[str]:
    """Return a block download of ten bytes, with at most one fault."""
    return [
        f"605#C6002100{size}",
        f"585#A4002100{blksize}000000",
        f"605#{first}30313233343536",
        "605#8237383900000000",
        f"585#A2{ack}7F0000000000",
        f"605#D1{crc.to_bytes(2, 'little').hex()}0000000000",
        "585#A100000000000000",
    ]


CRC = crc_hqx(b"0123456789", 0)

CASES: dict[str, tuple[list[str], list[str]]] = {
    "SDO-LENGTH": (["605#40416000"], ["605#4041600000000000"]),
    "SDO-COMMAND": (["605#E041600000000000"], ["605#8041600000000405"]),
    "SDO-RESERVED": (["605#4341600000000000"], ["605#4041600000000000"]),
    "SDO-WRONG-SCS": (
        ["605#4041600000000000", "585#6041600000000000"],
        ["605#4041600000000000", "585#4341600037060000"],
    ),
    "SDO-MUX": (
        ["605#4041600000000000", "585#4B42600037060000"],
        ["605#4041600000000000", "585#4B41600037060000"],
    ),
    "SDO-OVERLAP": (
        ["605#4041600000000000", "605#4040600000000000", "585#4B41600037060000", "585#4B40600037060000"],
        ["605#4041600000000000", "585#4B41600037060000", "605#4040600000000000", "585#4B40600037060000"],
    ),
    "SDO-UNASKED": (
        ["605#4041600000000000", "585#4B41600037060000", "605#6000000000000000", "585#8000000001000405"],
        [*UP, "605#6000000000000000", "585#8008100001000405"],
    ),
    "SDO-TOGGLE": (
        [*UP, "605#6000000000000000", "585#1001020304050607"],
        [*UP, "605#6000000000000000", "585#0001020304050607", "605#7000000000000000", "585#1D08000000000000"],
    ),
    "SDO-SIZE": (
        [*UP, "605#6000000000000000", "585#0101020304050607"],
        ["605#4008100000000000", "585#4108100007000000", "605#6000000000000000", "585#0101020304050607"],
    ),
    "SDO-ABORT-CODE": (
        ["605#4041600000000000", "585#8041600033000906"],
        ["605#4041600000000000", "585#8041600030000906"],
    ),
    "SDO-BLOCK-SIZE": (block(CRC, blksize="00"), block(CRC, blksize="01")[:2]),
    "SDO-BLOCK-SEQNO": (block(CRC, first="00"), block(CRC)),
    "SDO-BLOCK-ACK": (block(CRC, ack="05"), block(CRC)),
    "SDO-BLOCK-CRC": (block(CRC ^ 1), block(CRC)),
    "SDO-BLOCK-SWITCH": (
        ["605#A008100014000000", "585#4B08100037060000"],
        ["605#A008100014040000", "585#4B08100037060000"],
    ),
    "NMT-LENGTH": (["000#01"], ["000#0105"]),
    "NMT-COMMAND": (["000#0305"], ["000#8205"]),
    "NMT-NODE": (["000#0180"], ["000#017F"]),
    "NMT-NOT-OBEYED": ([PREOP, "000#0105", PREOP, PREOP], [PREOP, "000#0105", OPERATIONAL]),
    "STOPPED-SENDS": (
        [STOPPED, "605#4041600000000000", "585#4B41600037060000"],
        [STOPPED, "000#8005", "605#4041600000000000", "585#4B41600037060000"],
    ),
    "PDO-NOT-OPERATIONAL": ([PREOP, "185#0102"], [OPERATIONAL, "185#0102", PREOP, "205#0102"]),
    "HEARTBEAT-LENGTH": (["705#0500"], ["705#05"]),
    "HEARTBEAT-STATE": (["705#06"], ["705#7F"]),
    "HEARTBEAT-TOGGLE": (["705#85"], ["705#R1", "705#85"]),
    "GUARD-TOGGLE": (
        ["705#R1", "705#05", "705#R1", "705#05"],
        ["705#R1", "705#05", "705#R1", "705#85", "705#R1", "705#05"],
    ),
    "EMCY-LENGTH": (["085#308111"], ["085#3081110000000000"]),
    "EMCY-CODE": (["085#0001010000000000"], ["085#0010010000000000"]),
    "EMCY-REGISTER": (["085#1042080000000000"], ["085#1042090000000000", "085#0000080000000000"]),
    "SYNC-LENGTH": (["080#01", "080#"], ["080#01", "080#02"]),
    "SYNC-COUNTER": (["080#01", "080#03"], ["080#01", "080#02", "080#01"]),
    "TIME-LENGTH": (["100#952CB3024D"], ["100#952CB3024D39"]),
    "TIME-VALUE": (["100#005C26054D39"], ["100#FF5B26054D39"]),
    "LSS-LENGTH": (["7E5#0401"], ["7E5#0401000000000000"]),
    "LSS-SERVICE": (["7E5#4400000000000000"], ["7E4#4400000000000000"]),
    "PDO-TOO-SHORT": (["205#0F00"], ["205#0F0000000000"]),
    "PDO-TOO-LONG": (["205#0F00000000000000"], ["205#0F0000000000"]),
    "REMOTE-REQUEST": (["605#R8"], ["185#R8", "705#R1"]),
    "ID-RESERVED": (["6E5#01"], ["001#", "680#01", "000006E5#01"]),
}


def broken(lines: list[str]) -> list[Violation]:
    known = [of_device(load("az3"), 5)]
    monitor = CanMonitor([node._replace(commands=()) for node in known])
    events: list[MonitorEvent] = []
    for place, line in enumerate(lines):
        events += monitor.feed(CanFrame.parse(line), place / 10)
    events += monitor.end(len(lines) / 10)
    assert all(event_line(event).isprintable() for event in events)
    return [violation for violation in of(Violation, events) if not violation.repeated]


def test_every_rule_has_its_case_and_no_other() -> None:
    assert CASES.keys() == BUS_RULES.keys()


@every_case("rule", BUS_RULES)
def test_a_broken_rule_is_found(rule: str) -> None:
    found = broken(CASES[rule][0])
    assert rule in [violation.rule for violation in found], found
    shown = next(violation for violation in found if violation.rule == rule)
    assert shown.frame in [line.upper() for line in CASES[rule][0]]
    assert shown.text


@every_case("rule", BUS_RULES)
def test_a_kept_rule_is_not_reported(rule: str) -> None:
    assert [violation for violation in broken(CASES[rule][1]) if violation.rule == rule] == []


def test_the_dialect_of_a_known_device_breaks_no_rule() -> None:
    monitor = CanMonitor([of_device(load("az3"), 5)])
    events = monitor.feed(CanFrame.parse("605#4B41600000000000"), 0.0)
    assert of(Violation, events) == []
    events = monitor.feed(CanFrame.parse("606#4B41600000000000"), 0.0)
    events += monitor.feed(CanFrame.parse("586#4B41600037060000"), 0.1)  # so it is not a segment of a block
    assert [violation.rule for violation in of(Violation, events)] == ["SDO-RESERVED"]


def test_a_repeated_violation_is_reported_once_and_counted() -> None:
    whole = "185#0102030405060708"
    assert len(broken([PREOP, *[whole] * 20])) == 1
    assert [violation.rule for violation in broken(["185#0102"] * 20)] == ["PDO-TOO-SHORT"]
    assert len(broken(["6E5#01", "6E5#02", "6E6#01"])) == 2
    monitor = CanMonitor()
    for place in range(20):
        monitor.feed(CanFrame.parse("6E5#01"), place / 10)
    assert monitor.violations == {"ID-RESERVED": 20}


def test_the_page_lists_all_rules() -> None:
    page = PAGE.read_text(encoding="utf-8")
    listed = re.findall(r"^\| `([A-Z-]+)` \| ([^|]+) \| ([^|]+) \|$", page, re.MULTILINE)
    assert [(rule, clause.strip(), text.strip()) for rule, clause, text in listed] == [
        (name, rule.clause, rule.text) for name, rule in BUS_RULES.items()
    ]
