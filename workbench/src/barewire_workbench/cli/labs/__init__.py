"""The labs of the course "from one byte to a moving motor".

    model      a lab, its exercises, the check of an answer; answers as people type them
    line       1   levels, start bit and stop bit       2   the parity bit           4   CRC, t1.5 and t3.5
    modbus     3   a request by hand                    5   ASCII and TCP            6   registers as numbers
    canopen    7   CAN, SDO                             8   NMT, heartbeat, PDO      9   CiA 402 over both protocols
    repair    10   a broken line: its recordings, and the line itself
    real_line 11   the log of a real line

`LABS` has all of them, by number.
"""

from barewire_workbench.cli.labs.canopen import DRIVE_LAB, NMT_LAB, SDO_LAB
from barewire_workbench.cli.labs.line import BITS_LAB, CRC_LAB, PARITY_LAB
from barewire_workbench.cli.labs.modbus import ENVELOPES_LAB, REGISTER_LAB, VALUES_LAB
from barewire_workbench.cli.labs.real_line import REAL_LINE_LAB
from barewire_workbench.cli.labs.repair import REPAIR_LAB

LABS = {
    lab.number: lab
    for lab in (
        *(BITS_LAB, PARITY_LAB, REGISTER_LAB, CRC_LAB, ENVELOPES_LAB),
        *(VALUES_LAB, SDO_LAB, NMT_LAB, DRIVE_LAB, REPAIR_LAB, REAL_LINE_LAB),
    )
}
"""The labs by number."""
