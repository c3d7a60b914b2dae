"""The screens of `sniff --live` and `panel --terminal`: what they list, explain and write, and how they end."""

from __future__ import annotations

import asyncio
import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

import click
import pytest

from barewire import ModbusServer
from barewire.canopen import CanFrame
from barewire.devices import load
from barewire.devices.sim import MachineUnits, simulator
from barewire.errors import EncodeError, PortError
from barewire.io.ports.pty import PseudoTerminal
from barewire.rtu import encode as rtu_frame
from barewire_workbench.cli.panels.line import PanelLine, running
from barewire_workbench.cli.sources import Source
from barewire_workbench.cli.terminal.heard import Filter, HeardRows, KeepingMonitors, Rates, Row, hear_can, hear_modbus
from barewire_workbench.diagnosis.can_log import CanLogDiagnosis
from barewire_workbench.monitor import is_repeated
from barewire_workbench.wire import longest_can_frame
from tests.helpers import some_of, unhex, until
from tests.workbench.cli.helpers import ENVIRONMENT, error_of, output_of, run_here
from tests.workbench.cli.test_panel import SETTING, Machine, VirtualClock
from tools.screens import text_of

pytest.importorskip("textual")
from textual.events import Key
from textual.pilot import Pilot
from textual.widgets import Input

from barewire_workbench.cli.terminal import sniffing
from barewire_workbench.cli.terminal.machine import MachineScreen
from barewire_workbench.cli.terminal.screen import Ask, RowList
from barewire_workbench.cli.terminal.sniffing import SniffScreen, explained_lines, save_rows, shortened

LINE = "\n".join(
    f"{at} {rtu_frame(unit, unhex(pdu)).hex(' ')}"
    for at, unit, pdu in [
        (10.0, 1, "03 0000 0002"),
        (10.0123, 1, "03 04 0017 0007"),
        (10.1, 2, "06 0001 0003"),
        (10.115, 2, "06 0001 0003"),
        (10.2, 3, "03 0000 0001"),
        (11.3, 1, "03 0FA0 0002"),
        (11.31, 1, "83 02"),
        (11.4, 1, "03 0000 0002"),
    ]
)
LINE += "\n11.412 01 03 04 00 17 00 07 0B 00\n"  # the CRC is wrong
BUS = """\
(0.000) can0 705#7F
(0.500) can0 605#4041600000000000
(0.501) can0 585#4B41600037060000
(0.600) can0 605#2B17100040420000
(0.601) can0 585#8017100030000906
(0.700) can0 605#C600210012000000
(0.701) can0 585#A400210004000000
(0.702) can0 605#0174656E206C6574
(0.703) can0 605#027465727320616E
(0.704) can0 605#836420736F000000
(0.705) can0 585#A201040000000000
(0.706) can0 605#017465727320616E
(0.707) can0 605#826420736F000000
(0.708) can0 585#A202040000000000
(0.709) can0 605#CD25820000000000
(0.710) can0 585#A100000000000000
(0.800) can0 185#3706000000000000
(1.120) can0 085#1042090000000000
"""


def heard_of(text: str, tmp_path: Path, limit: int = 1000) -> HeardRows:
    """Read a recording to its end."""
    file = tmp_path / "heard.log"
    file.write_text(text)
    heard = HeardRows(limit=limit)
    with click.Context(click.Command("sniff")):
        traffic = Source(str(file), None)
        if traffic.is_can:
            hear_can(
                heard,
                traffic,
                KeepingMonitors(),
                CanLogDiagnosis(),
                is_shown=lambda event: not is_repeated(event),
                file=None,
            )
        else:
            hear_modbus(heard, traffic, seconds=None, window=1.0, names=None, file=None)
    heard.ended = True
    return heard


def row(number: int, *, wrong: bool = False, unit: int = 1) -> Row:
    request = f"unit {unit}  Read Holding Registers, 1 from {number:04X}h"
    return Row(float(number), f"unit {unit}", "", request, wrong, "3", request, (), list)


def shown(app: Any) -> str:
    """Return the text of the screen."""
    return text_of(app.export_screenshot())


