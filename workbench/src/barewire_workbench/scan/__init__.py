"""Finds what is on a line: the units that answer, the settings they have, the registers they hold, what they are.

Nothing here has a clock or a port: searches are conversations, and `live.scan_modbus` carries them out on real ports.
A search only reads.

    units             every sign of life of the units of a line
    serial_settings   the settings that an unknown line may have, the likely ones first
    addresses         the registers or bits of a unit that can be read
    identity          the device of the catalogue that gives these answers about itself
"""
