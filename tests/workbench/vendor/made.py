"""The files of `barewire vendor`, each made once in a process of the tests."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from tests.workbench.cli.helpers import output_of


@cache
def made(name: str, *families: str) -> str:
    """Return the text of a file."""
    return output_of("vendor", name, *(word for family in families for word in ("--with", family)))


def written(folder: Path, name: str, *families: str) -> Path:
    """Return a file in a folder."""
    path = folder / f"{name.replace('-', '_')}.py"
    path.write_text(made(name, *families))
    return path


def imported(folder: Path, name: str, *families: str) -> Any:
    """Return a file as a module."""
    path = written(folder, name, *families)
    spec = spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


ALONE = "import sys; sys.path = [place for place in sys.path if 'site-packages' not in place] + [{!r}]; "
"""The start of code for a Python that knows only its standard library and one folder."""


def run_alone(folder: Path, code: str) -> subprocess.CompletedProcess[str]:
    """Run code in a folder, in a Python that knows nothing else but its standard library."""
    return subprocess.run(
        [sys.executable, "-I", "-S", "-W", "error", "-c", ALONE.format(str(folder)) + code],
        cwd=folder, capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
