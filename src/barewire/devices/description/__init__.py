"""Descriptions of devices: from the TOML files of `catalog/` or of a user to a Device.

The files, in reading order:

    load            name or path -> Device
    build           the tables of the files -> Device, Parameter
    check           whether a description of a user follows the format; errors with file, line and key
"""
