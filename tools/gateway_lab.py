"""Measures the gateway beside others and under faults, and writes docs/reference/gateway.md: `make gateway-lab`.

    relay        processor time for one request, TCP to TCP, beside a relay of asyncio that understands nothing
    line         a serial line: requests in a second and processor time, 1 and 32 clients, beside mbusd and a gateway
                 of forty lines
    late         one answer in nine is late: right and wrong answers, beside mbusd
    dead         two units of ten are dead: what the living keep; a greedy client beside polite ones
    publish      values in a second from ten machines to Mosquitto
    faults       loss, noise, late and damaged answers at once, and a client that leaves every second

All of them are programs of their own, on pseudo-terminals and loopback. mbusd is used if its program is in PATH or
named by the variable MBUSD. Each number is the median of RUNS runs, which alternate.

    python tools/gateway_lab.py [RUNS] [SCENARIO ...]
"""

from __future__ import annotations

import asyncio
import json
import os
import platform
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "reference" / "gateway.md"
BEGIN, END = "<!-- made by tools/gateway_lab.py -->\n", "<!-- end -->\n"
MBUSD = os.environ.get("MBUSD") or shutil.which("mbusd")
BAUDRATE = 115200
READ = bytes.fromhex("00 00 00 06")


# Programs of their own, started as `python tools/gateway_lab.py --be NAME ARGUMENTS`


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


class _Answering(asyncio.Protocol):
    """The unit behind a TCP connection: it answers every read of two registers with their addresses."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport
        self.held = b""

    def data_received(self, data: bytes) -> None:
        self.held += data
        replies = []
        while len(self.held) >= 12:
            request, self.held = self.held[:12], self.held[12:]
            address = int.from_bytes(request[8:10], "big")
            values = address.to_bytes(2, "big") + (address + 1 & 0xFFFF).to_bytes(2, "big")
            replies.append(request[:4] + b"\0\x07" + request[6:8] + b"\x04" + values)
        self.transport.write(b"".join(replies))


class _Upstream(asyncio.Protocol):
    def __init__(self, client: _Relay) -> None:
        self.client = client

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport

    def data_received(self, data: bytes) -> None:
        self.client.transport.write(data)


class _Relay(asyncio.Protocol):
    """A relay that understands nothing: each client has a connection of its own behind it."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.waiting: list[bytes] = []
        self.up: _Upstream | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport
        self.task = asyncio.ensure_future(self._connect())

    async def _connect(self) -> None:
        loop = asyncio.get_running_loop()
        _, self.up = await loop.create_connection(lambda: _Upstream(self), "127.0.0.1", self.port)
        for data in self.waiting:
            self.up.transport.write(data)

    def data_received(self, data: bytes) -> None:
        if self.up is None:
            self.waiting.append(data)
        else:
            self.up.transport.write(data)


class _BareGateway:
    """A gateway from TCP to RTU of forty lines: one request after the other, a check of the CRC, and nothing else."""

    def __init__(self, path: str) -> None:
        import tty

        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd)
        self.queue: asyncio.Queue[tuple[bytes, Any]] = asyncio.Queue()
        self.received = b""
        self.arrived = asyncio.Event()
        asyncio.get_running_loop().add_reader(self.fd, self._read)

    def _read(self) -> None:
        self.received += os.read(self.fd, 512)
        self.arrived.set()

    async def carry_out(self) -> None:
        from barewire.rtu import crc16

        silence = 0.00175
        while True:
            request, transport = await self.queue.get()
            frame = request[6:]
            self.received = b""
            await asyncio.sleep(silence)
            os.write(self.fd, frame + crc16(frame).to_bytes(2, "little"))
            try:
                async with asyncio.timeout(0.5):
                    while len(self.received) < 5 or len(self.received) < 5 + self.received[2]:
                        self.arrived.clear()
                        await self.arrived.wait()
            except TimeoutError:
                transport.write(request[:4] + b"\0\x03" + request[6:7] + bytes((request[7] | 0x80, 0x0B)))
                continue
            body, check = self.received[:-2], self.received[-2:]
            if crc16(body).to_bytes(2, "little") == check:
                transport.write(request[:4] + len(body).to_bytes(2, "big") + body)


