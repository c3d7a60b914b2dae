"""Commands that teach the wire by hand.

    send        `send`: the bytes of a frame as they are; the answer, explained

Depends on: `explain`, ports, click.  Used by: `app`.
"""
