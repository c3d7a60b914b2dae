"""The gateway on a small machine: in a control group of Linux with little memory and a part of a processor.

    make small-machine, or .venv/bin/python -m tools.small_machine [gateway] [everything] [path]

    gateway       28 MiB   one program: a line with faults, one whose adapter is pulled out, eight clients
    everything    44 MiB   one program: also TLS, status page, metrics, a CAN bus, and values to a broker with a buffer
    path          64 MiB   from the sensor to the broker: the gateway and Mosquitto together, in the whole machine

Each has a fifth of a processor (--cpu), for --seconds. Sensors, clients, subscriber and this script are outside of the
group: they are other machines. A broker outside, or in `path` inside, is killed now and then. Nothing is changed on
this machine but the control group, which is removed. It needs Linux, root, Mosquitto, and what `make test` installs.
"""

from __future__ import annotations

import argparse
import asyncio
import socket
import sqlite3
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple
from urllib.request import ProxyHandler, build_opener

from tests.certificates import authority, leaf, tls_url
from tools.gateway_lab.broker import Outages, machine, meter
from tools.gateway_lab.control_group import ControlGroup, NoControlGroup
from tools.gateway_lab.programs import (
    MOSQUITTO,
    Load,
    free_port,
    gateway,
    line,
    load,
    median,
    peak_memory,
    program,
    stand_in,
)

FAULTS = "late:0.03,drop:0.03,flip:0.03,noise:0.03,split:0.03"
UNITS = 5
VALUES = 10

NODE = """
import signal, sys
from barewire import CanopenServer
with CanopenServer(sys.argv[1] + "?node=5", device="az3"):
    print("ready", flush=True)
    signal.sigwait([signal.SIGTERM])
"""


class Result(NamedTuple):
    """What a machine of this size did."""

    resident: dict[str, float]
    """The largest resident memory of each program in the group, in MiB, with the files that it shares with others."""
    did: list[str]


@contextmanager
def lines(folder: Path, pace: int) -> Iterator[tuple[str, str]]:
    """Two serial lines with five units each: one with faults, and one whose adapter is pulled out; their paths."""
    path = f"{folder}/adapter"
    with program(*stand_in("field", FAULTS, 2 * UNITS, pace)) as field, program(*stand_in("adapter", path, UNITS, 1)):
        yield field.first, path


def run_gateway(group: ControlGroup, seconds: float) -> Result:
    """The gateway alone, with eight clients who ask as fast as they can."""
    with TemporaryDirectory() as name, lines(Path(name), 0) as (faulty, pulled):
        backends = (
            f"{line(pulled, 0.3, '1-5', 'pulled')}\n[[backend]]\n{line(faulty, 0.3, '6-10', 'faulty')}\ndead_after = 5"
        )
        with gateway(backends, prefix=group.enter) as own:
            total = load(*own, seconds, 8, pause=0.05)
            return Result({"gateway": peak_memory(own[0])}, [f"Modbus: {total.summary}"])


def wait_for(port: int, until: float) -> None:
    """Wait until somebody listens."""
    while time.monotonic() < until:
        with suppress(OSError):
            socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
            return
        time.sleep(0.1)


def looking(port: int, until: float) -> str:
    """Ask for the status page, its data and the metrics again and again."""
    wait_for(port, until)
    url = f"http://127.0.0.1:{port}"
    count = failed = 0
    opener = build_opener(ProxyHandler({}))
    while time.monotonic() < until:
        for page in ("/", "/status.json", "/metrics"):
            try:
                with opener.open(url + page, timeout=20.0) as answer:
                    count += bool(answer.read())
            except OSError:
                failed += 1
        time.sleep(0.5)
    return f"status page and metrics: {count} answers, {failed} failed"


