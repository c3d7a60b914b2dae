"""The publisher and its broker."""

from __future__ import annotations

import asyncio
import json
import random
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from tools.gateway_lab.plots import Curve, plot_over_time
from tools.gateway_lab.programs import (
    MOSQUITTO,
    ROOT,
    free_port,
    median,
    peak_memory,
    processor_time,
    program,
    stand_in,
)

_PATIENCE = 60.0
"""Seconds in which what waits in the buffer must arrive at the end."""


def meter(folder: Path, values: int, table: str = "input") -> Path:
    """Write the description of a device with so many registers in a table."""
    path = folder / "meter"
    path.mkdir()
    (path / "device.toml").write_text('name = "meter"\ntitle = "Meter"\n[modbus]\nunit = 1\nfirst_register = 1\n')
    row = '[[parameter]]\nname = "V{0}"\ntype = "u16"\n{1} = {0}\naccess = "ro"\n'
    (path / "values.toml").write_text("".join(row.format(number, table) for number in range(1, values + 1)))
    return path


def machine(name: str, url: str, device: Path, values: int, every: float) -> str:
    """The configuration of a machine of which every reading is published."""
    names = ", ".join(f'"V{number}"' for number in range(1, values + 1))
    head = f'[[publish.machine]]\nname = "{name}"\nurl = "{url}"\ndevice = "{device}"\nparameters = [{names}]\n'
    return f"{head}every = {every}\non_change = false\n"


@contextmanager
def publishing(values: int, every: float) -> Iterator[tuple[Path, Path, int]]:
    """Ten machines; a configuration that publishes their values, the one of a broker, and the port in both."""
    with TemporaryDirectory() as name, program(*stand_in("machines")) as machines:
        folder, port = Path(name), free_port()
        device = meter(folder, values)
        rows = [machine(f"m{unit}", f"{machines.first}?unit={unit}", device, values, every) for unit in range(1, 11)]
        head = f'[publish]\nbroker = "mqtt://127.0.0.1:{port}"\nsite = "x"\nbuffer = "{folder}/buffer"\n'
        (folder / "gateway.toml").write_text(head + "".join(rows))
        (folder / "mosquitto.conf").write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
        yield folder / "gateway.toml", folder / "mosquitto.conf", port


def publisher(file: Path) -> tuple[str, ...]:
    """The command of the program that publishes."""
    return (sys.executable, "-m", "barewire.gateway", str(file))


def measure_publish(runs: int) -> list[str]:
    """One publisher, ten machines of a hundred values each, read as fast as it can; the broker is Mosquitto."""
    if not MOSQUITTO:
        return ["### Publishing", "", "Not measured: mosquitto is not installed.", ""]
    rates, costs, memories = [], [], []
    for _ in range(runs):
        with (
            publishing(100, 0.001) as (file, broker, port),
            program(MOSQUITTO, "-c", str(broker), is_ready=False),
            program(*publisher(file)) as running,
        ):
            time.sleep(3.0)
            before = processor_time(running)
            command = stand_in("subscriber", port, 10.0)
            counted = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
            number = int(counted.stdout)
            rates.append(number / 10.0)
            costs.append((processor_time(running) - before) / max(number, 1))
            memories.append(peak_memory(running))
    rate, cost, memory = median(rates), 1e6 * median(costs), median(memories)
    text = f"{rate:,.0f} values in a second, {cost:.0f} us of processor time for each, {memory:.1f} MiB at most."
    what = "Ten machines on TCP, a hundred values in one request each, SQLite, QoS 1:"
    return ["### Publishing", "", what, "", text, ""]


@dataclass
class Received:
    """What a subscriber has heard, judged: a reading is new, or it came before and says so, or it is an error."""

    latest: int = 0
    """The highest sequence."""
    again: int = 0
    """Readings that came before and are marked."""
    unmarked: int = 0
    missing: int = 0
    """Readings that were left out before a later one."""
    backwards: int = 0
    """Readings that were read before the previous one of their machine."""
    read_at: dict[str, float] = field(default_factory=dict)

    def hear(self, topic: str, payload: bytes | bytearray) -> None:
        """Judge one message."""
        reading = json.loads(payload)
        sequence = reading["sequence"]
        if sequence <= self.latest:
            self.again += 1
            self.unmarked += not reading.get("again")
            return
        self.missing += sequence - self.latest - 1
        self.latest = sequence
        name = topic.split("/")[2]
        self.backwards += reading["at"] < self.read_at.get(name, 0.0)
        self.read_at[name] = reading["at"]