async def wait_until(pilot: Pilot[None], is_so: Callable[[], bool]) -> None:
    """Wait until something is so: on a busy computer `pilot.pause` may end before what was pressed has had effect."""
    give_up = time.monotonic() + 60
    while not is_so():
        assert time.monotonic() < give_up, shown(pilot.app)
        await pilot.pause(0.05)


async def until_shown(pilot: Pilot[None], *texts: str) -> None:
    """Wait until the screen shows these texts."""
    await wait_until(pilot, lambda: all(map(shown(pilot.app).__contains__, texts)))


def on_screen(app: Any, act: Callable[[Pilot[None]], Awaitable[None]], size: tuple[int, int] = (80, 24)) -> None:
    """Run a screen without a terminal, and act on it."""

    async def run() -> None:
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            await act(pilot)

    asyncio.run(run())


def screen_of(heard: HeardRows) -> SniffScreen:
    return SniffScreen(heard, "a line", lambda rows, name: save_rows(rows, name, is_can=False))


# What is heard


@pytest.mark.parametrize("text", [LINE, BUS])
def test_the_rows_are_the_lines_of_sniff(text: str, tmp_path: Path) -> None:
    lines = [row.line for row in heard_of(text, tmp_path).take()]
    assert lines == output_of("sniff", str(tmp_path / "heard.log")).splitlines()


def test_a_row_has_its_frames_as_explain_explains_them(tmp_path: Path) -> None:
    rows = heard_of(LINE, tmp_path).take()
    wrong = [text for text, _ in explained_lines(rows[-1])]
    request, damaged = "01 03 00 00 00 02 C4 0B", "01 03 04 00 17 00 07 0B 00"
    at = wrong.index(f"no frame  {damaged}")
    assert wrong[1:at] == [f"request  {request}", *output_of("explain", "rtu", request).splitlines()]
    assert wrong[at + 1 :] == output_of("explain", "rtu", damaged).splitlines()
    assert [is_wrong for _, is_wrong in explained_lines(rows[0])] == [False] * len(explained_lines(rows[0]))
    refused = [text for text, _ in explained_lines(rows[3])]
    assert refused[-1].startswith("valid: a response from unit 1, exception 02")


def test_a_transfer_has_all_its_frames_and_segments_are_known(tmp_path: Path) -> None:
    rows = heard_of(BUS, tmp_path).take()
    (upload,) = (row for row in rows if "upload 6041h:00" in row.line)
    assert [item.frame for item in upload.origin] == [
        CanFrame.parse("605#4041600000000000"),
        CanFrame.parse("585#4B41600037060000"),
    ]
    (block,) = (row for row in rows if "download 2100h:00" in row.line)
    words = dict(block.explained())
    assert len(block.origin) == 11
    assert "segment 2" in words["605#027465727320616E"].verdict
    assert [(row.what, row.wrong) for row in rows] == [
        ("heartbeat", False), ("SDO", False), ("SDO", True), ("LOSS", True), ("SDO", False),
        ("VIOLATION", True), ("TPDO1", False), ("EMCY", True), ("SUMMARY", False),
    ]  # fmt: skip


def test_the_diagnosis_is_that_of_diagnose(tmp_path: Path) -> None:
    for text in (LINE, BUS):
        heard = heard_of(text, tmp_path)
        file = str(tmp_path / "heard.log")
        lines = run_here("diagnose", file).stdout.splitlines()
        assert [finding.sentence for finding in heard.findings] + heard.verdicts == lines


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("", [0, 1, 2, 3, 4]),
        ("unit=1", [0, 3, 4]),
        ("UNIT=2 done", [1]),
        ("function=6", [1]),
        ("function=write", [1]),
        ("function=1", []),  # 12.3 ms is no function
        ("errors", [2, 3, 4]),
        ("error unit=1 exception", [3]),
        ("nothing", []),
    ],
)
def test_a_filter_chooses_rows(text: str, numbers: list[int], tmp_path: Path) -> None:
    rows, chosen = heard_of(LINE, tmp_path).take(), Filter.parse(text)
    assert [number for number, row in enumerate(rows) if chosen.fits(row)] == numbers


