"""The publisher: schedule, buffer and messages alone; and a whole one between a machine and Mosquitto."""

from __future__ import annotations

import asyncio
import itertools
import json
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import aiomqtt
import pytest

from barewire import ModbusServer
from barewire.devices.device import Device
from barewire.devices.parameter import Parameter, Reading
from barewire.errors import EncodeError, PortError
from barewire.gateway.config import ConfigError, GatewayConfig, read_config
from barewire.gateway.gateway import Gateway
from barewire.gateway.publish.buffer import Buffer
from barewire.gateway.publish.messages import Topics, discovery, reading_payload
from barewire.gateway.publish.publisher import PolledMachine, Publisher, broker_options, topics_that_collide
from barewire.gateway.publish.schedule import PollGroup, PollSchedule, ValueFilter
from barewire.modbus import ModbusException, Table
from tests.helpers import free_port

WAIT = 30.0

METER = """
name = "meter"
title = "Energy meter"
[modbus]
unit = 7
first_register = 1
"""
VALUES = """
[[parameter]]
name = "Count"
type = "u16"
input = 1
access = "ro"
[[parameter]]
name = "Ratio"
type = "u16"
holding = 1
access = "rw"
min = 1
max = 5000
unit = "A"
"""


# Schedule, filter, buffer, messages


def test_groups_of_a_line_are_staggered_and_each_has_its_own_period() -> None:
    schedule = PollSchedule([PollGroup(name, (), every) for name, every in (("a", 1.0), ("b", 1.0), ("c", 4.0))], 0.0)
    now, log = 0.0, []
    while now < 8.0:
        group = schedule.next()
        now = max(now, group.due_at)
        log.append((group.machine, now))
        schedule.done(group, now + 0.01, has_failed=False)
    assert [name for name, _ in log].count("a") in (8, 9)
    assert [name for name, _ in log].count("c") == 2
    assert len({at for _, at in log}) > len(log) - 3


def test_a_line_that_is_too_slow_reads_every_group_in_turn() -> None:
    schedule = PollSchedule([PollGroup(name, (), 1.0) for name in "abc"], 0.0)
    now, log = 0.0, []
    for _ in range(30):
        group = schedule.next()
        now = max(now, group.due_at) + 1.0  # each read takes a second
        log.append(group.machine)
        schedule.done(group, now, has_failed=False)
    assert all(log.count(name) == 10 for name in "abc")
    assert all(group.missed > 5 for group in schedule.groups)


def test_a_machine_that_does_not_respond_is_asked_less_often_and_then_as_before() -> None:
    schedule = PollSchedule([PollGroup("a", (), 1.0)], 0.0)
    times = []
    for _ in range(12):
        group = schedule.next()
        times.append(group.due_at)
        schedule.done(group, group.due_at, has_failed=True)
    pauses = [later - earlier for earlier, later in pairwise(times)]
    assert pauses[:4] == [2.0, 4.0, 8.0, 16.0]
    assert max(pauses) == 60.0
    group = schedule.next()
    schedule.done(group, group.due_at, has_failed=False)
    assert schedule.next().due_at - group.due_at == 0.0
    assert group.failures == 0


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1, 1, 2, 2], [True, False, True, False]),
        ([1.0, 1.4, 1.6, 0.9], [True, False, True, True]),
        ([True, True, False], [True, False, True]),
        (["a", "a", "b"], [True, False, True]),
        ([float("nan"), float("nan"), 1.0], [True, False, True]),
    ],
)
def test_what_changed_by_more_than_the_dead_band_is_published(values: list[Any], expected: list[bool]) -> None:
    dead_band = 0.5 if isinstance(values[0], float) and values[0] == values[0] else 0.0
    changes = ValueFilter(dead_band=dead_band)
    assert [changes.passes("x", value, float(at)) for at, value in enumerate(values)] == expected


def test_without_on_change_every_value_is_published() -> None:
    every = ValueFilter(on_change=False)
    assert [every.passes("x", 1, float(at)) for at in range(3)] == [True] * 3


def test_the_buffer_keeps_order_and_bound_and_knows_what_was_sent(tmp_path: Path) -> None:
    file = str(tmp_path / "buffer.sqlite")
    buffer = Buffer(file, limit=5)
    buffer.append([("t", str(number)) for number in range(3)])
    buffer.append([("t", str(number)) for number in range(3, 8)])
    assert (len(buffer), buffer.dropped) == (5, 3)
    assert [(row.payload, row.was_sent) for row in buffer.batch(2)] == [("3", False), ("4", False)]
    buffer.acknowledged(buffer.batch(1)[0].sequence)
    buffer.close()
    again = Buffer(file, limit=5)
    assert [(row.payload, row.was_sent) for row in again.batch(9)] == [
        ("4", True), ("5", False), ("6", False), ("7", False),
    ]  # fmt: skip
    again.append([("t", "8")])
    assert [row.sequence for row in again.batch(9)] == [5, 6, 7, 8, 9]
    again.close()


