"""A week of the gateway in virtual time, with a fault every few seconds.

    clients  ->  listener  gateway  ->  units 1-4   TCP, four requests in flight
                    ^         |     ->  units 5-8   RTU over TCP, reads are kept and merged
    publisher  -----'         |     ->  units 9-10  TCP, connections that do not live long
        |                     '------>  unit 11     a place that no one has
        '----->  machine, broker

Everything is in one loop and one process, so what is measured is all of it. Every response is judged: each register
holds a number of its own. What has threads or a pseudo-terminal is not in this world: a serial port, a CAN bus.
"""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import os
import random
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from barewire.gateway.config import read_config
from barewire.gateway.gateway import Gateway
from tools.gateway_lab.broker import Received, machine, meter
from tools.gateway_lab.mqtt_broker import Broker
from tools.gateway_lab.plots import Curve, plot_over_time
from tools.gateway_lab.simulated_units import Place, value_of
from tools.gateway_lab.virtual_time import run_in_virtual_time

HOUR = 3600.0
_PAUSE = 6.0
"""Seconds between two requests of a client, in the mean."""
_BETWEEN_FAULTS = 4.0
_PATIENCE = 60.0
"""Seconds after which a client says that its request was lost."""
_READINGS = 1000
"""The limit of the publisher's buffer."""


@dataclass
class Sample:
    """The process at one time."""

    hour: float
    objects: int
    resident: float
    """MiB."""


@dataclass
class Outcome:
    """What happened in the whole time."""

    responses: Counter[str] = field(default_factory=Counter)
    """What clients got: right, wrong, an exception code, `cut` (the connection ended), or `lost`: nothing."""
    faults: Counter[str] = field(default_factory=Counter)
    received: Received = field(default_factory=Received)
    wrong_readings: int = 0
    dropped: int = 0
    """Readings that the full buffer dropped."""
    samples: list[Sample] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    """Of the gateway's own code: must be empty."""
    took: float = 0.0
    """Seconds of real time."""


