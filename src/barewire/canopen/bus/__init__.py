"""The bus as a client sees it.

        node_monitor     which nodes sent frames, and when: explains why a node did not answer
        scan             find the nodes on a bus
        channel_locks    which conversations may run at the same time

Depends on: frames, NMT, EMCY and SDO messages, conversations. Used by: SDO client, gateway, `io.canopen`.
"""
