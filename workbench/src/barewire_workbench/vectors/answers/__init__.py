"""The answers of barewire to the questions of the vectors: for each kind and operation one function.

The files, in reading order; each ends with its table, `ANSWERS`:

    values                how the vectors write values; numbers, bits, characters, parameters, the words of a drive
    modbus                messages, checksums, the three framings
    servers               servers and gateways of Modbus, asked step by step
    client                a Modbus client on a line, with its peer
    canopen               frames and messages of CANopen; logs and an EDS
    nodes                 SDO transfers, devices and masters over time
    device_conformance    our devices, tested by the cases of device-conformance
    table                 `own_answer`: question -> answer
"""
