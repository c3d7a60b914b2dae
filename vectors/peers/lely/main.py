"""Lely CANopen (C) as an adapter: its devices and masters on a bus that only records, in virtual time.

Its core libraries are built by peer.toml.
"""

from __future__ import annotations

import device
import eds
import masters
import tested
from adapter import serve

serve("Lely", {**device.ANSWERS, **masters.ANSWERS, **tested.ANSWERS, **eds.ANSWERS})
