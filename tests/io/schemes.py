"""The schemes that carry Modbus, from the table of carriers: a new one is tested as soon as it is there."""

from __future__ import annotations

import pytest

from barewire.io.endpoint import CARRIERS

SERIAL = [scheme for scheme, carrier in CARRIERS.items() if carrier.transport == "serial"]
TUNNELS = [scheme for scheme, carrier in CARRIERS.items() if carrier.framing != "tcp" and scheme not in SERIAL]
NUMBERED = [scheme for scheme, carrier in CARRIERS.items() if carrier.framing == "tcp"]
"""Schemes whose answers have transaction numbers."""
NETWORK = [*NUMBERED, *TUNNELS]

with_openssl = pytest.mark.needs("openssl")
EVERY_SCHEME = pytest.mark.parametrize(
    "scheme", [pytest.param(scheme, marks=[with_openssl] if scheme == "tls" else []) for scheme in CARRIERS]
)
EVERY_SCHEME_WITHOUT_TLS = pytest.mark.parametrize("scheme", [scheme for scheme in CARRIERS if scheme != "tls"])
