"""`make plant`, with few nodes for a short time."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.mark.long
def test_the_nodes_of_a_plant_boot_run_and_are_counted() -> None:
    command = [sys.executable, "-m", "bench.plant", "--nodes", "5", "--seconds", "0.5", "--rate", "20"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.startswith("5 nodes booted and configured from their DCFs")
    found = re.search(r"(\d+) of (\d+) TPDOs received, 0 nodes lost, 0 frames lost", run.stdout)
    assert found is not None, run.stdout
    assert found[1] == found[2] != "0"
    assert not int(found[1]) % 5
