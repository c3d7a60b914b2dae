"""Answers for the behaviour of Modbus servers.

    servers        server: units with tables, asked step by step
    conformance    server-conformance: a server that runs, and what it may answer
    gateways       gateway: from TCP to an RTU line

Depends on: modbus, the framings, conversation.  Used by: the table of answers.
"""
