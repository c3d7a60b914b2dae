"""One exchange from a client through the installed gateway to a unit: does a package of barewire work by itself?

    python3 exchange.py

Distributions run it when they build the package, and after they have installed it. The line to the unit is a
pseudo-terminal if pyserial is installed, and TCP if not. Everything stays on this machine.
"""

import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import barewire

GATEWAY = [sys.executable, "-W", "error", "-m", "barewire.gateway"]
CONFIG = """
[[listen]]
url = "tcp://127.0.0.1:0"

[[backend]]
name = "hall"
url = "{line}"
units = "5"
timeout = 10
"""


def exchange(line: str) -> str:
    """Start a unit on the line and the gateway before it, write and read, stop both; return what was done."""
    with barewire.ModbusServer(line, units={5: barewire.Table()}) as field, tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "gateway.toml")
        config.write_text(CONFIG.format(line=field.url))
        subprocess.run([*GATEWAY, "--check", config], check=True)
        with subprocess.Popen([*GATEWAY, config], stdout=subprocess.PIPE, text=True) as gateway:
            try:
                assert gateway.stdout is not None
                ready = gateway.stdout.readline().strip()
                if not ready.startswith("listening on tcp://"):
                    raise SystemExit(f"the gateway printed {ready!r}, expected where it listens")
                with barewire.ModbusClient(ready.split()[-1], unit=5, timeout=20) as client:
                    client.write_multiple_registers(107, [555, 0, 100])
                    values = client.read_holding_registers(107, 3)
            finally:
                gateway.terminate()
    if values != (555, 0, 100) or gateway.returncode != 0:
        raise SystemExit(f"read {values}, expected (555, 0, 100); the gateway ended with status {gateway.returncode}")
    return f"barewire {barewire.__version__} of {Path(barewire.__file__).parent}: {line}, through the gateway, {values}"


if __name__ == "__main__":
    print(exchange("rtu://pty" if find_spec("serial") else "rtu+tcp://127.0.0.1:0"))
