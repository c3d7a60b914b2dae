"""Commands for recordings: what they show becomes a simulated device, or is compared with a device.

record    `record`: the traffic of a Modbus line -> a file that `simulate` serves
replay    `replay`: a recording of a CAN bus against a device, differences listed
recording_file    the file of `--write`
"""
