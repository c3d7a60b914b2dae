"""The settings of a device: which of its values they are, the file that keeps them, and what differs between two.

rules      a description -> its settings, in the order in which they are written; what stores them
saved      settings <-> the TOML file of `barewire save`
objects    the same of an EDS or DCF: its storable objects, and settings <-> DCF
compare    two sets of settings -> their differences

On real devices: `live/save_settings.py`, `live/restore_settings.py`.
"""