def test_events_of_can_are_chosen_by_node_and_service(tmp_path: Path) -> None:
    rows = heard_of(BUS, tmp_path).take()
    assert len([row for row in rows if Filter.parse("node=5 function=sdo").fits(row)]) == 3
    assert [row.what for row in rows if Filter.parse("function=emcy").fits(row)] == ["EMCY"]
    with pytest.raises(EncodeError, match="node=x: expected a number, such as node=3"):
        Filter.parse("node=x")


def test_rates_are_those_of_the_last_ten_seconds() -> None:
    rates = Rates()
    for second in range(100):
        rates.count(second + 0.5, rows=4, busy=0.25)
    assert [rates.per_second(name, 99.9) for name in ("rows", "busy")] == [4, 0.25]
    assert rates.per_second("rows", 104.5) == 2
    assert rates.per_second("rows", 200) == 0


# The screen of sniff --live


def test_the_list_grows_follows_and_stays_where_the_user_looks() -> None:
    heard = HeardRows()
    app = screen_of(heard)

    async def act(pilot: Pilot[None]) -> None:
        await until_shown(pilot, "nothing was heard yet")
        for number in range(40):
            heard.put(row(number))
        app.look()
        await until_shown(pilot, "1 from 0027h", "40 exchanges")
        await pilot.press("up", "up")
        chosen = app.query_one(RowList).chosen
        assert chosen.at == 37
        await until_shown(pilot, "paused")
        heard.put(row(40))
        app.look()
        assert app.query_one(RowList).chosen is chosen
        await pilot.press("space")
        assert app.query_one(RowList).chosen.at == 40
        await pilot.press("up", "end")
        heard.put(row(41))
        app.look()
        assert app.query_one(RowList).chosen.at == 41
        await pilot.press("home")
        await pilot.pause()
        assert app.query_one(RowList).chosen.at == 0
        await until_shown(pilot, "1 from 0000h")

    on_screen(app, act)


def test_the_chosen_row_is_explained(tmp_path: Path) -> None:
    app = screen_of(heard_of(LINE, tmp_path))

    async def act(pilot: Pilot[None]) -> None:
        await until_shown(pilot, "CRC wrong, should be 0B F5")
        await pilot.press("home")
        await until_shown(pilot, "request  01 03 00 00 00 02 C4 0B")
        assert re.search("function code +3 +03 Read Holding Registers", shown(app))
        assert "CRC wrong" not in shown(app)
        await pilot.press("d")
        await until_shown(pilot, "no response to Read Holding Registers")

    on_screen(app, act, (120, 40))


def test_what_is_wrong_is_red(tmp_path: Path) -> None:
    app = screen_of(heard_of(LINE, tmp_path))

    async def act(pilot: Pilot[None]) -> None:
        rows = app.query_one(RowList)
        parts = [[part for part in rows.render_line(y) if part.text.strip()] for y in range(5)]
        colors = [{part.style.color.name for part in line if part.style and part.style.color} for line in parts]
        assert ["red" in names for names in colors] == [False, False, True, True, True]
        assert all(names == {"red"} for names in colors[2:])

    on_screen(app, act)


def test_a_narrow_screen_leaves_out_a_part_of_the_request_rather_than_the_answer() -> None:
    text = "Read Holding Registers, 2 from 0FA0h -> exception 02 (illegal data address)"
    assert shortened(text, 100) == text
    assert shortened(text, 46) == "Read Holding Registers…" + " -> exception 02 (illegal data address)"
    assert shortened("no arrow in a long text", 10) == "no arrow in a long text"


def test_a_filter_is_typed_and_removed(tmp_path: Path) -> None:
    app = screen_of(heard_of(LINE, tmp_path))

    def listed() -> int:
        return len(app.query_one(RowList).rows)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press(*"/unit=")
        assert listed() == 5  # not yet a filter
        await pilot.press(*"2", "enter")
        assert listed() == 1
        await until_shown(pilot, "1 shown")
        await pilot.press("escape")
        assert listed() == 5
        await pilot.press("e")
        assert listed() == 3
        await pilot.press("e")
        assert listed() == 5

    on_screen(app, act)