class _BareConnection(asyncio.Protocol):
    def __init__(self, gateway: _BareGateway) -> None:
        self.gateway = gateway

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport
        self.held = b""

    def data_received(self, data: bytes) -> None:
        self.held += data
        while len(self.held) >= 12:
            self.gateway.queue.put_nowait((self.held[:12], self.transport))
            self.held = self.held[12:]


async def _serve(make: Callable[[], asyncio.Protocol], port: int) -> None:
    await asyncio.get_running_loop().create_server(make, "127.0.0.1", port)
    _say("ready")
    await asyncio.Event().wait()


async def _serve_bare(path: str, port: int) -> None:
    gateway = _BareGateway(path)
    await asyncio.gather(gateway.carry_out(), _serve(lambda: _BareConnection(gateway), port))


def _field(faults: str, units: str, speed: str) -> None:
    """Units 1 to `units` on a new pseudo-terminal; every register holds its address."""
    from barewire import ModbusServer
    from barewire.modbus import Table

    tables = {unit: Table(holding_registers=list(range(65536))) for unit in range(1, int(units) + 1)}
    options: dict[str, Any] = {"faults": faults, "fault_delay": 0.15} if faults != "-" else {}
    with ModbusServer(f"rtu://pty?baudrate={BAUDRATE}&pace={speed}", tables, fault_seed=1, **options) as server:
        _say(server.url.partition("?")[0].removeprefix("rtu://"))
        signal.sigwait([signal.SIGTERM])


def _machines() -> None:
    """Units 1 to 10 on a TCP port."""
    from barewire import ModbusServer
    from barewire.modbus import Table

    tables = {unit: Table(200) for unit in range(1, 11)}
    with ModbusServer("tcp://127.0.0.1:0", tables) as server:
        _say(server.url)
        signal.sigwait([signal.SIGTERM])


async def _subscribe(port: int, seconds: float) -> None:
    """Count the values that a broker delivers."""
    import aiomqtt

    count = 0
    async with aiomqtt.Client("127.0.0.1", port) as client:
        await client.subscribe("barewire/x/+/+", qos=0)
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                async for _ in client.messages:
                    count += 1
    _say(str(count))


class Client:
    """A client that reads two registers, which hold their addresses, of one unit after the other."""

    def __init__(self, units: list[int], pipelined: int) -> None:
        self.units = units
        self.pipelined = pipelined
        self.right = self.wrong = self.declined = 0
        self.longest = 0.0
        self.asked: dict[int, tuple[int, float]] = {}
        self.number = 0

    async def run(self, port: int, until: float, start: int) -> None:
        """Ask until that time."""
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        self.number = start

        def ask() -> None:
            self.number += 1
            address, unit = self.number * 7 % 65000, self.units[self.number % len(self.units)]
            transaction = self.number & 0xFFFF
            self.asked[transaction] = address, time.monotonic()
            pdu = b"\x03" + address.to_bytes(2, "big") + b"\0\x02"
            writer.write(transaction.to_bytes(2, "big") + b"\0\0\0\x06" + bytes((unit,)) + pdu)

        for _ in range(self.pipelined):
            ask()
        while time.monotonic() < until:
            try:
                async with asyncio.timeout(max(0.01, until + 3.0 - time.monotonic())):
                    head = await reader.readexactly(6)
                    body = await reader.readexactly(int.from_bytes(head[4:6], "big"))
            except (TimeoutError, asyncio.IncompleteReadError):
                break
            address, asked_at = self.asked.pop(int.from_bytes(head[:2], "big"))
            self.longest = max(self.longest, time.monotonic() - asked_at)
            expected = address.to_bytes(2, "big") + (address + 1).to_bytes(2, "big")
            if body[1] & 0x80:
                self.declined += 1
            elif body[2:] == b"\x04" + expected:
                self.right += 1
            else:
                self.wrong += 1
            ask()
        writer.close()


async def _clients(port: int, seconds: float, count: int, units: int, greedy: int) -> None:
    """`count` clients, the first of which sends `greedy` requests at once. Prints what each got as JSON."""
    clients = [Client(list(range(1, units + 1)), greedy if place == 0 else 1) for place in range(count)]
    until = time.monotonic() + seconds
    await asyncio.gather(*(client.run(port, until, 1000 * place) for place, client in enumerate(clients)))
    _say(json.dumps([[row.right, row.wrong, row.declined, row.longest] for row in clients]))


