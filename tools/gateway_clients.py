"""Runs the configurations of the pages Node-RED, Telegraf and ESPHome against the gateway of each page.

    make gateway-clients                                     the programs of npm and PyPI, in build/gateway-clients
    make gateway-clients TELEGRAF=/usr/bin/telegraf          Telegraf too, which neither of them has

A page is what is tested: its blocks are read from docs/how-to, and only addresses that are not on this machine are
replaced: the serial port by a pseudo-terminal with a simulated unit 5, whose holding register N is 1000 + N, and ports
by free ones.

    Node-RED    imports the flow, in a folder of its own, without its editor
    ESPHome     validates every YAML; that of a client also becomes a program of Linux (platform host), by the C++ that
                ESPHome generates and the compiler of this machine, because its own build tools fetch a toolchain
    Telegraf    has its options compared with those of the plugin; with TELEGRAF= it gathers once
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import venv
from collections.abc import AsyncIterator, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from barewire import ModbusServer
from barewire.gateway import Gateway, read_config
from barewire.modbus import Table

ROOT = Path(__file__).parent.parent
WORK = ROOT / "build" / "gateway-clients"
LIMIT = 120.0
"""Seconds in which a program must have printed what is expected. Each takes less than ten."""

NODE_RED = {"node": "22.23.3", "node-red": "5.0.7", "node-red-contrib-modbus": "5.60.2", "modbus-serial": "8.0.25"}
ESPHOME = "2026.10.0"
HOST = "esphome:\n  name: host\nhost:\nlogger:\n  level: DEBUG\n"

TELEGRAF = {
    "": "name controller transmission_mode baud_rate data_bits parity stop_bits rs485 timeout busy_retries "
    "busy_retries_wait debug_connection workarounds configuration_type exclude_register_type_tag "
    "optimization optimization_max_register_fill metric",
    "metric": "slave_id byte_order measurement fields tags",
    "fields": "register address length name type scale output bit",
}
"""The options of the plugin in the style `metric`, from its source: influxdata/telegraf at b2726314 (1.40.0)."""


class Wrong(Exception):
    """What a page says does not hold."""


def blocks(page: str, language: str) -> list[str]:
    """Return the fenced blocks of one language of a page."""
    text = (ROOT / "docs" / "how-to" / f"{page}.md").read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def say(what: str) -> None:
    """Print one line."""
    sys.stdout.write(f"{what}\n")
    sys.stdout.flush()


def run(*command: object, cwd: Path = WORK) -> str:
    """Run a command and return its output. If it fails, end with that."""
    done = subprocess.run([*map(str, command)], cwd=cwd, capture_output=True, text=True, check=False)
    if done.returncode:
        raise Wrong(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout


@asynccontextmanager
async def gateway_of(text: str, written: list[tuple[int, list[int]]]) -> AsyncIterator[int]:
    """Run the gateway of a page, with a simulated unit 5 as its line. Yields its port; `written` gets the writes."""
    unit = Table(100, holding_registers=list(range(1000, 1100)))
    unit.on_write = lambda name, address, values: written.append((address, list(values)))
    with ModbusServer("rtu://pty", {5: unit}) as line:
        here = re.sub(r'"rtu:///dev/[^"]*"', f'"{line.url}"', re.sub(r"//[0-9.]+:\d+", "//127.0.0.1:0", text, count=1))
        async with Gateway(read_config(here)) as gateway:
            yield int(gateway.urls[0].rpartition(":")[2])


async def prints(expected: Iterable[str], *command: object, cwd: Path) -> str:
    """Run a program until it has printed every expected text, and end it. Returns what it printed."""
    program = await asyncio.create_subprocess_exec(
        *map(str, command), cwd=cwd, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    assert program.stdout is not None
    output = ""
    try:
        async with asyncio.timeout(LIMIT):
            while not all(text in output for text in expected) and (data := await program.stdout.read(4096)):
                output += data.decode(errors="replace")
    except TimeoutError:
        pass
    finally:
        if program.returncode is None:
            program.terminate()
        await program.communicate()
    if missing := [text for text in expected if text not in output]:
        raise Wrong(f"{command[0]} did not print {missing} in {LIMIT:g} s, but:\n{output}")
    return output


# Node-RED -------------------------------------------------------------------------------------------------------------


async def node_red() -> str:
    """Import the flow of the page and compare what the nodes report."""
    folder = WORK / "node-red"
    folder.mkdir(parents=True, exist_ok=True)
    direct = {name: version for name, version in NODE_RED.items() if name != "modbus-serial"}
    below = f"npm:modbus-serial@{NODE_RED['modbus-serial']}"  # the one that it asks for is not on npm
    package = {"private": True, "dependencies": direct, "overrides": {"@openp4nr/modbus-serial": below}}
    (folder / "package.json").write_text(json.dumps(package), encoding="utf-8")
    run(ROOT / "tools" / "with-node", "npm", "install", "--no-audit", "--no-fund", "--loglevel=error", cwd=folder)
    settings = "module.exports = {httpAdminRoot: false, httpNodeRoot: false, uiPort: 0}\n"
    (folder / "settings.js").write_text(settings, encoding="utf-8")
    (flow,), (config,) = blocks("node-red", "json"), blocks("node-red", "toml")
    written: list[tuple[int, list[int]]] = []
    async with gateway_of(config, written) as port:
        (folder / "flow.json").write_text(flow.replace('"1502"', f'"{port}"'), encoding="utf-8")
        values = "[ 1000, 1001, 1002, 1003 ]"
        dead = "[modbus-read:unit 6] Error: Modbus exception 11: Gateway target device failed to respond"
        expected = (values, dead, "value: 4711", *(f"v{NODE_RED[name]}" for name in ("node-red", "node")))
        red = folder / "node_modules" / "node-red" / "red.js"
        output = await prints(
            expected, folder / "node_modules" / ".bin" / "node", red, "-u", folder, "flow.json", cwd=folder
        )
    if written != [(7, [4711])] or "Timed out" in output:
        raise Wrong(f"unit 5 received {written}, Node-RED printed:\n{output}")
    return f"Node-RED {NODE_RED['node-red']}: values of unit 5, exception 11 of unit 6, register 7 written"


# ESPHome --------------------------------------------------------------------------------------------------------------


async def esphome() -> str:
    """Validate every YAML of the page; compile that of a client for this machine, and run it."""
    folder = WORK / "esphome"
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / "venv" / "bin" / "esphome"
    if not program.exists():
        venv.create(folder / "venv", with_pip=True)
        run(folder / "venv" / "bin" / "pip", "-q", "install", f"esphome=={ESPHOME}")
    (folder / "secrets.yaml").write_text("wifi_ssid: hall\nwifi_password: not-a-secret\n", encoding="utf-8")
    pages = blocks("esphome", "yaml")
    for number, text in enumerate(pages):
        (folder / f"{number}.yaml").write_text(text, encoding="utf-8")
        run(program, "config", f"{number}.yaml", cwd=folder)
    (client,) = (text for text in pages if "tcp_uart:" in text)
    (config,) = (text for text in blocks("esphome", "toml") if "rtu+tcp://0.0.0.0" in text)
    async with gateway_of(config, []) as port:
        here = HOST + client[client.index("tcp_uart:") :].replace("192.168.10.2", "127.0.0.1").replace(
            "1503", str(port)
        )
        (folder / "host.yaml").write_text(here.replace("update_interval: 10s", "update_interval: 1s"), encoding="utf-8")
        run(program, "compile", "--only-generate", "host.yaml", cwd=folder)
        await prints(
            ("'Grid voltage'", "Sensor new state: 1003.00"),
            compiled(folder / ".esphome" / "build" / "host"),
            cwd=folder,
        )
    return f"ESPHome {ESPHOME}: {len(pages)} configurations are valid, the client read 1003 through the gateway"


def compiled(build: Path) -> Path:
    """Compile the sources that ESPHome generated, and return the program."""
    flags = ("-std=gnu++20", "-O0", "-DUSE_HOST", "-DESPHOME_LOG_LEVEL=ESPHOME_LOG_LEVEL_DEBUG", "-I.")
    sources = [path.relative_to(build / "src") for path in sorted((build / "src").rglob("*.cpp"))]

    def compile_one(numbered: tuple[int, Path]) -> Path:
        number, source = numbered
        run("g++", *flags, "-c", source, "-o", build / f"{number}.o", cwd=build / "src")
        return build / f"{number}.o"

    with ThreadPoolExecutor(os.cpu_count()) as compilers:
        objects = list(compilers.map(compile_one, enumerate(sources)))
    run("g++", *objects, "-lpthread", "-o", build / "program", cwd=build)
    return build / "program"


# Telegraf -------------------------------------------------------------------------------------------------------------


async def telegraf() -> str:
    """Compare the options of the page with those of the plugin; run the program if it is named."""
    (config, ours) = blocks("telegraf", "toml")
    (inputs,) = tomllib.loads(ours)["inputs"]["modbus"]
    tables: list[tuple[str, dict[str, Any]]] = [("", inputs)]
    for metric in inputs["metric"]:
        tables += [("metric", metric), *(("fields", field) for field in metric["fields"])]
    unknown = {key for place, table in tables for key in table if key not in TELEGRAF[place].split()}
    if unknown:
        raise Wrong(f"the plugin modbus of Telegraf has no options {', '.join(sorted(unknown))}")
    program = os.environ.get("TELEGRAF", "")
    if not shutil.which(program):
        return "Telegraf: every option is one of its plugin; not run, because TELEGRAF= names no program"
    async with gateway_of(config, []) as port:
        file = WORK / "telegraf.conf"
        file.write_text(ours.replace(":1502", f":{port}"), encoding="utf-8")
        expected = ("meter,", "slave_id=5", "voltage=100", "slave 6 on controller")
        await prints(expected, program, "--test", "--config", file, cwd=WORK)
    return "Telegraf: values of slave 5, an error of slave 6"


def main() -> None:
    """Check the three pages."""
    if sys.version_info < (3, 12):
        sys.exit("ESPHome needs Python 3.12 or later: make gateway-clients PYTHON=python3.12 VENV=.venv-3.12")
    WORK.mkdir(parents=True, exist_ok=True)
    named = {"node-red": NODE_RED.values(), "esphome": (ESPHOME,), "telegraf": ("b2726314",)}
    for page, versions in named.items():
        text = (ROOT / "docs" / "how-to" / f"{page}.md").read_text(encoding="utf-8")
        if missing := [version for version in versions if version not in text]:
            sys.exit(f"docs/how-to/{page}.md does not name what is checked here: {', '.join(missing)}")
    for check in (telegraf, node_red, esphome):
        try:
            say(asyncio.run(check()))
        except Wrong as wrong:
            sys.exit(str(wrong))


if __name__ == "__main__":
    main()
