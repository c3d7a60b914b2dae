"""Fixtures of the tests of io: certificates, made once, the log, and a long default time-out."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

from barewire.io.canopen import client_base
from barewire.io.endpoint import Endpoint
from tests.certificates import authority, leaf


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with certificates of a server and of clients, good ones and wrong ones."""
    where = tmp_path_factory.mktemp("certificates")
    authority(where)
    authority(where, "other")
    leaf(where, "server", server=True)
    leaf(where, "operator", role="Operator")
    leaf(where, "viewer", role="Viewer")
    leaf(where, "norole")
    leaf(where, "expired", role="Operator", days=-1)
    leaf(where, "expired-server", server=True, days=-1)
    leaf(where, "other-ca", role="Operator", ca="other")
    leaf(where, "other-ca-server", server=True, ca="other")
    leaf(where, "odd", role="INTEGER:7")
    return where


@pytest.fixture
def log(caplog: pytest.LogCaptureFixture) -> Iterator[pytest.LogCaptureFixture]:
    """The log of barewire, from INFO on."""
    with caplog.at_level(logging.INFO, "barewire"):
        yield caplog


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The default time-out is half a minute, because a busy machine may stand still for more than a second. A test that
    waits for a time-out gives its own."""
    seconds = Endpoint.seconds

    def at_least(endpoint: Endpoint, name: str, default: float) -> float:
        return seconds(endpoint, name, 30.0 if name == "timeout" else default)

    monkeypatch.setattr(Endpoint, "seconds", at_least)
    monkeypatch.setattr(client_base, "DEFAULT_TIMEOUT", 30.0)  # of a bus that is given and not a URL
