"""The settings of a device: which of its values they are, the file that keeps them, and what differs between two.

rules      a description -> its settings, in the order in which they are written; what stores them
saved      settings <-> the TOML file of `barewire save`
dcf        the same settings <-> a DCF
compare    two sets of settings -> their differences

On real devices: `live/save_settings.py`, `live/restore_settings.py`. An EDS is a device too: `eds/device.py`.
"""
