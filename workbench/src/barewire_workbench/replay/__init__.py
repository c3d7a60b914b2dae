"""A recording of a CAN bus, played: against a device, against a client, and what it reads from a device.

    played              what is sent and when, and how the answers are compared
    peer_replay         a recording of a master played against a device
    client_replay       a recording of a device played against our SDO client
    recorded_values     what a recording reads from a device

Time comes from the recording, so nothing here waits.
"""
