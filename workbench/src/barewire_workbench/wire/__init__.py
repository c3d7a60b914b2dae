"""Bits on a wire: the levels of characters and CAN frames, and what receivers make of them.

The files, in reading order:

    uart      characters with start, parity and stop bits; a receiver at another rate, or with exchanged wires
    can_bits  a CAN frame as bits: fields, CRC, stuff bits; arbitration between frames
"""
