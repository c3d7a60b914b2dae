"""Commands for recordings: what is wrong in them; what they show becomes a simulated device, or is
compared with one.

diagnose  `diagnose`: what is wrong in a recording, or on a line or bus
record    `record`: the traffic of a Modbus line -> a file that `simulate` serves
replay    `replay`: a recording of a CAN bus against a device, differences listed
recording_file    the file of `--write`
"""
