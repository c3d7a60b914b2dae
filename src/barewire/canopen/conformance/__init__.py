"""Conformance of CANopen devices: cases as data, and a conversation that carries them out.   [CiA 301, CiA 305]

    model           the device under test, a case, its steps, its outcome
    frames          frames as text, of which the cases are made
    probe           which objects a device has
    sdo_expedited, sdo_segmented, sdo_block, nmt, emcy_sync_time, pdo, lss     the cases of each service
    configuration   the cases of restricted identifiers, SDO channels, 1020h, and of random reads and writes
    eds_objects     the cases of the objects of an EDS
    restore         undoes what a case wrote, on a device that keeps values over a reset
    battery         all cases for one device, and how one is run

Depends on: the messages of canopen, the objects of an EDS.  Used by: `io.canopen.conformance`, `tools/conform_can.py`.
"""
