"""The publisher: a task for each line, which polls and carries out commands, and one for the broker.

    line 1: poll, command, poll ...  ->  |
                                         |  Buffer  ->  broker task: connect, say what there is, send in order
    line 2: poll, poll ...           ->  |                     '-  commands, and Home Assistant's birth message

A slow or dead machine delays only its own line. While the broker is away, polling goes on and the buffer grows.
"""

from __future__ import annotations

import asyncio
import json
import math
import ssl
import time
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, unquote, urlsplit

from barewire.devices.device import Device
from barewire.devices.parameter import Reading
from barewire.errors import BarewireError, DecodeError, EncodeError, PortError, Refused
from barewire.gateway.dispatch import NO_PATH, NO_RESPONSE
from barewire.gateway.publish.buffer import Buffer
from barewire.gateway.publish.messages import (
    OFFLINE,
    ONLINE,
    Topics,
    description,
    discovery,
    reading_payload,
    with_sequence,
)
from barewire.gateway.publish.schedule import PollGroup, PollSchedule, ValueFilter
from barewire.io.endpoint import Endpoint
from barewire.io.log import PortLog
from barewire.io.machine import AsyncMachineClient
from barewire.io.modbus.async_client import AsyncModbusClient
from barewire.io.ports.network import reason
from barewire.modbus.exceptions import ModbusException

if TYPE_CHECKING:
    from aiomqtt import Client

_BATCH = 100
"""Readings under way to the broker at once."""
_PAUSES = (0.5, 30.0)
"""Seconds of the first and the longest pause between attempts to connect to the broker, or to use the buffer."""
_GOODBYE = 2.0
"""Seconds in which the broker has to take the last messages."""
_REFUSED_FOR = 60.0
"""Seconds after which a machine is asked again for parameters that it refused."""
_LAST_EXCHANGE = 5.0
"""Seconds in which an exchange that is under way may end when the publisher ends."""
_ENDS = "the publisher ends: the command was not carried out"
_COMMANDS = 16
"""Commands that wait for a line; further ones are refused."""


@dataclass(frozen=True)
class PolledMachine:
    """One machine: where it is, what is read, what may be written."""

    name: str
    url: str
    device: Device
    every: float
    parameters: tuple[str, ...]
    commands: tuple[str, ...] = ()
    on_change: bool = True
    dead_band: float = 0.0
    at_least: float = 60.0


@dataclass(frozen=True)
class PublishConfig:
    """A publisher. `broker` is mqtt://[USER:PASSWORD@]HOST[:PORT], or mqtts:// with `?ca=FILE` for an authority. No log
    and no error has it, because of the password."""

    broker: str = field(repr=False)
    site: str
    machines: tuple[PolledMachine, ...]
    buffer: str = ":memory:"
    limit: int = 100_000
    retain: bool = False
    """Whether the broker keeps the latest value of each parameter for clients that subscribe later."""
    home_assistant: str | None = None
    """The prefix of discovery, by default of Home Assistant `homeassistant`; None for none."""


def broker_options(url: str) -> dict[str, Any]:
    """Return the options of the MQTT client. Raises EncodeError for a wrong URL, PortError for a file that it names."""
    try:
        parts = urlsplit(url)
        query = parse_qs(parts.query, keep_blank_values=True)
        is_whole = parts.path in ("", "/") and not parts.fragment and not query.keys() - {"ca"}
        if parts.scheme not in ("mqtt", "mqtts") or not parts.hostname or not is_whole:
            raise ValueError
        if parts.password and not parts.username:
            raise ValueError
        port = parts.port
    except ValueError:
        raise EncodeError("broker: expected mqtt://[USER:PASSWORD@]HOST[:PORT] or mqtts://") from None
    options: dict[str, Any] = {"hostname": parts.hostname, "port": port or (8883 if parts.scheme == "mqtts" else 1883)}
    if parts.username:
        options |= {"username": unquote(parts.username), "password": unquote(parts.password or "")}
    if parts.scheme == "mqtts":
        try:
            options["tls_context"] = ssl.create_default_context(cafile=query.get("ca", [None])[0])
        except OSError as error:
            raise PortError(f"ca={query['ca'][0]}: {(error.strerror or str(error)).lower()}") from None
    return options


@dataclass
class _Command:
    machine: str
    parameter: str
    value: Any


@dataclass
class _Line:
    """The machines on one line or connection, which are asked one after the other."""

    schedule: PollSchedule
    machines: dict[str, PolledMachine]
    clients: dict[str, AsyncMachineClient]
    commands: asyncio.Queue[_Command | None] = field(default_factory=lambda: asyncio.Queue(_COMMANDS))
    """None only ends the wait for a command."""
    is_ending: bool = False


