"""Lely CANopen (C) as an adapter: its devices and masters on a bus that only records, in virtual time.

barewire vectors check --adapter "python vectors/peers lely liblely.so 2.3.0"

The arguments are a shared library of Lely's core libraries, built by hand outside of this repository, and its version.
make scoreboard takes them from $LELY.
"""

from __future__ import annotations

import sys

if len(sys.argv) != 3:
    sys.exit("main.py: two arguments are needed, the library of Lely CANopen and its version")

import device
import eds
import masters
import tested
from adapter import serve

serve("Lely", sys.argv[2], {**device.ANSWERS, **masters.ANSWERS, **tested.ANSWERS, **eds.ANSWERS})
