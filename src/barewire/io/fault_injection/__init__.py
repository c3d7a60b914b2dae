"""Fault injection: answers of a server that are late, damaged, misdirected or missing, on request.

The files, in reading order:

    faults    the kinds of faults, which answers they hit, and the changes of an answer; the text of `simulate --fault`
    ports     puts them into the answers: around a port, or inside a server of connections
"""
