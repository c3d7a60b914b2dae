"""Answers for the behaviour of Modbus servers.

The files, in reading order:

    servers        server: units with tables, asked step by step
    conformance    server-conformance: a server that runs, and what it may answer
    gateways       gateway: from TCP to an RTU line
"""