def test_memory_is_bounded_and_what_was_dropped_is_counted() -> None:
    heard = HeardRows(limit=50)
    app = screen_of(heard)

    async def act(pilot: Pilot[None]) -> None:
        for number in range(20):
            heard.put(row(number))
        app.look()
        await pilot.press("up")  # 18 is looked at
        for number in range(20, 60):
            heard.put(row(number))
        app.look()
        assert app.query_one(RowList).chosen.at == 18
        for number in range(60, 260):
            heard.put(row(number))
        app.look()
        assert len(app.query_one(RowList).rows) == len(app._rows) == 50
        assert app.dropped + heard.dropped == 210
        await until_shown(pilot, "210 dropped")
        assert app.query_one(RowList).chosen.at == 210
        assert len(heard.rates._seconds) <= 11

    on_screen(app, act)


def test_rows_that_are_shown_are_written_as_a_recording(tmp_path: Path) -> None:
    app = screen_of(heard_of(LINE, tmp_path))
    file = tmp_path / "shown.pcapng"

    async def act(pilot: Pilot[None]) -> None:
        app.filter_by("unit=2")
        await pilot.press("w")
        app.screen.query_one(Input).value = str(file)
        await pilot.press("enter")
        await pilot.pause()

    on_screen(app, act)
    (line,) = output_of("sniff", str(file)).splitlines()
    assert line.startswith("10.100000  unit 2  Write Single Register, 3 to 0001h -> done")
    with pytest.raises(EncodeError, match="the file is there already"):
        save_rows([], str(file), is_can=False)
    with pytest.raises(EncodeError, match="ends in"):
        save_rows([], "x.txt", is_can=False)


def test_frames_of_can_are_written_once(tmp_path: Path) -> None:
    rows, file = heard_of(BUS, tmp_path).take(), tmp_path / "again.log"
    save_rows(rows, str(file), is_can=True)
    assert file.read_text().count("\n") == BUS.count("\n")
    assert output_of("sniff", str(file)) == output_of("sniff", str(tmp_path / "heard.log"))


def test_an_error_of_the_line_is_shown_and_the_screen_stays() -> None:
    def read(heard: HeardRows) -> None:
        raise PortError("/dev/x: it is gone")

    heard = HeardRows()
    heard.run(read)
    app = screen_of(heard)

    async def act(pilot: Pilot[None]) -> None:
        await until_shown(pilot, "/dev/x: it is gone")
        await pilot.press("question_mark")
        await until_shown(pilot, "only what is wrong")
        await pilot.press("escape")
        assert isinstance(heard.error, PortError)

    on_screen(app, act)


@pytest.mark.parametrize("key", ["x", "escape"])
def test_keys_that_come_faster_than_a_box_closes_close_it_once(key: str) -> None:
    app = screen_of(HeardRows())

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("question_mark")
        box = app.screen
        assert isinstance(box, Ask)
        for _ in range(3):
            box.post_message(Key(key, None))
        await pilot.pause()
        await pilot.press("question_mark")
        assert isinstance(app.screen, Ask)

    on_screen(app, act)


def test_a_recording_without_times_has_no_column_for_them(tmp_path: Path) -> None:
    heard = heard_of("Tx: 01 03 00 00 00 02 C4 0B\nRx: 01 83 02 C0 F1\n", tmp_path)
    app = screen_of(heard)

    async def act(pilot: Pilot[None]) -> None:
        line = app.query_one(RowList).render_line(0).text
        assert line.startswith("unit 1 ")

    on_screen(app, act)


# The screen of panel --terminal


def panel_of(machine: Machine, *, writable: bool = True) -> tuple[MachineScreen, PanelLine, VirtualClock]:
    clock = VirtualClock()
    line = PanelLine(load("csd-mt"), "rtu:///dev/x", check=False, connect=machine, clock=clock)
    app = MachineScreen(line, writable=writable)
    app._group = app._names.index("Drive setting")
    return app, line, clock