def over_tls(port: int, folder: Path, until: float) -> str:
    """Connect by TLS, read, and leave, again and again."""
    from barewire import ModbusClient
    from barewire.errors import BarewireError

    wait_for(port, until)
    url = f"{tls_url(folder, 'client', f'127.0.0.1:{port}')}&unit=6&timeout=10&server_name=localhost"
    count = failed = 0
    while time.monotonic() < until:
        try:
            with ModbusClient(url) as client:
                count += client.read_holding_registers(7, 1) == (7,)
        except BarewireError:
            failed += 1
        time.sleep(0.2)
    return f"new TLS connections: {count} with a right answer, {failed} with a time-out or fault of the line"


def ask_when_ready(port: int, seconds: float) -> Load:
    """Two clients with ten requests a second each, as soon as the gateway listens."""
    until = time.monotonic() + seconds
    wait_for(port, until)
    return load(None, port, until - time.monotonic(), 2, every=0.1)


def delivered(outages: Outages) -> str:
    """Say what became of the readings."""
    with closing(sqlite3.connect(outages.buffer)) as rows:
        (waiting,) = rows.execute("SELECT count(*) FROM reading").fetchone()
        (appended,) = rows.execute("SELECT seq FROM sqlite_sequence").fetchone()
    heard = outages.received
    missing = max(heard.missing, appended - waiting - heard.latest)
    wrong = heard.unmarked + heard.backwards
    return (
        f"readings: {heard.latest:,} at the subscriber, half of them within {median(outages.delays):.2f} s; "
        f"**{missing} missing, {wrong} out of order or twice without a mark**; broker killed "
        f"{outages.kills['broker']} times"
    )


