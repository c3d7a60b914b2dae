"""What the tests of the shells share: certificates, made once."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.certificates import authority, leaf


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with a server, clients of several kinds, and strangers."""
    where = tmp_path_factory.mktemp("certificates")
    authority(where)
    authority(where, "other")
    leaf(where, "server", server=True)
    leaf(where, "operator", role="Operator")
    leaf(where, "viewer", role="Viewer")
    leaf(where, "norole")
    leaf(where, "expired", role="Operator", days=-1)
    leaf(where, "expired-server", server=True, days=-1)
    leaf(where, "stranger", role="Operator", ca="other")
    leaf(where, "stranger-server", server=True, ca="other")
    leaf(where, "odd", role="INTEGER:7")
    return where