def test_values_of_the_group_that_is_shown_are_polled_and_shown() -> None:
    machine = Machine()
    machine.values = {SETTING: 55, "Status Word": 0x0237}
    app, line, _ = panel_of(machine)

    async def act(pilot: Pilot[None]) -> None:
        line.turn()
        app.look()
        await pilot.pause()
        assert re.search(r"Current Ratio +55 % +0 … 120 % +rw", shown(app))
        await until_shown(pilot, "connected", "operation enabled")
        machine.asked.clear()
        await pilot.press("right")
        line.turn()
        names = {name for asked in machine.asked for name in asked}
        assert "Status Word" in names  # the state of the drive is always shown
        assert SETTING not in names
        assert "Motor Current Limit" in names
        await pilot.press("left", *"/step rev", "enter")
        assert [row["name"] for row in app.query_one("#values", RowList).rows] == ["Step Revolution"]

    on_screen(app, act)
    machine.asked.clear()
    line.turn()
    assert machine.asked == []


def test_chosen_values_are_drawn_over_time_with_a_gap_where_the_machine_is_silent() -> None:
    app, line, clock = panel_of(machine := Machine())
    app._group = app._names.index("Motion")

    async def polled(seconds: int, position: int) -> None:
        for _ in range(seconds):
            machine.values["Position Actual Value"] = position
            line.turn()
            clock.time += 1
            app.look()

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("down", "down", "p", "down", "p")
        await polled(20, 0)
        machine.is_silent = True
        await polled(20, 0)
        machine.is_silent = False
        await polled(20, 700)
        await pilot.pause()
        screen = shown(app)
        assert re.search("Position Actual Value  700 step +0 … 700", screen)
        (bars,) = (row for row in screen.splitlines() if "▁" in row and "█" in row)
        assert re.fullmatch("▁{23,29} {23,29}█{23,29}", bars.strip())
        assert "frames" not in screen
        await pilot.press("t")
        await until_shown(pilot, "-600 s")
        await pilot.press("s")
        await until_shown(pilot, "frames")
        await pilot.press("p", "up", "p")
        line.turn()
        app.look()
        await until_shown(pilot, "p: the chosen value, over time")

    on_screen(app, act)


def test_only_numbers_are_drawn_and_four_at_most() -> None:
    app, _, _ = panel_of(Machine())
    app._group = app._names.index("Motion")

    async def act(pilot: Pilot[None]) -> None:
        for _ in range(5):
            await pilot.press("p", "down")
        await until_shown(pilot, "4 values are drawn: p removes one of them")
        await pilot.press("r")
        await until_shown(pilot, "r reads a setting behind the numbers of a menu")
        assert len(app._scope.names) == 4

    on_screen(app, act)


def test_the_ramp_of_a_soft_starter_is_drawn_started_and_set() -> None:
    machine = simulator("adxl")
    with (
        ModbusServer("rtu://pty", MachineUnits(machine)) as server,
        running(PanelLine(load("adxl"), f"{server.url}?timeout=60", period=0.05)) as line,
    ):
        app = MachineScreen(line, writable=True)

        async def act(pilot: Pilot[None]) -> None:
            await until_shown(pilot, "(Starter ready)", "Max current  0 A", "Torque  0 %", "L3-L1 Voltage", "not read")
            await pilot.press("end", "r")
            await until_shown(pilot, "P01.04 acceleration time, read; the device has 10 s")
            await pilot.press("enter", *"120", "enter")
            await until_shown(pilot, "P01.04 acceleration time = 120 s, would be sent", "y: send")
            assert shown(app).count("Write Single Register") == 4  # three numbers, then the value
            await pilot.press("y")
            await until_shown(pilot, "P01.04 acceleration time = 120 s, written; the device has 120 s")
            await pilot.press("home", "down", "enter")
            await until_shown(pilot, "1 = execute")
            await pilot.press("enter", "y")
            await until_shown(pilot, "(Acceleration ramp)")

        on_screen(app, act, (130, 40))


def test_without_write_no_number_of_a_menu_is_written() -> None:
    line = PanelLine(load("adxl"), "rtu:///dev/x", check=False, connect=Machine(), clock=VirtualClock())
    app = MachineScreen(line, writable=False)

    async def act(pilot: Pilot[None]) -> None:
        await until_shown(pilot, "not asked yet")
        assert "no answer" not in shown(app)
        await pilot.press("end", "r")
        await until_shown(pilot, "start it with --write to write")
        await pilot.press("home", "p", "right")
        await until_shown(pilot, "write only")  # the group of commands
        await pilot.press("p")
        await until_shown(pilot, "is no number that is polled")

    on_screen(app, act, (160, 40))


