"""The panel of a machine: a page for browsers, behind `barewire panel`.

line      the machine: one thread polls what is looked at, writes, and keeps the frames that pass
server    the page, its stream of events, and who may write
world     the environment and the faults of a simulated machine
page/     the files of the page
"""
