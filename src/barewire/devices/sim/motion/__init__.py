"""Motion that both simulated drives share, in closed form: nothing is computed step by step.

The files, in reading order:

    trajectory     position and velocity as functions of time; when a position or a speed is reached
    cia402_axis    the CiA 402 states, and the motion that the modes of operation make of set-points
"""