def test_a_write_shows_its_frame_and_is_sent_after_yes() -> None:
    app, line, _ = panel_of(machine := Machine())

    def written() -> bool:
        line.turn()
        return machine.values == {SETTING: 55}

    async def act(pilot: Pilot[None]) -> None:
        line.turn()
        await pilot.press("enter")
        await wait_until(pilot, lambda: isinstance(app.screen, Ask))
        await pilot.press(*"500", "enter")
        await until_shown(pilot, "Current Ratio")
        assert isinstance(app.screen, Ask)
        await pilot.press(*"55", "enter")
        await until_shown(pilot, "01 06 04 38 00 37")
        await pilot.press("escape")
        await pilot.pause()
        line.turn()
        assert machine.values == {}
        await pilot.press("enter")
        await wait_until(pilot, lambda: isinstance(app.screen, Ask))
        await pilot.press(*"55", "enter")
        await until_shown(pilot, "01 06 04 38 00 37")
        await pilot.press("y")
        await wait_until(pilot, written)
        await until_shown(pilot, "Current Ratio = 55 %, written; the device has 55 %")

    on_screen(app, act, (160, 50))


def test_without_write_nothing_is_written() -> None:
    app, line, _ = panel_of(machine := Machine(), writable=False)

    async def act(pilot: Pilot[None]) -> None:
        line.turn()
        await pilot.press("enter")
        await until_shown(pilot, "start it with --write to write")
        await pilot.press("c")
        line.turn()
        assert not machine.values

    on_screen(app, act, (160, 50))


def test_commands_of_a_drive_are_those_of_its_state() -> None:
    machine = Machine()
    machine.values = {"Status Word": 0x0231}
    app, line, _ = panel_of(machine)

    def written() -> bool:
        line.turn()
        return machine.values.get("Control Word") == 7

    async def act(pilot: Pilot[None]) -> None:
        line.turn()
        app.look()
        await pilot.press("c")
        await until_shown(pilot, "1  switch on -> switched on, transition 3")
        await pilot.press("1")
        await until_shown(pilot, "Control Word = 7")
        await pilot.press("y")
        await wait_until(pilot, written)

    on_screen(app, act, (120, 40))


def test_a_silent_machine_is_shown_in_red_until_it_answers() -> None:
    app, line, clock = panel_of(machine := Machine())

    async def act(pilot: Pilot[None]) -> None:
        machine.is_silent = True
        line.turn()
        clock.time += 90
        app.look()
        await until_shown(pilot, "no answer for 90 s: unit 1: no answer within 1 s")
        machine.is_silent = False
        line.turn()
        app.look()
        await until_shown(pilot, "connected")

    on_screen(app, act, (120, 40))


def test_the_diagnosis_of_the_last_frames_is_shown() -> None:
    app, line, clock = panel_of(Machine())

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("d")
        await until_shown(pilot, "nothing wrong")
        line._watch("sent", rtu_frame(1, unhex("03 0000 0002")))
        line._watch("received", rtu_frame(1, unhex("83 02")))
        clock.time += 10
        line.turn()
        app.look()
        await until_shown(
            pilot, "diagnosis of the last 1 exchanges", "verdict: a device refused or reported something [refused]"
        )

    on_screen(app, act, (160, 50))


def test_frames_are_listed_and_the_chosen_one_is_explained() -> None:
    app, line, _ = panel_of(Machine())

    async def act(pilot: Pilot[None]) -> None:
        line._frames.watch("sent", rtu_frame(1, unhex("03 0000 0002")))
        line._frames.watch("received", rtu_frame(1, unhex("03 04 0017 0007")))
        app.look()
        await pilot.press("tab", "up")
        await until_shown(pilot, "function code")
        line._frames.watch("sent", rtu_frame(1, unhex("03 0000 0002")))
        app.look()
        assert app.query_one("#frames", RowList).chosen.direction == "sent"
        assert len(app.query_one("#frames", RowList).rows) == 2  # it is held while it is looked at
        await pilot.press("space")
        app.look()
        assert len(app.query_one("#frames", RowList).rows) == 3

    on_screen(app, act, (160, 50))


