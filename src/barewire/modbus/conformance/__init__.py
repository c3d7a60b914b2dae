"""Conformance of Modbus servers, as data.

    model    a case, and the comparison of answers with it
    cases    the cases, for TCP, RTU and ASCII servers

Depends on: modbus.adu. Used by: io.modbus.conformance, which runs the cases.
"""
