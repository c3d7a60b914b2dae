"""The bus as a client sees it.

The files, in reading order:

        scan             find the nodes on a bus
        channel_locks    which conversations may run at the same time
"""
