"""Conformance of Modbus servers, as data.

    model    a case, and the comparison of answers with it
    cases    a case of the vectors, read; the cases themselves are in vectors/modbus/server-conformance.json

Depends on: modbus.adu. Used by: io.modbus.conformance, which runs the cases.
"""