class Gate:
    """The publisher's way to the broker. It is opened when the subscriber has subscribed, or a broker that was just
    started would take readings that nobody hears."""

    def __init__(self, port: int, to: int) -> None:
        self.port = port
        self.to = to
        self.server: asyncio.Server | None = None
        self.writers: set[asyncio.StreamWriter] = set()

    async def open(self) -> None:
        """Let the publisher in."""
        self.server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)

    def close(self) -> None:
        """End all connections, and refuse new ones."""
        if self.server is not None:
            self.server.close()
        for writer in self.writers:
            writer.transport.abort()
        self.writers.clear()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self.to)
            self.writers |= {writer, far_writer}
            await asyncio.gather(self._pass(reader, far_writer), self._pass(far_reader, writer))

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while data := await reader.read(65536):
                writer.write(data)
                await writer.drain()
        writer.close()


class Outages:
    """Broker and publisher are killed at random, and started again, while a subscriber judges what arrives.

    `victims` is who is killed next, by chance: "broker", "publisher" or "both"; `steady` is the longest time in seconds
    between two kills. Both are started by the commands in `prefixes`, such as one that enters a control group.
    """

    def __init__(
        self,
        file: Path,
        broker: Path,
        port: int,
        seed: int,
        victims: Sequence[str] = ("broker", "broker", "publisher", "both"),
        prefixes: tuple[Sequence[str], Sequence[str]] = ((), ()),
        steady: float = 6.0,
    ) -> None:
        self.victims, self.prefixes, self.steady = victims, prefixes, steady
        self.file, self.buffer = file, file.parent / "buffer"
        self.broker_file, self.broker_port = broker, free_port()
        broker.write_text(broker.read_text().replace(str(port), str(self.broker_port)))
        self.gate = Gate(port, self.broker_port)
        self.dice = random.Random(seed)
        self.received = Received()
        self.moments: list[float] = []
        """When each reading arrived."""
        self.delays: list[float] = []
        """Seconds from when it was read."""
        self.broker: subprocess.Popen[bytes] | None = None
        self.publisher: subprocess.Popen[bytes] | None = None
        self.absences: list[tuple[float, float]] = []
        self.kills = {"broker": 0, "publisher": 0}
        self.peaks = {"broker": 0.0, "publisher": 0.0}
        """The largest resident memory of each, in MiB."""
        self.buffered: list[tuple[float, int]] = []
        self.listening: asyncio.Task[None] | None = None

    async def start_broker(self) -> None:
        """Start the broker, subscribe, and only then let the publisher in."""
        import aiomqtt

        assert MOSQUITTO is not None
        self.broker = subprocess.Popen(
            [*self.prefixes[0], MOSQUITTO, "-c", str(self.broker_file)], stderr=subprocess.DEVNULL
        )
        subscribed: asyncio.Future[None] = asyncio.get_running_loop().create_future()

        async def listen() -> None:
            while True:
                with suppress(aiomqtt.MqttError):
                    async with aiomqtt.Client("127.0.0.1", self.broker_port) as client:
                        await client.subscribe("barewire/x/+/+", qos=0)
                        if not subscribed.done():
                            subscribed.set_result(None)
                        async for message in client.messages:
                            topic, payload = str(message.topic), message.payload
                            if isinstance(payload, bytes | bytearray) and b'"sequence"' in payload:
                                self.received.hear(topic, payload)
                                self.moments.append(time.monotonic())
                                self.delays.append(time.time() - json.loads(payload)["at"])
                if subscribed.done():
                    return
                await asyncio.sleep(0.05)

        self.listening = asyncio.create_task(listen())
        await subscribed
        await self.gate.open()

    async def kill_broker(self) -> None:
        """Kill the broker; what it has sent is still heard."""
        assert self.broker is not None
        assert self.listening is not None
        self.broker.send_signal(signal.SIGKILL)
        self.broker.wait(10)
        self.gate.close()
        await self.listening
        self.kills["broker"] += 1

    def start_publisher(self) -> None:
        """Start the publisher."""
        nowhere = subprocess.DEVNULL
        self.publisher = subprocess.Popen(
            [*self.prefixes[1], *publisher(self.file)], cwd=ROOT, stdout=nowhere, stderr=nowhere
        )

    def kill_publisher(self) -> None:
        """Kill the publisher."""
        assert self.publisher is not None
        self.publisher.send_signal(signal.SIGKILL)
        self.publisher.wait(10)
        self.kills["publisher"] += 1

    async def watch(self) -> None:
        """Record how many readings wait in the buffer, and the memory of the publisher."""
        while True:
            with (
                suppress(sqlite3.Error, OSError),
                closing(sqlite3.connect(f"file:{self.buffer}?mode=ro", uri=True)) as rows,
            ):
                (count,) = rows.execute("SELECT count(*) FROM reading").fetchone()
                self.buffered.append((time.monotonic(), count))
                for name, running in (("broker", self.broker), ("publisher", self.publisher)):
                    if running is not None and running.poll() is None:
                        self.peaks[name] = max(self.peaks[name], peak_memory(running))
            await asyncio.sleep(0.25)

    async def run(self, seconds: float) -> None:
        """Kill for so long; then wait until the buffer is empty."""
        await self.start_broker()
        self.start_publisher()
        watching = asyncio.create_task(self.watch())
        begin = time.monotonic()
        while time.monotonic() < begin + seconds:
            await asyncio.sleep(self.dice.uniform(1.0, self.steady))
            since = time.monotonic()
            which = self.dice.choice(self.victims)
            if which in ("broker", "both"):
                await self.kill_broker()
            if which in ("publisher", "both"):
                self.kill_publisher()
            await asyncio.sleep(self.dice.uniform(0.2, 4.0))
            if which in ("publisher", "both"):
                self.start_publisher()
            if which in ("broker", "both"):
                await self.start_broker()
            self.absences.append((since, time.monotonic()))
        until = time.monotonic() + _PATIENCE
        while time.monotonic() < until and not (self.buffered and self.buffered[-1][1] < 500):
            await asyncio.sleep(0.25)
        assert self.publisher is not None
        self.publisher.terminate()
        self.publisher.wait(20)
        await asyncio.sleep(1.0)
        watching.cancel()
        await self.kill_broker()
        self.kills["broker"] -= 1


