"""What the interop tests share: certificates, the witness of what was really exchanged, and who can be collected.

tmodbus wants Python 3.12. Where it is not installed its tests are not collected; `.ci/run` runs them on the first
Python that can. `tools/interop.py` names the file itself, and reads its marks anywhere.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.certificates import authority, leaf

collect_ignore = [] if importlib.util.find_spec("tmodbus") else ["test_tmodbus.py"]


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with an authority, a server and a client whose role is Operator."""
    where = tmp_path_factory.mktemp("certificates")
    authority(where)
    leaf(where, "server", server=True)
    leaf(where, "operator", role="Operator")
    return where


@pytest.fixture
def witness() -> set[str]:
    """Every service that was asked and answered."""
    return set()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """What was exchanged must be what the test's marks say: no less, and no more."""
    yield
    if "witness" in getattr(item, "fixturenames", ()):
        seen: set[str] = item.funcargs["witness"]  # type: ignore[attr-defined]
        assert sorted(seen) == sorted({name for mark in item.iter_markers("evidence") for name in mark.args[3:]})
