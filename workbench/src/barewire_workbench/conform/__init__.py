"""What every server and every CANopen device must show, as data: the cases of `barewire conform`.

    modbus      a Modbus server: its cases, and the judgement of answers
    canopen/    a CANopen device

Nothing here has a clock or a port: `live` puts the cases to what runs.
"""
