"""What every server and every CANopen device must show, as data: the cases of `barewire conform`.

    modbus/     a Modbus server          canopen/    a CANopen device

Nothing here has a clock or a port: `live` puts the cases to what runs.
"""