class Week:
    """The world: places, broker, clients, faults, and the gateway among them."""

    def __init__(self, folder: Path, seconds: float, quiet: float, seed: int) -> None:
        self.folder, self.seconds, self.quiet = folder, seconds, quiet
        self.dice = random.Random(seed)
        self.places = [
            Place(range(1, 5), 1.0, self.dice),
            Place(range(5, 9), 0.5, self.dice, is_serial=True),
            Place(range(9, 11), 1.0, self.dice),
        ]
        self.machine = Place(range(1, 2), 1.0, self.dice)
        self.outcome = Outcome()
        self.broker = Broker(self._hear)
        self.gateway: Gateway | None = None
        self.tasks: set[asyncio.Task[None]] = set()
        self.port = 0

    def _hear(self, topic: str, payload: bytes) -> None:
        self.outcome.received.hear(topic, payload)
        number = int(topic.rpartition("v")[2])  # of the register, from 1 on
        self.outcome.wrong_readings += json.loads(payload)["value"] != value_of(1, number - 1)

    def config(self, timeout: float = 1.0) -> str:
        """The configuration, with this time-out of one backend."""
        fast, line, short = self.places
        device = self.folder / "meter"
        through = f"tcp://127.0.0.1:{self.port}?unit=1"
        return f"""
[[listen]]
url = "tcp://127.0.0.1:{self.port}?connections=64&idle=900"
[[backend]]
name = "fast"
url = "{fast.url}"
units = "1-4"
timeout = {timeout}
in_flight = 4
[[backend]]
name = "line"
url = "{line.url}"
units = "5-8"
timeout = 0.5
cache = 0.5
merge = 4
[[backend]]
name = "short"
url = "{short.url}"
units = "9-10"
timeout = 1.0
settle = 0.1
idle = 60
lifetime = 3600
[[backend]]
name = "nowhere"
url = "tcp://127.0.0.1:9"
units = "11"
[[policy.allow]]
functions = [3, 6]
addresses = "0-999"
[publish]
broker = "mqtt://127.0.0.1:{self.broker.port}"
site = "x"
buffer = "{self.folder}/buffer"
limit = {_READINGS}
home_assistant = "homeassistant"
{machine("through", through, device, 5, 20.0)}
{machine("direct", self.machine.url, device, 5, 30.0)}
"""

    async def run(self) -> None:
        """Let the time pass."""
        loop = asyncio.get_running_loop()
        meter(self.folder, 5, table="holding")
        for place in (*self.places, self.machine):
            await place.open()
        await self.broker.open()
        probe = await loop.create_server(asyncio.Protocol, "127.0.0.1", 0)
        self.port = probe.sockets[0].getsockname()[1]
        probe.close()
        async with Gateway(read_config(self.config())) as self.gateway:
            tasks = [loop.create_task(self._client()) for _ in range(4)]
            tasks += [loop.create_task(self._make_faults()), loop.create_task(self._measure())]
            await asyncio.sleep(self.seconds)
            for task in tasks[4:]:
                task.cancel()
            self.broker.speak()
            await asyncio.sleep(self.quiet)  # everything is mended: what waits arrives
            for task in (*tasks, *self.tasks):
                task.cancel()
            await asyncio.gather(*tasks, *self.tasks, return_exceptions=True)
            publisher = self.gateway.publisher
            assert publisher is not None
            self.outcome.dropped = publisher.buffer.dropped
        for place in (*self.places, self.machine):
            place.close()
        self.broker.close()

    async def _measure(self) -> None:
        while True:
            gc.collect()
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            hour = asyncio.get_running_loop().time() / HOUR
            resident = pages * os.sysconf("SC_PAGE_SIZE") / 2**20
            self.outcome.samples.append(Sample(hour, len(gc.get_objects()), resident))
            await asyncio.sleep(HOUR)

    # Clients

    async def _client(self) -> None:
        """Ask and judge, and connect again when the connection has ended."""
        while True:
            with suppress(OSError, asyncio.IncompleteReadError):
                reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
                try:
                    while True:
                        await asyncio.sleep(self.dice.expovariate(1 / _PAUSE))
                        await self._ask(reader, writer)
                finally:
                    writer.transport.abort()
            await asyncio.sleep(1.0)

    def _request(self) -> tuple[bytes, bytes]:
        """Return a request without its transaction number, and the right response."""
        unit, address, count = self.dice.randint(1, 11), self.dice.randrange(990), self.dice.randint(1, 4)
        if self.dice.random() < 0.1:
            request = bytes((unit, 6)) + address.to_bytes(2, "big") + value_of(unit, address).to_bytes(2, "big")
            return request, request
        request = bytes((unit, 3)) + address.to_bytes(2, "big") + count.to_bytes(2, "big")
        words = b"".join(value_of(unit, address + offset).to_bytes(2, "big") for offset in range(count))
        return request, bytes((unit, 3, 2 * count)) + words

    async def _ask(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        request, right = self._request()
        if self.dice.random() < 0.01:  # the policy refuses it
            request = request[:2] + (2000).to_bytes(2, "big") + request[4:]
        responses = self.outcome.responses
        writer.write(self.dice.randbytes(2) + b"\0\0\0\x06" + request)
        try:
            async with asyncio.timeout(_PATIENCE):
                head = await reader.readexactly(6)
                body = await reader.readexactly(int.from_bytes(head[4:6], "big"))
        except TimeoutError:
            responses["lost"] += 1
            raise OSError from None
        except (OSError, asyncio.IncompleteReadError):
            responses["cut"] += 1
            raise
        if body[1] & 0x80:
            responses[f"{body[2]:02X}"] += 1
        else:
            responses["right" if body == right else "wrong"] += 1

    # Faults

    async def _make_faults(self) -> None:
        kinds: list[Callable[[], None]] = [
            *[self._unit_is_silent] * 4,
            *[self._answers_are_bad] * 6,
            self._place_is_gone,
            self._connections_break,
            self._client_leaves,
            self._client_is_greedy,
            self._bytes_are_noise,
            self._broker_is_gone,
            self._broker_is_mute,
            self._home_assistant_starts,
            self._is_reloaded,
            self._is_looked_at,
        ]
        while True:
            await asyncio.sleep(self.dice.expovariate(1 / _BETWEEN_FAULTS))
            fault = self.dice.choice(kinds)
            self.outcome.faults[fault.__name__.strip("_").replace("_", " ")] += 1
            fault()

    def _begin(self, work: Any) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self.tasks.add(task)
        task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self.tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            self.outcome.errors.append(repr(error))

    def _for_how_long(self) -> float:
        """Mostly seconds, seldom hours."""
        return float(min(self.dice.paretovariate(0.7), 2 * HOUR))

    def _unit_is_silent(self) -> None:
        place = self.dice.choice((*self.places, self.machine))
        now = asyncio.get_running_loop().time()
        place.silent[self.dice.choice(place.units)] = now + self._for_how_long()

    def _answers_are_bad(self) -> None:
        place = self.dice.choice((*self.places, self.machine))
        kinds = ("drop", "busy", "late", "damaged", "reset")
        place.faults += self.dice.choices(kinds, k=self.dice.randint(1, 3))
        del place.faults[:-8]

    def _place_is_gone(self) -> None:
        place = self.dice.choice((*self.places, self.machine))

        async def be_gone() -> None:
            place.close()
            await asyncio.sleep(self._for_how_long())
            await place.open()

        if place.server is not None and place.server.is_serving():
            self._begin(be_gone())

    def _connections_break(self) -> None:
        self.dice.choice((*self.places, self.machine)).reset()

    def _client_leaves(self) -> None:
        async def leave() -> None:
            with suppress(OSError):
                _, writer = await asyncio.open_connection("127.0.0.1", self.port)
                for number in range(self.dice.randint(1, 5)):
                    writer.write(number.to_bytes(2, "big") + b"\0\0\0\x06" + self._request()[0])
                await asyncio.sleep(self.dice.choice((0.0, 0.002, 0.3)))
                writer.transport.abort()

        self._begin(leave())

    def _client_is_greedy(self) -> None:
        async def be_greedy() -> None:
            with suppress(OSError, asyncio.IncompleteReadError):
                reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
                count = self.dice.randint(10, 60)
                for number in range(count):
                    writer.write(number.to_bytes(2, "big") + b"\0\0\0\x06" + self._request()[0])
                try:
                    async with asyncio.timeout(_PATIENCE):
                        for _ in range(count):
                            head = await reader.readexactly(6)
                            await reader.readexactly(int.from_bytes(head[4:6], "big"))
                except TimeoutError:
                    self.outcome.responses["lost"] += 1
                writer.transport.abort()

        self._begin(be_greedy())

    def _bytes_are_noise(self) -> None:
        async def be_noise() -> None:
            with suppress(OSError):
                _, writer = await asyncio.open_connection("127.0.0.1", self.port)
                writer.write(self.dice.randbytes(self.dice.randint(1, 300)))
                await asyncio.sleep(self._for_how_long())
                writer.transport.abort()

        self._begin(be_noise())

    def _broker_is_gone(self) -> None:
        async def be_gone() -> None:
            self.broker.close()
            await asyncio.sleep(self._for_how_long())
            await self.broker.open()

        if self.broker.server is not None and self.broker.server.is_serving():
            self._begin(be_gone())

    def _broker_is_mute(self) -> None:
        async def be_mute() -> None:
            self.broker.is_mute = True
            await asyncio.sleep(self._for_how_long())
            self.broker.speak()

        self._begin(be_mute())

    def _home_assistant_starts(self) -> None:
        topic = b"homeassistant/status"
        content = len(topic).to_bytes(2, "big") + topic + b"online"
        for connection in self.broker.connections:
            connection.transport.write(bytes((0x30, len(content))) + content)

    def _is_reloaded(self) -> None:
        assert self.gateway is not None
        self._begin(self.gateway.reload(read_config(self.config(self.dice.choice((0.9, 1.0))))))

    def _is_looked_at(self) -> None:
        assert self.gateway is not None
        json.dumps(self.gateway.status())
        for backend in self.gateway.backends:
            backend.watch_frames()


class _Errors(logging.Handler):
    """Keeps the lines of level ERROR."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__()
        self.outcome = outcome

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        is_of_library = record.name == "mqtt" or "MqttCodeError" in text  # a connection was reset, and nobody asked why
        if record.levelno >= logging.ERROR and not is_of_library:
            self.outcome.errors.append(text)


def play(seconds: float, quiet: float = 3 * HOUR, seed: int = 1) -> Outcome:
    """Play so many seconds, and some without new faults after them: a fault lasts two hours at most."""
    began = time.monotonic()
    random.seed(seed)  # of the pauses between attempts to connect
    with TemporaryDirectory() as folder:
        week = Week(Path(folder), seconds, quiet, seed)
        handler = _Errors(week.outcome)
        loggers = [
            logging.getLogger(name)
            for name in ("barewire.gateway", "barewire.publish", "barewire.server", "mqtt", "asyncio")
        ]
        for logger in loggers:
            logger.addHandler(handler)
            logger.propagate = False
        try:
            run_in_virtual_time(week.run())
        finally:
            for logger in loggers:
                logger.removeHandler(handler)
                logger.propagate = True
    week.outcome.took = time.monotonic() - began
    return week.outcome


def measure_week(runs: int) -> list[str]:
    """A week in virtual time with a fault every few seconds: whether the memory is flat, and every request answered."""
    outcome = play(7 * 24 * HOUR)
    samples, heard = outcome.samples, outcome.received
    second, last = samples[24:48], samples[-24:]

    def mean(rows: list[Sample], name: str) -> float:
        return sum(float(getattr(row, name)) for row in rows) / len(rows)

    picture = plot_over_time(
        "week",
        "MiB resident",
        [
            Curve("resident memory", [row.hour for row in samples], [row.resident for row in samples]),
            Curve("objects", [row.hour for row in samples], [float(row.objects) for row in samples], on_the_right=True),
        ],
        unit="hours of virtual time",
        right="objects",
    )
    responses = outcome.responses
    exceptions = ", ".join(f"{responses[code]:,} {code}" for code in sorted(responses) if len(code) == 2)
    return [
        "### A week in compressed time",
        "",
        "Gateway, publisher, their units, clients and a small broker in one process, in an event loop whose time jumps "
        f"to the next timer: seven days with {sum(outcome.faults.values()):,} faults, one every {_BETWEEN_FAULTS:g} s, "
        f"in {outcome.took / 60:.0f} minutes. Places behind TCP and RTU over TCP; serial ports and CAN buses have "
        "pseudo-terminals or threads, and are not in it.",
        "",
        "| | |",
        "|---|---|",
        f"| requests of four clients | {responses['right']:,} right, exceptions {exceptions}, **{responses['wrong']} "
        f"wrong, {responses['lost']} lost**, {responses['cut']} cut off |",
        f"| readings published | {heard.latest:,}, {outcome.dropped:,} dropped because the buffer of {_READINGS:,} was "
        f"full, **{heard.missing - outcome.dropped:,} others missing**, {heard.again:,} twice and marked, "
        f"**{heard.unmarked + heard.backwards + outcome.wrong_readings} unmarked, out of order or wrong** |",
        f"| memory, second day to last day | {mean(second, 'resident'):.1f} to {mean(last, 'resident'):.1f} MiB, "
        f"{mean(second, 'objects'):,.0f} to {mean(last, 'objects'):,.0f} objects |",
        f"| errors of the gateway's own code | {len(outcome.errors)} |",
        f"| faults | {', '.join(f'{count:,} {name}' for name, count in outcome.faults.most_common())} |",
        "",
        picture,
        "",
    ]