# The command


def test_a_screen_needs_a_terminal_and_textual(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = tmp_path / "bus.log"
    log.write_text(LINE)
    commands = (("sniff", str(log), "--live"), ("panel", "tcp://127.0.0.1:1", "adxl", "--terminal"))
    for command in commands:
        assert f"{command[-1]} needs a terminal, and standard " in error_of(*command, status=2)
    for name in [name for name in sys.modules if name.startswith("barewire_workbench.cli.terminal.")]:
        monkeypatch.delitem(sys.modules, name)
    for name in [name for name in sys.modules if name.partition(".")[0] == "textual"]:
        monkeypatch.setitem(sys.modules, name, None)
    for command in commands:
        needs = f"{command[-1]} needs the extra 'terminal': pip install 'barewire[terminal]'"
        assert error_of(*command) == f"barewire: {needs}\n"


class Terminal:
    """A command in a pseudo-terminal of 80 columns and 24 lines."""

    def __init__(self, *arguments: str, code: str = "", piped: bool = False) -> None:
        self.controller, self.screen = pty.openpty()
        fcntl.ioctl(self.screen, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self.before = termios.tcgetattr(self.screen)
        program = f"{code}\nfrom barewire_workbench.cli import main; main()"
        environment = ENVIRONMENT | {"TERM": "xterm-256color", "PYTHONPATH": os.pathsep.join(sys.path)}
        self.process = subprocess.Popen(
            [sys.executable, "-c", program, *arguments],
            stdin=subprocess.PIPE if piped else self.screen,
            stdout=self.screen,
            stderr=self.screen,
            env=environment,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(1, termios.TIOCSCTTY, 0),
        )
        self.output = ""

    def until(self, text: str) -> None:
        """Read the output until it has a text."""
        give_up = time.monotonic() + 60
        while text not in self.output:
            assert time.monotonic() < give_up, self.output[-2000:]
            self._read()

    def _read(self) -> None:
        if select.select([self.controller], [], [], 0.1)[0]:
            self.output += os.read(self.controller, 65536).decode(errors="replace")

    def press(self, keys: bytes) -> None:
        os.write(self.controller, keys)

    def end(self) -> int:
        """Wait for the end; the terminal must be as it was before. Return the exit status."""
        give_up = time.monotonic() + 60
        while self.process.poll() is None:
            assert time.monotonic() < give_up, self.output[-2000:]
            self._read()
        self._read()
        assert "\x1b[?1049h" in self.output  # it had the other screen
        assert "\x1b[?1049l" in self.output.rpartition("\x1b[?1049h")[2]
        assert "\x1b[?25h" in self.output.rpartition("\x1b[?25l")[2]  # the cursor is seen
        assert "\x1b[?1000l" in self.output.rpartition("\x1b[?1000h")[2]  # the mouse is the terminal's
        assert termios.tcgetattr(self.screen) == self.before
        for descriptor in (self.controller, self.screen):
            os.close(descriptor)
        if self.process.stdin is not None:
            self.process.stdin.close()
        return self.process.returncode


@pytest.mark.parametrize("way", some_of(["SIGTERM", "exception", "q", "ctrl-c", "SIGINT", "SIGHUP"], 2))
def test_the_terminal_is_as_before_however_the_screen_ends(way: str, tmp_path: Path) -> None:
    log = tmp_path / "bus.log"
    log.write_text(LINE)
    code = ""
    if way == "exception":
        code = "import barewire_workbench.cli.terminal.sniffing as s\ns.explained_lines = lambda row: 1 / 0"
    terminal = Terminal("sniff", str(log), "--live", code=code)
    if way == "exception":
        assert terminal.end() == 1
        assert "ZeroDivisionError" in terminal.output
        return
    terminal.until("no valid answe")
    if way.startswith("SIG"):
        terminal.process.send_signal(getattr(signal, way))
    else:
        terminal.press({"q": b"q", "ctrl-c": b"\x03"}[way])
    assert terminal.end() == 0


def test_keys_come_from_the_terminal_where_standard_input_is_a_log() -> None:
    terminal = Terminal("sniff", "-", "--live", piped=True)
    assert terminal.process.stdin is not None
    for line in LINE.splitlines(keepends=True):
        terminal.process.stdin.write(line.encode())
        terminal.process.stdin.flush()
    terminal.until("exception 02")
    terminal.press(b"e")
    terminal.until("shown")
    terminal.press(b"q")  # while the log is still open
    assert terminal.end() == 0


def test_a_recording_that_is_not_read_to_its_end_is_no_error_and_leaves_no_thread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, heard, before = tmp_path / "long.log", HeardRows(), threading.active_count()
    file.write_text("".join(f"{place}.0 01 83 02 C0 F1\n" for place in range(100_000)))
    pauses = threading.Event()

    def run_screen(app: SniffScreen) -> int:
        while not heard.total:
            pauses.wait(0.01)
        return 0

    monkeypatch.setattr(sniffing, "run_screen", run_screen)
    with click.Context(click.Command("sniff")):
        traffic = Source(str(file), None)
        read = partial(hear_modbus, traffic=traffic, seconds=None, window=1.0, names=None, file=None)
        assert sniffing.watch_traffic(heard, traffic, read) == 0
    assert 0 < heard.total < 100_000
    until(lambda: threading.active_count() == before)


def test_a_port_that_cannot_be_opened_is_an_error_before_there_is_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sniffing, "run_screen", lambda app: pytest.fail("a screen"))
    monkeypatch.setattr(sniffing, "_OPENED", 60)
    traffic = Source("tcp://127.0.0.1:1", None)
    read = partial(hear_modbus, traffic=traffic, seconds=None, window=1.0, names=None, file=None)
    with pytest.raises(EncodeError, match="listening in needs a line"):
        sniffing.watch_traffic(HeardRows(live=True), traffic, read)


def test_a_line_is_heard_until_it_is_told_to_stop() -> None:
    heard, terminal = HeardRows(live=True), PseudoTerminal()
    traffic = Source(f"rtu://{terminal.path}?parity=N&baudrate=9600", None)
    read = partial(hear_modbus, traffic=traffic, seconds=None, window=60.0, names=None, file=None)
    thread = threading.Thread(target=heard.run, args=(read,))
    thread.start()
    give_up = time.monotonic() + 60
    while all(row.wrong for row in heard.take()) and time.monotonic() < give_up:
        terminal.send(rtu_frame(1, unhex("03 0000 0002")))
        traffic.stop.wait(0.05)
        terminal.send(rtu_frame(1, unhex("03 04 0017 0007")))
        traffic.stop.wait(0.05)
    busy = heard.per_second("busy")
    traffic.stop.set()
    thread.join(60)
    terminal.close()
    assert heard.error is None
    assert time.monotonic() < give_up
    assert heard.has_load
    assert 0 < busy < 1
    assert heard.verdicts


def test_a_bus_is_heard_with_its_load_until_it_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = [CanFrame(0x701 + number, b"\x05") for number in range(3)]

    class Port:
        def receive_any(self, timeout: float) -> CanFrame | None:
            if not frames:
                raise PortError("the server hung up")
            return frames.pop()

        def close(self) -> None: ...

    monkeypatch.setattr("barewire.io.ports.can.interfaces.can_port", lambda endpoint, *, stamps: Port())
    heard, monitors, diagnosis = HeardRows(live=True), KeepingMonitors(), CanLogDiagnosis()
    traffic = Source("can://socketcand/127.0.0.1/can0?bitrate=1000", None)
    heard.run(partial(hear_can, traffic=traffic, monitors=monitors, diagnosis=diagnosis, is_shown=bool, file=None))
    assert str(heard.error) == "the server hung up"
    assert [row.station for row in heard.take()] == ["node 3", "node 2", "node 1"]
    assert sum(counter["busy"] for counter in heard.rates._seconds.values()) == pytest.approx(
        3 * longest_can_frame(1) / 1000
    )
