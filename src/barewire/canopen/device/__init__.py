"""A local node: a whole CANopen device as one machine.   [CiA 301]

The files, in reading order:

        device           `LocalNode`: all services of one node, each in the NMT states that allow it
        node_group       `NodeGroup`: many nodes on one bus, each fed the identifiers that it receives
        services         SYNC, error control, TIME, EMCY and SDO channels, as the objects configure them
        storage          store parameters 1010h, restore defaults 1011h
"""
