"""Fault injection: answers of a server that are late, damaged, misdirected or missing, on request.

    faults    which faults there are, and what becomes of an answer
    ports     where that is done: around a port, or inside a server of connections

Depends on: `endpoint`, `ports`.  Used by: `server`, if faults are asked for; tests of clients.
"""
