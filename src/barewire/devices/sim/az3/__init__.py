"""The AZ3 servo drive: one machine on Modbus RTU and on CANopen.

The files, in reading order:

    motion     units, limits and rates of the axis, which `sim.motion` moves along its ramps; brake; phasing
    memory     saved parameters, node-ID, bit rate and unit address; measured values
    machine    the drive that joins them; its head lists what is simulated and what is only stored
"""
