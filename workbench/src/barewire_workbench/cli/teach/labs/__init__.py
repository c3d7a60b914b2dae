"""The labs of the course "from one byte to a moving motor".

    model         a lab, its exercises, the check of an answer
    reading       answers as people type them
    played        answers played against simulated machines, in virtual time
    faulty_line   the recordings and the line of lab 10

    bits          1   levels, start bit and stop bit         values      6   registers as numbers
    parity        2   the parity bit                         sdo         7   CAN, SDO
    register      3   a request by hand                      network     8   NMT, heartbeat, PDO
    crc_silence   4   CRC, t1.5 and t3.5                     drive       9   CiA 402 over both protocols
    envelopes     5   ASCII and TCP                          repair     10   a broken line

`LABS` has all of them, by number.
"""

from barewire_workbench.cli.teach.labs.bits import BITS_LAB
from barewire_workbench.cli.teach.labs.crc_silence import CRC_LAB
from barewire_workbench.cli.teach.labs.drive import DRIVE_LAB
from barewire_workbench.cli.teach.labs.envelopes import ENVELOPES_LAB
from barewire_workbench.cli.teach.labs.network import NMT_LAB
from barewire_workbench.cli.teach.labs.parity import PARITY_LAB
from barewire_workbench.cli.teach.labs.register import REGISTER_LAB
from barewire_workbench.cli.teach.labs.repair import REPAIR_LAB
from barewire_workbench.cli.teach.labs.sdo import SDO_LAB
from barewire_workbench.cli.teach.labs.values import VALUES_LAB

LABS = {
    lab.number: lab
    for lab in (
        BITS_LAB,
        PARITY_LAB,
        REGISTER_LAB,
        CRC_LAB,
        ENVELOPES_LAB,
        VALUES_LAB,
        SDO_LAB,
        NMT_LAB,
        DRIVE_LAB,
        REPAIR_LAB,
    )
}
"""The labs by number."""
