"""A recording of a CAN bus, played: against a device, against a client, and what it reads from a device.

    played              the outcome of a comparison; what a recording reads from a device
    peer_replay         a recording of a master played against a device
    client_replay       a recording of a device played against our SDO client

Time comes from the recording, so nothing here waits.
"""
