"""Fixtures of the interop tests: certificates, and the set of exchanged services that is compared with the marks.

tmodbus needs Python 3.12. Where it is not installed its tests are not collected; `.ci/run` runs them on the first
Python that is new enough. `tools/interop.py` names that file itself, so it reads its marks everywhere.
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
    """Return a directory with the certificates of an authority, a server and a client with the role Operator."""
    where = tmp_path_factory.mktemp("certificates")
    authority(where)
    leaf(where, "server", server=True)
    leaf(where, "operator", role="Operator")
    return where


@pytest.fixture
def exchanged() -> set[str]:
    """Return the services that were requested and answered; the test adds to it."""
    return set()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Assert that exactly the services in the marks of the test were exchanged."""
    yield
    if "exchanged" in getattr(item, "fixturenames", ()):
        seen: set[str] = item.funcargs["exchanged"]  # type: ignore[attr-defined]
        assert sorted(seen) == sorted({name for mark in item.iter_markers("evidence") for name in mark.args[3:]})
