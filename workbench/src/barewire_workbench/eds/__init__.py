"""EDS files: checked against CiA 306, and written from the description of a device.

lint        what is wrong in an EDS or DCF, beyond what reading it finds
export      the EDS of a device
"""
