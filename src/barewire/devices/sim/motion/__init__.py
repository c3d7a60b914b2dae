"""Motion that both simulated drives share, in closed form: nothing is computed step by step.

    trajectory     position and velocity as functions of time; when a position or a speed is reached
    cia402_axis    the CiA 402 states, and the motion that the modes of operation make of set-points

Depends on: the CiA 402 words and states of devices.drive.  Used by: az3, csd_mt.
"""
