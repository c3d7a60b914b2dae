"""The conformance battery: all cases for one CANopen device, in their order.   [CiA 301, CiA 305]

Depends on: the files with the cases of each service.  Used by: `io.canopen.conformance`, `tools/conform_can.py`.
"""

from __future__ import annotations

from barewire.canopen.conformance.emcy_sync_time import emcy_sync_time_cases
from barewire.canopen.conformance.lss import lss_cases
from barewire.canopen.conformance.model import NodeCase, Subject
from barewire.canopen.conformance.nmt import nmt_cases
from barewire.canopen.conformance.pdo import pdo_cases
from barewire.canopen.conformance.sdo_block import block_cases
from barewire.canopen.conformance.sdo_expedited import expedited_cases
from barewire.canopen.conformance.sdo_segmented import segmented_cases


def cases(subject: Subject) -> tuple[NodeCase, ...]:
    """Return the whole battery for one device. Where the device lacks what a case needs, `lacks` of the case names it."""
    services = (expedited_cases, segmented_cases, block_cases, nmt_cases, emcy_sync_time_cases, pdo_cases, lss_cases)
    return tuple(case for service in services for case in service(subject))
