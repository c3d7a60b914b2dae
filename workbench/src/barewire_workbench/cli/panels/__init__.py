"""The panel of a machine: a page for browsers, behind `barewire panel`; the folder terminal has it without a browser.

line          the machine: one thread polls what is looked at, writes, and keeps the frames that pass
diagnosis     the last frames of its line, as `barewire diagnose` judges them
description   what is shown before anything is read, and the frames of a write before they are sent
server        the page, its stream of events, and who may write
world         the environment and the faults of a simulated machine
page/         the files of the page
"""
