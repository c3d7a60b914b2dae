"""EDS files: checked against CiA 306, written from the description of a device, and read as one.

lint        what is wrong in an EDS or DCF, beyond what reading it finds
export      the EDS of a device
device      the device of an EDS or DCF
storable    which of its objects are settings
"""
