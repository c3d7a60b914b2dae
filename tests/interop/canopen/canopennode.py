"""CANopenNode's demo device under our conformance battery, and its test scripts against our device and our gateway.

    python -m tests.interop.canopen.canopennode conform DEVICE EDS [OPTIONS OF barewire conform]
    python -m tests.interop.canopen.canopennode scripts TESTS COCOMM GATEWAY DEVICE EDS [GATEWAY_EDS]

DEVICE is its demo program for Linux, EDS its `demoDevice.eds`, TESTS is the folder with `running_canopen` and `libs`,
COCOMM its command line client. GATEWAY is its `canopend`. GATEWAY or DEVICE may be `ours`: our gateway as node 1, with
the objects of GATEWAY_EDS if it is given, and our device as node 4 with those of EDS. The programs are built outside of
this repository. Everything runs on vcan0 in the guest kernel of `guest`; the exit status is that of the command.

    GATEWAY   ----  vcan0  ----  DEVICE      node 1, and node 4, which is started again whenever it ends: it ends at
                                             each NMT reset node
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import barewire
from barewire.errors import BarewireError
from tests.helpers import BAREWIRE
from tests.interop.canopen.guest import in_guest

OURS = "ours"
BUS = "can://socketcan/vcan0"
NODE, GATEWAY_NODE, PORT = 4, 1, 4501
WORK = Path("/run/tmp")
LOGS = Path("/run/job")
BATTERY, SCRIPTS = "conform", "scripts"
FILES = ("basic_NMT_SDO_heartbeat.bats", "heartbeat_consumer.bats", "SDO_transfer.bats")


@contextlib.contextmanager
def kept_running(command: Sequence[str], name: str) -> Iterator[None]:
    """Run a program, in a directory of its own, and start it again whenever it ends."""
    directory = WORK / name
    directory.mkdir()
    ended = threading.Event()
    running: list[subprocess.Popen[bytes]] = []

    def keep() -> None:
        with (LOGS / f"{name}.log").open("wb") as log:
            while not ended.is_set():
                running[:] = [subprocess.Popen(command, cwd=directory, stdout=log, stderr=subprocess.STDOUT)]
                running[0].wait()

    thread = threading.Thread(target=keep, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        for process in running:
            process.kill()
        thread.join(10)


def with_factory_settings(*nodes: int) -> None:
    """Restore the defaults of programs of CANopenNode: without its files a device reports an error and cannot start."""
    with barewire.CanopenClient(BUS) as bus:
        for node in nodes:
            until_it_answers(bus, node)
            bus.node(node).sdo.download(0x1011, 1, b"load")
            bus.node(node).nmt.reset()
            time.sleep(1.0)  # it sends the boot-up message of its new process
            until_it_answers(bus, node)


def until_it_answers(bus: barewire.CanopenClient, node: int) -> None:
    """Wait until a node answers an upload."""
    until = time.monotonic() + 30
    while True:
        try:
            bus.node(node).sdo.upload(0x1000, timeout=0.2)
            return
        except BarewireError:
            if time.monotonic() > until:
                raise
            time.sleep(0.1)


def conform(device: str, eds: str, *options: str) -> int:
    """Run the battery against the demo device."""
    with kept_running([device, "vcan0", "-i", str(NODE)], "device"):
        with_factory_settings(NODE)
        command = [BAREWIRE, "conform", f"{BUS}?node={NODE}&timeout=0.2", "--eds", eds]
        return subprocess.run([*command, *options], check=False).returncode


def scripts(tests: str, cocomm: str, gateway: str, device: str, eds: str, gateway_eds: str = "") -> int:
    """Run the three test scripts."""
    socket = str(WORK / "commands")
    with contextlib.ExitStack() as stack:
        environment = {**os.environ, "cocomm": cocomm, "test_can_device": "vcan0"}
        if device == OURS:
            stack.enter_context(our_device(eds))
        else:
            stack.enter_context(kept_running([device, "vcan0", "-i", str(NODE)], "device"))
        if gateway == OURS:
            serve = [BAREWIRE, "canopen-gateway", BUS, "--node-id", str(GATEWAY_NODE)]
            own_objects = ["--eds", gateway_eds] if gateway_eds else []
            stack.enter_context(kept_running([*serve, "--listen", f"127.0.0.1:{PORT}", *own_objects], "gateway"))
            environment |= {"cocomm_host": "127.0.0.1", "cocomm_port": str(PORT)}
        else:
            command = [gateway, "vcan0", "-i", str(GATEWAY_NODE), "-c", f"local-{socket}"]
            stack.enter_context(kept_running(command, "gateway"))
            environment |= {"cocomm_socket": socket}
        with_factory_settings(*(node for node, who in ((NODE, device), (GATEWAY_NODE, gateway)) if who != OURS))
        if gateway == OURS:
            with barewire.CanopenClient(BUS) as bus:
                until_it_answers(bus, GATEWAY_NODE)
        shutil.copytree(tests, WORK / "tests")
        folder = WORK / "tests" / "running_canopen"
        bats = [str(WORK / "tests" / "libs" / "bats-core" / "bin" / "bats"), "--tap"]
        done = [subprocess.run([*bats, file], cwd=folder, env=environment, check=False) for file in FILES]
        return max(run.returncode for run in done)


@contextlib.contextmanager
def our_device(eds: str) -> Iterator[None]:
    """Run our device with the objects of an EDS."""
    with barewire.CanopenServer(f"{BUS}?node={NODE}", eds=eds):
        yield


def main(arguments: list[str]) -> int:
    """Run a command in the guest; there, this module runs again."""
    actions: dict[str, Callable[..., int]] = {BATTERY: conform, SCRIPTS: scripts}
    if arguments and arguments[0] == "--inside":
        return actions[arguments[1]](*arguments[2:])
    if len(arguments) < 3 or arguments[0] not in actions:
        sys.stderr.write(__doc__ or "")
        return 2
    options = [str(Path(word).resolve()) if Path(word).exists() else word for word in arguments[1:]]
    with in_guest([sys.executable, "-m", __spec__.name, "--inside", arguments[0], *options], {}, timeout=1500) as done:
        sys.stdout.write(done.out)
        sys.stderr.write(done.err)
        if done.status is None:
            sys.stderr.write(done.console)
        return 70 if done.status is None else done.status


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