class Publisher:
    """A running publisher.

        async with Publisher(config): ...

    Raises PortError for a buffer that cannot be opened, ModuleNotFoundError without aiomqtt. A broker or a machine that
    cannot be reached is no error: it is tried again.
    """

    def __init__(self, config: PublishConfig, buffer: Buffer | None = None) -> None:
        import aiomqtt

        self.config = config
        self.buffer = Buffer(config.buffer, config.limit) if buffer is None else buffer  # one that is empty is false
        """`buffer`, which may be that of a publisher that ends when this one begins, or its own."""
        self.is_connected = False
        self._is_stopping = False
        self._pause = _PAUSES[0]
        self._mqtt = aiomqtt
        self._options = broker_options(config.broker)
        self._broker = f"{self._options['hostname']}:{self._options['port']}"
        self._topics = Topics(config.site)
        self._log = PortLog("barewire.publish", config.site)
        self._filters = {row.name: ValueFilter(row.on_change, row.dead_band, row.at_least) for row in config.machines}
        self._responds: dict[str, bool] = {}
        self._errors: dict[str, str] = {}
        """Why the latest read of a machine failed; empty if it did not."""
        self._news = asyncio.Event()  # there is something for the broker
        self._retained: dict[str, str] = {}  # what has to be told again after a reconnect
        self._results: deque[tuple[str, str]] = deque(maxlen=_COMMANDS * 4)
        self._tasks: list[asyncio.Task[None]] = []
        self._lines = self._make_lines()
        self._by_topic = {
            self._topics.parameter(row.name, name): (row.name, name) for row in config.machines for name in row.commands
        }

    def _make_lines(self) -> list[_Line]:
        now = asyncio.get_running_loop().time()
        places: dict[str, list[PolledMachine]] = {}
        for machine in self.config.machines:
            endpoint = Endpoint.parse(machine.url)
            places.setdefault(f"{endpoint.scheme}://{endpoint.place}", []).append(machine)
        lines = []
        for machines in places.values():
            shared: Any = None
            clients: dict[str, AsyncMachineClient] = {}
            for machine in machines:
                client = AsyncMachineClient(machine.device, machine.url, shared=shared)
                clients[machine.name] = client
                shared = shared or client.client
            groups = [PollGroup(row.name, row.parameters, row.every) for row in machines]
            lines.append(_Line(PollSchedule(groups, now), {row.name: row for row in machines}, clients))
        return lines

    async def __aenter__(self) -> Publisher:
        loop = asyncio.get_running_loop()
        self.buffer.limit = self.config.limit
        self._tasks = [loop.create_task(self._poll(line)) for line in self._lines]
        self._tasks.append(loop.create_task(self._serve_broker()))
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.stop()
        self.buffer.close()

    async def stop(self) -> None:
        """End, and tell the broker. The buffer stays open. What is under way on the lines ends first; commands that
        wait are not carried out."""
        *polling, broker = self._tasks
        await asyncio.gather(*(self._end(line, task) for line, task in zip(self._lines, polling)))
        with suppress(TimeoutError):  # a result that is interrupted would be sent twice
            async with asyncio.timeout(_GOODBYE):
                while self._results and self.is_connected:
                    await asyncio.sleep(0.01)
        self._is_stopping = True
        broker.cancel()
        await asyncio.gather(broker, return_exceptions=True)
        for topic, payload in self._results:
            self._log.warning("result", f"the broker did not take {topic} {payload}")

    async def _end(self, line: _Line, polling: asyncio.Task[None]) -> None:
        """End the polling of a line and close it, when no answer can come on it that its next client could get: that
        may be another publisher, which begins at once. On TCP answers have numbers, so there is nothing to wait for."""
        line.is_ending = True
        while not line.commands.empty():
            if (command := line.commands.get_nowait()) is not None:
                self._refuse(command, _ENDS)
        line.commands.put_nowait(None)
        await asyncio.wait([polling], timeout=_LAST_EXCHANGE)
        polling.cancel()
        await asyncio.gather(polling, return_exceptions=True)
        for machine in line.clients.values():
            client = machine.client
            if isinstance(client, AsyncModbusClient) and (client.connected or client.bus.state.pending):
                with suppress(BarewireError):
                    await client.settle()  # at most `late_window`
            await machine.close()

    def status(self) -> dict[str, Any]:
        """Return the state as values that JSON has."""
        groups = [group for line in self._lines for group in line.schedule.groups]
        now = asyncio.get_running_loop().time()
        return {
            "broker": self._broker,
            "connected": self.is_connected,
            "buffered": len(self.buffer),
            "dropped": self.buffer.dropped,
            "machines": [
                {
                    "name": group.machine,
                    "responds": self._responds.get(group.machine),
                    "error": self._errors.get(group.machine, ""),
                    "refused": group.refused,
                    "tried_again_in": max(0.0, group.due_at - now),
                    "failures": group.failures,
                    "missed": group.missed,
                }
                for group in groups
            ],
        }

    # The lines

    async def _poll(self, line: _Line) -> None:
        """Carry out a command or read what is due, in turn, so that neither holds up the other."""
        loop = asyncio.get_running_loop()
        while not line.is_ending:
            command = None
            with suppress(TimeoutError):
                async with asyncio.timeout_at(line.schedule.next().due_at):
                    command = await line.commands.get()
            if command is not None:
                await self._carry_out(line, command)
            group = line.schedule.next()
            if group.due_at <= loop.time() and not line.is_ending:
                has_readings = await self._read(line, group)
                line.schedule.done(group, loop.time(), has_failed=not has_readings)

    async def _read(self, line: _Line, group: PollGroup) -> bool:
        """Read a group, and put what is to be published into the buffer. Returns whether there are readings."""
        machine = line.machines[group.machine]
        try:
            readings = await self._readings(line, group)
        except BarewireError as error:
            self._log.warning(("read", machine.name), f"{machine.name}: {error}")
            self._set_responds(machine.name, False, str(error))
            group.refused = {}  # it may have restarted, or be another one
            return False
        except Exception as error:  # a poll must not end because of one machine
            text = f"{type(error).__name__}: {error}"
            self._log.error("code", f"{machine.name}: {text}", error)
            self._set_responds(machine.name, False, text)
            return False
        self._set_responds(machine.name, True)
        at, now = time.time(), asyncio.get_running_loop().time()
        passes = self._filters[machine.name].passes
        rows = [
            (self._topics.parameter(machine.name, reading.name), reading_payload(reading, at))
            for reading in readings
            if passes(reading.name, reading.value, now)
        ]
        if rows:
            try:
                self.buffer.append(rows)
            except PortError as error:
                self._log.error("buffer", f"{error}; {len(self.buffer)} readings wait")
            self._news.set()
        return bool(readings)

    async def _readings(self, line: _Line, group: PollGroup) -> list[Reading]:
        """Read a group without the parameters that the machine refuses. It is asked for these again after a while, and
        at once if it refuses all. Raises the error of a machine that does not respond."""
        client, now = line.clients[group.machine], asyncio.get_running_loop().time()
        is_again = now >= group.all_again_at or len(group.refused) == len(group.names)
        wanted = [name for name in group.names if is_again or name not in group.refused]
        refused = {} if is_again else dict(group.refused)
        readings: list[Reading] = []
        try:
            readings = await client.read_all(wanted)
        except (Refused, DecodeError) as error:
            if _is_of_gateway(error):
                raise
            for name in wanted:
                if line.is_ending:
                    return readings
                try:
                    readings += await client.read_all([name])
                except (Refused, DecodeError) as of_one:
                    if _is_of_gateway(of_one):
                        raise
                    refused[name] = str(of_one)
        for name in refused.keys() - group.refused.keys():
            self._log.warning(("refused", group.machine), f"{group.machine}: {name} is left out: {refused[name]}")
        if is_again:
            group.all_again_at = now + _REFUSED_FOR
        group.refused = refused
        return readings

    def _set_responds(self, machine: str, responds: bool, error: str = "") -> None:
        self._errors[machine] = error
        if self._responds.get(machine) is not responds:
            if responds and machine in self._responds:
                self._log.info(("read", machine), f"{machine}: responds again")
            self._responds[machine] = responds
            self._retained[self._topics.machine_status(machine)] = ONLINE if responds else OFFLINE
            self._news.set()

    async def _carry_out(self, line: _Line, command: _Command) -> None:
        outcome: dict[str, Any] = {"value": command.value}
        try:
            await line.clients[command.machine].write(command.parameter, command.value)
            outcome["ok"] = True
        except BarewireError as error:
            outcome |= {"ok": False, "error": str(error)}
        except Exception as error:
            outcome |= {"ok": False, "error": f"{type(error).__name__}: {error}"}
        except asyncio.CancelledError:
            self._refuse(command, "the publisher ended before the outcome: it may have been carried out")
            raise
        self._answer(command.machine, command.parameter, outcome)
        for group in line.schedule.groups if outcome["ok"] else ():
            if group.machine == command.machine and command.parameter in group.names:
                group.due_at = min(group.due_at, asyncio.get_running_loop().time())  # the new value is read at once

    def _refuse(self, command: _Command, why: str) -> None:
        self._answer(command.machine, command.parameter, {"value": command.value, "ok": False, "error": why})

    def _answer(self, machine: str, parameter: str, outcome: Mapping[str, Any]) -> None:
        topic = f"{self._topics.parameter(machine, parameter)}/result"
        self._results.append((topic, json.dumps(outcome)))  # ASCII: a command may have half a surrogate pair
        self._news.set()

    # The broker

    async def _serve_broker(self) -> None:
        """Stay connected to the broker. After it has taken readings, the pause between attempts is the first one again:
        one that takes none is no better than one that is away."""
        will = self._mqtt.Will(self._topics.status, OFFLINE, qos=1, retain=True)
        while True:
            client = self._mqtt.Client(**self._options, will=will, keepalive=15, timeout=10.0)
            client.pending_calls_threshold = 2 * _BATCH  # above it, each is a warning in the log
            try:
                async with client:
                    self.is_connected = True
                    self._log.info("connected", f"connected to {self._broker}")
                    try:
                        if self._is_stopping:  # the cancellation may be lost, see `_end_if_cancelled`
                            raise asyncio.CancelledError
                        async with asyncio.TaskGroup() as tasks:
                            tasks.create_task(self._listen(client))
                            tasks.create_task(self._send(client))
                    except asyncio.CancelledError:
                        await self._say_goodbye(client)
                        raise
            except* (self._mqtt.MqttError, PortError, OSError, TimeoutError) as error:
                why = _why(error.exceptions[0])
                self._log.warning("broker", f"{self._broker}: {why}; next attempt in {self._pause:g} s")
            except* Exception as error:  # the next attempt may do better than none
                first = error.exceptions[0]
                self._log.error("code", f"{type(first).__name__}: {first}; next attempt in {self._pause:g} s", first)
            finally:
                client._client.disconnect()  # aiomqtt leaves a connection open that the broker did not answer
            self.is_connected = False
            await asyncio.sleep(self._pause)
            self._pause = _longer(self._pause)

    async def _say_everything(self, client: Client) -> None:
        """Publish what is retained: birth, descriptions, discovery, and whether each machine responds."""
        for topic, payload in self._introduction():
            await client.publish(topic, payload, qos=1, retain=True)
        self._retained = {
            self._topics.machine_status(name): ONLINE if responds else OFFLINE
            for name, responds in self._responds.items()
        }
        await client.publish(self._topics.status, ONLINE, qos=1, retain=True)

    async def _say_goodbye(self, client: Client) -> None:
        """Publish the outcomes that wait, and that the polling has ended: the last will is for a lost connection."""
        with suppress(self._mqtt.MqttError, TimeoutError):
            async with asyncio.timeout(_GOODBYE):
                await self._send_results(client)
                for machine in self.config.machines:
                    await client.publish(self._topics.machine_status(machine.name), OFFLINE, qos=1, retain=True)
                await client.publish(self._topics.status, OFFLINE, qos=1, retain=True)

    def _introduction(self) -> list[tuple[str, str]]:
        messages = []
        for machine in self.config.machines:
            names = dict.fromkeys((*machine.parameters, *machine.commands))
            parameters = [machine.device.find(name) for name in names]
            commands = {machine.device.find(name).name for name in machine.commands}
            topic = f"{self._topics.machine(machine.name)}/description"
            messages.append((topic, description(machine.name, parameters, commands)))
            if self.config.home_assistant:
                messages += [
                    discovery(
                        self.config.home_assistant,
                        self._topics,
                        machine.name,
                        machine.device.title,
                        parameter,
                        is_command=parameter.name in commands,
                    )
                    for parameter in parameters
                ]
        return messages

    async def _send(self, client: Client) -> None:
        """Subscribe, say everything, send what there is, in order, and wait for more."""
        await client.subscribe(self._topics.commands, qos=1)
        if self.config.home_assistant:
            await client.subscribe(f"{self.config.home_assistant}/status", qos=1)
        await self._say_everything(client)
        pause, buffer_at = _PAUSES[0], None
        while True:
            self._news.clear()
            while self._retained:
                topic, payload = next(iter(self._retained.items()))
                await client.publish(topic, payload, qos=1, retain=True)
                if self._retained.get(topic) == payload:  # it may have changed meanwhile
                    del self._retained[topic]
            await self._send_results(client)
            _end_if_cancelled()
            has_sent, now = False, asyncio.get_running_loop().time()
            if buffer_at is None or now >= buffer_at:
                try:
                    has_sent = await self._send_readings(client)
                    pause, buffer_at = _PAUSES[0], None
                except PortError as error:  # of the buffer, so the broker is not left
                    self._log.error("buffer", f"{error}; tried again in {pause:g} s")
                    pause, buffer_at = _longer(pause), now + pause
            if not has_sent:
                with suppress(TimeoutError):
                    async with asyncio.timeout_at(buffer_at):
                        await self._news.wait()

    async def _send_readings(self, client: Client) -> bool:
        """Send the oldest readings, in order, and take them from the buffer. Returns whether there were any."""
        rows = self.buffer.batch(_BATCH)
        # Each is given to the client before the next; it keeps the order, and all wait for the broker together.
        await asyncio.gather(
            *(
                client.publish(
                    row.topic,
                    with_sequence(row.payload, row.sequence, again=row.was_sent),
                    qos=1,
                    retain=self.config.retain,
                )
                for row in rows
            )
        )
        if rows:
            self._pause = _PAUSES[0]
            self.buffer.acknowledged(rows[-1].sequence)
        return bool(rows)

    async def _send_results(self, client: Client) -> None:
        """Send the outcomes of commands. One that the broker did not take is sent again after a reconnect."""
        while self._results:
            result = self._results[0]
            await client.publish(*result, qos=1)
            if self._results[0] is result:  # it may have been dropped meanwhile
                self._results.popleft()

    async def _listen(self, client: Client) -> None:
        """Take commands, and Home Assistant's birth message."""
        async for message in client.messages:
            if message.retain:
                continue  # a command that was left there long ago is not carried out, and birth is not told again
            topic, payload = str(message.topic), message.payload
            data = payload if isinstance(payload, bytes | bytearray) else str(payload).encode()
            if topic == f"{self.config.home_assistant}/status":
                if data == b"online":
                    await self._say_everything(client)
                    _end_if_cancelled()
                    for known in self._filters.values():
                        known.forget()  # every state is published again with the next poll
                continue
            self._take_command(topic.removesuffix("/set"), bytes(data))

    def _take_command(self, topic: str, data: bytes) -> None:
        allowed = self._by_topic.get(topic)
        if allowed is None:
            self._log.warning("refused", f"a command to {topic}, which the configuration does not allow: refused")
            return
        machine, parameter = allowed
        try:
            value = json.loads(data)
            if not isinstance(value, int | float | str) or value in (math.inf, -math.inf) or value != value:
                raise ValueError
        except (ValueError, RecursionError):
            text = 'the payload is no value: expected JSON, such as 30, true or "text"'
            self._answer(machine, parameter, {"value": None, "ok": False, "error": text})
            return
        line = next(line for line in self._lines if machine in line.machines)
        command = _Command(machine, parameter, value)
        if line.is_ending:
            self._refuse(command, _ENDS)
        elif line.commands.full():
            self._refuse(command, "too many commands wait")
        else:
            line.commands.put_nowait(command)


