"""A recording, played: of a CAN bus against a device or a client, and of a Modbus line as its units.

    played              the outcome of a comparison; what a recording reads from a device
    peer_replay         a recording of a master played against a device
    client_replay       a recording of a device played against our SDO client
    recorded            what the units of a Modbus line answered, learned from a recording and kept as TOML
    unit_replay         units that repeat it: `recorded_units("pump.toml")`

Time comes from the recording, so nothing here waits.
"""
