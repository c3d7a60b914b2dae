"""Drives of CiA 402: moves any of them, over Modbus and over CANopen.

The files, in reading order:

    cia402      states, status words, control words, transitions
    report      one reading of a drive, progress, and the error DriveStuck with the reasons
    access      how a drive is read and written by name: ModbusAccess, CanopenAccess
    drive       enable, disable, quick stop, reset, move, velocity, home
"""
