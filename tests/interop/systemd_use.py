"""Uses the unit of systemd as an administrator would: starts, reloads, kills, stops it. Run by systemd_guest.sh."""

from __future__ import annotations

import os
import pwd
import signal
import subprocess
import time
from pathlib import Path
from urllib.request import urlopen

from barewire import ModbusClient, ModbusServer, Table
from barewire.errors import BarewireError

UNIT = "barewire-gateway"
CONFIG = Path("/etc/barewire/gateway.toml")
PATIENCE = 240.0


def systemctl(*arguments: str) -> int:
    """Run systemctl and return its status."""
    return subprocess.run(["systemctl", *arguments], check=False, timeout=PATIENCE).returncode


def shown(name: str) -> str:
    """A property of the unit."""
    command = ["systemctl", "show", "--value", "-p", name, UNIT]
    return subprocess.run(command, check=True, timeout=PATIENCE, capture_output=True, text=True).stdout.strip()


def configure(machine: str, units: str) -> None:
    """Write the configuration."""
    CONFIG.write_text(
        f'[[listen]]\nurl = "tcp://127.0.0.1:1502"\n[[backend]]\nname = "hall"\nurl = "{machine}"\nunits = {units}\n'
        '[status]\nurl = "http://127.0.0.1:8502"\n[publish]\nbroker = "mqtt://127.0.0.1:9"\nsite = "x"\n'
        'buffer = "/var/lib/barewire/buffer.sqlite"\n[[publish.machine]]\nname = "drive"\nevery = 0.5\n'
        'on_change = false\nurl = "tcp://127.0.0.1:1502?unit=7"\ndevice = "csd-mt"\nparameters = ["Status Word"]\n'
    )
    CONFIG.chmod(0o640)
    subprocess.run(["chgrp", "barewire", CONFIG], check=True)


def answers(unit: int) -> bool:
    """Whether a unit can be read through the gateway, now or soon."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        try:
            with ModbusClient(f"tcp://127.0.0.1:1502?unit={unit}", timeout=10) as client:
                return client.read_holding_registers(107, 1) == (555,)
        except BarewireError:
            time.sleep(0.2)
    return False


def check(what: str, is_so: object) -> None:
    """Print a line."""
    print(f"{'ok' if is_so else 'NOT SO'}: {what}", flush=True)


def main() -> None:
    """Use the unit."""
    tables = {unit: Table(2000, holding_registers=[555] * 2000) for unit in (7, 8)}
    with ModbusServer("tcp://127.0.0.1:0", tables) as machine:
        configure(machine.url, '"7"')
        check("it starts", systemctl("start", UNIT) == 0)
        check("a unit answers through it", answers(7))
        pid = int(shown("MainPID"))
        rows = dict(row.split(":\t", 1) for row in Path(f"/proc/{pid}/status").read_text().splitlines() if ":\t" in row)
        check("its user is barewire", os.stat(f"/proc/{pid}").st_uid == pwd.getpwnam("barewire").pw_uid)
        check("it has no capability", int(rows["CapEff"], 16) == int(rows["CapBnd"], 16) == 0)
        check("no new privileges, and a filter of system calls", (rows["NoNewPrivs"], rows["Seccomp"]) == ("1", "2"))
        with urlopen("http://127.0.0.1:8502/metrics", timeout=PATIENCE) as answer:
            check("the status page and the metrics", b"barewire" in answer.read())
        check("the buffer is in /var/lib/barewire", Path("/var/lib/barewire/buffer.sqlite").exists())
        check("its memory is limited to 64 MB", shown("MemoryMax") == str(64 << 20))

        configure(machine.url, '"7-8"')
        check("it reloads", systemctl("reload", UNIT) == 0)
        check("a unit that is new answers", answers(8))
        check("it is the same process", int(shown("MainPID")) == pid)
        CONFIG.write_text("[[listen]]\nurl = 5\n")
        check("a faulty file is refused", systemctl("reload", UNIT) != 0)
        check("and changes nothing", answers(8) and int(shown("MainPID")) == pid)
        configure(machine.url, '"7"')

        os.kill(pid, signal.SIGKILL)
        check("it is started again when it was killed", answers(7) and int(shown("MainPID")) != pid)
        check("it stops", systemctl("stop", UNIT) == 0)
        check("with status 0", (shown("ExecMainStatus"), shown("Result")) == ("0", "success"))
        CONFIG.write_text("[[listen]]\nurl = 5\n")
        check(
            "a faulty file is status 2 at the start", systemctl("start", UNIT) != 0 and shown("Result") == "exit-code"
        )
    print("done", flush=True)


if __name__ == "__main__":
    main()
