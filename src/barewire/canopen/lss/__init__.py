"""LSS: give devices their node-ID and bit rate over the bus.   [CiA 305]

The files, in reading order:

        messages     the messages, the address of a device, the bit rate table
        slave        the LSS state of a device
        master       the services of the master, one conversation each; fastscan
"""
