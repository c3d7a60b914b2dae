"""The command as one file, a zipapp: `devices`, `simulate` and `read` run from the archive, without the venv.

The archive has both packages and what the extras `cli` and `serial` need, copied from the packages of this environment.
"""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import zipapp
from importlib.metadata import distribution
from pathlib import Path

import pytest

import barewire
from tests.helpers import part_or_whole, some_of
from tests.workbench.cli.helpers import ENVIRONMENT
from tools.rooms import HOUSES

NEEDED = ("click", "rich", "markdown-it-py", "mdurl", "pygments", "pyserial")
"""The packages of the extras `cli` and `serial`; `pip install --target` finds them by itself."""


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    content = tmp_path_factory.mktemp("content")
    for package, folder in HOUSES.items():
        shutil.copytree(folder / package, content / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in NEEDED:
        for file in distribution(name).files or ():
            if file.suffix != ".pyc" and ".." not in file.parts:
                target = content / file
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(str(file.locate()), target)
    made = tmp_path_factory.mktemp("archive") / "barewire.pyz"
    zipapp.create_archive(content, made, main="barewire_workbench.cli:main", compressed=True)
    return made


def command(archive: Path, *arguments: str) -> list[str]:
    """-I: no PYTHONPATH, no user packages; -S: not those of the environment either."""
    return [sys.executable, "-I", "-S", str(archive), *arguments]


def output_of(archive: Path, *arguments: str) -> str:
    done = subprocess.run(
        command(archive, *arguments), capture_output=True, text=True, env=ENVIRONMENT, cwd=archive.parent, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.parametrize("names", part_or_whole(("az3",), ("adxl", "az3", "csd-mt")))
def test_the_catalogue_is_in_the_archive(archive: Path, names: tuple[str, ...]) -> None:
    assert [line.split()[0] for line in output_of(archive, "devices").splitlines()[1:]] == ["adxl", "az3", "csd-mt"]
    for name in names:
        assert barewire.load(name).parameters[-1].name in output_of(archive, "devices", name)


@pytest.mark.parametrize("endpoint", some_of(["rtu://pty", "tcp://127.0.0.1:0"], 1))  # the first needs pyserial, too
def test_simulate_and_read(archive: Path, endpoint: str) -> None:
    simulate = command(archive, "simulate", "adxl", endpoint)
    with subprocess.Popen(simulate, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT) as run:
        assert run.stdout is not None
        assert run.stderr is not None
        ready = run.stdout.readline()
        assert ready.startswith("ready "), run.stderr.read()
        url = f"{ready.split()[1]}?timeout=30"
        assert output_of(archive, "read", url, "adxl", "Status") == "Status = 2 (Starter ready)\n"
        run.send_signal(signal.SIGTERM)
        assert (run.wait(30), run.stderr.read()) == (0, "")
