"""The CSD MT stepper drive on Modbus TCP, as the models CSD MT 94 and CSD MT S4.

    environment    the surroundings of the drive: supply, mechanics, switches, temperature
    context        state that all parts share: clock, store, environment, alarm log; the fault codes
    shaft          the motor's shaft and its encoder: lost steps, Auto Sync, following error
    inputs         the meanings of I0 to I4
    homing         each homing method as a sequence of movements
    axis           delays, brake, limits, set-points and homing on top of the CiA 402 axis
    edges          switches that the shaft passes, the index pulse, the touch probe
    thermal        current and temperature
    registers      saved parameters, alarm log, outputs, and the registers with rules of their own
    machine        the drive that joins them; its head lists what is simulated and what is only stored

Each file uses only those above it.
"""
