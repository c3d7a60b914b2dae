"""Fault injection: answers of a server that are late, damaged, misdirected or missing, on request.

The files, in reading order:

    targets   one fault, and which answers it hits; the text of `simulate --fault`
    faults    the kinds of faults, and the changes of an answer
    ports     puts them into the answers: around a port, or inside a server of connections
"""
