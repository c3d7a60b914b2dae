"""PDO: process data without protocol overhead.   [CiA 301, PDO]

The files, in reading order:

        mapping          which bits of a frame are which object
        multiplexed      MPDOs: one object in a frame, with its index and sub-index
        config           the communication and mapping records in the object dictionary
        engine           all PDOs of a device: sent and received by SYNC, change, time and request
        remote           the PDOs of other devices: their configuration, their values by name
"""
