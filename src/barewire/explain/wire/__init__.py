"""Bits on a wire: the levels of characters, and what a receiver makes of them.

    uart    characters with start, parity and stop bits; a receiver with another baud rate or exchanged wires

Depends on: errors. Used by: diagnosis, and by what draws or explains the bits of a line.
"""