def measure_outages(runs: int) -> list[str]:
    """Broker and publisher are killed at random: what arrives, in which order, and what is marked."""
    if not MOSQUITTO:
        return ["### Broker and publisher killed at random", "", "Not measured: mosquitto is not installed.", ""]
    seconds = 20.0 + 20.0 * runs
    with publishing(20, 0.5) as (file, broker, port):
        outages = Outages(file, broker, port, seed=1)
        start = time.monotonic()
        asyncio.run(outages.run(seconds))
        with closing(sqlite3.connect(outages.buffer)) as rows:
            (waiting,) = rows.execute("SELECT count(*) FROM reading").fetchone()
            (appended,) = rows.execute("SELECT seq FROM sqlite_sequence").fetchone()
    heard, shown = outages.received, 60.0
    picture = plot_over_time(
        "outages",
        "values in a second",
        [
            Curve.of_moments("at the subscriber", [at - start for at in outages.moments], shown),
            Curve(
                "waiting in the buffer",
                [at - start for at, _ in outages.buffered if at < start + shown],
                [float(count) for at, count in outages.buffered if at < start + shown],
                on_the_right=True,
            ),
        ],
        [(a - start, b - start) for a, b in outages.absences if b < start + shown],
        right="readings",
    )
    kills = f"The broker was killed {outages.kills['broker']} times, the publisher {outages.kills['publisher']} times"
    return [
        "### Broker and publisher killed at random",
        "",
        f"{kills}, in {seconds:g} s (SIGKILL; grey: until they were started again), while ten machines of twenty "
        "values were read twice a second.",
        "",
        "| | |",
        "|---|---:|",
        f"| readings in the buffer, all in all | {appended:,} |",
        f"| of these at the subscriber | {heard.latest - heard.missing:,} |",
        f"| waiting at the end | {waiting:,} |",
        f"| **missing** | {max(heard.missing, appended - waiting - heard.latest):,} |",
        f"| **out of order** | {heard.backwards:,} |",
        f"| came twice, and say so | {heard.again - heard.unmarked:,} |",
        f"| **came twice, and do not** | {heard.unmarked:,} |",
        f"| memory of the publisher at most | {outages.peaks['publisher']:.1f} MiB |",
        "",
        picture,
        "",
    ]