def test_rows_wait_in_memory_while_the_file_is_locked(tmp_path: Path) -> None:
    file = str(tmp_path / "buffer.sqlite")
    buffer = Buffer(file, limit=4)
    buffer.append([("t", "1")])
    (first,) = buffer.batch(9)
    other = sqlite3.connect(file, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    for number in range(2, 8):
        with pytest.raises(PortError, match="locked"):
            buffer.append([("t", str(number))])
    assert (len(buffer), buffer.dropped) == (5, 2)  # the one in the file, and four in memory
    with pytest.raises(PortError):
        buffer.batch(9)
    with pytest.raises(PortError):
        buffer.acknowledged(first.sequence)
    other.execute("ROLLBACK")
    buffer.append([("t", "8")])
    assert [(row.payload, row.was_sent) for row in buffer.batch(9)] == [(text, False) for text in "5678"]
    assert (len(buffer), buffer.dropped) == (4, 4)
    other.close()
    buffer.close()


def test_what_the_broker_has_is_not_sent_again_though_it_could_not_be_deleted(tmp_path: Path) -> None:
    file = str(tmp_path / "buffer.sqlite")
    buffer = Buffer(file, limit=4)
    buffer.append([("t", "1"), ("t", "2")])
    (first,) = buffer.batch(1)
    other = sqlite3.connect(file, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(PortError, match="locked"):
        buffer.acknowledged(first.sequence)
    other.execute("ROLLBACK")
    other.close()
    (second,) = buffer.batch(9)
    assert (second.payload, second.was_sent) == ("2", False)
    buffer.acknowledged(second.sequence)
    assert len(buffer) == 0
    buffer.close()


def test_payloads_have_value_unit_word_and_time() -> None:
    mode = Parameter("Mode", "u16", values={2: "automatic"})
    assert json.loads(reading_payload(Reading(mode, 2), 1.5)) == {"value": 2, "text": "automatic", "at": 1.5}
    volts = Parameter("Voltage", "f32", unit="V")
    assert json.loads(reading_payload(Reading(volts, float("inf")), 1.5)) == {"value": None, "unit": "V", "at": 1.5}
    assert json.loads(reading_payload(Reading(volts, 0.20000000298023224), 1.5))["value"] == 0.2  # of 32 bits


@pytest.mark.parametrize(
    ("parameter", "is_command", "kind", "more"),
    [
        (Parameter("Speed", "f32", unit="1/min"), False, "sensor", {"unit_of_measurement": "1/min"}),
        (Parameter("Speed", "u16", minimum=0, maximum=9), True, "number", {"min": 0, "max": 9, "step": 1.0}),
        (
            Parameter("Place", "i16", scale=Fraction(1, 10)),
            True,
            "number",
            {"min": -3276.8, "max": 3276.7, "step": 0.1},
        ),
        (Parameter("Total", "u64"), True, "number", {"min": 0, "max": 2**53, "step": 1.0}),
        (Parameter("Kp", "f32"), True, "number", {"step": 0.001}),
        (Parameter("Kp", "u16", scale=Fraction(1, 10000)), True, "number", {"step": 0.001}),
        (Parameter("Ratio", "f64", maximum=1), True, "number", {"min": -(2**53), "max": 1}),
        (Parameter("Label", "text"), True, "text", {"command_template": "{{ value | tojson }}"}),
        (Parameter("Fault", "bool"), False, "binary_sensor", {"payload_on": "true", "payload_off": "false"}),
        (Parameter("Start", "bool"), True, "switch", {"state_on": "true", "payload_on": "true"}),
    ],
)
def test_discovery_of_home_assistant(parameter: Parameter, is_command: bool, kind: str, more: dict[str, Any]) -> None:
    topic, payload = discovery("ha", Topics("Hall 1"), "Press", "X", parameter, is_command=is_command)
    config = json.loads(payload)
    name = parameter.name.lower()
    assert topic == f"ha/{kind}/barewire-hall_1-press-{name}/config"
    assert config.items() >= more.items()
    assert config["state_topic"] == f"barewire/hall_1/press/{name}"
    assert ("command_topic" in config) is is_command
    assert {row["topic"] for row in config["availability"]} == {
        "barewire/hall_1/status",
        "barewire/hall_1/press/status",
    }


def test_a_command_with_one_value_is_a_button() -> None:
    reset = Parameter("Reset", "u16", minimum=1, maximum=1)
    topic, payload = discovery("ha", Topics("Hall 1"), "Press", "X", reset, is_command=True)
    assert topic == "ha/button/barewire-hall_1-press-reset/config"
    config = json.loads(payload)
    assert config["payload_press"] == "1"
    assert config["command_topic"] == "barewire/hall_1/press/reset/set"
    assert "state_topic" not in config


def test_no_topic_is_that_of_another_value() -> None:
    topics = Topics("Hall")
    assert topics.parameter("Press", "Status") == "barewire/hall/press/status_value"
    assert topics.parameter("Press", "Description") == "barewire/hall/press/description_value"
    machines = [
        PolledMachine(name, "tcp://127.0.0.1", Device("x", "X", ()), 1.0, parameters)
        for name, parameters in (("Press 1", ("Speed", "speed!")), ("press-1", ("Speed", "Other")))
    ]
    assert topics_that_collide("Hall", machines) == [
        "barewire/hall/press_1",
        *["barewire/hall/press_1/speed"] * 2,
    ]


def test_no_id_of_home_assistant_is_that_of_another_value() -> None:
    names = ("1", "1 x", "x", "x 1", "Status", "status value", "-", "x - 1")
    values = list(itertools.product(names, repeat=3))

    def ids(site: str, machine: str, name: str) -> tuple[str, str]:
        topic, payload = discovery("ha", Topics(site), machine, "X", Parameter(name, "u16"), is_command=False)
        config = json.loads(payload)
        assert topic == f"ha/sensor/{config['unique_id']}/config"
        return config["unique_id"], config["device"]["identifiers"][0]

    topics = {Topics(site).parameter(machine, name) for site, machine, name in values}
    assert len({ids(*value)[0] for value in values}) == len(topics)
    assert len({ids(*value)[1] for value in values}) == len({topic.rpartition("/")[0] for topic in topics})


@pytest.mark.parametrize(
    "url",
    ["http://x", "mqtt://", "mqtt://x:99999", "mqtt://x?y=1", "mqtt://x/y", "mqtt://x?y", "mqtt://x#y", "mqtt://[::1"],
)
def test_a_wrong_broker_is_an_error(url: str) -> None:
    with pytest.raises(EncodeError):
        broker_options(url)


def test_the_file_of_a_broker_that_is_missing_is_named(site: Site) -> None:
    config = site.config().replace(f"mqtt://127.0.0.1:{site.port}", "mqtts://127.0.0.1?ca=/missing")
    with pytest.raises(ConfigError, match="broker: ca=/missing: no such file or directory"):
        read_config(config)


@pytest.mark.parametrize(
    "broker",
    [
        '"mqtt://me:s3cret@host:99999"',
        '"mqtt://me:s3cret"',
        '"mqtt://me:1#s3cret@host"',
        '"mqtt://me:1/s3cret@host"',
        '"mqtt://me:1?s3cret@host"',
        '"mqtt://:s3cret@host"',
        '"mqtt://s3cret#1@host"',
        '"mqtt://me:s3cret@[::1"',
        '"mqtt://me:s3cret@\u2100"',
        '"mqtts://me:s3cret@host?cafile=x"',
        '["mqtt://me:s3cret@host"]',
    ],
)
def test_the_password_of_a_broker_is_in_no_error(site: Site, broker: str) -> None:
    text = site.config().replace(f'"mqtt://127.0.0.1:{site.port}"', broker)
    with pytest.raises(ConfigError, match="broker") as wrong:
        read_config(text)
    assert "s3cret" not in str(wrong.value)
    with pytest.raises(EncodeError) as wrong_url:
        broker_options(broker[1:-1])
    assert "s3cret" not in str(wrong_url.value)


def test_the_password_of_a_broker_is_not_shown(site: Site) -> None:
    config = read_config(site.config().replace("mqtt://", "mqtt://me:s3cret@"))
    assert config.publish is not None
    assert broker_options(config.publish.broker)["password"] == "s3cret"
    assert "s3cret" not in repr(config)


# With a broker


@contextmanager
def mosquitto(port: int, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A broker on loopback, which ends with the block."""
    file = folder / "mosquitto.conf"
    file.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
    # Debian installs it where the PATH of a usual user does not lead.
    broker = subprocess.Popen(["/usr/sbin/mosquitto", "-c", str(file)], stderr=subprocess.DEVNULL)
    try:
        yield broker
    finally:
        broker.kill()
        broker.wait(WAIT)


class Site:
    """A meter, a broker, and the text of a configuration that publishes one to the other."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        (folder / "meter").mkdir()
        (folder / "meter" / "device.toml").write_text(METER)
        (folder / "meter" / "values.toml").write_text(VALUES)
        self.folder = folder
        self.port = free_port()
        self.table = Table(10)
        self.reads = 0

        def count(name: str, address: int, quantity: int) -> None:
            if name == "input_registers":
                self.reads += 1
                self.table.input_registers[0] = self.reads & 0xFFFF

        self.table.on_read = count
        self.server = stack.enter_context(ModbusServer("tcp://127.0.0.1:0", {7: self.table}))
        self.stack = stack
        self.broker: subprocess.Popen[bytes] | None = None

    def start_broker(self) -> None:
        self.broker = self.stack.enter_context(mosquitto(self.port, self.folder))

    def config(self, *, every: float = 0.05, port: int | None = None, more: str = "") -> str:
        return f"""
[publish]
broker = "mqtt://127.0.0.1:{port or self.port}"
site = "Hall 1"
buffer = "{self.folder}/buffer.sqlite"
home_assistant = "homeassistant"
{more}
[[publish.machine]]
name = "Meter"
url = "{self.server.url}"
device = "{self.folder}/meter"
every = {every}
parameters = ["Count", "Ratio"]
commands = ["Ratio"]
at_least = 1000
"""


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with ExitStack() as stack:
        yield Site(tmp_path, stack)


async def connected(port: int) -> aiomqtt.Client:
    """A client of the broker, which may still be starting."""
    until = time.monotonic() + WAIT
    while True:
        client = aiomqtt.Client("127.0.0.1", port)
        try:
            return await client.__aenter__()
        except aiomqtt.MqttError:
            assert time.monotonic() < until
            await asyncio.sleep(0.02)


class Listener:
    """Everything that a client of the broker has heard."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, str, bool]] = []
        self._tasks: list[asyncio.Task[None]] = []
        self._clients: list[aiomqtt.Client] = []

    async def __aenter__(self) -> Listener:
        return self

    async def __aexit__(self, *_: object) -> None:
        for client in self._clients:
            with suppress(aiomqtt.MqttError):  # of a broker that was killed
                await client.__aexit__(None, None, None)
        await asyncio.gather(*self._tasks)

    async def listen(self, port: int) -> aiomqtt.Client:
        client = await connected(port)
        self._clients.append(client)
        await client.subscribe("#", qos=1)

        async def collect() -> None:
            try:
                async for message in client.messages:
                    self.heard.append((str(message.topic), bytes(message.payload).decode(), message.retain))
            except aiomqtt.MqttError:
                pass

        self._tasks.append(asyncio.ensure_future(collect()))
        return client

    def of(self, topic: str) -> list[str]:
        return [payload for heard, payload, _ in self.heard if heard == topic]

    async def has(self, topic: str, count: int, payload: str | None = None) -> None:
        """Wait until the topic has so many messages, or so many with this payload."""
        await self.until(lambda: sum(payload in (None, heard) for heard in self.of(topic)) >= count)

    async def until(self, condition: Callable[[], Any]) -> None:
        give_up = time.monotonic() + WAIT
        while not condition():
            assert time.monotonic() < give_up, (
                f"{len(self.heard)} heard, {self.heard[-20:]}, ended: {[task.done() for task in self._tasks]}"
            )
            await asyncio.sleep(0.01)


def publishing(site: Site, act: Callable[[Listener, aiomqtt.Client], Awaitable[None]], machines: str = "") -> None:
    """Act with a listener while a publisher runs, also of these machines. The broker is started if there is none."""

    async def main() -> None:
        async with Listener() as listener:
            client = await listener.listen(site.port)
            async with Gateway(read_config(site.config() + machines)):
                await act(listener, client)

    if site.broker is None:
        site.start_broker()
    asyncio.run(main())


class _KeepsCancellation:
    """A client of aiomqtt whose calls wait, and end without an error when they are cancelled, as those that use
    `asyncio.wait_for` of Python 3.11 do when the broker answers in that moment."""

    def __init__(self, waits_in: str) -> None:
        self._waits_in = waits_in
        self._client = self
        self.messages = self
        self.has_waited = asyncio.Event()

    async def __aenter__(self) -> _KeepsCancellation:
        await self._call("connect")
        return self

    async def __aexit__(self, *_: object) -> None: ...

    def __aiter__(self) -> _KeepsCancellation:
        return self

    async def __anext__(self) -> None:
        await asyncio.Event().wait()

    def disconnect(self) -> None: ...

    async def subscribe(self, *_: object, **__: object) -> None:
        await self._call("subscribe")

    async def publish(self, *_: object, **__: object) -> None:
        await self._call("publish")

    async def _call(self, name: str) -> None:
        if name == self._waits_in and not self.has_waited.is_set():
            self.has_waited.set()
            with suppress(asyncio.CancelledError):
                await asyncio.Event().wait()


@pytest.mark.parametrize("waits_in", ["connect", "subscribe", "publish"])
def test_a_publisher_ends_though_a_call_to_the_broker_keeps_the_cancellation(
    site: Site, waits_in: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def main() -> None:
        broker = _KeepsCancellation(waits_in)
        monkeypatch.setattr(aiomqtt, "Client", lambda *_, **__: broker)
        async with asyncio.timeout(WAIT), Gateway(read_config(site.config())):
            await broker.has_waited.wait()

    asyncio.run(main())


class _TakesNoReadings(_KeepsCancellation):
    """A client of aiomqtt whose broker takes everything but values, as one that gives no right to publish them."""

    async def publish(self, *given: object, **_: object) -> None:
        if str(given[0]).endswith("/count"):
            raise aiomqtt.MqttError("not authorized")


def test_a_broker_that_takes_no_readings_is_tried_less_often(
    site: Site, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("barewire.gateway.publish.publisher._PAUSES", (0.01, 0.04))
    monkeypatch.setattr(aiomqtt, "Client", lambda *_, **__: _TakesNoReadings(""))

    async def main() -> None:
        async with Gateway(read_config(site.config())), asyncio.timeout(WAIT):
            while len(pauses()) < 4:
                await asyncio.sleep(0.01)

    def pauses() -> list[str]:
        lines = [record.getMessage().partition("not authorized; next attempt in ")[2] for record in caplog.records]
        return [line for line in lines if line]

    asyncio.run(main())
    assert pauses()[:4] == ["0.01 s", "0.02 s", "0.04 s", "0.04 s"]


def test_an_outcome_that_the_broker_did_not_take_is_sent_again(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    results: list[object] = []

    class LosesTheFirst(_KeepsCancellation):
        async def publish(self, *given: object, **_: object) -> None:
            if str(given[0]).endswith("/result"):
                results.append(given[1])
                if len(results) == 1:
                    raise aiomqtt.MqttError("the connection was lost")

    monkeypatch.setattr("barewire.gateway.publish.publisher._PAUSES", (0.01, 0.01))
    monkeypatch.setattr(aiomqtt, "Client", lambda *_, **__: LosesTheFirst(""))

    async def main() -> None:
        async with Gateway(read_config(site.config())) as gateway, asyncio.timeout(WAIT):
            assert gateway.publisher is not None
            gateway.publisher._take_command("barewire/hall_1/meter/ratio", b"200")
            while len(results) < 2:
                await asyncio.sleep(0.01)

    asyncio.run(main())
    assert results == [json.dumps({"value": 200, "ok": True})] * 2


@pytest.mark.needs("mosquitto")
def test_values_are_published_with_birth_description_and_discovery(site: Site) -> None:
    async def act(listener: Listener, client: aiomqtt.Client) -> None:
        await listener.until(lambda: len(listener.of("barewire/hall_1/meter/count")) >= 5)
        counts = [json.loads(payload) for payload in listener.of("barewire/hall_1/meter/count")]
        assert [row["value"] for row in counts[:5]] == [1, 2, 3, 4, 5]
        assert all(abs(row["at"] - time.time()) < WAIT for row in counts)
        assert len(listener.of("barewire/hall_1/meter/ratio")) == 1  # it did not change
        assert listener.of("barewire/hall_1/status")[-1] == "online"
        assert listener.of("barewire/hall_1/meter/status") == ["online"]
        described = json.loads(listener.of("barewire/hall_1/meter/description")[0])
        assert [(row["name"], row["command"]) for row in described["parameters"]] == [("Count", False), ("Ratio", True)]
        number = "homeassistant/number/barewire-hall_1-meter-ratio/config"
        assert len(listener.of(number)) == 1
        await client.publish("homeassistant/status", "online")
        await listener.until(lambda: len(listener.of(number)) == 2)
        await listener.until(lambda: len(listener.of("barewire/hall_1/meter/ratio")) == 2)
        async with Listener() as retained:
            await retained.listen(site.port)
            await retained.until(lambda: retained.of(number))
        assert {topic for topic, _, flag in retained.heard if flag} >= {
            "barewire/hall_1/status",
            "barewire/hall_1/meter/status",
            "barewire/hall_1/meter/description",
        }

    publishing(site, act)


@pytest.mark.needs("mosquitto")
def test_commands_are_carried_out_only_where_they_are_allowed(site: Site) -> None:
    async def act(listener: Listener, client: aiomqtt.Client) -> None:
        result = "barewire/hall_1/meter/ratio/result"
        await listener.until(lambda: listener.of("barewire/hall_1/meter/ratio"))
        payloads = ("200", "9000", '"x"', "[1]", "{", "null", '"\\ud800"', "NaN", "-Infinity", "1e999")
        for number, payload in enumerate(payloads, 1):
            await client.publish("barewire/hall_1/meter/ratio/set", payload, qos=1)
            await listener.has(result, number)
        outcomes = [json.loads(payload) for payload in listener.of(result)]
        assert outcomes[0] == {"value": 200, "ok": True}
        assert [row["ok"] for row in outcomes] == [True] + [False] * 9
        assert "expected 1..5000 A" in outcomes[1]["error"]
        assert site.table.holding_registers[0] == 200
        await listener.until(lambda: json.loads(listener.of("barewire/hall_1/meter/ratio")[-1])["value"] == 200)
        await client.publish("barewire/hall_1/meter/count/set", "5", qos=1)
        await client.publish("barewire/hall_1/other/ratio/set", "5", qos=1)
        await client.publish("barewire/hall_1/meter/ratio/set", "300", qos=1)
        await listener.until(lambda: len(listener.of(result)) == 11)
        assert not listener.of("barewire/hall_1/meter/count/result")

    publishing(site, act)


async def leave(site: Site, topic: str, payload: str) -> None:
    """Publish what the broker keeps, from a client of its own."""
    client = await connected(site.port)
    await client.publish(topic, payload, qos=1, retain=True)
    await client.__aexit__(None, None, None)


@pytest.mark.needs("mosquitto")
def test_a_command_that_was_left_there_is_not_carried_out(site: Site) -> None:
    async def act(listener: Listener, client: aiomqtt.Client) -> None:
        await listener.until(lambda: len(listener.of("barewire/hall_1/meter/count")) >= 3)
        assert site.table.holding_registers[0] == 0

    site.start_broker()
    asyncio.run(leave(site, "barewire/hall_1/meter/ratio/set", "77"))
    publishing(site, act)


@pytest.mark.needs("mosquitto")
def test_a_birth_message_that_the_broker_keeps_is_no_loop(site: Site) -> None:
    """Home Assistant may retain it. Everything is said once for each connection, and once for each new birth."""

    async def act(listener: Listener, client: aiomqtt.Client) -> None:
        description = "barewire/hall_1/meter/description"
        await listener.has("barewire/hall_1/meter/count", 20)
        assert len(listener.of(description)) == 1
        await client.publish("homeassistant/status", "online", qos=1, retain=True)
        await listener.has(description, 2)
        before = len(listener.of("barewire/hall_1/meter/count"))
        await listener.has("barewire/hall_1/meter/count", before + 20)
        assert len(listener.of(description)) == 2

    site.start_broker()
    asyncio.run(leave(site, "homeassistant/status", "online"))
    publishing(site, act)


class Relay:
    """A way to the broker that the test opens and closes."""

    def __init__(self, to: int) -> None:
        self.to, self.port = to, 0
        self.writers: set[asyncio.StreamWriter] = set()
        self.server: asyncio.Server | None = None

    async def open(self) -> None:
        self.server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)
        self.port = self.server.sockets[0].getsockname()[1]

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.writers.add(writer)
        try:
            up_reader, up_writer = await asyncio.open_connection("127.0.0.1", self.to)
            self.writers.add(up_writer)
            await asyncio.gather(self._pass(reader, up_writer), self._pass(up_reader, writer))
        except OSError:
            pass

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(4096):
            writer.write(data)
        writer.close()

    async def close(self) -> None:
        assert self.server is not None
        self.server.close()
        for writer in self.writers:
            writer.close()
        self.writers.clear()


def check_sequence(listener: Listener, first: int = 1) -> None:
    """Every reading arrived, in order; one that arrived twice says so."""
    rows = [
        json.loads(payload)
        for topic, payload, _ in listener.heard
        if topic in ("barewire/hall_1/meter/count", "barewire/hall_1/meter/ratio")
    ]
    seen = first - 1
    for row in rows:
        assert row["sequence"] == seen + 1 or (row["sequence"] <= seen and row["again"]), (seen, row)
        seen = max(seen, row["sequence"])


@pytest.mark.needs("mosquitto")
def test_a_broker_that_is_killed_loses_no_reading(site: Site) -> None:
    async def main() -> None:
        relay = Relay(site.port)
        await relay.open()
        async with Listener() as listener:
            await kill_thrice(listener, relay)
        await relay.close()
        check_sequence(listener)

    async def kill_thrice(listener: Listener, relay: Relay) -> None:
        await listener.listen(site.port)
        async with Gateway(read_config(site.config(port=relay.port))) as gateway:
            for number in range(1, 4):
                await listener.has("barewire/hall_1/meter/count", 10 * number)
                assert site.broker is not None
                site.broker.kill()
                site.broker.wait(WAIT)
                await relay.close()
                before = site.reads
                async with asyncio.timeout(WAIT):
                    while site.reads < before + 10:  # polling goes on
                        await asyncio.sleep(0.01)
                assert gateway.publisher is not None
                assert len(gateway.publisher.buffer) >= 5
                site.start_broker()
                await listener.listen(site.port)
                await relay.open()
            await listener.has("barewire/hall_1/meter/count", 60)

    site.start_broker()
    asyncio.run(main())


@pytest.mark.needs("mosquitto")
def test_a_publisher_that_is_killed_goes_on_where_it_was(site: Site, tmp_path: Path) -> None:
    file = tmp_path / "gateway.toml"
    file.write_text(site.config())

    async def main() -> None:
        async with Listener() as listener:
            await listener.listen(site.port)
            await kill_thrice(listener)
        check_sequence(listener)

    async def kill_thrice(listener: Listener) -> None:
        for number in range(1, 4):
            program = subprocess.Popen([sys.executable, "-m", "barewire.gateway", str(file)], stdout=subprocess.DEVNULL)
            try:
                await listener.has("barewire/hall_1/meter/count", 10 * number)
            finally:
                program.send_signal(signal.SIGKILL)
                program.wait(WAIT)
            await listener.has("barewire/hall_1/status", number, "offline")

    site.start_broker()
    asyncio.run(main())


@pytest.mark.needs("mosquitto")
def test_a_machine_that_does_not_respond_is_said_and_delays_no_other_line(site: Site) -> None:
    dead = f"""
[[publish.machine]]
name = "Dead"
url = "tcp://127.0.0.1:{free_port()}"
device = "{site.folder}/meter"
every = 0.05
parameters = ["Count"]
"""

    async def act(listener: Listener, client: aiomqtt.Client) -> None:
        await listener.has("barewire/hall_1/dead/status", 1)
        await listener.has("barewire/hall_1/meter/count", 20)
        assert listener.of("barewire/hall_1/dead/status") == ["offline"]
        assert listener.of("barewire/hall_1/meter/status") == ["online"]

    publishing(site, act, dead)


def declining(site: Site, code: int, *addresses: int) -> list[int]:
    """Let the meter decline reads that begin at a holding register of these. Returns the list of all that it declined,
    and publishes Backup too, the register behind Ratio."""
    backup = '[[parameter]]\nname = "Backup"\ntype = "u16"\nholding = 2\naccess = "ro"\n'
    (site.folder / "meter" / "values.toml").write_text(VALUES + backup)
    count, declined = site.table.on_read, list[int]()
    assert count is not None

    def decline(name: str, address: int, quantity: int) -> None:
        count(name, address, quantity)
        if name == "holding_registers" and address in addresses:
            declined.append(address)
            raise ModbusException(code)

    site.table.on_read = decline
    return declined


def polling(site: Site, act: Callable[[Publisher], Awaitable[None]]) -> None:
    """Act while the meter is polled, without a broker."""

    async def main() -> None:
        text = site.config().replace('"Count", "Ratio"]', '"Count", "Ratio", "Backup"]')
        async with Gateway(read_config(text)) as gateway, asyncio.timeout(WAIT):
            assert gateway.publisher is not None
            await act(gateway.publisher)

    asyncio.run(main())


def test_a_parameter_that_is_refused_is_left_out_and_tried_again(site: Site, caplog: pytest.LogCaptureFixture) -> None:
    declined = declining(site, 2, 0)

    async def act(publisher: Publisher) -> None:
        while len(publisher.buffer) < 20:
            await asyncio.sleep(0.01)
        values = {row.topic: json.loads(row.payload)["value"] for row in publisher.buffer.batch(2)}
        assert values == {"barewire/hall_1/meter/count": 1, "barewire/hall_1/meter/backup": 0}
        assert declined == [0, 0]  # with Backup, and alone
        (machine,) = publisher.status()["machines"]
        assert (machine["responds"], machine["error"], [*machine["refused"]]) == (True, "", ["Ratio"])
        assert "exception 02" in machine["refused"]["Ratio"]
        site.table.on_read = None
        publisher._lines[0].schedule.groups[0].all_again_at = 0.0  # a minute later
        while publisher.status()["machines"][0]["refused"]:
            await asyncio.sleep(0.01)
        assert publisher.buffer.batch(100)[-1].topic == "barewire/hall_1/meter/ratio"

    polling(site, act)
    lines = [record.getMessage() for record in caplog.records if "Ratio" in record.getMessage()]
    assert [line.partition(": unit")[0] for line in lines] == ["Hall 1: Meter: Ratio is left out"]


@pytest.mark.parametrize(
    ("code", "responds"), [(0x02, True), (0x0A, False), (0x0B, False)], ids=["address", "no path", "no response"]
)
def test_a_machine_that_refuses_everything_is_asked_less_often(site: Site, code: int, responds: bool) -> None:
    """It does respond, unless it is a gateway that refuses, which has no response of it."""
    declined = declining(site, code, 0, 1)

    async def act(publisher: Publisher) -> None:
        (group,) = publisher._lines[0].schedule.groups
        group.names = ("Ratio", "Backup")
        while group.failures < 3:
            await asyncio.sleep(0.01)
        assert publisher.status()["machines"][0]["responds"] is responds
        assert declined[:3] == ([0, 0, 1] if responds else [0, 0, 0])

    polling(site, act)


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("mqtt://127.0.0.1", "http://127.0.0.1", "broker: expected mqtt://"),
        ('"Count", "Ratio"]', '"Count", "Rato"]', "meter has no parameter 'Rato'; did you mean 'Ratio'?"),
        ('commands = ["Ratio"]', 'commands = ["Count"]', "Count cannot be written"),
        ("every = 0.05", "every = 0", "every = 0: expected 0.001 seconds or more"),
        ('site = "Hall 1"', 'site = "Hall 1"\nlimit = 0', "5:1: limit = 0: expected a whole number, 1 or more"),
        ('"\ndevice', '?timeout=0"\ndevice', "timeout=0: expected more than 0"),
        ('"homeassistant"', '"homeassistant/"', "expected the beginning of a topic"),
        ('/meter"', '/metre"', "and no such directory"),
        ("tcp://", "can://memory/", "CANopen"),
        ("/buffer.sqlite", "/missing/buffer.sqlite", "/missing is no directory"),
    ],
)
def test_what_is_wrong_is_said_before_it_runs(site: Site, old: str, new: str, fault: str) -> None:
    text = site.config()
    assert old in text
    with pytest.raises(ConfigError) as wrong:
        read_config(text.replace(old, new))
    assert fault in str(wrong.value)


def test_a_serial_port_has_one_owner(site: Site) -> None:
    line = '[[listen]]\nurl = "tcp://127.0.0.1:0"\n[[backend]]\nname = "hall"\nunits = 1\nurl = "rtu:///dev/ttyS0"\n'
    text = site.config().replace(f'url = "{site.server.url}', 'url = "rtu:///dev/ttyS0?unit=7')
    read_config(text)
    with pytest.raises(ConfigError, match="/dev/ttyS0 is the line of the backend 'hall': poll through a listener"):
        read_config(line + text)


def test_machines_on_one_line_share_its_connection(tmp_path: Path) -> None:
    with ModbusServer("tcp://127.0.0.1:0", {number: Table(10) for number in (1, 2, 3)}) as server:
        (tmp_path / "meter").mkdir()
        (tmp_path / "meter" / "device.toml").write_text(METER)
        (tmp_path / "meter" / "values.toml").write_text(VALUES)
        machines = "".join(
            f'[[publish.machine]]\nname = "m{number}"\nurl = "{server.url}?unit={number}"\n'
            f'device = "{tmp_path}/meter"\nparameters = ["Count"]\nevery = 0.02\n'
            for number in (1, 2, 3)
        )
        text = f'[publish]\nbroker = "mqtt://127.0.0.1:{free_port()}"\nsite = "x"\n{machines}'

        async def main() -> None:
            async with Gateway(read_config(text)) as gateway, asyncio.timeout(WAIT):
                assert gateway.publisher is not None
                while len(gateway.publisher.buffer) < 3:
                    await asyncio.sleep(0.01)

        asyncio.run(main())
        assert server.statistics.opened == 1


@pytest.mark.needs("mosquitto")
def test_a_publisher_that_ends_says_so(site: Site) -> None:
    async def main() -> None:
        async with Listener() as listener:
            await listener.listen(site.port)
            async with Gateway(read_config(site.config())):
                await listener.has("barewire/hall_1/meter/status", 1, "online")
            await listener.has("barewire/hall_1/meter/status", 1, "offline")
            await listener.has("barewire/hall_1/status", 1, "offline")

    site.start_broker()
    asyncio.run(main())


@pytest.mark.needs("mosquitto")
def test_readings_under_way_are_no_lines_in_the_log(site: Site, caplog: pytest.LogCaptureFixture) -> None:
    """After an outage a hundred are under way at once, which aiomqtt calls too many pending calls."""

    async def main() -> None:
        async with Listener() as listener:
            await listener.listen(site.port)
            async with Gateway(read_config(site.config())):
                await listener.has("barewire/hall_1/meter/count", 250)

    buffer = Buffer(f"{site.folder}/buffer.sqlite")
    buffer.append([("barewire/hall_1/meter/count", json.dumps({"value": number})) for number in range(250)])
    buffer.close()
    site.start_broker()
    with caplog.at_level("WARNING"):
        asyncio.run(main())
    assert [record.getMessage() for record in caplog.records] == []


@pytest.mark.needs("mosquitto")
def test_commands_do_not_hold_up_polling(site: Site) -> None:
    async def act(listener: Listener, client: aiomqtt.Client) -> None:
        async def command() -> None:
            for number in itertools.cycle((1, 2)):
                await client.publish("barewire/hall_1/meter/ratio/set", str(number), qos=0)
                await asyncio.sleep(0)

        await listener.has("barewire/hall_1/meter/count", 1)
        commanding = asyncio.ensure_future(command())
        before = site.reads
        await listener.has("barewire/hall_1/meter/ratio/result", 20)
        await listener.until(lambda: site.reads > before + 20)
        commanding.cancel()

    publishing(site, act)


@pytest.mark.needs("mosquitto")
def test_a_buffer_that_cannot_be_written_ends_nothing(site: Site) -> None:
    """Another program has the file locked for a while. Nothing is lost, and all of it arrives afterwards; meanwhile the
    publisher stays at its broker, and commands have their outcomes."""

    async def main() -> None:
        async with Listener() as listener:
            client = await listener.listen(site.port)
            async with Gateway(read_config(site.config())):
                await listener.has("barewire/hall_1/meter/count", 3)
                other = sqlite3.connect(site.folder / "buffer.sqlite", isolation_level=None, timeout=WAIT)
                other.execute("BEGIN IMMEDIATE")
                before = site.reads
                await listener.until(lambda: site.reads > before + 10)
                for number in (1, 2):
                    await client.publish("barewire/hall_1/meter/ratio/set", str(number), qos=1)
                    await listener.has("barewire/hall_1/meter/ratio/result", number)
                other.execute("ROLLBACK")
                other.close()
                last = site.reads
                counts = "barewire/hall_1/meter/count"
                await listener.until(lambda: json.loads(listener.of(counts)[-1])["value"] > last)
        check_sequence(listener)
        values = [json.loads(payload)["value"] for payload in listener.of(counts)]
        assert sorted(set(values)) == list(range(1, max(values) + 1))
        assert len(listener.of("barewire/hall_1/meter/description")) == 1

    site.start_broker()
    asyncio.run(main())


def test_a_reload_keeps_what_waits_in_memory(site: Site) -> None:
    """Also without a file, and without a broker that could have taken it."""
    text = site.config().replace(f'buffer = "{site.folder}/buffer.sqlite"\n', "")

    async def main() -> None:
        async with Gateway(read_config(text)) as gateway:
            assert gateway.publisher is not None
            buffer = gateway.publisher.buffer
            async with asyncio.timeout(WAIT):
                while len(buffer) < 5:
                    await asyncio.sleep(0.01)
                await gateway.reload(read_config(text.replace("every = 0.05", "every = 0.06")))
                assert gateway.publisher.buffer is buffer
                before = len(buffer)
                while len(buffer) < before + 3:
                    await asyncio.sleep(0.01)
                assert [row.sequence for row in buffer.batch(6)] == [1, 2, 3, 4, 5, 6]

    asyncio.run(main())


def test_a_reload_keeps_a_buffer_that_is_empty(site: Site) -> None:
    """Nothing was read yet, and the buffer is the same one nevertheless."""
    text = site.config()

    async def main() -> None:
        async with Gateway(read_config(text)) as gateway:
            assert gateway.publisher is not None
            buffer = gateway.publisher.buffer
            assert len(buffer) == 0
            await gateway.reload(read_config(text.replace("every = 0.05", "every = 0.06")))
            assert gateway.publisher.buffer is buffer

    asyncio.run(main())


def test_a_late_answer_does_not_become_a_value_of_the_publisher_that_follows(tmp_path: Path) -> None:
    """A reload changes the parameter while the answer to the old one is late, on a line whose answers have no names."""
    registers = (("Temperature", 1), ("Pressure", 2))
    (tmp_path / "meter").mkdir()
    (tmp_path / "meter" / "device.toml").write_text(METER)
    rows = (
        f'[[parameter]]\nname = "{name}"\ntype = "u16"\nholding = {place}\naccess = "ro"\n' for name, place in registers
    )
    (tmp_path / "meter" / "values.toml").write_text("".join(rows))
    table = Table(10, holding_registers=[1000, 1100] * 5)
    is_asked, may_answer = threading.Event(), threading.Event()

    def hold(name: str, address: int, quantity: int) -> None:
        is_asked.set()
        may_answer.wait(WAIT)

    table.on_read = hold

    def config(parameter: str, timeout: float) -> GatewayConfig:
        return read_config(f"""
[publish]
broker = "mqtt://127.0.0.1:{free_port()}"
site = "x"
[[publish.machine]]
name = "m"
url = "{server.url}&timeout={timeout}&late_window={WAIT}"
device = "{tmp_path}/meter"
parameters = ["{parameter}"]
every = 0.02
on_change = false
""")

    async def main() -> None:
        async with Gateway(config("Temperature", 0.05)) as gateway, asyncio.timeout(WAIT):
            old = gateway.publisher
            assert old is not None
            await asyncio.to_thread(is_asked.wait)
            client: Any = old._lines[0].clients["m"].client
            reload = asyncio.create_task(gateway.reload(config("Pressure", WAIT)))

            def waits() -> bool:
                return old._tasks[0].done() and client.connected

            while not reload.done() and not waits():
                await asyncio.sleep(0.01)
            if reload.done():  # wrong: then the next request is sent before the answer
                await asyncio.sleep(0.1)
            may_answer.set()
            await reload
            assert gateway.publisher is not None
            while len(gateway.publisher.buffer) < 1:
                await asyncio.sleep(0.01)
            rows = gateway.publisher.buffer.batch(9)
            assert {(row.topic, json.loads(row.payload)["value"]) for row in rows} == {("barewire/x/m/pressure", 1100)}

    with ModbusServer("rtu://pty?baudrate=115200&unit=7", {7: table}) as server:
        asyncio.run(main())


@pytest.mark.needs("mosquitto")
def test_the_outcome_of_a_command_is_told_before_the_publisher_ends(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three commands arrive, the first is under way when a reload replaces the publisher; the others are not begun."""
    monkeypatch.setattr("barewire.gateway.publish.publisher._LAST_EXCHANGE", WAIT)
    is_written, may_answer = threading.Event(), threading.Event()

    def hold(name: str, address: int, values: Any) -> None:
        is_written.set()
        may_answer.wait(WAIT)

    site.table.on_write = hold
    result = "barewire/hall_1/meter/ratio/result"
    text = site.config().replace(site.server.url, f"{site.server.url}?timeout={WAIT}")

    async def main() -> None:
        async with Listener() as listener:
            client = await listener.listen(site.port)
            async with Gateway(read_config(text)) as gateway:
                publisher = gateway.publisher
                assert publisher is not None
                await listener.has("barewire/hall_1/meter/ratio", 1)
                for number in (200, 300, 400):
                    await client.publish("barewire/hall_1/meter/ratio/set", str(number), qos=1)
                await listener.until(lambda: is_written.is_set() and publisher._lines[0].commands.qsize() == 2)
                reload = asyncio.create_task(gateway.reload(read_config(text.replace("every = 0.05", "every = 0.06"))))
                await listener.has(result, 2)
                assert not reload.done()
                may_answer.set()
                await reload
                await listener.has(result, 3)
                await listener.has("barewire/hall_1/meter/status", 1, "offline")
            outcomes = [json.loads(payload) for payload in listener.of(result)]
            assert [(row["value"], row["ok"]) for row in outcomes] == [(300, False), (400, False), (200, True)]
            assert "not carried out" in outcomes[0]["error"]
            ends = [topic for topic, payload, _ in listener.heard if topic == result or payload == "offline"]
            assert ends[:4] == [*[result] * 3, "barewire/hall_1/meter/status"]
            assert site.table.holding_registers[0] == 200

    site.start_broker()
    asyncio.run(main())


def test_a_command_that_is_not_over_when_the_publisher_ends_has_an_unknown_outcome(
    site: Site, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("barewire.gateway.publish.publisher._LAST_EXCHANGE", 0.05)
    is_written, may_answer = threading.Event(), threading.Event()

    def hold(name: str, address: int, values: Any) -> None:
        is_written.set()
        may_answer.wait(WAIT)

    site.table.on_write = hold
    text = site.config().replace(site.server.url, f"{site.server.url}?timeout={WAIT}")

    async def main() -> None:
        async with Gateway(read_config(text)) as gateway, asyncio.timeout(WAIT):
            assert gateway.publisher is not None
            gateway.publisher._take_command("barewire/hall_1/meter/ratio", b"200")
            await asyncio.to_thread(is_written.wait)
        may_answer.set()

    asyncio.run(main())
    (line,) = (record.getMessage() for record in caplog.records if "/result" in record.getMessage())
    assert '"ok": false' in line
    assert "it may have been carried out" in line
