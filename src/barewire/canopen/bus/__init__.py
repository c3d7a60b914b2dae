"""The bus as a client sees it.

        scan             find the nodes on a bus
        channel_locks    which conversations may run at the same time

Depends on: frames, NMT, EMCY and SDO messages, conversations. Used by: the device, the gateway, `io.canopen`.
"""
