"""A program for the guest kernel: the SDO client of `barewire vendor`, alone, reads and writes a drive on vcan0.

BAREWIRE_ONE_FILE is the folder with the file, which was made outside the guest.
"""

from __future__ import annotations

import os
from pathlib import Path

from barewire import CanopenServer
from tests.workbench.vendor.made import run_alone

CODE = """
from sdo_client import *
with SdoClient("vcan0", 5, timeout=20) as client:
    client.write_number(0x60FF, "i32", -1500)
    print("value", client.read_number(0x60FF, "i32"))
    print("bytes", len(client.upload(0x1000)))
    try:
        client.upload(0x5FFF)
    except SdoAbort as abort:
        print("abort", hex(abort.code))
try:
    SdoClient("vcan7", 5)
except PortError as error:
    print(error)
"""


def main() -> None:
    with CanopenServer("can://socketcan/vcan0?node=5", device="az3"):
        done = run_alone(Path(os.environ["BAREWIRE_ONE_FILE"]), CODE)
    print(done.stdout + done.stderr, flush=True)
    assert done.returncode == 0


if __name__ == "__main__":
    main()
