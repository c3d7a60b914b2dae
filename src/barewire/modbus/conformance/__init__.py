"""Conformance of Modbus servers, as data.

    model    what a case is, and whether the answers of a server fit it
    cases    the cases, for TCP, RTU and ASCII servers

Depends on: modbus.adu. Used by: io.modbus.conformance, which runs the cases.
"""
