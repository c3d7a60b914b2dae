"""Conformance of CANopen devices: cases as data, and a conversation that carries them out.   [CiA 301, CiA 305]

The files, in reading order:

    model           the device under test, a case, its steps, its outcome
    script          a case of the vectors, read; the cases themselves are in vectors/canopen/conform-*.json
    placeholders    values of the device in the texts of a case
    frames          frames as text; what a case needs
    transfers       whole SDO transfers as steps
    probe           which objects a device has
    lss_pause       a pause between two LSS requests
    random_order    the cases of random reads and writes
    eds_objects     the cases of the objects of an EDS
    application     the cases that write the application objects of an EDS
    restore         undoes what a case wrote, on a device that keeps values over a reset
    battery         all cases for one device, and how one is run
"""
