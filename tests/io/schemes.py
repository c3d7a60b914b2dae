"""The schemes that carry Modbus, from the table of carriers: a new one is tested as soon as it is there."""

from __future__ import annotations

import pytest

from barewire.io.endpoint import CARRIERS

SERIAL = [scheme for scheme, carrier in CARRIERS.items() if carrier.transport == "serial"]
TUNNELS = [scheme for scheme, carrier in CARRIERS.items() if carrier.framing != "tcp" and scheme not in SERIAL]
NUMBERED = [scheme for scheme, carrier in CARRIERS.items() if carrier.framing == "tcp"]
"""Those whose answers bear transaction numbers."""
NETWORK = [*NUMBERED, *TUNNELS]

with_openssl = pytest.mark.needs("openssl")
EVERY_SCHEME = pytest.mark.parametrize(
    "scheme", [pytest.param(one, marks=[with_openssl] if one == "tls" else []) for one in CARRIERS]
)
EVERY_SCHEME_WITHOUT_TLS = pytest.mark.parametrize("scheme", [one for one in CARRIERS if one != "tls"])
