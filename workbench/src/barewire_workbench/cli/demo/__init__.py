"""`demo`: simulated machines read and written on every wire.

story     two screens: a value read and written on each wire, a movement, a late answer
frames    `--all` and `--json`: every frame of every wire, explained
"""
