"""A local node: a whole CANopen device as one machine.   [CiA 301]

The files, in reading order:

        device           `LocalNode`: all services of one node, each in the NMT states that allow it
        node_group       `NodeGroup`: many nodes on one bus, each fed the identifiers that it receives
        error_control    heartbeat, guarding, consumers of TIME and EMCY, as the objects configure them
        sync             SYNC as the objects configure it
        sdo_channels     additional SDO servers, and the channels of SDO clients
        storage          store parameters 1010h, restore defaults 1011h
"""
