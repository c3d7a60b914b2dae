"""`barewire panel`: one poll for all browsers, writes that are not lost, a machine that goes and comes, who may write.

The line is run in virtual time where a test does not need the port of the page.
"""

from __future__ import annotations

import asyncio
import gc
import http.client
import json
import socket
import threading
import time
import tracemalloc
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import replace
from datetime import datetime
from random import Random
from typing import Any

import pytest

from barewire import ModbusServer, connect, load
from barewire.devices import Parameter
from barewire.devices.sim import MachineUnits, simulator
from barewire.errors import BarewireError, EncodeError, NoAnswer
from barewire.io.fault_injection.faults import Faults, ModbusWire
from barewire.rtu import encode
from barewire_workbench.cli.panels.description import description, planned_frames, range_text, value_to_write
from barewire_workbench.cli.panels.line import Busy, PanelLine, running
from barewire_workbench.cli.panels.server import PanelServer
from barewire_workbench.cli.panels.world import SimulatedWorld
from barewire_workbench.live.polling import Clock
from barewire_workbench.settings.rules import SettingRules
from tests.helpers import every_case, refused, until
from tests.workbench.cli.helpers import error_of

STATUS, CURRENT = "Status", "L1 current"
SETTING = "Current Ratio"


class VirtualClock(Clock):
    """A clock that tests advance."""

    def __init__(self) -> None:
        self.time = 0.0

    def now(self) -> float:
        return self.time

    def date(self) -> datetime:
        raise NotImplementedError


@contextmanager
def csd_mt(url: str = "rtu://pty") -> Iterator[str]:
    """Serve a simulated stepper drive; yield the URL for clients, with a time-out that a busy machine does not miss."""
    with ModbusServer(url, MachineUnits(simulator("csd-mt", time.monotonic()))) as server:
        yield f"{server.url}{'&' if '?' in server.url else '?'}timeout=20"


@asynccontextmanager
async def panel(
    endpoint: str, *, writable: bool = True, **options: Any
) -> AsyncIterator[tuple[PanelServer, PanelLine]]:
    with running(PanelLine(load("csd-mt"), endpoint, period=0.05)) as line:
        server = PanelServer(line, writable=writable, **options)
        await server.start()
        try:
            yield server, line
        finally:
            await server.close()


def port_of(server: PanelServer) -> int:
    return int(server.url.split("/")[2].rpartition(":")[2])


def request(
    server: PanelServer, method: str, path: str, body: Any = None, **headers: str
) -> tuple[int, dict[str, Any], http.client.HTTPMessage]:
    """Send a request as a browser does, in a thread; return status, answer and headers."""
    client = http.client.HTTPConnection("127.0.0.1", port_of(server), timeout=60)
    try:
        client.request(method, path, body if isinstance(body, bytes | None) else json.dumps(body), headers)
        response = client.getresponse()
        return response.status, json.loads(response.read()), response.headers
    finally:
        client.close()


async def written(server: PanelServer, text: str, path: str = "/write", **headers: str) -> tuple[int, dict[str, Any]]:
    sent = {"X-Token": server.token or "", **headers}
    answer = await asyncio.to_thread(request, server, "POST", path, {"name": SETTING, "text": text}, **sent)
    return answer[:2]