def _be(name: str, *arguments: str) -> None:
    if name == "unit":
        asyncio.run(_serve(_Answering, int(arguments[0])))
    elif name == "relay":
        asyncio.run(_serve(lambda: _Relay(int(arguments[1])), int(arguments[0])))
    elif name == "bare":
        asyncio.run(_serve_bare(arguments[0], int(arguments[1])))
    elif name == "field":
        _field(*arguments)
    elif name == "machines":
        _machines()
    elif name == "subscriber":
        asyncio.run(_subscribe(int(arguments[0]), float(arguments[1])))
    elif name == "clients":
        port, seconds, count, units, greedy = arguments
        asyncio.run(_clients(int(port), float(seconds), int(count), int(units), int(greedy)))


# The measuring


class Program(subprocess.Popen[str]):
    """A program that was started, and the first line that it wrote."""

    first = ""


@contextmanager
def program(*command: str, is_ready: bool = True) -> Iterator[Program]:
    """Start a program; with `is_ready` wait for its first line."""
    running = Program(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        if is_ready and running.stdout is not None:
            running.first = running.stdout.readline().strip()
            if not running.first:
                raise OSError(f"{command} has ended")
        yield running
    finally:
        running.terminate()
        running.wait(10)


def part(name: str, *arguments: object) -> tuple[str, ...]:
    return (sys.executable, __file__, "--be", name, *map(str, arguments))


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def processor_time(running: Program) -> float:
    """Seconds that a program has been on a processor."""
    return int(Path(f"/proc/{running.pid}/schedstat").read_text().split()[0]) / 1e9


def peak_memory(running: Program) -> float:
    """The largest resident memory of a program, in MiB."""
    for line in Path(f"/proc/{running.pid}/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    raise OSError("no VmHWM")


@contextmanager
def gateway(backend: str, *, more: str = "") -> Iterator[tuple[Program, int]]:
    with TemporaryDirectory() as folder:
        file, port = Path(folder) / "gateway.toml", free_port()
        file.write_text(f'[[listen]]\nurl = "tcp://127.0.0.1:{port}?connections=400"\n[[backend]]\n{backend}\n{more}')
        with program(sys.executable, "-m", "barewire.gateway", str(file)) as running:
            yield running, port


@contextmanager
def mbusd(path: str, *, wait: int) -> Iterator[tuple[Program, int]]:
    assert MBUSD is not None
    port = free_port()
    options = ["-d", "-L", "-", "-v", "0", "-p", path, "-s", str(BAUDRATE), "-A", "127.0.0.1", "-P", str(port)]
    with program(MBUSD, *options, "-C", "128", "-N", "0", "-R", "2", "-W", str(wait), is_ready=False) as running:
        time.sleep(0.3)
        yield running, port


class Load(NamedTuple):
    """What clients got, and what it cost the gateway."""

    right: int
    wrong: int
    declined: int
    longest: float
    each: list[int]
    cost: float
    """Seconds of processor time for a request with a right answer."""
    rate: float


def load(running: Program, port: int, seconds: float, count: int, units: int, greedy: int = 1) -> Load:
    before = processor_time(running)
    output = subprocess.run(part("clients", port, seconds, count, units, greedy), capture_output=True, text=True)
    if output.returncode:
        raise OSError(output.stderr)
    rows = json.loads(output.stdout)
    right = sum(row[0] for row in rows)
    used = processor_time(running) - before
    return Load(
        right,
        sum(row[1] for row in rows),
        sum(row[2] for row in rows),
        max(row[3] for row in rows),
        [row[0] for row in rows],
        used / max(right, 1),
        right / seconds,
    )


def _line(path: str, timeout: float, units: int = 10) -> str:
    return f'name = "line"\nurl = "rtu://{path}?baudrate={BAUDRATE}"\nunits = "1-{units}"\ntimeout = {timeout}'


def median(values: list[float]) -> float:
    return statistics.median(values)


def measure_relay(runs: int) -> list[str]:
    lines = ["| clients | relay | gateway | ratio |", "|---|---:|---:|---:|"]
    behind, relayed = free_port(), free_port()
    backend = f'name = "b"\nurl = "tcp://127.0.0.1:{behind}"\nunits = "1-10"\nin_flight = 16'
    with program(*part("unit", behind)), program(*part("relay", relayed, behind)) as relay, gateway(backend) as own:
        for count in (1, 32):
            costs: dict[str, list[float]] = {"relay": [], "gateway": []}
            for _ in range(runs):
                costs["relay"].append(load(relay, relayed, 2.0, count, 10).cost)
                costs["gateway"].append(load(*own, 2.0, count, 10).cost)
            one, other = (1e6 * median(costs[name]) for name in ("relay", "gateway"))
            lines.append(f"| {count} | {one:.1f} us | {other:.1f} us | {other / one:.2f} |")
    return ["### TCP to TCP: processor time for a request", "", *lines, ""]


def measure_line(runs: int) -> list[str]:
    lines = ["| clients | | requests in a second | processor time for a request |", "|---|---|---:|---:|"]
    with (
        program(*part("field", "-", 10, 0)) as first,
        program(*part("field", "-", 10, 0)) as second,
        program(*part("field", "-", 10, 0)) as third,
    ):
        bare_port = free_port()
        with (
            gateway(_line(first.first, 0.5)) as own,
            program(*part("bare", second.first, bare_port)) as bare,
            mbusd(third.first, wait=500) if MBUSD else nullcontext(own) as other,
        ):
            for count in (1, 32):
                results: dict[str, list[Load]] = {}
                for _ in range(runs):
                    results.setdefault("barewire", []).append(load(*own, 3.0, count, 10))
                    results.setdefault("forty lines", []).append(load(bare, bare_port, 3.0, count, 10))
                    if MBUSD:
                        results.setdefault("mbusd, pause 2 ms", []).append(load(*other, 3.0, count, 10))
                for name, rows in results.items():
                    rate, cost = median([row.rate for row in rows]), 1e6 * median([row.cost for row in rows])
                    lines.append(f"| {count} | {name} | {rate:.0f} | {cost:.0f} us |")
    return ["### A serial line at 115200 bit/s, units that answer at once", "", *lines, ""]


def measure_late(runs: int) -> list[str]:
    lines = ["| | right | **wrong** | exceptions |", "|---|---:|---:|---:|"]
    results: dict[str, list[Load]] = {}
    for _ in range(runs):
        late = part("field", "late:0.111", 10, 0)
        with program(*late) as field, gateway(_line(field.first, 0.1), more="dead_after = 0") as own:
            results.setdefault("barewire", []).append(load(*own, 10.0, 8, 10))
        if MBUSD:
            with program(*late) as field, mbusd(field.first, wait=100) as other:
                results.setdefault("mbusd", []).append(load(*other, 10.0, 8, 10))
    for name, rows in results.items():
        total = [sum(getattr(row, key) for row in rows) for key in ("right", "wrong", "declined")]
        lines.append(f"| {name} | {' | '.join(f'{number:,}' for number in total)} |")
    text = f"Eight clients, ten units, {10 * runs} s; answers are late by 0.15 s, the time-out is 0.1 s."
    return ["### One answer in nine is late", "", text, "", *lines, ""]


def measure_dead(runs: int) -> list[str]:
    lines = ["| | all ten answer | two are dead, first 10 s | after that |", "|---|---:|---:|---:|"]
    shares: list[tuple[float, float, float]] = []
    for _ in range(runs):
        with program(*part("field", "-", 10, 0)) as field, gateway(_line(field.first, 0.3)) as own:
            whole = load(*own, 5.0, 32, 10).rate
        with program(*part("field", "-", 8, 0)) as field, gateway(_line(field.first, 0.3)) as own:
            begin = load(*own, 10.0, 32, 10).rate
            later = load(*own, 10.0, 32, 10).rate
        shares.append((whole, begin, later))
    whole, begin, later = (median(list(column)) for column in zip(*shares))
    lines.append(f"| right answers in a second, 32 clients | {whole:.0f} | {begin:.0f} | {later:.0f} |")
    with program(*part("field", "-", 10, 0)) as field, gateway(_line(field.first, 0.3)) as own:
        each = load(*own, 10.0, 10, 10, greedy=16).each
    polite = f"nine polite ones {min(each[1:])} to {max(each[1:])}"
    greedy = f"A client that sends 16 requests at once got {each[0]} answers, {polite}."
    return ["### Dead units, greedy clients", "", *lines, "", greedy, ""]


def measure_faults(runs: int) -> list[str]:
    kinds = "late:0.05,drop:0.05,flip:0.05,noise:0.05,split:0.05,exception:0.02"
    field = part("field", kinds, 10, 0)
    with program(*field) as line, gateway(_line(line.first, 0.1), more="dead_after = 3") as own:
        rows = [load(*own, 10.0, 8, 10) for _ in range(runs)]
        memory = peak_memory(own[0])
    right, wrong, declined = (sum(getattr(row, key) for row in rows) for key in ("right", "wrong", "declined"))
    faults = f"Faults in a quarter of the answers ({kinds.replace(':', ' ')})"
    text = f"{faults}: {right:,} right, {declined:,} exceptions, **{wrong} wrong**; {memory:.1f} MiB at most."
    return ["### Everything at once", "", text, ""]


def measure_publish(runs: int) -> list[str]:
    """One publisher, ten machines of a hundred values each, read as fast as it can; the broker is Mosquitto."""
    if not shutil.which("mosquitto"):
        return ["### Publishing", "", "Not measured: mosquitto is not installed.", ""]
    rates, costs, memories = [], [], []
    for _ in range(runs):
        with TemporaryDirectory() as folder, program(*part("machines")) as machines:
            meter = Path(folder) / "meter"
            meter.mkdir()
            (meter / "device.toml").write_text(
                'name = "meter"\ntitle = "Meter"\n[modbus]\nunit = 1\nfirst_register = 1\n'
            )
            (meter / "values.toml").write_text(
                "".join(
                    f'[[parameter]]\nname = "V{number}"\ntype = "u16"\ninput = {number}\naccess = "ro"\n'
                    for number in range(1, 101)
                )
            )
            port = free_port()
            names = ", ".join(f'"V{number}"' for number in range(1, 101))
            rows = "".join(
                f'[[publish.machine]]\nname = "m{unit}"\nurl = "{machines.first}?unit={unit}"\ndevice = "{meter}"\n'
                f"parameters = [{names}]\nevery = 0.001\non_change = false\n"
                for unit in range(1, 11)
            )
            file = Path(folder) / "gateway.toml"
            head = f'[publish]\nbroker = "mqtt://127.0.0.1:{port}"\nsite = "x"\nbuffer = "{folder}/buffer"\n'
            file.write_text(head + rows)
            broker = Path(folder) / "mosquitto.conf"
            broker.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
            with (
                program("mosquitto", "-c", str(broker), is_ready=False),
                program(sys.executable, "-m", "barewire.gateway", str(file)) as running,
            ):
                time.sleep(3.0)
                before = processor_time(running)
                counted = subprocess.run(part("subscriber", port, 10.0), capture_output=True, text=True, check=True)
                number = int(counted.stdout)
                rates.append(number / 10.0)
                costs.append((processor_time(running) - before) / max(number, 1))
                memories.append(peak_memory(running))
    rate, cost, memory = median(rates), 1e6 * median(costs), median(memories)
    text = f"{rate:,.0f} values in a second, {cost:.0f} us of processor time for each, {memory:.1f} MiB at most."
    return [
        "### Publishing",
        "",
        "Ten machines on TCP, a hundred values in one request each, SQLite, QoS 1:",
        "",
        text,
        "",
    ]


SCENARIOS = {
    "relay": measure_relay,
    "line": measure_line,
    "late": measure_late,
    "dead": measure_dead,
    "faults": measure_faults,
    "publish": measure_publish,
}


def main() -> None:
    """Measure and write the page."""
    if sys.argv[1:2] == ["--be"]:
        _be(*sys.argv[2:])
        return
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="?", type=int, default=5)
    parser.add_argument("scenarios", nargs="*", choices=[*SCENARIOS, []], help="default: all, and the page is written")
    given = parser.parse_args()
    lines: list[str] = []
    for name in given.scenarios or SCENARIOS:
        made = SCENARIOS[name](given.runs)
        sys.stdout.write("\n".join(made) + "\n")
        sys.stdout.flush()
        lines += made
    if given.scenarios:
        return
    conditions = f"CPython {platform.python_version()}, {os.cpu_count()} processors, {time.strftime('%Y-%m-%d')}."
    others = "mbusd 0.5.3" if MBUSD else "Without mbusd, which was not installed."
    text = PAGE.read_text(encoding="utf-8")
    before, after = text.partition(BEGIN)[0], text.partition(END)[2]
    PAGE.write_text(
        f"{before}{BEGIN}\n" + "\n".join(lines) + f"\n{conditions} {others}\n\n{END}{after}", encoding="utf-8"
    )


if __name__ == "__main__":
    main()
