"""The program: python -m barewire.gateway CONFIG. It needs neither the workbench nor another package.

    python -m barewire.gateway --example > gateway.toml     a commented configuration
    python -m barewire.gateway --check gateway.toml         what is wrong in it: file:line:column
    python -m barewire.gateway gateway.toml                 run, until SIGTERM or Ctrl-C
    python -m barewire.gateway --status gateway.toml        what the running one does, from its status page

SIGHUP reads the file again: what is the same goes on without a break. SIGTERM and Ctrl-C answer what is under way
first. A faulty file is status 2, a port that cannot be opened is 1.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import signal
import sys
from pathlib import Path

from barewire.errors import BarewireError
from barewire.gateway.config import ConfigError, GatewayConfig, config_schema, example, read_config
from barewire.gateway.gateway import Gateway
from barewire.gateway.status import in_words
from barewire.io.log import PortLog


def run_program(arguments: list[str] | None = None) -> int:
    """Run the program and return its exit status."""
    parser = argparse.ArgumentParser(
        "python -m barewire.gateway", description="A Modbus gateway, and a publisher of values to an MQTT broker."
    )
    parser.add_argument("config", nargs="?", type=Path, metavar="CONFIG", help="the configuration, in TOML")
    parser.add_argument("--check", action="store_true", help="say what is wrong in CONFIG, and end")
    parser.add_argument("--status", action="store_true", help="print what the gateway of CONFIG does, and end")
    parser.add_argument("--example", action="store_true", help="print a commented configuration, and end")
    parser.add_argument("--schema", action="store_true", help="print the JSON schema of configurations, and end")
    parser.add_argument("--verbose", action="store_true", help="log connections and time-outs too")
    given = parser.parse_args(arguments)
    if given.example:
        print(example(), end="")
        return 0
    if given.schema:
        print(json.dumps(config_schema(), indent=2))
        return 0
    if given.config is None:
        parser.error("expected CONFIG; --example prints one")
    try:
        config = _read(given.config)
    except ConfigError as error:
        print(*(f"{given.config}:{fault}" for fault in error.faults), sep="\n", file=sys.stderr)
        return 2
    except (OSError, UnicodeDecodeError) as error:
        print(f"{given.config}: {getattr(error, 'strerror', None) or error}", file=sys.stderr)
        return 2
    if given.check:
        _print_summary(given.config, config)
        return 0
    if given.status:
        return _print_status(config)
    level = logging.INFO if given.verbose else logging.WARNING
    logging.basicConfig(level=level, format="%(asctime)s %(levelname)s %(name)s %(message)s", stream=sys.stderr)
    for name in ("barewire.gateway", "barewire.publish"):  # also what works again
        logging.getLogger(name).setLevel(logging.INFO)
    try:
        asyncio.run(_run(config, given.config))
    except BarewireError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def _print_summary(path: Path, config: GatewayConfig) -> None:
    machines = config.publish.machines if config.publish is not None else ()
    counts = ((len(config.listeners), "listener"), (len(config.backends), "backend"), (len(machines), "machine"))
    parts = [f"{number} {name}{'' if number == 1 else 's'}" for number, name in counts if number]
    print(f"{path}: {', '.join(parts)}: nothing wrong")
    for backend in config.backends:
        if units := ", ".join(map(str, backend.without_registers)):
            text = "no registers without [backend.unit.N] device or eds: only function 2B/0D reaches it"
            print(f"{path}: backend {backend.name!r}, unit {units}: {text}")


def _read(path: Path) -> GatewayConfig:
    return read_config(path.read_text(encoding="utf-8"))


def _print_status(config: GatewayConfig) -> int:
    """Print the state of the running gateway of a configuration, from its status page."""
    if config.status is None:
        print("the configuration has no [status] url, from which it could be asked", file=sys.stderr)
        return 2
    from urllib.request import ProxyHandler, build_opener

    try:
        with build_opener(ProxyHandler({})).open(f"{config.status.rstrip('/')}/status.json", timeout=5.0) as answer:
            state = json.load(answer)
    except (OSError, ValueError) as error:
        print(f"{config.status}: {getattr(error, 'reason', error)}", file=sys.stderr)
        return 1
    print(*in_words(state), sep="\n")
    return 0


async def _run(config: GatewayConfig, path: Path) -> None:
    log = PortLog("barewire.gateway", str(path))
    gateway = Gateway(config)
    must_reload = asyncio.Event()
    loop = asyncio.get_running_loop()
    # Not `loop.add_signal_handler`, which Windows does not have; there is no SIGHUP there either.
    actions = {"SIGTERM": gateway.stop, "SIGINT": gateway.stop, "SIGHUP": must_reload.set}
    for name, action in actions.items():
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), lambda *_, action=action: loop.call_soon_threadsafe(action))
    async with gateway:
        parts = [f"listening on {', '.join(gateway.urls)}"] if gateway.urls else []
        if gateway.publisher is not None:
            parts.append(f"publishing to {gateway.publisher.status()['broker']}")
        print("; ".join(parts), flush=True)
        log.info("start", "running")
        stopping = loop.create_task(gateway.stopping.wait())
        while not stopping.done():
            reloading = loop.create_task(must_reload.wait())
            await asyncio.wait([stopping, reloading], return_when=asyncio.FIRST_COMPLETED)
            reloading.cancel()
            if must_reload.is_set():
                must_reload.clear()
                try:
                    await gateway.reload(_read(path))
                    log.info("reload", "the configuration was read again")
                except (BarewireError, OSError, UnicodeDecodeError) as error:
                    log.error("reload", f"the configuration stays as it was: {error}")
        log.info("end", f"ending: what is under way has {gateway.config.drain:g} s")


if __name__ == "__main__":
    sys.exit(run_program())