async def events(server: PanelServer, *names: str) -> AsyncIterator[dict[str, Any]]:
    """Yield the events of a browser that looks at these values."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port_of(server), limit=1 << 20)
    try:
        query = "&".join(f"name={name.replace(' ', '%20')}" for name in names)
        writer.write(f"GET /events?{query} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
        async for line in reader:
            if line.startswith(b"data: "):
                yield json.loads(line[6:])
    finally:
        writer.close()


# The line


class Machine:
    """A machine in place of a client: counts what is asked, and is silent while `is_silent`."""

    def __init__(self) -> None:
        self.device = load("csd-mt")
        self.values: dict[str, Any] = {}
        self.asked: list[tuple[str, ...]] = []
        self.is_silent = False

    def __call__(self, *_: Any, **options: Any) -> Machine:
        self.watch = options["watch"]
        return self

    def read_all(self, names: Any) -> Any:
        self.asked.append(tuple(names))
        if self.is_silent:
            raise NoAnswer("unit 1: no answer within 1 s")
        from barewire.devices import Reading

        return [Reading(self.device.find(name), self.values.get(name, 0)) for name in names]

    def read(self, name: str) -> Any:
        return self.read_all([name])[0]

    def write(self, name: str, value: Any) -> None:
        if self.is_silent:
            raise NoAnswer("unit 1: no answer within 1 s")
        self.values[name] = value

    def close(self) -> None:
        pass


def line_of(machine: Any, clock: Clock | None = None) -> PanelLine:
    return PanelLine(load("csd-mt"), "rtu:///dev/x", check=False, connect=machine, clock=clock or VirtualClock())


def test_only_what_somebody_looks_at_is_polled_and_once_for_all() -> None:
    line = line_of(machine := Machine())
    line.turn()
    assert machine.asked == []
    with line.look_at([SETTING, "Status Word"]), line.look_at(["Status Word"]), line.look_at([SETTING]):
        line.turn()
        machine.asked.clear()
        line.turn()
        assert [sorted(names) for names in machine.asked] == [sorted([SETTING, "Status Word"])]
    machine.asked.clear()
    line.turn()
    assert machine.asked == []


def test_what_a_reading_changes_is_not_polled_and_says_so() -> None:
    machine = Machine()
    machine.device = load("adxl")
    line = PanelLine(machine.device, "rtu:///dev/x", check=False, connect=machine, clock=VirtualClock())
    with line.look_at(names := ["Status", "Event description"]):
        line.turn()
    assert machine.asked == [("Status",), ("Status",)]
    values = line.changes_since(0, names)["values"]
    assert values["Event description"] == (None, "", "not polled: each reading moves the event index on")


def test_a_slow_line_is_used_at_most_half_of_the_time() -> None:
    clock = VirtualClock()

    class Slow(Machine):
        def read_all(self, names: Any) -> Any:
            clock.time += 3
            return super().read_all(names)

    line = line_of(Slow(), clock)
    with line.look_at([SETTING]):
        line.turn()
        assert line.turn() == 6


def test_a_silent_machine_is_asked_for_one_value_and_shown_as_dead_until_it_answers() -> None:
    clock = VirtualClock()
    line = line_of(machine := Machine(), clock)
    with line.look_at(names := [SETTING, "Status Word", "Homing Method"]):
        line.turn()
        machine.is_silent = True
        line.turn()
        machine.asked.clear()
        clock.time += 90
        line.turn()
        assert [len(asked) for asked in machine.asked] == [1]
        state = line.changes_since(0, names)
        assert (state["alive"], state["for"]) == (False, 90)
        assert "no answer" in state["problem"]
        machine.is_silent, machine.values = False, {SETTING: 55}
        line.turn()
        state = line.changes_since(0, names)
        assert state["alive"] is True
        assert state["values"][SETTING][:2] == (55, "55 %")


@every_case("number", [float("nan"), float("inf")])
def test_a_value_that_json_does_not_have_is_told_by_its_text_and_changes_once(number: float) -> None:
    line = line_of(machine := Machine())
    machine.values = {SETTING: number}
    with line.look_at([SETTING, "Status Word"]):
        line.turn()
        state = line.changes_since(0, [SETTING, "Status Word"])
        assert json.loads(json.dumps(state, allow_nan=False))["values"][SETTING] == [None, f"{number} %", ""]
        line.turn()
        assert line.changes_since(state["revision"], [SETTING])["values"] == {}


def test_on_a_line_that_loses_answers_every_value_is_read() -> None:
    class Lossy(Machine):
        def read_all(self, names: Any) -> Any:
            self.is_silent = len(self.asked) % 3 == 2
            return super().read_all(names)

    line = line_of(machine := Lossy())
    names = [row.name for row in machine.device.parameters if row.readable][:100]
    with line.look_at(names):
        for _ in range(20):
            line.turn()
    assert line.changes_since(0, names)["values"].keys() == set(names)


def test_a_write_to_a_silent_machine_fails_once_and_is_not_repeated() -> None:
    line = line_of(machine := Machine())
    machine.is_silent = True
    result = line.write(SETTING, 50)
    line.turn()
    assert isinstance(result.exception(0), NoAnswer)
    machine.is_silent = False
    line.turn()
    assert machine.values == {}


def test_more_writes_than_may_wait_are_refused_and_none_is_forgotten() -> None:
    line = line_of(Machine())
    results = [line.write(SETTING, number) for number in range(32)]
    with pytest.raises(Busy):
        line.write(SETTING, 99)
    line.turn()
    assert [result.result(0) for result in results] == [f"written; the device has {number} %" for number in range(32)]


def test_when_the_thread_ends_waiting_writes_fail() -> None:
    class Broken(Machine):
        def write(self, name: str, value: Any) -> None:
            raise ZeroDivisionError

    line = line_of(Broken())
    first, second = line.write(SETTING, 1), line.write(SETTING, 2)
    with pytest.raises(ZeroDivisionError):
        line.run()
    assert isinstance(first.exception(0), ZeroDivisionError)
    assert isinstance(second.exception(0), BarewireError)
    with pytest.raises(Busy):
        line.write(SETTING, 3)


def test_the_line_is_diagnosed_over_its_last_frames_and_a_fault_that_is_over_leaves_with_them() -> None:
    clock = VirtualClock()

    class Lossy(Machine):
        def read_all(self, names: Any) -> Any:
            unit, self.frames = 1, getattr(self, "frames", 0) + 1
            self.watch("sent", encode(unit, bytes.fromhex("03 0000 0001")))
            clock.time += 0.02
            if self.is_silent and self.frames % 2:
                clock.time += 1
                raise NoAnswer("unit 1: no answer within 1 s")
            self.watch("received", encode(unit, bytes.fromhex("03 02 0017")))
            return super().read_all(names) if not self.is_silent else []

    line = line_of(machine := Lossy(), clock)

    def turns(number: int) -> dict[str, Any]:
        for _ in range(number):
            clock.time += line.turn()
        diagnosis: dict[str, Any] = line.changes_since(0, [])["diagnosis"]
        return diagnosis

    with line.look_at([SETTING]):
        assert turns(20) == {"exchanges": 21, "verdicts": [], "findings": []}
        machine.is_silent = True
        diagnosis = turns(20)
        assert diagnosis["verdicts"][0][0] == "responses are missing now and then [lost-answers]"
        assert len(diagnosis["findings"]) == 5
        assert "no response to Read Holding Registers, 1 from 0000h [no-answer]" in diagnosis["findings"][-1][1]
        machine.is_silent = False
        assert turns(160) == {"exchanges": 150, "verdicts": [], "findings": []}


def test_a_device_that_refuses_to_say_what_it_is_has_no_fault_of_its_line() -> None:
    with csd_mt() as url, running(PanelLine(load("csd-mt"), url, period=0.05)) as line, line.look_at([SETTING]):
        until(lambda: line.polls > 3)
        state = line.changes_since(0, [])
        assert any("exception 01" in verdict for _, _, _, verdict, _ in state["frames"])
        assert not state["diagnosis"] or state["diagnosis"]["verdicts"] == []


@pytest.mark.proof
def test_an_hour_with_twenty_viewers_takes_no_more_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """7,200 polls of half a second in compressed time; the first half fills what is kept and all caches. The line is
    diagnosed once a minute."""
    monkeypatch.setattr("barewire_workbench.cli.panels.line._DIAGNOSED", 60.0)
    clock = VirtualClock()
    machine = simulator("csd-mt")
    with ModbusServer("tcp://127.0.0.1:0", MachineUnits(machine)) as server:
        line = PanelLine(load("csd-mt"), f"{server.url}?timeout=20", connect=connect, clock=clock)
        names = [SETTING, "Status Word"]
        tracemalloc.start()
        try:
            with line.look_at(names):
                revisions = [0] * 20
                sizes = []
                for number in range(7200):
                    clock.time += line.turn()
                    for viewer in range(20):
                        revisions[viewer] = line.changes_since(revisions[viewer], names)["revision"]
                    if number % 720 == 719:
                        gc.collect()  # a diagnosis refers to itself
                        sizes.append(tracemalloc.get_traced_memory()[0])
        finally:
            tracemalloc.stop()
            line._close()
    assert line.polls == 7200
    assert clock.time >= 3600
    assert max(sizes[5:]) < sizes[4] * 1.02  # 56 bytes kept from each poll would be 20 percent


# The page


def test_twenty_browsers_cost_one_poll_and_no_write_is_lost() -> None:
    async def main() -> None:
        with csd_mt() as endpoint:
            async with panel(endpoint) as (server, line):
                newest: list[dict[str, Any]] = [{} for _ in range(20)]

                async def look(viewer: int) -> None:
                    async for event in events(server, SETTING, "Status Word"):
                        newest[viewer] |= event["values"]

                async with asyncio.TaskGroup() as group:
                    viewers = [group.create_task(look(viewer)) for viewer in range(20)]
                    while server.viewers < 20:
                        await asyncio.sleep(0.01)
                    polls, before = line.polls, line.revision
                    answers = await asyncio.gather(*(written(server, str(50 + number)) for number in range(20)))
                    assert {status for status, _ in answers} == {200}
                    assert len({answer["result"] for _, answer in answers}) == 20
                    for number, (_, answer) in enumerate(answers):
                        assert answer["result"].endswith(f"the device has {50 + number} %")
                    while line.polls < polls + 5:
                        await asyncio.sleep(0.01)
                    while len({json.dumps(values) for values in newest}) > 1 or not newest[0]:
                        await asyncio.sleep(0.01)
                    requests = Counter(
                        frame.digits for frame in line.frames if frame.direction == "sent" and frame.number > before
                    )
                    reads = [count for digits, count in requests.items() if digits.startswith("01 03")]
                    # Each poll takes two requests; each write is read back.
                    assert sum(reads) <= 2 * (line.polls - polls + 2) + 20
                    for viewer in viewers:
                        viewer.cancel()
                while server.viewers:
                    await asyncio.sleep(0.01)

    asyncio.run(main())


def test_a_page_that_stays_open_sees_the_machine_go_and_come_again() -> None:
    async def main() -> None:
        with csd_mt("tcp://127.0.0.1:0") as endpoint:
            port = endpoint.partition("?")[0].rpartition(":")[2]
            opened = panel(endpoint)
            server, _ = await opened.__aenter__()
            stream = events(server, SETTING)
            async for event in stream:
                if event["alive"]:
                    break
        async for event in stream:
            if not event["alive"]:
                break
        with csd_mt(f"tcp://127.0.0.1:{port}"):
            async for event in stream:
                if event["alive"]:
                    break
            await stream.aclose()  # type: ignore[attr-defined]
            await opened.__aexit__(None, None, None)

    asyncio.run(main())


def test_a_browser_that_does_not_read_is_cut_off() -> None:
    async def main() -> None:
        with csd_mt() as endpoint:
            async with panel(endpoint, stalled=0.2) as (server, line):
                for explained in range(400):  # frames, so that an event is larger than what a socket takes
                    line._frames.watch("sent", bytes(250) + explained.to_bytes(2))
                browser = socket.socket()
                browser.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                browser.connect(("127.0.0.1", port_of(server)))
                browser.sendall(b"GET /events?name=Status%20Word HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
                while not server.viewers:
                    await asyncio.sleep(0.01)
                number = 0
                while server.viewers:
                    number += 1
                    line._frames.watch("sent", bytes(250) + number.to_bytes(2))
                    line.on_change()
                    await asyncio.sleep(0.001)
                browser.close()

    asyncio.run(main())


@pytest.mark.parametrize(
    ("path", "headers", "reason"),
    [
        ("/", {"Host": "evil.example"}, "another name"),
        ("/events", {"Host": "evil.example:80"}, "another name"),
        ("/device.json", {"Origin": "http://evil.example"}, "another site"),
        ("/write", {"X-Token": "wrong"}, "token"),
        ("/write", {"Origin": "http://evil.example"}, "another site"),
        ("/plan", {}, "token"),
    ],
)
def test_other_sites_and_requests_without_the_token_are_refused(
    path: str, headers: dict[str, str], reason: str
) -> None:
    async def main() -> None:
        async with panel("rtu:///dev/none") as (server, line):
            method = "POST" if path in ("/write", "/plan") else "GET"
            body = {"name": SETTING, "text": "50"} if method == "POST" else None
            status, answer, _ = await asyncio.to_thread(request, server, method, path, body, **headers)
            assert status == 403
            assert reason in answer["problem"]
            assert line._machine is None

    asyncio.run(main())


def test_without_write_nothing_can_be_written() -> None:
    async def main() -> None:
        async with panel("rtu:///dev/none", writable=False) as (server, _):
            assert "#" not in server.url
            status, answer = await written(server, "50")
            assert (status, answer["problem"]) == (403, "this panel only shows: start it with --write to write")

    asyncio.run(main())


def test_a_plan_shows_the_frames_and_sends_nothing() -> None:
    async def main() -> None:
        async with panel("rtu:///dev/none") as (server, line):
            status, plan = await written(server, "55", "/plan")
            assert status == 200
            assert (plan["raw"], plan["value"]) == ("0037", "55 %")
            ((digits, verdict),) = plan["frames"]
            assert digits.startswith("01 06") or digits.startswith("01 10")
            assert verdict.startswith("valid: a request to unit 1, Write")
            for text in ("1000", "many", ""):
                status, answer = await written(server, text, "/plan")
                assert status == 400
                assert SETTING in answer["problem"]
            sent = {"X-Token": server.token or ""}
            for depth in (1, 5_000):  # of lists in lists
                nested = f"{'[' * depth}{']' * depth}".encode()
                status, answer, _ = await asyncio.to_thread(request, server, "POST", "/plan", nested, **sent)
                assert (status, "expected {" in answer["problem"]) == (400, True)
            assert line._machine is None

    asyncio.run(main())


def test_a_setting_of_a_menu_has_its_range() -> None:
    device, name = load("adxl"), "P01.04 acceleration time"
    menu = {"name": name, "at": [1, 0, 4], "unit": "s", "min": 1, "max": 100}
    settings = {**device.extra["settings"], "menus": [menu]}
    menus = SettingRules.of(replace(device, extra={**device.extra, "settings": settings})).behind_menus(is_can=False)
    assert value_to_write(device, name, "100", menus)[1] == 100
    with refused(EncodeError, f"{name} = 101: expected 1..100 s"):
        value_to_write(device, name, "101", menus)


def test_what_is_no_menu_is_not_read_on_demand() -> None:
    async def main() -> None:
        async with panel("rtu:///dev/none") as (server, line):
            status, answer = await written(server, "", "/read")
            assert (status, answer["problem"]) == (400, f"{SETTING}: expected a menu, and there is none")
            assert line._machine is None

    asyncio.run(main())


def test_the_frames_of_a_plan_are_those_that_a_write_sends() -> None:
    device, sent = load("csd-mt"), []
    with (
        csd_mt("tcp://127.0.0.1:0") as endpoint,
        connect(device, endpoint, watch=lambda *row: sent.append(row)) as drive,
    ):
        drive.write(SETTING, 55)
    planned = planned_frames(endpoint, device, {SETTING: 55})
    assert [digits[6:] for digits, _ in planned] == [data.hex(" ").upper()[6:] for way, data in sent if way == "sent"]


def test_bytes_that_are_no_http_close_the_connection() -> None:
    async def main() -> None:
        async with panel("rtu:///dev/none") as (server, _):
            for data in (b"\r\n\r\n", b"\xff" * 3000 + b"\r\n\r\n", b"GET\r\n\r\n", b"POST /write HTTP/1.1\r\n\r\n{"):
                reader, writer = await asyncio.open_connection("127.0.0.1", port_of(server))
                writer.write(data)
                writer.write_eof()
                await reader.read()
                writer.close()
            answer = await asyncio.to_thread(request, server, "GET", "/device.json")
            assert answer[0] == 200
            assert "default-src 'none'" in answer[2]["Content-Security-Policy"]

    asyncio.run(main())


def test_a_wrong_device_and_a_busy_port_are_one_line() -> None:
    assert "no-such" in error_of("panel", "tcp://127.0.0.1:1", "no-such", status=2)


def test_no_thread_is_left() -> None:
    before = threading.active_count()

    async def main() -> None:
        async with panel("rtu:///dev/none") as (server, _):
            await asyncio.to_thread(request, server, "GET", "/device.json")

    asyncio.run(main())
    assert threading.active_count() == before


@pytest.mark.parametrize(
    ("name", "endpoint", "has_drive"),
    [
        ("az3", "rtu:///dev/x", True),
        ("az3", "can://socketcan/can0?node=5", True),
        ("csd-mt", "rtu:///dev/x", True),
        ("adxl", "rtu:///dev/x", False),
    ],
)
def test_a_drive_shows_its_states_and_its_words_can_be_read_and_written_there(
    name: str, endpoint: str, has_drive: bool
) -> None:
    shown = description(load(name), endpoint)
    assert (shown["drive"] is not None) == has_drive
    if has_drive:
        access = {row["name"]: row["access"] for group in shown["groups"].values() for row in group}
        assert access[shown["drive"]["status"]] == "ro"
        assert access[shown["drive"]["control"]] != "ro"
        device = load(name)
        for *_, control in shown["drive"]["transitions"]:
            assert planned_frames(endpoint, device, {shown["drive"]["control"]: control})


@pytest.mark.parametrize(
    ("name", "endpoint", "first"),
    [
        ("csd-mt", "tcp://127.0.0.1", "Motion"),  # and not the log with 20 alarms
        ("adxl", "rtu:///dev/x", "Measures"),
        ("az3", "rtu:///dev/x", "Measured values"),
        ("az3", "can://socketcan/can0", "Measured values"),
    ],
)
def test_the_group_that_opens_tells_how_the_machine_moves(name: str, endpoint: str, first: str) -> None:
    assert description(load(name), endpoint)["first"] == first


def test_without_a_role_the_group_that_opens_has_most_that_is_measured() -> None:
    device = load("csd-mt")
    device = replace(device, drive=None, parameters=tuple(row for row in device.parameters if row.group != "Motion"))
    assert description(device, "tcp://127.0.0.1")["first"] == "Motor, as set by Motor Code"
    assert description(replace(device, parameters=()), "tcp://127.0.0.1")["first"] == ""


def test_the_world_of_a_simulated_machine_is_set_and_a_wrong_property_is_an_error() -> None:
    async def main() -> None:
        machine, faults = simulator("adxl"), Faults(ModbusWire("rtu"), "drop@20,late:0.5", Random(1))
        async with panel("rtu:///dev/none", world=SimulatedWorld(machine, faults)) as (server, _):

            async def post(path: str, name: str, text: str, **headers: str) -> tuple[int, str]:
                body = {"name": name, "text": text}
                status, answer, _ = await asyncio.to_thread(request, server, "POST", path, body, **headers)
                return status, answer.get("result") or answer["problem"]

            token = {"X-Token": server.token or ""}
            assert (await post("/world", "line", "off"))[0] == 403
            assert machine.has_line
            assert await post("/world", "line", "off", **token) == (200, "line: off")
            assert not machine.has_line
            status, problem = await post("/world", "wind", "3", **token)
            assert (status, "expected NAME=VALUE with a name of line, alarm" in problem) == (400, True)
            assert await post("/fault", "late", "", **token) == (200, "late: off")
            assert await post("/fault", "exception", "exception=0B:1", **token) == (200, "exception: exception=0B:1")
            status, problem = await post("/fault", "late", "late:7", **token)
            assert (status, "expected a probability" in problem) == (400, True)
            status, problem = await post("/fault", "wrong-transaction", "wrong-transaction", **token)
            assert (status, "is not possible on this wire" in problem) == (400, True)
            assert [(fault.kind, fault.value) for fault in faults.present] == [("drop", None), ("exception", 11)]
            stream = events(server, "Status")
            world = (await anext(stream))["world"]
            assert world["environment"][0]["text"] == "off"
            assert {row["name"]: (row["share"], row["value"]) for row in world["faults"] if row["share"]} == {
                "exception": (100, "0B"),
                "drop": (100, ""),
            }
            await stream.aclose()

    asyncio.run(main())


def test_a_wrong_table_ramp_is_an_error_that_says_what_is_expected() -> None:
    device = load("adxl")
    for table, text in (
        ({"status": "Status"}, "expected the names status, start and stop, and the lists traces and settings"),
        (5, "expected the names status"),
        (dict(device.extra["ramp"]) | {"traces": ["Max curent"]}, "did you mean 'Max current'"),
    ):
        with pytest.raises(BarewireError, match=text):
            description(replace(device, extra={**device.extra, "ramp": table}), "rtu:///dev/x")


def test_a_page_needs_a_described_machine() -> None:
    assert "--panel" in error_of("simulate", "table", "tcp://127.0.0.1:0", "--panel", status=2)


def test_a_range_is_shown_with_all_its_digits() -> None:
    assert range_text(Parameter("Limit", "i32", minimum=-1.5, maximum=123456.78)) == "-1.5 … 123456.78"
    assert range_text(Parameter("Limit", "u32", maximum=4294967295)) == "… 4294967295"
