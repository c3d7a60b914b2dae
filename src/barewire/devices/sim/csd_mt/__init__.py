"""The CSD MT stepper drive on Modbus TCP, as the models CSD MT 94 and CSD MT S4.

    environment    the surroundings of the drive: supply, mechanics, switches; the state that all parts share
    shaft          the motor's shaft and its encoder: lost steps, Auto Sync, following error
    inputs         the meanings of I0 to I4; switches that the shaft passes, the index pulse, the touch probe
    axis           delays, brake, limits, set-points and homing on top of the CiA 402 axis
    registers      saved parameters, alarm log, outputs, temperature, and the registers with rules of their own
    machine        the drive that joins them; its head lists what is simulated and what is only stored

Each file uses only those above it.
"""
