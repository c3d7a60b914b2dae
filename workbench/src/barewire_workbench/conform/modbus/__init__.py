"""Conformance of Modbus servers, as data.

The files, in reading order:

    model    a case, and the comparison of answers with it
    cases    a case of the vectors, read; the cases themselves are in vectors/modbus/server-conformance.json
"""
