"""Machines that repeat what they said on a recorded line: values, exceptions, missing answers, and their times.

The files, in reading order:

    overheard line --> sniffer events --learn--> RecordedLine --to_toml--> a file to read, edit, keep beside a test
                                                                              |
    client <-- Server <-- ReplayedUnit <----------- recorded_units -----------'

    learn     sniffer events -> the model of a line: units, requests, the answers to each
    toml      model <-> text, with its checks
    replay    model -> a unit of a server
"""
