#!/usr/bin/env python3
"""Makes the root file system of the container and runs the gateway in it, without a container engine:

    sudo .venv/bin/python packaging/container/try_root.py [ROOT]      an existing ROOT is not made again

As in the container: nothing but what make-root puts there, a user of its own without capabilities and new privileges,
everything read-only but /tmp and the volume, an empty /dev. Not as in a container: namespaces of network, processes and
users. Prints the size and what is not as it should be; then the status is 1.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.request import ProxyHandler, build_opener

from barewire import ModbusClient, ModbusServer, Table

HERE = Path(__file__).parent
LIMIT = 60e6
WAIT = 60.0

INSIDE = """
import json, os, sys
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
written = []
for folder in ("/", "/etc", "/etc/barewire", "/usr/lib", "/dev", "/tmp", "/var/lib/barewire"):
    try:
        open(folder + "/written", "w").close()
        written.append(folder)
    except OSError:
        pass
places = [(place, names) for place, _, names in os.walk("/") if not place.startswith("/proc")]
found = [os.path.join(place, name) for place, names in places for name in names]
programs = [path for path in found if path.startswith(("/bin", "/usr/bin", "/sbin")) or path.endswith("/sh")]
suid = [path for path in found if os.lstat(path).st_mode & 0o6000]
import aiomqtt, microdot, prometheus_client, serial, sqlite3, ssl
print(json.dumps({"user": os.getuid(), "group": os.getgid(), "capabilities": status["CapEff"].strip(),
    "no new privileges": status["NoNewPrivs"].strip(), "written": written, "programs": sorted(programs), "suid": suid,
    "devices": sorted(os.listdir("/dev")), "authorities": len(ssl.create_default_context().get_ca_certs()) > 50}))
"""

EXPECTED = {
    "user": 10001,
    "group": 20,
    "capabilities": "0000000000000000",
    "no new privileges": "1",
    "written": ["/tmp", "/var/lib/barewire"],
    "programs": ["/usr/bin/python3", "/usr/bin/python3.11"],
    "suid": [],
    "devices": ["null", "urandom"],
    "authorities": True,
}

CONFIG = """
[[listen]]
url = "tcp://127.0.0.1:{port}"
[[backend]]
name = "machine"
url = "{machine}"
units = "7"
[status]
url = "http://127.0.0.1:{status}"
[publish]
broker = "mqtt://127.0.0.1:9"
site = "x"
buffer = "/var/lib/barewire/buffer.sqlite"
[[publish.machine]]
name = "drive"
url = "tcp://127.0.0.1:{port}?unit=7"
device = "csd-mt"
parameters = ["Status Word"]
every = 0.2
on_change = false
"""


def free_ports(count: int) -> list[int]:
    """Ports on which nobody listens."""
    import socket

    probes = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [probe.getsockname()[1] for probe in probes]
    for probe in probes:
        probe.close()
    return ports


def use(root: Path, folder: Path) -> list[str]:
    """Run the gateway in this root, and return what is not as it should be."""
    port, status = free_ports(2)
    config, data = folder / "gateway.toml", folder / "data"
    data.mkdir()
    faults = []
    with ModbusServer("tcp://127.0.0.1:0", {7: Table(2000, holding_registers=[555] * 2000)}) as machine:
        config.write_text(CONFIG.format(port=port, status=status, machine=machine.url))
        config.chmod(0o644)
        command = [HERE / "run-root", root, config, data]
        seen = json.loads(subprocess.check_output([*command, "/usr/bin/python3", "-c", INSIDE]))
        faults += [f"{name}: {seen[name]}, expected {value}" for name, value in EXPECTED.items() if seen[name] != value]
        began = time.monotonic()
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
            assert running.stdout is not None
            assert running.stderr is not None
            first = running.stdout.readline()
            sys.stdout.write(f"after {time.monotonic() - began:.1f} s: {first}")
            try:
                with ModbusClient(f"tcp://127.0.0.1:{port}", unit=7, timeout=10) as client:
                    if client.read_holding_registers(107, 2) != (555, 555):
                        faults.append("a register of the machine is another one through the gateway")
                opener = build_opener(ProxyHandler({}))
                buffered, until = 0, time.monotonic() + WAIT
                while buffered < 3 and time.monotonic() < until:
                    with opener.open(f"http://127.0.0.1:{status}/status.json", timeout=10) as answer:
                        buffered = json.load(answer)["publisher"]["buffered"]
                    time.sleep(0.1)
                if buffered < 3 or not (data / "buffer.sqlite").exists():
                    faults.append(f"{buffered} readings in the buffer on the volume")
                running.send_signal(signal.SIGHUP)
                lines = iter(running.stderr.readline, "")
                reloaded = next((line for line in lines if "read again" in line or "stays" in line), "no line")
                if "read again" not in reloaded:
                    faults.append(f"after SIGHUP: {reloaded}")
            finally:
                running.terminate()
                with suppress(subprocess.TimeoutExpired):
                    running.wait(20)
            if running.returncode:
                faults.append(f"status {running.returncode} after SIGTERM")
    return faults


def main() -> int:
    """Make, measure and use the root."""
    if os.geteuid():
        sys.stderr.write("needed is root: to mount, and to be another user\n")
        return 2
    with TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        root = Path(sys.argv[1]) if len(sys.argv) > 1 else folder / "root"
        if not root.exists():
            subprocess.run([HERE / "make-root", root], check=True)
        size = sum(file.lstat().st_size for file in root.rglob("*") if file.is_file() and not file.is_symlink())
        faults = use(root, folder)
    if size > LIMIT:
        faults.append(f"{size / 1e6:.1f} MB, expected below {LIMIT / 1e6:.0f}")
    sys.stdout.write(f"{size / 1e6:.1f} MB, the gateway in it: {'; '.join(faults) or 'as it should be'}\n")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