def _longer(pause: float) -> float:
    return min(2 * pause, _PAUSES[1])


def _is_of_gateway(error: BarewireError) -> bool:
    """Whether a gateway between says that it cannot reach the machine, which is then no refusal of the machine."""
    return isinstance(error, ModbusException) and error.code in (NO_PATH, NO_RESPONSE)


def _end_if_cancelled() -> None:
    """Raise CancelledError if this task of a group was cancelled. aiomqtt waits with `asyncio.wait_for`, which before
    Python 3.12 keeps a cancellation to itself if the broker answers in that moment. (The task that runs the group has
    wrong counts of its own cancellations, before 3.13, after one of the group has failed.)"""
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError


def _why(error: BaseException) -> str:
    """Return the reason of an error of aiomqtt, which has that of the system only in its context."""
    cause = error.__cause__ or error.__context__
    return reason(cause) if isinstance(cause, OSError) else str(error)


def topics_that_collide(site: str, machines: Sequence[PolledMachine]) -> list[str]:
    """Return the topics that two machines or two parameters would have, because their names are too much alike."""
    topics = Topics(site)
    owners: dict[str, tuple[int, str]] = {}
    twice = [topic for topic, count in Counter(topics.machine(row.name) for row in machines).items() if count > 1]
    for place, machine in enumerate(machines):
        for name in dict.fromkeys((*machine.parameters, *machine.commands)):
            topic = topics.parameter(machine.name, name)
            if owners.setdefault(topic, (place, name)) != (place, name):
                twice.append(topic)
    return twice
