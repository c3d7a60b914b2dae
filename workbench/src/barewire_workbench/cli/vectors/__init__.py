"""`barewire vectors`: list, show and check the reference vectors.

command   the commands
report    what a check prints and writes: lines, JSON, JUnit XML
show      one case, explained
picture   one case, drawn
frames    the frames of a case, byte by byte
"""