def publishing(group: ControlGroup, seconds: float, *, is_everything: bool) -> Result:
    """Values from a serial line through the gateway to a broker; with `is_everything` all other parts of it too."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        faulty, pulled = stack.enter_context(lines(folder, 1))
        port, secure, status, broker = (free_port() for _ in range(4))
        parts = [f'[[listen]]\nurl = "tcp://127.0.0.1:{port}"']
        parts += [f"[[backend]]\n{line(pulled, 0.3, '1-5', 'pulled')}"]
        parts += [f"[[backend]]\n{line(faulty, 0.3, '6-10', 'faulty')}\ndead_after = 5"]
        if is_everything:
            authority(folder)
            leaf(folder, "server", server=True)
            leaf(folder, "client", role="Operator")
            bus = f"can://socketcand/127.0.0.1:{free_port()}/can0"
            stack.enter_context(program(sys.executable, "-c", NODE, bus))
            parts += [f'[[listen]]\nurl = "{tls_url(folder, "server", f"127.0.0.1:{secure}")}"']
            parts += [
                f'[[backend]]\nname = "bus"\nurl = "{bus}"\nunits = "20"\n[backend.unit.20]\nas = 5\ndevice = "az3"'
            ]
            parts += [f'[status]\nurl = "http://127.0.0.1:{status}"']
            az3 = (
                f'name = "drive"\nurl = "tcp://127.0.0.1:{port}?unit=20"\ndevice = "az3"\nparameters = ["STATUS WORD"]'
            )
            parts += [f"[[publish.machine]]\n{az3}\nevery = 1.0"]
        device = meter(folder, VALUES, table="holding")
        parts += [
            machine(f"m{unit}", f"tcp://127.0.0.1:{port}?unit={unit}&timeout=5", device, VALUES, 1.0)
            for unit in range(1, 2 * UNITS + 1)
        ]
        head = f'[publish]\nbroker = "mqtt://127.0.0.1:{broker}"\nsite = "x"\nbuffer = "{folder}/buffer"\n'
        (folder / "gateway.toml").write_text(f'{head}home_assistant = "homeassistant"\n' + "\n".join(parts))
        (folder / "mosquitto.conf").write_text(f"listener {broker} 127.0.0.1\nallow_anonymous true\n")
        prefixes = ((), group.enter) if is_everything else (group.enter, group.enter)
        files = folder / "gateway.toml", folder / "mosquitto.conf"
        outages = Outages(*files, broker, 1, ("broker",), prefixes, steady=10.0)
        until = time.monotonic() + seconds
        threads = stack.enter_context(ThreadPoolExecutor())
        asking: Future[Load] = threads.submit(ask_when_ready, port, seconds)
        others: list[Future[str]] = []
        if is_everything:
            others.append(threads.submit(looking, status, until))
            others.append(threads.submit(over_tls, secure, folder, until))
        asyncio.run(outages.run(seconds))
        did = [f"Modbus: {asking.result().summary}", delivered(outages), *(row.result() for row in others)]
        resident = {"gateway": outages.peaks["publisher"]}
        return Result(resident if is_everything else resident | {"Mosquitto": outages.peaks["broker"]}, did)


def run_everything(group: ControlGroup, seconds: float) -> Result:
    """The gateway with all its parts."""
    return publishing(group, seconds, is_everything=True)


def run_path(group: ControlGroup, seconds: float) -> Result:
    """The gateway and the broker."""
    return publishing(group, seconds, is_everything=False)


SIZES: dict[str, tuple[int, str, Callable[[ControlGroup, float], Result]]] = {
    "gateway": (28, "gateway alone", run_gateway),
    "everything": (44, "with TLS, status page, metrics, MQTT, SQLite, CANopen", run_everything),
    "path": (64, "sensor to broker: gateway with publisher, and Mosquitto", run_path),
}


def rows(names: Sequence[str], seconds: float, cpu: float, memory: int | None = None) -> Iterator[str]:
    """Run these, and yield the rows of a table. Raises NoControlGroup."""
    with ControlGroup(64, cpu):
        pass  # it can be made here
    yield "| | limit | charged at most | resident at most | periods used up | killed | |"
    yield "|---|---:|---:|---|---:|---:|---|"
    for name in names:
        size, what, run = SIZES[name]
        with ControlGroup(memory or size, cpu) as group:
            result = run(group, seconds)
            resident = ", ".join(f"{program} {peak:.1f} MiB" for program, peak in result.resident.items())
            limits = f"{group.memory} MiB | {group.peak:.1f} MiB | {resident} | {group.throttled:.0%}"
            yield f"| {what} | {limits} | {group.killed} | {'; '.join(result.did)} |"


def measure_memory(runs: int) -> list[str]:
    """Memory and a fifth of a processor, in a control group."""
    title = "### On a small machine"
    try:
        table = list(rows(list(SIZES), 20.0 + 20.0 * runs, 0.2))
    except NoControlGroup as error:
        return [title, "", f"Not measured: {error}.", ""]
    text = (
        "A fifth of a processor, and so much memory that the kernel kills what needs more (`make small-machine`). "
        "Two serial lines of five units: one with faults in every seventh answer, one whose adapter is pulled out "
        "again and again; the exceptions are 0A and 0B of these. The broker is killed now and then. *Charged* is what "
        "the control group counts, without the pages of shared libraries that another program has read before; "
        "*resident* has them. *Used up*: in which part of the periods of 0.1 s the programs had to wait."
    )
    return [title, "", text, "", *table, ""]


def main() -> int:
    """Run what was asked for, and print the table."""
    parser = argparse.ArgumentParser(
        "small_machine", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", choices=[*SIZES, []], metavar="NAME", help="default: all three")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each, default 60")
    parser.add_argument("--cpu", type=float, default=0.2, help="processors, default 0.2")
    parser.add_argument("--memory", type=int, help="MiB, in place of the limits above")
    given = parser.parse_args()
    if not MOSQUITTO:
        sys.stderr.write("mosquitto is not installed\n")
        return 2
    try:
        for row in rows(given.names or list(SIZES), given.seconds, given.cpu, given.memory):
            sys.stdout.write(f"{row}\n")
            sys.stdout.flush()
    except NoControlGroup as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
