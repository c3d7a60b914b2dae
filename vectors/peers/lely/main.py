"""Lely CANopen (C) as an adapter: its devices and masters on a bus that only records, in virtual time.

barewire vectors check --adapter "python vectors/peers lely"

Its core libraries are built by peer.toml.
"""

from __future__ import annotations

import sys

import device
import eds
import masters
import tested
from adapter import serve

serve("Lely", sys.argv[2], {**device.ANSWERS, **masters.ANSWERS, **tested.ANSWERS, **eds.ANSWERS})
